"""One file from the web, fetched into a `.part` file that a later attempt or run goes on with.

No library does this part: pooch starts anew, pypdl appends what comes to a range without looking at
`Content-Range` or sending `If-Range`, so that a changed file is mixed with the old one.
"""

import os
import re
import shutil
import socket
import ssl
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from http.client import HTTPConnection, HTTPException, HTTPResponse, HTTPSConnection
from pathlib import Path
from typing import IO, Any, Literal, NamedTuple, Self
from urllib.parse import urlsplit

import numpy as np
from pydantic import Field

from gmrdata import __version__
from gmrdata.stage.progress import console, progress_bar
from gmrdata.values.errors import BadRecipe, BadRecord, FetchFailed, MissingInput
from gmrdata.values.files import sha256_of_file
from gmrdata.values.records import Config, Record


class FetchConfig(Config):
    """Where from, and how patiently."""

    base_url: str | None = None
    """A mirror's folder, http, https or of this machine; the files' own address when left out."""
    timeout_s: float = Field(default=30.0, gt=0)
    """Longest silence of the server [s]."""
    file_limit_s: float = Field(default=900.0, gt=0)
    """Longest time for one attempt at one file [s]."""
    total_limit_s: float = Field(default=3600.0, gt=0)
    """Longest time for all attempts at one file [s]."""
    attempts: int = Field(default=5, ge=1, le=1000)
    """At one file."""
    first_wait_s: float = Field(default=1.0, ge=0)
    """Mean wait before the second attempt; it doubles with each further one [s]."""
    longest_wait_s: float = Field(default=30.0, ge=0)
    largest_bytes: int = Field(default=1 << 28, gt=0)
    """A longer answer is none of the files that are fetched, and is refused [bytes]."""


DEFAULT_FETCH = FetchConfig()


BLOCK_BYTES = 1 << 16
_RANGE = re.compile(r"bytes ([0-9]+)-([0-9]+)/([0-9]+)")
_PASSING = frozenset({408, 425, 429, 500, 502, 503, 504})
_WEB = ("http", "https")


class PassingFailure(FetchFailed):
    """The same request may well work a little later."""


class NotOnServer(FetchFailed):
    """The server says that there is no such file."""


class PartNote(Record):
    """Which version of the file a `.part` belongs to."""

    format: Literal["gmrdata-part/1"] = "gmrdata-part/1"
    url: str
    validator: str
    """The server's ETag or date of change."""
    size: int | None
    """Length of the whole file, if the server said it [bytes]."""


def folder_address(base_url: str) -> str:
    """The address of a folder without the slash at its end; BadRecipe if it is none of the web, and
    none of this machine."""
    if "://" not in base_url and Path(base_url).is_dir():
        return str(Path(base_url).absolute())
    wrong = BadRecipe(
        f"--base-url {base_url!r}: must be an http:// or https:// folder in ASCII: a host of "
        "other letters as xn--..., a path's as %XX, an IPv6 address in brackets; or a folder that "
        "is there"
    )
    try:
        parts = urlsplit(base_url)
        plain = base_url.isascii() and base_url.isprintable() and " " not in base_url
        usable = bool(parts.hostname) and (parts.port is None or parts.port > 0)
    except ValueError:  # a port or an IPv6 address that is none
        raise wrong from None
    if parts.scheme not in _WEB or not (plain and usable) or parts.query or parts.fragment:
        raise wrong
    return base_url.rstrip("/")


def part_of(path: Path, suffix: str = "") -> Path:
    """Where an unfinished download of `path` lies, and with ".json" its `PartNote`."""
    return path.with_name(f"{path.name}.part{suffix}")


def drop_part(path: Path) -> None:
    """Forget an unfinished download."""
    part_of(path).unlink(missing_ok=True)
    part_of(path, ".json").unlink(missing_ok=True)


