"""Worker processes that read changed files, one after the other, within limits.

An input is told by its target and number, which are the seed of its changes.  A finding is what
ends in anything but a result that holds or a GmrdataError: another exception, a time of over 20 s,
memory of over 1 GiB and 1 GiB for each MiB of input, a process that dies, or a file that is opened,
a program that is started or an address that is asked outside of the input's folder.
"""

import json
import multiprocessing
import os
import resource
import shutil
import signal
import sys
import sysconfig
import time
import traceback
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from fuzz.mutations import Mutation, changed_bytes

import gmrdata
from gmrdata.stage.progress import console
from gmrdata.values.errors import GmrdataError

LONGEST_S = 20  # of the processor, which other work doesn't change
DEAD_S = 120  # after which a worker waits for something, or didn't hear its alarm
GIB = 1 << 30


@dataclass(frozen=True)
class Target:
    """One reader."""

    name: str
    files: Mapping[str, bytes]  # what it reads, by its path in the input's folder
    changed: Mapping[str, Sequence[Mutation]]  # which of them are changed, and how
    read: Callable[[Path], object]  # takes the folder; raises where a result does not hold


@dataclass(frozen=True)
class Finding:
    target: str
    number: int
    what: str
    where: str  # the last lines of a traceback


class Hang(BaseException):
    """The alarm; no reader catches it."""


def changed_files(target: Target, seed: int, number: int) -> dict[str, bytes]:
    """The files of an input: one of them is changed, mostly once."""
    rng = np.random.default_rng([seed, number])
    name = list(target.changed)[int(rng.integers(0, len(target.changed)))]
    ways, data = target.changed[name], target.files[name]
    data = _changed(data, ways, rng)
    while rng.random() < 0.25:
        data = _changed(data, ways, rng)
    return {**target.files, name: data}


def _changed(data: bytes, ways: Sequence[Mutation], rng: np.random.Generator) -> bytes:
    try:
        return ways[int(rng.integers(0, len(ways)))](data, rng)
    except Exception:  # what was changed before is no such file any more, or can't be written
        return changed_bytes(data, rng)


def run(
    targets: Sequence[Target], folder: Path, seed: int, seconds: float, n_workers: int
) -> tuple[dict[str, int], list[Finding]]:
    """Inputs by target, and what was found; the files of findings are kept in `folder/found`."""
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "found").mkdir(parents=True)
    end_s = time.monotonic() + seconds
    workers = [
        _Worker(number, n_workers, targets, folder, seed, end_s) for number in range(n_workers)
    ]
    while any(worker.goes_on() for worker in workers):
        time.sleep(0.2)
    rows = [row for worker in workers for row in worker.rows()]
    counts = dict.fromkeys((target.name for target in targets), 0)
    for worker in workers:
        for place, number in enumerate(worker.counts):
            counts[targets[place].name] += number
    return counts, [Finding(**row) for row in rows]


class _Worker:
    """A process that is started again where it dies."""

    def __init__(
        self, number: int, of: int, targets: Sequence[Target], folder: Path, seed: int, end_s: float
    ) -> None:
        context = multiprocessing.get_context("fork")
        self.number, self.of, self.targets = number, of, targets
        self.folder, self.seed, self.end_s = folder, seed, end_s
        self.now = context.Array("d", [-1.0, 0.0, 0.0], lock=False)  # target, number, since when
        self.counts = context.Array("q", len(targets), lock=False)
        self._start(number)

    def _start(self, first: int) -> None:
        context = multiprocessing.get_context("fork")
        self.process = context.Process(target=_work, args=(self, first), daemon=True)
        self.process.start()

    def goes_on(self) -> bool:
        if self.process.is_alive():
            if time.monotonic() - self.now[2] < DEAD_S or self.now[2] == 0:
                return True
            self.process.kill()
            self.process.join()
            self._note("no end, and no answer to the alarm")
        elif self.process.exitcode == 0:
            return False
        else:
            self._note(f"the process died with {self.process.exitcode}")
        self._start(int(self.now[1]) + self.of)
        return True

    def _note(self, what: str) -> None:
        target = self.targets[int(self.now[0])]
        note(self.folder, self.number, target, self.seed, int(self.now[1]), what, "")

    def rows(self) -> list[dict[str, Any]]:
        path = self.folder / f"found_{self.number}.jsonl"
        return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def note(
    folder: Path, worker: int, target: Target, seed: int, number: int, what: str, where: str
) -> None:
    """Keep a finding and its files."""
    finding = Finding(target.name, number, what, where)
    with (folder / f"found_{worker}.jsonl").open("a") as stream:
        stream.write(json.dumps(vars(finding)) + "\n")
    _put(folder / "found" / f"{target.name}_{number}", changed_files(target, seed, number))


