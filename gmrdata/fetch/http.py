"""One HTTP request, with the errors sorted into those worth another attempt and the others."""

import http.client
import ssl
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Mapping
from typing import IO, Any
from urllib.parse import urlsplit

from gmrdata import __version__
from gmrdata.errors import FetchFailed

BLOCK_BYTES = 1 << 16
_PASSING = frozenset({408, 425, 429, 500, 502, 503, 504})


class PassingFailure(FetchFailed):
    """The same request may well work a little later."""


class NotOnServer(FetchFailed):
    """The server says that there is no such file."""


class _WebOnly(urllib.request.HTTPRedirectHandler):
    """Follows redirects to http and https; urllib would follow ftp too."""

    def redirect_request(
        self, req: Any, fp: IO[bytes], code: int, msg: str, headers: Any, newurl: str
    ) -> urllib.request.Request | None:
        if urlsplit(newurl).scheme not in ("http", "https"):
            raise FetchFailed(f"{req.full_url}: redirects to {newurl[:200]}, which is not followed")
        return super().redirect_request(req, fp, code, msg, headers, newurl)


def open_url(url: str, headers: Mapping[str, str], timeout_s: float) -> http.client.HTTPResponse:
    """Ask for a file; the answer is 200, 206 or 416.

    Raises:
        NotOnServer: 404 or 410.
        PassingFailure: the network or the server failed in a way that may pass.
        FetchFailed: anything else.
    """
    request = urllib.request.Request(
        url, headers={"User-Agent": f"gmrdata/{__version__}", **headers}
    )
    try:
        return _opener().open(request, timeout=timeout_s)
    except urllib.error.HTTPError as error:
        error.close()
        raise _of_status(url, error) from None
    except urllib.error.URLError as error:
        if isinstance(error.reason, ssl.SSLCertVerificationError):
            raise FetchFailed(f"{url}: the server's certificate is not good: {error}") from None
        raise PassingFailure(f"{url}: no connection ({error.reason})") from None
    except (OSError, http.client.HTTPException) as error:
        raise PassingFailure(f"{url}: no answer ({_say(error)})") from None


def blocks(answer: http.client.HTTPResponse, url: str, limit_s: float) -> Iterator[bytes]:
    """The body, block by block, as it comes.

    Raises:
        PassingFailure: the connection broke, or the time ran out.
    """
    start_s = time.monotonic()
    while True:
        try:
            block = answer.read1(BLOCK_BYTES)
        except (OSError, http.client.HTTPException) as error:
            raise PassingFailure(f"{url}: the connection broke ({_say(error)})") from None
        if not block:
            return
        if time.monotonic() - start_s > limit_s:
            raise PassingFailure(f"{url}: not done after {limit_s:g} s")
        yield block


def _opener() -> urllib.request.OpenerDirector:
    """An opener without handlers for file, ftp and data addresses."""
    opener = urllib.request.OpenerDirector()
    for handler in (
        urllib.request.ProxyHandler(),
        urllib.request.HTTPHandler(),
        urllib.request.HTTPSHandler(),
        urllib.request.UnknownHandler(),
        _WebOnly(),
        urllib.request.HTTPErrorProcessor(),
        urllib.request.HTTPDefaultErrorHandler(),
    ):
        opener.add_handler(handler)
    return opener


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
