"""Claims: who works on a folder of a shared disk now, and who takes over when he dies.

Locks of the kernel are not kept to by every network file system, and lock files stay behind.  A
claim is a file that appears by one `link`, which only one process wins, also over NFS.  It names
its owner and is written again every few seconds, with a count that goes up.  An owner on the same
machine is looked up by its process.  Any other is dead when the count stands still for a while by
the clock of who watches: clocks of machines may differ by minutes.
"""

import errno
import os
import socket
import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Literal

from gmrdata.stage.progress import console
from gmrdata.values.errors import BadRecord, ClaimLost, MissingInput
from gmrdata.values.files import host_word, json_text, temporary_name, write_text
from gmrdata.values.records import Record

BEAT_S = 5.0
"""How often an owner shows that it lives [s]."""
SILENT_S = 90.0
"""An owner on another machine that was silent for so long is dead [s]."""
NO_LINKS = (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK, errno.EXDEV)
FIRST_LOOK_S, LONGEST_LOOK_S = 0.01, 1.0  # waits between two looks at a claim grow to this [s]


class ClaimRecord(Record):
    """`.<folder>.claim`: who works on the folder."""

    format: Literal["gmrdata-claim/1"] = "gmrdata-claim/1"
    token: str
    """Unlike that of any other claim."""
    host: str
    """One word for a machine, its boot and the namespace of its process numbers."""
    machine: str
    """The machine's name, for messages."""
    pid: int
    started: str
    """When the process began, as its kernel counts: numbers of processes are used again."""
    beats: int
    """Goes up as long as the owner lives."""
    deaths: int
    """How many owners died on this work before."""


class Claim:
    """A claim that this process holds."""

    def __init__(self, path: Path, record: ClaimRecord) -> None:
        self.path, self.record = path, record
        self._written = threading.Lock()

    @property
    def taken_over(self) -> bool:
        """Whether a dead owner may have left something, or may yet wake up and write it."""
        return self.record.deaths > 0

    def beat(self) -> None:
        """Show that the owner lives; nothing where the claim is another's by now."""
        later = self.record.model_copy(update={"beats": self.record.beats + 1})
        # In the file that was opened: if another claim takes its place now, that one stays whole.
        with self._written, suppress(FileNotFoundError), self.path.open("r+") as stream:
            if f'"token": "{self.record.token}"' in stream.read():
                stream.seek(0)
                stream.write(_text(later))
                stream.truncate()
                self.record = later

    def require(self) -> None:
        """ClaimLost where somebody took over."""
        with self._written:
            found = _read(self.path, self.record.token)
        if found is None:
            raise ClaimLost(
                f"{self.path}: another process took over, since this one was silent for longer "
                f"than {SILENT_S:g} s. What it makes counts; run again to go on"
            )

    def release(self) -> None:
        with self._written:
            if _read(self.path, self.record.token):
                self.path.unlink(missing_ok=True)


@contextmanager
def claimed(path: Path) -> Iterator[Claim]:
    """Hold a claim; waits while another living process has it, and takes over from a dead one."""
    claim, wait_s, said = try_claim(path), FIRST_LOOK_S, False
    while claim is None:
        time.sleep(wait_s)
        wait_s = min(2.0 * wait_s, LONGEST_LOOK_S)
        if wait_s == LONGEST_LOOK_S and not said:
            console.print(f"waiting for {owner_in_words(path)}", markup=False, soft_wrap=True)
            said = True
        claim = try_claim(path)
    with held(claim):
        yield claim


@contextmanager
def held(claim: Claim) -> Iterator[Claim]:
    """Show in the block that the owner lives; the claim is given back after it."""
    _HEART.add(claim)
    try:
        yield claim
    finally:
        _HEART.remove(claim)
        claim.release()


def try_claim(path: Path) -> Claim | None:
    """A claim if nobody holds it or its owner is dead; None else.  It does not beat by itself."""
    own = _own_record()
    if _link(path, own):
        return Claim(path, own)
    found = _read(path)
    if found is None or not is_dead(path, found):
        return None
    # One of several that see the death wins; the token of the dead makes its prize unique.
    with suppress(FileExistsError):
        prize = try_claim(path.with_name(f"{path.name}.{found.token}"))
        if prize is not None:
            try:
                if _read(path, found.token):
                    own = own.model_copy(update={"deaths": found.deaths + 1})
                    write_text(path, _text(own))
                    return Claim(path, own)
            finally:
                prize.release()
    return None


def is_dead(path: Path, record: ClaimRecord) -> bool:
    """Whether a claim's owner is known to be dead by now."""
    if record.host == host_word() and not _is_hidden(record.pid):
        return _started(record.pid) != record.started
    with _WATCH:
        seen = _SEEN.get(path)
        if seen is None or seen[:2] != (record.token, record.beats):
            _SEEN[path] = (record.token, record.beats, time.monotonic())
            return False
        return time.monotonic() - seen[2] > SILENT_S