def download(
    url: str,
    path: Path,
    config: FetchConfig,
    rng: np.random.Generator,
    sleep: Callable[[float], None] = time.sleep,
) -> Path:
    """Fetch all bytes of a file, with further attempts where they may help.

    Gives the `.part` file beside the final `path`, as long as the server said; what is in it was
    not looked at.  `rng` spreads the waits, so that many clients don't come back at the same time.
    """
    if "://" not in url:
        return _copied(Path(url), part_of(path), config)
    wait_s, end_s = config.first_wait_s, time.monotonic() + config.total_limit_s
    for attempt in range(1, config.attempts + 1):
        try:
            _attempt(url, path, config)
            break
        except PassingFailure as error:
            if attempt == config.attempts or time.monotonic() > end_s:
                what = f"gave up after {attempt} attempts. The same command goes on"
                raise FetchFailed(f"{error}; {what}") from None
            pause_s = min(wait_s, config.longest_wait_s) * float(rng.uniform(0.5, 1.5))
            what = f"attempt {attempt + 1} of {config.attempts} in {pause_s:.1f} s"
            console.print(f"{error}; {what}", markup=False, soft_wrap=True)
            sleep(pause_s)
            wait_s *= 2
    return part_of(path)


class Wanted(NamedTuple):
    """A file to fetch."""

    title: str  # by which a problem is told
    path: Path
    url: str
    sha256: str | None  # None where it is not on record
    accept: Callable[[Path], None]
    """Looks at what came, a `.part`; FetchFailed where it is not the file."""
    needs: str = ""  # title of the file without which this one is of no use

    def state(self) -> str:
        """In words, for a plan."""
        if not self.path.is_file():
            return "unfinished" if part_of(self.path).is_file() else "to do"
        if self.sha256 is None:
            return "there, not recorded"
        same = sha256_of_file(self.path) == self.sha256
        return "done" if same else "there, with another hash"

    def fetch(self, get: Callable[[str, Path], Path], redo: bool) -> None:
        """Get it, unless it is there with its hash; other content stays without `redo`."""
        if (state := self.state()) == "done":
            return
        if self.path.exists() and not redo:
            remedy = "move it away, or pass --redo to fetch it again"
            raise FetchFailed(f"{self.path} is {state}: {remedy}")
        part = get(self.url, self.path)
        try:
            self.accept(part)
        except FetchFailed:
            drop_part(self.path)
            raise
        part.replace(self.path)
        drop_part(self.path)


def fetch_files(
    files: Sequence[Wanted],
    config: FetchConfig,
    rng: np.random.Generator,
    sleep: Callable[[float], None],
    redo: bool,
) -> dict[str, str]:
    """Fetch one file after the other; why some are missing, by title."""
    problems: dict[str, str] = {}
    get = partial(download, config=config, rng=rng, sleep=sleep)
    with progress_bar() as bar:
        task = bar.add_task("fetching", total=len(files))
        for file in files:
            bar.update(task, description=f"fetching {file.path.name}")
            try:
                if file.needs in problems:
                    raise FetchFailed(f"its {file.needs} is missing")
                file.fetch(get, redo)
            except FetchFailed as error:
                problems[file.title] = str(error)
                console.print(f"{file.title}: {error}", markup=False, soft_wrap=True)
            bar.advance(task)
    return problems


def fetch_plan(files: Sequence[Wanted]) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    """A table of what `fetch_files` would do, without doing or asking anything."""
    return ("file", "address", "state"), [(f.path.name, f.url, f.state()) for f in files]


def _copied(source: Path, part: Path, config: FetchConfig) -> Path:
    """A file of a folder of this machine, as a download of it would be."""
    if not source.is_file():
        raise FetchFailed(f"{source}: no such file")
    if (n_bytes := source.stat().st_size) > config.largest_bytes:
        raise FetchFailed(f"{source}: {n_bytes} bytes are more than {config.largest_bytes}")
    shutil.copyfile(source, part)
    return part


