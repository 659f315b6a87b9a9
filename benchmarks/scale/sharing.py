"""Shards beside one process: the same bytes whoever is killed, twice as fast, and no work twice."""

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from film.set_kills import contents

HALVES = ("1/2", "2/2")
PAIRS = 3
SETTLED_S = 3  # after which a file that was written counts as old


def motion_files(source: Path, folder: Path, n: int) -> Path:
    """A folder with n motion files, of names of their own: those of `source`, again and again."""
    files = sorted(source.glob("*.bvh"), key=lambda path: (path.stat().st_size, path.name))
    files = files[len(files) // 2 :]  # the long ones: a process takes seconds to begin
    folder.mkdir(parents=True)
    for number in range(n):
        shutil.copyfile(files[number % len(files)], folder / f"motion_{number:03d}.bvh")
    return folder


def killed_and_taken_over(motions: Path, root: Path) -> dict[str, bool | int]:
    """Four shards, two at a time; one of the first two is killed (-9) at a random moment."""
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
    for process in [start(motions, shared, f"{index}/4") for index in (3, 4)]:
        assert process.wait() == 0
    same = contents(whole) == contents(shared)
    return {"shard_bytes_equal": same, "shard_killed": died, "clips_when_killed": made}


def _pair_s(motions: Path, root: Path) -> tuple[float, float]:
    """Seconds of one process, and of two shards, from nothing."""
    return _seconds(motions, root / "one", ["1/1"]), _seconds(motions, root / "two", HALVES)


def speedups(motions: Path, root: Path) -> dict[str, float]:
    """Two shards at once beside one, the median of three pairs; two processes that share nothing; a
    run of what is made."""
    pairs = [_pair_s(motions, root / f"pair_{number}") for number in range(PAIRS)]
    one_s, two_s = sorted(pairs, key=lambda pair: pair[0] / pair[1])[PAIRS // 2]
    _seconds(motions, root / "two", HALVES)
    again_s = _seconds(motions, root / "two", HALVES)
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
        "repeat_share": round(again_s / two_s, 4),
    }


def rendered_repeat(n: int, root: Path) -> dict[str, float]:
    """The same of n rendered clips of five small frames, for which Blender starts each time."""
    root.mkdir(parents=True)
    clip = {"gait": "walk", "programme": {"kind": "static"}}
    recipe = {
        "recipe": "synthetic",
        "name": "small",
        "film": {"duration_s": 0.5, "fps_hz": 10, "width_px": 96, "height_px": 64},
        "render": {"samples": 1, "scene": {"kind": "room"}},
        "clips": [clip | {"id": f"clip_{number:03d}"} for number in range(n)],
    }
    (root / "small.yaml").write_text(json.dumps(recipe))
    time.sleep(SETTLED_S)

    def seconds() -> float:
        begin_s = time.perf_counter()
        shards = [_gmrdata("render", root / "small.yaml", root / "out", one) for one in HALVES]
        assert [process.wait() for process in shards] == [0, 0]
        return time.perf_counter() - begin_s

    first_s, again_s = seconds(), seconds()
    return {
        "rendered_s": round(first_s, 1),
        "repeat_share_rendered": round(again_s / first_s, 4),
    }


def _seconds(motions: Path, out: Path, shards: Sequence[str]) -> float:
    begin_s = time.perf_counter()
    for process in [start(motions, out, shard) for shard in shards]:
        assert process.wait() == 0
    return time.perf_counter() - begin_s


def start(motions: Path, out: Path, shard: str = "1/1") -> subprocess.Popen[bytes]:
    """The verb `motions` as one shard, in a process of its own."""
    return _gmrdata("motions", motions, out, shard)


def _gmrdata(verb: str, source: Path, out: Path, shard: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "gmrdata", verb, str(source), "--out", str(out)]
    return subprocess.Popen([*command, "--shard", shard], stderr=subprocess.DEVNULL)
