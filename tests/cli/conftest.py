"""A small demo on captured motions, run once for all tests of this folder."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from gmrdata.cli.demo_recipe import DemoPaths

RECIPE = {
    "recipe": "demo",
    "workers": 2,
    "film": {"duration_s": 2.4, "max_frames": 26, "width_px": 480, "height_px": 270},
    "clips": [
        {"id": "circular", "gait": "walk", "programme": {"kind": "circular"}},
        {"id": "linear", "gait": "walk", "programme": {"kind": "linear"}},
        {"id": "panning", "gait": "walk", "programme": {"kind": "panning"}},
    ],
    "training": {"gait_count": 4, "gait_duration_s": 7.0, "max_files": 3},
    "render": {"samples": 1},
    "gmr": {
        "model": {"layers": 1, "hidden": 32},
        "loss": {"n_vertices": 50},
        "batch_size": 4,
        "steps": 40,
        "checkpoint_every": 10,
    },
}
TRIALS = ("02_03", "08_02", "05_01")


def _start(out: Path, recipe: Path, motions: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", "from gmrdata.cli import main; main()", "demo"]
    command += ["--out", str(out), "--recipe", str(recipe), "--motions", str(motions)]
    command += ["--trials", *TRIALS]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def _finish(process: subprocess.Popen[str]) -> str:
    said, _ = process.communicate(timeout=900)
    assert process.returncode == 0, said
    return said


@pytest.fixture(scope="session")
def recipe_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recipe") / "small.yaml"
    path.write_text(yaml.safe_dump(RECIPE))
    return path


@pytest.fixture(scope="session")
def finished(
    tmp_path_factory: pytest.TempPathFactory, recipe_path: Path, cmu_dir: Path
) -> tuple[DemoPaths, str]:
    out = tmp_path_factory.mktemp("demo") / "out"
    said = _finish(_start(out, recipe_path, cmu_dir))
    return DemoPaths(out), said


@pytest.fixture(scope="session")
def start_demo() -> Callable[[Path, Path, Path], subprocess.Popen[str]]:
    """Starts `gmrdata demo` as a process: (output folder, recipe, folder of motions)."""
    return _start


@pytest.fixture(scope="session")
def finish_demo() -> Callable[[subprocess.Popen[str]], str]:
    """Waits for it, and gives what it said."""
    return _finish