def _attempt(url: str, path: Path, config: FetchConfig) -> None:
    too_long = PassingFailure(f"{url}: not done after {config.file_limit_s:g} s")
    with _Watch(config.file_limit_s) as watch:
        try:
            _try(url, path, config, watch)
        except PassingFailure:
            if watch.ended:
                raise too_long from None
            raise
    if watch.ended:  # an answer without a length seems to be whole
        raise too_long


def _try(url: str, path: Path, config: FetchConfig, watch: "_Watch") -> None:
    part = part_of(path)
    note = _read_note(path, url)
    n_there = part.stat().st_size if part.is_file() and note else 0
    headers = {"Accept-Encoding": "identity"}
    if note and n_there:
        if n_there == note.size:
            return
        headers |= {"Range": f"bytes={n_there}-", "If-Range": note.validator}
    try:
        answer = _open_url(url, headers, config.timeout_s, watch)
    except FetchFailed as error:
        if n_there and "answers 416" in str(error):
            drop_part(path)
            raise PassingFailure(f"{url}: its length changed; from the start again") from None
        raise
    with answer:
        _refuse_page(answer, url)
        start, total = _place(answer, url, n_there, note, path)
        if total is not None and total > config.largest_bytes:
            raise FetchFailed(f"{url}: {total} bytes are more than {config.largest_bytes}")
        if start == 0:
            drop_part(path)
            validator = _validator(answer)
            if validator is not None:  # else the next attempt starts anew
                note = PartNote(url=url, validator=validator, size=total)
                note.write(part_of(path, ".json"))
        n_bytes = _append(answer, url, part, start, config)
    if total is not None and n_bytes != total:
        if n_bytes > total:
            drop_part(path)
        raise PassingFailure(f"{url}: {n_bytes} bytes came where the server promised {total}")


def _append(answer: HTTPResponse, url: str, part: Path, start: int, config: FetchConfig) -> int:
    """Write the body at the end of the `.part`; its length then."""
    n_bytes = start
    with part.open("ab") as stream:
        for block in _blocks(answer, url):
            n_bytes += len(block)
            if n_bytes > config.largest_bytes:
                raise FetchFailed(f"{url}: more than {config.largest_bytes} bytes came")
            stream.write(block)
        stream.flush()
        os.fsync(stream.fileno())
    return n_bytes


def _place(
    answer: HTTPResponse, url: str, n_there: int, note: PartNote | None, path: Path
) -> tuple[int, int | None]:
    """Where the body goes in the file, and the whole file's length if the server says it."""
    if answer.status != 206:
        length = answer.headers.get("Content-Length", "")
        return 0, int(length) if re.fullmatch(r"[0-9]{1,15}", length) else None
    match = _RANGE.fullmatch(answer.headers.get("Content-Range", ""))
    if match and note and _validator(answer) in (None, note.validator):
        start, total = int(match[1]), int(match[3])
        if start == n_there and note.size in (None, total):
            return n_there, total
    drop_part(path)
    raise PassingFailure(f"{url}: the file on the server changed; from the start again")


def _refuse_page(answer: HTTPResponse, url: str) -> None:
    kind = answer.headers.get_content_type()
    if kind in ("text/html", "application/xhtml+xml"):
        raise FetchFailed(f"{url}: the server sends a web page in place of the file")
    if answer.headers.get("Content-Encoding", "identity") != "identity":
        raise FetchFailed(f"{url}: the server sends it packed, which was not asked for")


def _validator(answer: HTTPResponse) -> str | None:
    """What tells this version from others: a strong ETag, else Last-Modified (RFC 9110, 13.1.5)."""
    tag = answer.headers.get("ETag")
    if tag is not None and not tag.startswith("W/"):
        return str(tag)
    return answer.headers.get("Last-Modified")


def _read_note(path: Path, url: str) -> PartNote | None:
    try:
        note = PartNote.read(part_of(path, ".json"))
    except (MissingInput, BadRecord):
        return None
    return note if note.url == url else None


