"""Run `gmrdata render` as a process of its own and kill it, its workers and its Blenders."""

import hashlib
import json
import re
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
import yaml

VICTIMS = ("parent", "worker", "blender")
ORPHANS_END_S = 20.0
BESIDE_A_STAGE = re.compile(r"\..+\.(lock|inputs)(\..+)?")
LEFTOVERS = (".tmp", ".partial", ".old", ".unfinished", "job.json", "blender.log")


@dataclass(frozen=True)
class Kill:
    """One SIGKILL."""

    victim: str
    """Which process: one of VICTIMS."""
    after_s: float
    """How long after the start, or after the kill before [s]."""
    frames: int
    """Frames of the set that were there."""
    unfinished: int
    """Clips that were begun and not done."""


def write_recipe(path: Path, n_clips: int, n_frames: int) -> None:
    """A set of embedded gaits in small pictures, each under another programme."""
    gaits = ("walk", "run", "turn", "side_step")
    kinds = ("circular", "linear", "panning", "linear_panning", "small")
    clips = [
        {
            "id": f"clip{i}",
            "gait": gaits[i % len(gaits)],
            "programme": {"kind": kinds[i % len(kinds)]},
        }
        for i in range(n_clips)
    ]
    film = {"duration_s": n_frames / 10, "fps_hz": 10, "width_px": 96, "height_px": 64}
    recipe = {
        "recipe": "synthetic",
        "name": "kills",
        "workers": 2,
        "clips": clips,
        "film": film,
        "render": {"samples": 1, "joints": True, "scene": {"kind": "room"}},
    }
    path.write_text(yaml.safe_dump(recipe))


def start(recipe: Path, out_dir: Path) -> psutil.Popen:
    """`gmrdata render RECIPE --out OUT_DIR`; what it says is appended to `<out_dir>.log`."""
    code = "from gmrdata.cli import main; main()"
    words = [sys.executable, "-c", code, "render", str(recipe), "--out", str(out_dir)]
    with out_dir.with_name(f"{out_dir.name}.log").open("ab") as log:
        return psutil.Popen(words, stdout=log, stderr=log)


def kill_and_complete(
    recipe: Path, out_dir: Path, victims: Sequence[str], whole_s: float, rng: np.random.Generator
) -> list[Kill]:
    """Kill each victim at a moment that `rng` chooses, and start again until the set is complete.

    A run that was killed is started again at once; one whose worker or Blender was killed goes on
    by itself.  What is complete before all are killed is made again in the next free folder
    `<out_dir>_1`, `<out_dir>_2`, so that every kill meets a run.

    Args:
        recipe: The recipe.
        out_dir: Folder of the set.
        victims: Whom to kill, in this order.
        whole_s: How long an undisturbed run takes [s].
        rng: Chooses the moments.

    Returns:
        What was killed when.
    """
    kills: list[Kill] = []
    folder, n_complete = out_dir, 0
    process = start(recipe, folder)
    for victim in victims:
        after_s = float(rng.uniform(0, whole_s))
        begin_s = time.monotonic()
        while (target := _target(process, victim, begin_s + after_s)) is None:
            if process.wait() == 0:
                n_complete += 1
                folder = out_dir.with_name(f"{out_dir.name}_{n_complete}")
            begin_s = time.monotonic()
            process = start(recipe, folder)
        there = len(list(folder.glob("render/*/masks/0*.png")))
        begun = len(list(folder.glob("render/*.partial")))
        waited_s = time.monotonic() - begin_s
        _kill(target)
        kills.append(Kill(victim, round(waited_s, 2), there, begun))
        if victim == "parent":
            process.wait()
            process = start(recipe, folder)
    for _ in range(len(victims)):  # a clip whose Blender was killed twice needs another run
        if process.wait() == 0:
            return kills
        process = start(recipe, folder)
    assert process.wait() == 0, folder.with_name(f"{folder.name}.log").read_text()
    return kills


def contents(out_dir: Path) -> dict[str, str]:
    """SHA-256 by file of a set; of a stage's record without its time and the code's commit."""
    found = {}
    for path in sorted(path for path in out_dir.rglob("*") if path.is_file()):
        data = path.read_bytes()
        # Inodes and times of this disk, a dead process's lock.
        if BESIDE_A_STAGE.fullmatch(path.name):
            continue
        if path.name == "stage.json":
            record = json.loads(data)
            del record["seconds"], record["git_commit"]
            data = json.dumps(record, sort_keys=True).encode()
        found[path.relative_to(out_dir).as_posix()] = hashlib.sha256(data).hexdigest()
    return found


def leftovers(out_dir: Path) -> list[str]:
    """Files and folders that only an unfinished run has."""
    return [
        path.relative_to(out_dir).as_posix()
        for path in out_dir.rglob("*")
        if any(part in path.name for part in LEFTOVERS)
    ]


def _target(process: psutil.Popen, victim: str, moment_s: float) -> psutil.Process | None:
    """The victim, once there is one from a moment on; None when the run ends before."""
    while process.poll() is None:
        if time.monotonic() >= moment_s:
            if victim == "parent":
                return process
            found = [child for child in _children(process) if _role(child) == victim]
            if found:
                return found[0]
        time.sleep(0.01)
    return None


def _children(process: psutil.Process) -> list[psutil.Process]:
    try:
        return list(process.children(recursive=True))
    except psutil.NoSuchProcess:
        return []


def _role(process: psutil.Process) -> str | None:
    try:
        command, before = process.cmdline(), process.parent()
        starts = before.cmdline() if before else []
    except psutil.Error:
        return None
    if "blender" in command and "--parent" in command:
        return "blender"
    # A worker is called as the process that it was forked from.
    return "worker" if any("forkserver" in word for word in starts) else None


def _kill(process: psutil.Process) -> None:
    """SIGKILL, after which nothing that the process started may live on."""
    children = _children(process)
    process.kill()
    _, alive = psutil.wait_procs(children, timeout=ORPHANS_END_S)
    assert not alive, f"live on without their parent: {alive}"