def owner(path: Path) -> ClaimRecord | None:
    """Who holds a claim, dead or alive; None for nobody."""
    return _read(path)


def owner_in_words(path: Path) -> str:
    """Who holds a claim, for messages."""
    found = _read(path)
    who = "another process" if found is None else f"process {found.pid} on {found.machine}"
    return f"{who}, which works on {path.name.removeprefix('.').removesuffix('.claim')}"


_SEEN: dict[Path, tuple[str, int, float]] = {}
"""Token and count of others' claims, and when this process saw that count first."""
_WATCH = threading.Lock()


class _Heart:
    """One thread that shows for all claims of this process that it lives."""

    def __init__(self) -> None:
        self._claims: set[Claim] = set()
        self._lock, self._pid = threading.Lock(), 0

    def add(self, claim: Claim) -> None:
        with self._lock:
            self._claims.add(claim)
            if self._pid != os.getpid():  # not begun, or in the parent before a fork
                self._pid, self._claims = os.getpid(), {claim}
                threading.Thread(target=self._run, daemon=True, name="claims").start()

    def remove(self, claim: Claim) -> None:
        with self._lock:
            self._claims.discard(claim)

    def _run(self) -> None:
        while True:
            time.sleep(BEAT_S)
            with self._lock:
                claims = list(self._claims)
            for claim in claims:
                # A disk that is full or away for a moment, or rubbish in a claim, kills nobody.
                with suppress(OSError, ValueError):
                    claim.beat()


_HEART = _Heart()


def _own_record() -> ClaimRecord:
    pid = os.getpid()
    return ClaimRecord(
        token=uuid.uuid4().hex,
        host=host_word(),
        machine=socket.gethostname(),
        pid=pid,
        started=_started(pid),
        beats=0,
        deaths=0,
    )


UNREADABLE = ClaimRecord(
    token="unreadable", host="", machine="?", pid=0, started="", beats=0, deaths=0
)
"""Stands for a claim that another version wrote, or that was cut off: no sign of life comes."""


def _read(path: Path, token: str | None = None) -> ClaimRecord | None:
    """A claim; None where there is none, or another than that of the token."""
    try:
        found = ClaimRecord.read(path)
    except MissingInput:
        return None
    except BadRecord:
        found = UNREADABLE
    except OSError as error:  # it may go while it is read
        if error.errno not in (errno.ENOENT, errno.ESTALE):
            raise
        return None
    return found if token in (None, found.token) else None


def _text(record: ClaimRecord) -> str:
    return json_text(record.model_dump(mode="json"))


def _link(path: Path, record: ClaimRecord) -> bool:
    """Write a claim unless there is one."""
    if path.exists():
        return False
    try:
        # Without a name until it is linked, so that a process that is killed leaves nothing.
        nameless = os.open(path.parent, os.O_TMPFILE | os.O_WRONLY, 0o666)
    except OSError:  # a file system, like NFS, that has no such files
        return _link_named(path, record)
    with os.fdopen(nameless, "w") as stream, _root() as root:
        stream.write(_text(record))
        stream.flush()
        try:
            return _linked(f"/proc/self/fd/{nameless}", path, record, root)
        except FileNotFoundError:  # who ended a batch took the folder away in this moment
            return _link_named(path, record)


@contextmanager
def _root() -> Iterator[int]:
    """With a folder given `os.link` follows links in its first path, and not else."""
    folder = os.open("/", os.O_RDONLY)
    try:
        yield folder
    finally:
        os.close(folder)


def _link_named(path: Path, record: ClaimRecord) -> bool:
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(temporary_name(path))
    try:
        temporary.write_text(_text(record))
        return _linked(str(temporary), path, record)
    finally:
        temporary.unlink(missing_ok=True)


def _linked(file: str, path: Path, record: ClaimRecord, root: int | None = None) -> bool:
    try:
        os.link(file, path, src_dir_fd=root)
    except FileExistsError:
        # NFS asks again where an answer was lost, and then finds the link that it made itself.
        return _read(path, record.token) is not None
    except OSError as error:
        if error.errno not in NO_LINKS:
            raise
        return _create(path, record)
    return True


def _create(path: Path, record: ClaimRecord) -> bool:
    try:
        with path.open("x") as stream:
            stream.write(_text(record))
    except FileExistsError:
        return False
    return True


def _started(pid: int) -> str:
    """When a process of this machine began; empty where there is none, or it is only not buried."""
    try:
        # The name may hold spaces and brackets; what follows its last bracket does not.
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ""
    return "" if fields[0] in "ZX" else fields[19]


def _is_hidden(pid: int) -> bool:
    """Whether it is a process of somebody else, on a machine whose `/proc` shows only one's own."""
    try:
        os.kill(pid, 0)
    except PermissionError:
        return not Path(f"/proc/{pid}").exists()
    except OSError:
        return False
    return False
