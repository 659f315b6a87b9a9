"""A folder in which the pages' commands find small files under the names that they use."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from gmrdata.film.programmes import Panning, camera_path
from gmrdata.motion.gait import make_gait
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip
from tests.clip_manifests import write_clips

NETWORK: dict[str, Any] = {
    "model": {"layers": 1, "hidden": 8},
    "loss": {"n_vertices": 20},
    "windows": {"frames": 4},
    "batch_size": 2,
    "steps": 2,
}
RECIPES: dict[str, Any] = {
    "gmr.yaml": {"recipe": "gmr", "train": NETWORK | {"data": {"held_out_subjects": [2, 8]}}},
    "places.yaml": {
        "recipe": "synthetic",
        "name": "synthetic",
        "workers": 1,
        "film": {"duration_s": 1.5, "fps_hz": 5, "width_px": 64, "height_px": 64},
        "render": {"samples": 1},
        "clips": [{"id": "walk", "gait": "walk", "programme": {"kind": "panning"}}],
    },
}
TRIALS = ("02_01", "08_01", "16_01")


@pytest.fixture(scope="module")
def small_world(anny, filmed_set, made_set, write_person, tmp_path_factory) -> Path:
    """3DPW/, out/3dpw, path/to/cmu, a manifest set.yaml, and recipes."""
    world = tmp_path_factory.mktemp("world")
    shutil.copytree(filmed_set.root, world / "3DPW")
    shutil.copytree(made_set, world / "out/3dpw")
    recipes = RECIPES | {"my.yaml": filmed_set.recipe().model_dump(mode="json")}
    for name, recipe in recipes.items():
        (world / name).write_text(yaml.safe_dump(recipe), encoding="utf-8")
    (world / "path/to/cmu").mkdir(parents=True)
    for number, name in enumerate(TRIALS):
        _write_walk(world / "path/to/cmu" / f"{name}.bvh", number, anny, write_person)
    write_clips(world / "filmed", anny, [_filmed_walk(anny)], camera_motions=["panning"])
    return world


def _write_walk(path: Path, number: int, body: BodyModel, write: Callable[..., Path]) -> None:
    """A second of somebody who glides ahead and turns."""
    angles_deg = np.zeros((100, 24, 3))
    angles_deg[:, 0, 2] = np.linspace(0, 10 * number, 100)
    angles_deg[:, 1, 1] = np.linspace(0, 20, 100)
    write(path, body, angles_deg, np.linspace([0.0, 0.95, 0.0], [0.0, 0.95, 1.0], 100))


def _filmed_walk(body: BodyModel) -> Clip:
    motion = make_gait("walk", 1.0, 10.0, body, np.random.default_rng(0))
    rng, rows = np.random.default_rng(1), np.arange(motion.n_frames)
    camera = camera_path(Panning(), motion.pelvis_m, 10.0, 90, 160, 45.0, rng)
    return Clip("walk", motion, rows >= 0, rows, camera)
