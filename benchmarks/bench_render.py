"""Measure the Blender stage: exactness, overhead, throughput, feet, and food for COLMAP.

`make bench-render` runs this file alone and takes about 40 minutes on two quiet cores; `--small`
only tries every part.  Prints tables and writes out/bench/render.json.  Ratios are of wall times
of whole processes in one run; seconds depend on the machine.
"""

import json
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from record import OUT_DIR, Record, bar_of, machine
from render.clips import FPS_HZ
from render.exactness import measure_exactness
from render.feet import measure_feet
from render.inliers import measure_inliers
from render.overhead import CONFIG, measure_overhead, measure_script
from render.pool import measure_workers
from render.scale import FULL, SMALL
from render.tables import show
from render.timing import run_in_blender

from gmrdata.film.blender_environment import versions_said
from gmrdata.read.bodies import keep_body
from gmrdata.read.body_file import read_body

pytestmark = pytest.mark.bench
OUT = OUT_DIR / "render.json"
BARS = {
    "projection_px_max": ("<", 0.05),
    "mask_iou_min": (">", 0.98),
    "overhead_ratio": ("<=", 1.10),
    "per_frame_script_ratio": (">=", 3.0),
    "two_worker_ratio": (">=", 1.6),
    "foot_gap_cm_mean": ("<", 2.0),
    "inliers_median_min": (">=", 200),
}


def test_the_renderer(tmp_path: Path, request: pytest.FixtureRequest) -> None:
    small = request.config.getoption("--small")
    scale = SMALL if small else FULL
    body_path = keep_body("anny", tmp_path / "body")
    exact = measure_exactness(tmp_path / "exact", body_path, scale)
    show("Stored cameras and masks", exact)
    overhead = [
        measure_overhead(tmp_path / f"overhead{n}", body_path, size_px, scale)
        for n, size_px in enumerate(scale.overhead_sizes_px)
    ]
    show("A clip beside Blender's bare animation render of the same scene", overhead)
    clip_wall_s = sorted(overhead[0]["clip_wall_s"])[scale.overhead_runs // 2]
    script = measure_script(tmp_path / "script", body_path, clip_wall_s, scale)
    show("A script that sets the scene up anew for each frame, in one process", [script])
    workers = measure_workers(tmp_path / "workers", body_path, scale)
    show("Workers with one thread each; repeat: the same bytes from both runs", [workers])
    feet = measure_feet(read_body(body_path), _cmu_dir(request))
    show("Lower foot over the ground", feet)
    inliers = measure_inliers(tmp_path / "sfm", body_path, scale)
    show("Inlier points per frame", inliers)
    figures = {
        "projection_px_max": max(row["projection_px_max"] for row in exact),
        "mask_iou_min": min(row["mask_iou_min"] for row in exact),
        "overhead_ratio": overhead[0]["ratio"],
        "per_frame_script_ratio": script["ratio"],
        "two_worker_ratio": workers["ratio"],
        "foot_gap_cm_mean": _mean_gap_cm(feet),
        "inliers_median_min": min(row["inliers_median"] for row in inliers),
    }
    settings = _settings() | {"scale": "small" if small else "full"} | asdict(scale)
    gpu = _devices()
    show("Machine", [{"gpu": ", ".join(gpu) or "none here", **_settings()}])
    tables = {
        "exactness": exact,
        "overhead": overhead,
        "script": script,
        "workers": workers,
        "feet": feet,
        "inliers": inliers,
    }
    record = Record(OUT, small, lambda: settings)
    record.add(**figures, gpu=gpu, tables=tables)
    assert workers["clips_that_repeat"] == workers["clips"], "a clip differs from run to run"
    record.hold([bar_of(name, value, *BARS[name]) for name, value in figures.items()])


def _mean_gap_cm(feet: list[dict[str, Any]]) -> float:
    """Over the frames of the recorded walks; of the embedded ones where there are no others."""
    recorded = [row for row in feet if row["walk"].startswith("CMU")] or feet
    frames = sum(row["frames"] for row in recorded)
    return round(sum(row["frames"] * row["gap_cm_mean"] for row in recorded) / frames, 3)


def _cmu_dir(request: pytest.FixtureRequest) -> Path | None:
    """The real motions; without them the feet of the embedded walks alone are measured."""
    try:
        folder: Path = request.getfixturevalue("cmu_dir")
    except pytest.skip.Exception:
        return None
    return folder


def _devices() -> list[str]:
    said = run_in_blender(Path(__file__).parent / "render" / "devices.py").said
    line = next(line for line in said.splitlines() if line.startswith("DEVICES "))
    found: list[str] = json.loads(line.removeprefix("DEVICES "))
    return found


def _settings() -> dict[str, Any]:
    return machine() | {
        "blender": versions_said(run_in_blender(Path("blender.probe")).said.splitlines()),
        "pycolmap": metadata.version("pycolmap"),
        "samples": CONFIG.samples,
        "fps_hz": FPS_HZ,
    }
