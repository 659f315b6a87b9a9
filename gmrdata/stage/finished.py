"""What a finished run of shards leaves, so that the same command again need not look at each clip.

As make and rsync do it, a file whose size and times are as they were is taken for unchanged; so
must be its inode here, and the time of its last change of any kind, which nobody can set.
"""

import hashlib
import os
import platform
import stat
import time
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Literal

from gmrdata import __version__
from gmrdata.stage.progress import answers, remarks
from gmrdata.stage.store import FRESH_NS, INPUTS_READ, git_commit, package_versions
from gmrdata.values.errors import BadRecord, MissingInput
from gmrdata.values.files import is_beside_a_stage, sha256_of_file
from gmrdata.values.records import Config, Record

FINISHED_FILE = ".run.inputs"
DECIDES = ("HOME", "XDG_CACHE_HOME")  # of the environment: where models and bodies lie


class Asked(Config):
    """What was asked for, and what decides the answer beside files."""

    command: tuple[str, ...]
    """What was typed, without the shard: the result is the same for each."""
    folder: str
    """The working folder, in which relative paths hold."""
    environment: dict[str, str]
    versions: dict[str, str]


class FinishedRecord(Record):
    """`.run.inputs` in an output folder: a run that ended well, and all that it read and wrote."""

    format: Literal["gmrdata-finished/1"] = "gmrdata-finished/1"
    asked: Asked
    inputs: tuple[str, ...]
    """Files and folders that were read, besides those that the command names."""
    looked_ns: int
    """When the files were looked at, by the clock of the output's disk [ns]."""
    files_sha256: str
    """Of the paths, sizes, inodes and times of all that was read and written."""
    remarks: tuple[str, ...]
    answers: str


@dataclass(frozen=True)
class Batch:
    """A command that shards share, and its output folder."""

    command: tuple[str, ...]
    out_dir: Path

    def finished(self) -> FinishedRecord | None:
        """What the same command left, if since then no file changed that it read or wrote."""
        try:
            found = FinishedRecord.read(self.out_dir / FINISHED_FILE)
            roots = [*self._named(), *found.inputs]
            if (
                found.asked == self._asked()
                and found.files_sha256 == self._look(roots, found.looked_ns).sha256
            ):
                return found
        except (MissingInput, BadRecord, OSError):
            pass
        return None

    def remember(self, began_ns: int) -> None:
        """Leave the record of a run that ended well, and began by this machine's clock at a time.

        None is left where an input changed since then: what was made may be of what it was before.
        It only saves time, so it may fail.
        """
        with suppress(OSError, MissingInput):
            looked_ns = _disk_now_ns(self.out_dir)
            began_ns += looked_ns - time.time_ns()
            inputs = self._others(INPUTS_READ)
            seen = self._look([*self._named(), *inputs], looked_ns)
            if seen.newest_input_ns < began_ns - FRESH_NS:
                FinishedRecord(
                    asked=self._asked(),
                    inputs=inputs,
                    looked_ns=looked_ns,
                    files_sha256=seen.sha256,
                    remarks=tuple(remarks),
                    answers=answers.export_text(clear=False),
                ).write(self.out_dir / FINISHED_FILE)

    def _asked(self) -> Asked:
        kept = {key for key in os.environ if key.startswith("GMRDATA_") or key in DECIDES}
        versions = {"gmrdata": __version__, "python": platform.python_version()}
        return Asked(
            command=self.command,
            folder=str(Path.cwd()),
            environment={key: os.environ[key] for key in sorted(kept)},
            versions=package_versions() | versions | {"commit": git_commit() or ""},
        )

    def _named(self) -> list[str]:
        """What the command names that is there: files, and folders with all in them."""
        there = (Path(part) for part in self.command[1:] if os.path.lexists(part))
        return sorted({str(path.absolute()) for path in there})

    def _others(self, paths: Iterable[Path]) -> tuple[str, ...]:
        """Of files and folders those that lie in none that the command names."""
        holders = [Path(one).resolve() for one in self._named()] + [self.out_dir.resolve()]
        absolute = sorted({path.absolute() for path in paths})
        real = ((path, path.resolve()) for path in absolute)
        return tuple(str(path) for path, at in real if not any(map(at.is_relative_to, holders)))

    def _look(self, inputs: Sequence[str], looked_ns: int) -> "_Seen":
        """Look at all that was read and written.

        Of what was written right before the first look the content counts too: it may have changed
        within one tick of the disk's clock.
        """
        digest, newest_ns = hashlib.sha256(), 0
        out_dir = str(self.out_dir.absolute())
        for is_input, root in [*((True, one) for one in inputs), (False, out_dir)]:
            for path, found in _walk(Path(root), leave_out={out_dir} if is_input else ()):
                changed_ns = max(found.st_mtime_ns, found.st_ctime_ns)
                newest_ns = max(newest_ns, changed_ns) if is_input else newest_ns
                is_fresh = changed_ns > looked_ns - FRESH_NS
                digest.update(f"{path}\0{_state(path, found, is_fresh)}\n".encode())
        return _Seen(digest.hexdigest(), newest_ns)


def forget() -> None:
    """Begin a run: what this process read and said before is no part of it."""
    INPUTS_READ.clear()
    remarks.clear()
    answers.export_text()


@dataclass(frozen=True)
class _Seen:
    sha256: str
    newest_input_ns: int


def _state(path: Path, found: os.stat_result, is_fresh: bool) -> str:
    if stat.S_ISDIR(found.st_mode):  # what is in it counts, and not the marks that come and go
        return "folder"
    state = (found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns)
    return f"{state} {sha256_of_file(path) if is_fresh else ''}"


def _walk(root: Path, leave_out: Collection[str]) -> Iterator[tuple[Path, os.stat_result]]:
    """A file; or a folder with all that is in it but for what stages keep beside their results."""
    if str(root) in leave_out:
        return
    found = root.stat()
    yield root, found
    if stat.S_ISDIR(found.st_mode):
        for path in sorted(root.iterdir(), key=str):
            if path.is_symlink() and not path.is_file():  # a folder that nobody enters, or nothing
                yield path, path.lstat()
            elif not is_beside_a_stage(path.name):
                yield from _walk(path, leave_out)


def _disk_now_ns(folder: Path) -> int:
    """The time by the clock of a folder's disk, which may be another machine's [ns]."""
    with NamedTemporaryFile(dir=folder, prefix=".", suffix=".inputs") as written:
        return Path(written.name).stat().st_mtime_ns
