"""gmrdata's projection against Blender's own, through every camera programme."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gmrdata.film.programmes import (
    Circular,
    Linear,
    LinearPanning,
    Panning,
    Programme,
    Small,
    Static,
    camera_path,
)
from gmrdata.values.camera import CameraPath, intrinsics_from_fov, project

PROGRAMMES: dict[str, Programme] = {
    "circular": Circular(),
    "linear": Linear(),
    "dolly": Linear(move="dolly"),
    "panning": Panning(),
    "linear_panning": LinearPanning(),
    "small": Small(),
    "static": Static(),
}
SCRIPT = Path(__file__).with_name("projection_by_blender.py")


def ask_blender(
    tmp_path: Path, camera: CameraPath, points_world_m: np.ndarray
) -> dict[str, np.ndarray]:
    cameras = tmp_path / "cameras.npz"
    np.savez(
        cameras,
        intrinsics_px=camera.intrinsics_px,
        size_px=[camera.width_px, camera.height_px],
        world_from_cam=camera.world_from_cam,
        points_world_m=points_world_m,
    )
    said = subprocess.run(
        [sys.executable, str(SCRIPT), str(cameras)], capture_output=True, text=True, check=True
    )
    line = next(line for line in said.stdout.splitlines() if line.startswith("ANSWER "))
    return {k: np.array(v) for k, v in json.loads(line.removeprefix("ANSWER ")).items()}


def points_in_view(camera: CameraPath, n: int, rng: np.random.Generator) -> np.ndarray:
    """(T, n, 3) world points somewhere inside each frame's picture, 1 to 15 m away."""
    pixels = rng.uniform(0, 1, (camera.n_frames, n, 2)) * (camera.width_px, camera.height_px)
    homogeneous = np.concatenate([pixels, np.ones((camera.n_frames, n, 1))], axis=-1)
    rays = homogeneous @ np.linalg.inv(camera.intrinsics_px).T
    points_cam_m = rays * rng.uniform(1, 15, (camera.n_frames, n, 1))
    rotmats, centres = camera.world_from_cam[:, :3, :3], camera.centres_world_m
    return points_cam_m @ np.swapaxes(rotmats, -1, -2) + centres[:, None]


def film_all(width_px: int, height_px: int) -> tuple[CameraPath, np.ndarray]:
    """All programmes one after another, and the programme's index of each frame."""
    time_s = np.arange(48) / 10
    pelvis = np.c_[1.3 * time_s - 7, 4 + 0.4 * np.sin(time_s), 0.93 + 0.02 * np.sin(12 * time_s)]
    paths = [
        camera_path(p, pelvis, 10.0, width_px, height_px, 62.0, np.random.default_rng(7))
        for p in PROGRAMMES.values()
    ]
    world_from_cam = np.concatenate([path.world_from_cam[::3] for path in paths])
    intrinsics_px = intrinsics_from_fov(62.0, width_px, height_px)
    owner = np.repeat(np.arange(len(paths)), len(world_from_cam) // len(paths))
    has_camera = np.ones(len(world_from_cam), dtype=bool)
    return CameraPath(intrinsics_px, width_px, height_px, world_from_cam, has_camera), owner


@pytest.mark.parametrize("size_px", [(640, 360), (270, 480)])
@pytest.mark.parametrize("off_centre_px", [(0.0, 0.0), (17.5, -9.25)])
def test_projection_is_blenders(
    tmp_path: Path,
    size_px: tuple[int, int],
    off_centre_px: tuple[float, float],
) -> None:
    camera, owner = film_all(*size_px)
    camera.intrinsics_px[:2, 2] += off_centre_px
    points_m = points_in_view(camera, 24, np.random.default_rng(11))
    answer = ask_blender(tmp_path, camera, points_m)
    ours_px = project(camera.world_from_cam, points_m, camera.intrinsics_px)
    error_px = np.linalg.norm(ours_px - answer["points_px"], axis=-1).max(axis=1)
    for index, name in enumerate(PROGRAMMES):
        assert error_px[owner == index].max() < 0.05, name
    # What is read back is what was asked for, to single precision.
    np.testing.assert_allclose(answer["intrinsics_px"], camera.intrinsics_px, rtol=1e-6, atol=1e-4)
    np.testing.assert_allclose(answer["world_from_cam"], camera.world_from_cam, atol=2e-6)