def _put(folder: Path, files: Mapping[str, bytes]) -> None:
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)


def _work(worker: _Worker, first: int) -> None:
    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    console.quiet = True
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGPROF, _alarm)
    home = worker.folder / f"input_{worker.number}"
    seen = _Seen(home)
    sys.addaudithook(seen.hook)
    number = first
    while time.monotonic() < worker.end_s:
        place = number // worker.of % len(worker.targets)
        target = worker.targets[place]
        worker.now[0], worker.now[1], worker.now[2] = place, number, time.monotonic()
        said = read_one(target, home, seen, worker.seed, number)
        if said is not None:
            note(worker.folder, worker.number, target, worker.seed, number, *said)
        worker.counts[place] += 1
        number += worker.of
    shutil.rmtree(home, ignore_errors=True)
    os._exit(0)


def read_one(
    target: Target, home: Path, seen: "_Seen", seed: int, number: int
) -> tuple[str, str] | None:
    """What is wrong with how an input is read, and where; None where all is well."""
    files = changed_files(target, seed, number)
    shutil.rmtree(home, ignore_errors=True)
    _put(home, files)
    n_mib = sum(map(len, files.values())) / (1 << 20)
    before = resource.getrlimit(resource.RLIMIT_AS)
    most = _address_space() + int(GIB * (1 + n_mib))
    resource.setrlimit(resource.RLIMIT_AS, (most, before[1]))
    seen.found, seen.looks = None, True
    signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
    try:
        target.read(home)
    except GmrdataError as error:
        # What can't be printed would be a traceback after all.
        if not str(error).isprintable() and any(0xD800 <= ord(c) < 0xE000 for c in str(error)):
            return "an error that can't be printed", repr(str(error))[:300]
    except Hang:
        return f"over {LONGEST_S} s", traceback.format_exc(limit=-4)
    except Exception as error:
        return f"{type(error).__name__}: {str(error)[:200]}", traceback.format_exc(limit=-4)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        seen.looks = False
        resource.setrlimit(resource.RLIMIT_AS, before)
    return None if seen.found is None else (seen.found, "")


def _alarm(*_: object) -> None:
    raise Hang


def _address_space() -> int:
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


class _Seen:
    """An audit hook that tells of what is done outside of the input's folder."""

    def __init__(self, home: Path) -> None:
        own = (sys.prefix, sys.base_prefix, *sysconfig.get_paths().values(), *sys.path[1:])
        package = Path(gmrdata.__file__).resolve().parents[1]
        self.inside = tuple({str(home.resolve()), str(package), "/proc", *own})
        self.found: str | None = None
        self.looks = False

    def hook(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self.looks:
            return
        if event == "open" and isinstance(arguments[0], str | bytes | os.PathLike):
            path = str(Path(os.fsdecode(arguments[0])).absolute())
            if not path.startswith(self.inside):
                self.found = f"opens {path[:200]}"
        elif event in ("subprocess.Popen", "os.system", "os.exec", "os.fork", "socket.connect"):
            self.found = f"{event} {str(arguments)[:200]}"


def without_changes(target: Target, folder: Path) -> None:
    """Read the target's own files, which must work."""
    _put(folder, target.files)
    target.read(folder)


def families(findings: Sequence[Finding]) -> list[Finding]:
    """One finding of each kind: of the same target and the same last lines."""
    found = {(one.target, one.what.split(":")[0], one.where[-200:]): one for one in findings}
    return [replace(one, where=one.where[-600:]) for one in found.values()]
