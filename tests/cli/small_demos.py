"""Recipes of small demos on captured motions, and their runs as processes."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import yaml

RECIPE: dict[str, Any] = {
    "recipe": "demo",
    "workers": 2,
    "film": {"duration_s": 1.5, "max_frames": 16, "width_px": 480, "height_px": 270},
    "clips": [
        {"id": "circular", "gait": "walk", "programme": {"kind": "circular"}},
        {"id": "linear", "gait": "walk", "programme": {"kind": "linear"}},
        {"id": "panning", "gait": "walk", "programme": {"kind": "panning"}},
    ],
    "training": {"gait_count": 2, "gait_duration_s": 4.0, "max_files": 2},
    "render": {"samples": 1},
    "gmr": {
        "model": {"layers": 1, "hidden": 32},
        "loss": {"n_vertices": 50},
        "batch_size": 4,
        "steps": 12,
        "checkpoint_every": 5,
    },
}
"""Its pictures are good enough for the figures to be near those of the whole demo."""
TINY = RECIPE | {
    "workers": 1,
    "film": {"duration_s": 1.0, "max_frames": 10, "width_px": 160, "height_px": 90},
    "clips": RECIPE["clips"][2:],
    "training": {"gait_count": 1, "gait_duration_s": 2.0, "max_files": 1},
    "gmr": {
        "model": {"layers": 1, "hidden": 8},
        "loss": {"n_vertices": 20},
        "batch_size": 2,
        "steps": 60,
        "checkpoint_every": 10,
    },
}
"""Every stage, as small as it can be; the training goes on long enough to be killed in it."""
TRIALS = ("02_03", "08_02", "05_01")


def demo_arguments(out: Path, recipe: Path, motions: Path) -> list[str]:
    """Arguments of `gmrdata`; the first of `TRIALS` are filmed, one for each clip."""
    n_clips = len(yaml.safe_load(recipe.read_text())["clips"])
    arguments = ["demo", "--out", str(out), "--recipe", str(recipe), "--motions", str(motions)]
    return [*arguments, "--trials", *TRIALS[:n_clips]]


def start_gmrdata(arguments: list[str]) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", "from gmrdata.cli import main; main()", *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
