"""Faults that meet a running command at a random moment."""

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil
from scale import hosts
from soak.works import Work

LONGEST_S = 600.0
MOST_FAULTS = 6  # that meet one run, one after the other
LONGEST_CUT_S = 10.0
FOR_GOOD_SHARE = 0.3  # of the cut cables, that are not plugged in again


class Hit(NamedTuple):
    """A fault that met a running command."""

    work: str
    fault: str
    after_s: float


Fault = Callable[[Work, float, np.random.Generator], list[Hit]]


def end_well(processes: Sequence[subprocess.Popen[bytes]]) -> int:
    """0 where all end with 0; a process that hangs is killed, and counts as 99."""
    codes = []
    for process in processes:
        try:
            codes.append(process.wait(LONGEST_S))
        except subprocess.TimeoutExpired:
            _kill_group(process)
            codes.append(99)
    return max(map(abs, codes))


def kill_command(work: Work, whole_s: float, rng: np.random.Generator) -> list[Hit]:
    """-9 for one of the command's processes, and for its children by its death."""
    processes = work.start()
    after_s = _wait(processes, whole_s, rng)
    victim = processes[int(rng.integers(len(processes)))]
    alive = victim.poll() is None
    victim.kill()
    end_well(processes)
    _wait_for_orphans(victim)
    return [Hit(work.name, "command killed", after_s)] if alive else []


def kill_child(work: Work, whole_s: float, rng: np.random.Generator) -> list[Hit]:
    """-9 for a worker, a Blender, whatever the command started."""
    processes = work.start()
    after_s = _wait(processes, whole_s, rng)
    children: list[psutil.Process] = []
    for process in processes:
        with suppress(psutil.NoSuchProcess):
            children += psutil.Process(process.pid).children(recursive=True)
    hits = []
    if children:
        with suppress(psutil.NoSuchProcess):
            children[int(rng.integers(len(children)))].kill()
            hits.append(Hit(work.name, "child killed", after_s))
    end_well(processes)
    return hits


def kill_all(work: Work, whole_s: float, rng: np.random.Generator) -> list[Hit]:
    """As a power cut: -9 for all at once."""
    processes = work.start()
    after_s = _wait(processes, whole_s, rng)
    alive = any(process.poll() is None for process in processes)
    for process in processes:
        _kill_group(process)
    end_well(processes)
    return [Hit(work.name, "all killed", after_s)] if alive else []


def fill_disk(work: Work, whole_s: float, rng: np.random.Generator) -> list[Hit]:
    """The output's disk, a small one, fills up in the middle, and is freed after the command ended.

    Needs root; without, files can't grow beyond a limit instead.
    """
    if os.geteuid() != 0:
        return kill_all(work, whole_s, rng)
    kept = work.out.with_name(f"{work.out.name}_kept")
    work.out.mkdir(parents=True, exist_ok=True)
    work.out.rename(kept)
    work.out.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=256m", "none", work.out], check=True)
    try:
        subprocess.run(["cp", "-a", f"{kept}/.", work.out], check=True)
        shutil.rmtree(kept)
        processes = work.start()
        after_s = _wait(processes, whole_s, rng)
        alive = any(process.poll() is None for process in processes)
        ballast = work.out / ".ballast"
        with suppress(OSError), ballast.open("wb") as stream:
            while True:
                stream.write(bytes(1 << 20))
        end_well(processes)
        ballast.unlink()
        subprocess.run(["cp", "-a", work.out, kept], check=True)
    finally:
        subprocess.run(["umount", "-l", work.out], check=True)
    work.out.rmdir()
    kept.rename(work.out)
    return [Hit(work.name, "disk full", after_s)] if alive else []


def cut_cable(work: Work, whole_s: float, rng: np.random.Generator) -> list[Hit]:
    """On three hosts, one with a worker is unplugged: for some seconds, or for good.

    Needs root, for the hosts.
    """
    if os.geteuid() != 0:
        return kill_all(work, whole_s, rng)
    root = work.out.with_name("hosts")
    root.mkdir(parents=True)
    with hosts.network(), hosts.cluster(root):
        line = [*work.line(), "--scheduler", hosts.SCHEDULER]
        process = hosts.start(hosts.HOSTS[0], line, work.log)
        after_s = _wait([process], whole_s, rng)
        alive = process.poll() is None
        hosts.plug(hosts.HOSTS[1], "down")
        for_good = rng.random() < FOR_GOOD_SHARE
        if not for_good:
            time.sleep(rng.uniform(0.1, LONGEST_CUT_S))
            hosts.plug(hosts.HOSTS[1], "up")
        end_well([process])
    shutil.rmtree(root)
    name = f"host cut off {'for good' if for_good else 'for a while'}"
    return [Hit(work.name, name, after_s)] if alive else []


AGAIN: tuple[Fault, ...] = (kill_command, kill_child, kill_all, fill_disk)
FAULTS: tuple[Fault, ...] = (*AGAIN, cut_cable)


def in_turn(
    works: Sequence[Work], rng: np.random.Generator
) -> Iterator[tuple[Work, Sequence[Fault]]]:
    """Each work with each fault that can meet it, in a random order; up to five others follow."""
    pairs = [
        (work, fault)
        for work in works
        for fault in FAULTS
        if work.on_hosts or fault is not cut_cable
    ]
    for number in rng.permutation(len(pairs)):
        work, first = pairs[number]
        more = rng.integers(len(AGAIN), size=rng.integers(MOST_FAULTS))
        yield work, (first, *(AGAIN[index] for index in more))


def hit(work: Work, faults: Sequence[Fault], whole_s: float, rng: np.random.Generator) -> list[Hit]:
    """One fault after the other meets the work, each time it goes on, until it ended before one."""
    hits: list[Hit] = []
    for fault in faults:
        found = fault(work, whole_s, rng)
        if not found:
            break
        hits += found
    return hits


def _wait(
    processes: Sequence[subprocess.Popen[bytes]], whole_s: float, rng: np.random.Generator
) -> float:
    """Wait for a random part of what an undisturbed run takes, or until all have ended [s]."""
    begin_s, after_s = time.monotonic(), float(rng.uniform(0.1, whole_s))
    while time.monotonic() - begin_s < after_s and any(p.poll() is None for p in processes):
        time.sleep(0.02)
    return round(time.monotonic() - begin_s, 2)


def _kill_group(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _wait_for_orphans(process: subprocess.Popen[bytes], most_s: float = 30.0) -> None:
    """Until all of a killed process's session have ended: they notice its death themselves."""
    deadline_s = time.monotonic() + most_s
    while time.monotonic() < deadline_s and _session(process.pid):
        time.sleep(0.1)
    assert not _session(process.pid), f"processes outlive {process.args!r}"


def _session(sid: int) -> list[int]:
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, IndexError, ValueError):
            fields = stat.read_text().rpartition(")")[2].split()
            if int(fields[3]) == sid and fields[0] not in "ZX":
                found.append(int(stat.parent.name))
    return found