class _WebOnly(urllib.request.HTTPRedirectHandler):
    """Follows redirects to http and https; urllib would follow ftp too."""

    def redirect_request(
        self, req: Any, fp: IO[bytes], code: int, msg: str, headers: Any, newurl: str
    ) -> urllib.request.Request | None:
        if urlsplit(newurl).scheme not in _WEB:
            raise FetchFailed(f"{req.full_url}: redirects to {newurl[:200]}, which is not followed")
        return super().redirect_request(req, fp, code, msg, headers, newurl)


class _Watch:
    """Ends an attempt's connections after a time: a byte now and then keeps a timeout waiting."""

    def __init__(self, limit_s: float) -> None:
        self._timer = threading.Timer(min(limit_s, threading.TIMEOUT_MAX), self._end)
        self._timer.daemon = True
        self._sockets: list[socket.socket] = []
        self.ended = False

    def __enter__(self) -> Self:
        self._timer.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._timer.cancel()

    def _end(self) -> None:
        self.ended = True
        for one in self._sockets:
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)

    def handlers(self) -> tuple[urllib.request.BaseHandler, urllib.request.BaseHandler]:
        """What opens connections that are watched."""
        watch = self

        class Http(HTTPConnection):
            def connect(self) -> None:
                super().connect()
                watch._sockets.append(self.sock)

        class Https(HTTPSConnection):
            def connect(self) -> None:
                super().connect()
                watch._sockets.append(self.sock)

        class Plain(urllib.request.HTTPHandler):
            def http_open(self, req: urllib.request.Request) -> Any:
                return self.do_open(Http, req)

        class Safe(urllib.request.HTTPSHandler):
            def https_open(self, req: urllib.request.Request) -> Any:
                return self.do_open(Https, req)

        return Plain(), Safe()


def _open_url(
    url: str, headers: Mapping[str, str], timeout_s: float, watch: _Watch
) -> HTTPResponse:
    """Ask for a file; errors are sorted into those worth another attempt and the others."""
    agent = {"User-Agent": f"gmrdata/{__version__}"}
    request = urllib.request.Request(url, headers={**agent, **headers})
    try:
        if request.type not in _WEB:
            raise urllib.error.URLError(f"unknown url type: {request.type}")
        return urllib.request.build_opener(_WebOnly, *watch.handlers()).open(
            request, timeout=timeout_s
        )
    except urllib.error.HTTPError as error:
        error.close()
        raise _of_status(url, error) from None
    except urllib.error.URLError as error:
        if isinstance(error.reason, ssl.SSLCertVerificationError):
            raise FetchFailed(f"{url}: the server's certificate is not good: {error}") from None
        raise PassingFailure(f"{url}: no connection ({error.reason})") from None
    except (OSError, HTTPException) as error:
        raise PassingFailure(f"{url}: no answer ({_say(error)})") from None
    except (ValueError, OverflowError) as error:  # of an address that it redirects to, too
        raise FetchFailed(f"{url}: leads to an address that can't be asked ({error})") from None


def _blocks(answer: HTTPResponse, url: str) -> Iterator[bytes]:
    try:
        while block := answer.read1(BLOCK_BYTES):
            yield block
    except (OSError, HTTPException) as error:
        raise PassingFailure(f"{url}: the connection broke ({_say(error)})") from None


def _of_status(url: str, error: urllib.error.HTTPError) -> FetchFailed:
    if error.code in (404, 410):
        return NotOnServer(f"{url}: the server has no such file ({error.code})")
    if 300 <= error.code < 400:
        place = error.headers.get("Location", "nowhere") if error.headers else "nowhere"
        return FetchFailed(f"{url}: redirects to {place[:200]}, which is not followed")
    kind = PassingFailure if error.code in _PASSING else FetchFailed
    return kind(f"{url}: the server answers {error.code} {error.reason}")


def _say(error: Exception) -> str:
    return str(error) or type(error).__name__
