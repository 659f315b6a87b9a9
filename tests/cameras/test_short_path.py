"""A path that is short beside what it sees is adjusted by a loss as narrow as most errors are."""

from typing import Any

import numpy as np
import pytest

from gmrdata.cameras.colmap import LOSS_PX, bundle_adjuster, matrix_of, pycolmap
from gmrdata.cameras.mapping import NARROWEST_PX, _sharpen
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values import transforms
from gmrdata.values.camera import project
from gmrdata.values.transforms import fit_similarity

INTRINSICS_PX = np.array([[800.0, 0, 320], [0, 800.0, 240], [0, 0, 1]])
NOISE_PX, FAR_PX = 0.08, 0.8
N_FRAMES, N_POINTS = 15, 300


def filmed(extent: float, seed: int) -> tuple[Any, np.ndarray]:
    """A model of a hand-held camera before points 3 to 12 units away, and its true places (T, 3).
    A tenth of the image points is off by tenfold, all of them to one side, as edges are that slide.
    """
    rng = np.random.default_rng(seed)
    when = np.linspace(0, 2 * np.pi, N_FRAMES)
    places = extent * np.stack([np.sin(when), np.cos(2 * when), 0.5 * np.sin(3 * when)], -1) / 2
    cameras = transforms.rigid(np.tile(np.eye(3), (N_FRAMES, 1, 1)), places)
    rays = np.c_[rng.uniform(-0.35, 0.35, (N_POINTS, 2)), np.ones(N_POINTS)]
    points = rays * rng.uniform(3, 12, (N_POINTS, 1))
    image_px = np.array([project(camera, points, INTRINSICS_PX) for camera in cameras])
    image_px += rng.normal(0, NOISE_PX, image_px.shape)
    far = rng.random((N_FRAMES, N_POINTS)) < 0.1
    image_px[far] += FAR_PX * np.sign(places[:, None, :2]).repeat(N_POINTS, 1)[far]
    model = pycolmap.Reconstruction()
    params = [800.0, 800.0, 320.0, 240.0]
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(model="PINHOLE", width=640, height=480, params=params, camera_id=1)
    )
    for i, camera in enumerate(cameras, start=1):
        image = pycolmap.Image(f"{i:03d}.png", image_px[i - 1], 1, i)
        cam_from_world = transforms.invert(camera)
        rotation = pycolmap.Rotation3d(cam_from_world[:3, :3])
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(rotation, cam_from_world[:3, 3]))
    for n, point in enumerate(points):
        track = [pycolmap.TrackElement(i, n) for i in range(1, N_FRAMES + 1)]
        model.add_point3D(point, pycolmap.Track(track))
    bundle_adjuster(model).solve()
    return model, places


def error(model: Any, places: np.ndarray) -> float:
    """Root mean square of what a similarity leaves of the cameras' places."""
    found = np.array(
        [
            transforms.invert(matrix_of(model.image(i).cam_from_world()))[:3, 3]
            for i in sorted(model.reg_image_ids())
        ]
    )
    true_from_found = fit_similarity(places, found, scale=True)
    apart = true_from_found.apply(found) - places
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_short_path_does_not_follow_what_is_far_off(seed: int) -> None:
    model, places = filmed(0.06, seed)
    before = error(model, places)
    loss_px = _sharpen(model, SfmConfig())
    assert NARROWEST_PX < loss_px < 3 * NOISE_PX
    assert error(model, places) < 0.6 * before


def test_a_long_path_stays_as_it_is() -> None:
    model, places = filmed(4.0, 0)
    before = error(model, places)
    assert _sharpen(model, SfmConfig()) == LOSS_PX
    assert error(model, places) == before


def test_an_empty_model_is_no_error() -> None:
    assert _sharpen(pycolmap.Reconstruction(), SfmConfig()) == LOSS_PX
