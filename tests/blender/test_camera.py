"""gmrdata's projection against Blender's own, through every camera programme."""

from pathlib import Path
from typing import NamedTuple

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
from tests.blender.jobs import ask_blender

PROGRAMMES: dict[str, Programme] = {
    "circular": Circular(),
    "linear": Linear(),
    "dolly": Linear(move="dolly"),
    "panning": Panning(),
    "linear_panning": LinearPanning(),
    "small": Small(),
    "static": Static(),
}
SIZES_PX = ((640, 360), (270, 480))
OFF_CENTRE_PX = ((0.0, 0.0), (17.5, -9.25))


class Case(NamedTuple):
    """A camera through all programmes, points that it sees, and what Blender says of both."""

    camera: CameraPath
    owner: np.ndarray
    points_m: np.ndarray
    answer: dict[str, np.ndarray]


Cases = dict[tuple[tuple[int, int], tuple[float, float]], Case]


@pytest.fixture(scope="module")
def cases(tmp_path_factory) -> Cases:
    """By size and offset of the principal point; Blender is asked once for all."""
    folder, made = tmp_path_factory.mktemp("cameras"), {}
    for size_px in SIZES_PX:
        for off_centre_px in OFF_CENTRE_PX:
            camera, owner = film_all(*size_px)
            camera.intrinsics_px[:2, 2] += off_centre_px
            points_m = points_in_view(camera, 24, np.random.default_rng(11))
            made[size_px, off_centre_px] = Case(camera, owner, points_m, {})
    answers = zip(made.items(), blenders_answers(folder, list(made.values())), strict=True)
    return {key: case._replace(answer=answer) for (key, case), answer in answers}


def blenders_answers(folder: Path, cases: list[Case]) -> list[dict[str, np.ndarray]]:
    paths = [folder / f"{number}.npz" for number in range(len(cases))]
    for path, (camera, _, points_m, _) in zip(paths, cases, strict=True):
        np.savez(
            path,
            intrinsics_px=camera.intrinsics_px,
            size_px=[camera.width_px, camera.height_px],
            world_from_cam=camera.world_from_cam,
            points_world_m=points_m,
        )
    return [
        {name: np.array(values) for name, values in answer.items()}
        for answer in ask_blender("projection_by_blender.py", *paths)
    ]


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


@pytest.mark.parametrize("size_px", SIZES_PX)
@pytest.mark.parametrize("off_centre_px", OFF_CENTRE_PX)
def test_projection_is_blenders(cases, size_px, off_centre_px):
    camera, owner, points_m, answer = cases[size_px, off_centre_px]
    ours_px = project(camera.world_from_cam, points_m, camera.intrinsics_px)
    error_px = np.linalg.norm(ours_px - answer["points_px"], axis=-1).max(axis=1)
    for index, name in enumerate(PROGRAMMES):
        assert error_px[owner == index].max() < 0.05, name
    # What is read back is what was asked for, to single precision.
    np.testing.assert_allclose(answer["intrinsics_px"], camera.intrinsics_px, rtol=1e-6, atol=1e-4)
    np.testing.assert_allclose(answer["world_from_cam"], camera.world_from_cam, atol=2e-6)
