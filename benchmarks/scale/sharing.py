"""Shares beside one process: the same bytes whoever is killed, and twice as fast."""

import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from film.set_kills import contents

from gmrdata.cli.shards import COMMAND_FILE

HALVES = ("1/2", "2/2")
PAIRS = 3


def motion_files(source: Path, folder: Path, n: int) -> Path:
    """A folder with n motion files, of names of their own: those of `source`, again and again."""
    files = sorted(source.glob("*.bvh"), key=lambda path: (path.stat().st_size, path.name))
    files = files[len(files) // 2 :]  # the long ones: a process takes seconds to begin
    folder.mkdir(parents=True)
    for number in range(n):
        shutil.copyfile(files[number % len(files)], folder / f"motion_{number:03d}.bvh")
    return folder


def killed_and_started_again(motions: Path, root: Path) -> dict[str, bool | int]:
    """Four shares, two at a time; one of the first two is killed (-9) at a random moment."""
    whole, shared = root / "a" / "out", root / "b" / "out"
    assert start(motions, whole).wait() == 0
    rng = np.random.default_rng(0)
    victim, other = start(motions, shared, "1/4"), start(motions, shared, "2/4")
    while not list(shared.glob("clips/*")):
        time.sleep(0.05)
    time.sleep(rng.uniform(0.0, 0.05 * len(list(motions.iterdir()))))
    victim.kill()
    died = victim.wait() != 0
    made = len(list(shared.glob("clips/*/stage.json")))
    assert other.wait() == 0
    for index in (3, 4, 1):
        assert start(motions, shared, f"{index}/4").wait() == 0
    (shared / COMMAND_FILE).unlink(missing_ok=True)
    same = contents(whole) == contents(shared)
    return {"shard_bytes_equal": same, "shard_killed": died, "clips_when_killed": made}


def _pair_s(motions: Path, root: Path) -> tuple[float, float]:
    """Seconds of one process, and of two shares, from nothing."""
    return _seconds(motions, root / "one", ["1/1"]), _seconds(motions, root / "two", HALVES)


def speedups(motions: Path, root: Path) -> dict[str, float]:
    """Two shares beside one, the median of three pairs; two processes that share nothing."""
    pairs = [_pair_s(motions, root / f"pair_{number}") for number in range(PAIRS)]
    one_s, two_s = sorted(pairs, key=lambda pair: pair[0] / pair[1])[PAIRS // 2]
    halves = [root / "half" / side for side in ("a", "b")]
    for number, path in enumerate(sorted(motions.iterdir())):
        half = halves[number % 2]
        half.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, half / path.name)
    begin_s = time.perf_counter()
    for process in [start(half, root / "apart" / half.name) for half in halves]:
        assert process.wait() == 0
    apart_s = time.perf_counter() - begin_s
    return {
        "one_process_s": round(one_s, 1),
        "two_process_speedup": round(one_s / two_s, 3),
        "two_apart_speedup": round(one_s / apart_s, 3),
    }


def _seconds(motions: Path, out: Path, shards: Sequence[str]) -> float:
    begin_s = time.perf_counter()
    for process in [start(motions, out, shard) for shard in shards]:
        assert process.wait() == 0
    return time.perf_counter() - begin_s


def start(motions: Path, out: Path, shard: str = "1/1") -> subprocess.Popen[bytes]:
    """The verb `motions` as one share with one worker, in a process of its own."""
    command = [sys.executable, "-m", "gmrdata", "motions", str(motions), "--out", str(out)]
    command += ["--workers", "1", "--shard", shard]
    return subprocess.Popen(command, stderr=subprocess.DEVNULL)
