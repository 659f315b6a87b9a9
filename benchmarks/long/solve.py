"""Solve one long video in a process of its own, and say what each stage took, as JSON.

    python benchmarks/long/solve.py FRAMES OUT MODELS FOCAL_PX none|own

Processor seconds of all threads and children, seconds, and the largest memory of the process while
the stage ran [GB].  A stage that runs within another counts for itself alone.
"""

import json
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gmrdata import solve_video
from gmrdata.cameras.lens.intrinsics import GivenIntrinsics
from gmrdata.pages.solved_page import make_video_page
from gmrdata.people.sources import MasksConfig, PersonSource
from gmrdata.read.models import POSE_LANDMARKS, QUICK_LANDMARKS
from gmrdata.solve.request import NOBODY, SolveConfig
from gmrdata.stage import store

FPS_HZ = 30.0
PROC = Path("/proc/self")


def peak_gb() -> float:
    """Largest memory since the last call; begins anew where the system lets it."""
    lines = (PROC / "status").read_text().splitlines()
    kilobytes = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
    (PROC / "clear_refs").write_text("5")
    return kilobytes * 1024 / 1e9


def used_s() -> float:
    """Processor time of this process and of those that it waited for."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


class Stages:
    """What is booked to which stage."""

    def __init__(self) -> None:
        self.rows: dict[str, dict[str, float]] = {}
        self._open, self._since = ["all else"], (used_s(), time.monotonic())

    def book(self) -> None:
        """Give the innermost stage what was used since the last call."""
        row = self.rows.setdefault(self._open[-1], {"cpu_s": 0.0, "wall_s": 0.0, "peak_gb": 0.0})
        now = used_s(), time.monotonic()
        row["cpu_s"] += now[0] - self._since[0]
        row["wall_s"] += now[1] - self._since[1]
        row["peak_gb"] = max(row["peak_gb"], peak_gb())
        self._since = now

    def watched(self, run_stage: Callable[..., Any]) -> Callable[..., Any]:
        def call(name: str, *args: Any, **kwargs: Any) -> Any:
            self.book()
            self._open.append(name)
            try:
                return run_stage(name, *args, **kwargs)
            finally:
                self.book()
                self._open.pop()

        return call


def main() -> None:
    frames, out, models, focal_px, poses = sys.argv[1:]
    stages = Stages()
    watched = stages.watched(store.run_stage)
    for module in [one for name, one in sys.modules.items() if name.startswith("gmrdata.")]:
        if module is not store and getattr(module, "run_stage", None) is store.run_stage:
            module.run_stage = watched  # type: ignore[attr-defined]
    network = QUICK_LANDMARKS if poses == NOBODY else POSE_LANDMARKS
    landmarks = Path(models) / network.name
    person = PersonSource(model=Path(models) / "yolox_nano.onnx", landmarks=landmarks)
    config = SolveConfig(masks=MasksConfig(sources=(person,)))
    lens = GivenIntrinsics(focal_px=float(focal_px))
    folder = Path(frames) if Path(frames).is_dir() else None  # a file has its own times
    fps_hz = FPS_HZ if folder else None
    solve_video(frames, out, poses=poses, lens=lens, fps_hz=fps_hz, config=config)
    make_video_page(Path(out), images_dir=folder)
    stages.book()
    sys.stdout.write(json.dumps(stages.rows) + "\n")


if __name__ == "__main__":
    main()
