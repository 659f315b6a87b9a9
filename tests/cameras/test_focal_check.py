"""The focal length that a reconstruction chooses: COLMAP's own synthetic ones, and filmed ones."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gmrdata.cameras.colmap import bundle_adjuster, pycolmap
from gmrdata.cameras.files import load_quality
from gmrdata.cameras.focal import FREED_NOT_INDEPENDENT, freed_focal
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.reconstruct import reconstruct

NOISE_PX = 0.4


def synthetic(seed: int, frames: int = 12) -> Any:
    """Cameras all round a cloud of points, with noise in the image points."""
    pycolmap.set_random_seed(seed)
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 1, frames
    options.num_points3D = 200
    options.camera_model_id = pycolmap.CameraModelId.PINHOLE
    options.camera_width, options.camera_height = 540, 960
    options.camera_params = [700.0, 700.0, 270.0, 480.0]
    model = pycolmap.synthesize_dataset(options)
    noise = pycolmap.SyntheticNoiseOptions()
    noise.point2D_stddev = NOISE_PX
    pycolmap.synthesize_noise(noise, model)
    return model


def with_focal(model: Any, factor: float) -> Any:
    """The model as a bundle adjustment with a wrong focal length leaves it."""
    wrong = pycolmap.Reconstruction(model)
    (camera,) = wrong.cameras.values()
    camera.focal_length_x *= factor
    camera.focal_length_y *= factor
    bundle_adjuster(wrong).solve()
    return wrong


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_right_intrinsics_are_kept_within_the_standard_error(seed: int) -> None:
    freed = freed_focal(with_focal(synthetic(seed), 1.0))
    assert freed is not None and freed.sigma is not None
    assert 1e-5 < freed.sigma < 0.02
    assert abs(freed.factor - 1.0) < 1.5 * freed.sigma


@pytest.mark.parametrize("factor", [1.3, 1 / 1.3])
def test_wrong_intrinsics_are_undone(factor: float) -> None:
    freed = freed_focal(with_focal(synthetic(3), factor))
    assert freed is not None
    assert freed.factor == pytest.approx(1 / factor, rel=0.01)


def test_the_standard_error_is_that_of_many_noises() -> None:
    """Errors of single image points are independent here, so the covariance is right as it is."""
    found = [freed_focal(with_focal(synthetic(seed), 1.0)) for seed in range(10, 30)]
    factors = np.array([freed.factor for freed in found if freed is not None])
    stated = np.array([freed.sigma for freed in found if freed is not None])
    pulls = (factors - 1.0) / (stated / FREED_NOT_INDEPENDENT)
    assert 0.6 < pulls.std() < 1.6


def test_the_model_stays_as_it_is_and_the_figures_repeat() -> None:
    model = with_focal(synthetic(4), 1.1)
    before = {i: model.image(i).cam_from_world().matrix() for i in model.reg_image_ids()}
    first, second = freed_focal(model), freed_focal(model)
    assert first == second
    (camera,) = model.cameras.values()
    assert camera.focal_length_x == pytest.approx(770.0)
    for i, matrix in before.items():
        assert np.array_equal(model.image(i).cam_from_world().matrix(), matrix)


def test_nothing_is_said_of_an_empty_model() -> None:
    assert freed_focal(pycolmap.Reconstruction()) is None


@pytest.mark.parametrize("factor", [1.0, 1.3, 1 / 1.3])
def test_a_filmed_arc_names_its_focal_length(
    film: Callable[[str, int], Any], tmp_path: Path, factor: float
) -> None:
    filmed = film("arc", 12)
    intrinsics_px = filmed.intrinsics_px.copy()
    intrinsics_px[[0, 1], [0, 1]] *= factor
    config = SfmConfig(max_features=1200, first_octave=-1)
    made = reconstruct(filmed.images_dir, filmed.masks_dir, intrinsics_px, tmp_path / "o", config)
    quality = load_quality(made)
    assert quality.focal_factor is not None and quality.focal_sigma is not None
    assert quality.geometry == "full"
    assert quality.focal_sigma < 0.03
    assert abs(quality.focal_factor - 1 / factor) < 3 * quality.focal_sigma


def test_a_filmed_pan_names_its_focal_length(pan: Any, tmp_path: Path) -> None:
    config = SfmConfig(max_features=1200)
    made = reconstruct(pan.images_dir, pan.masks_dir, pan.intrinsics_px, tmp_path / "o", config)
    quality = load_quality(made)
    assert quality.focal_factor is not None and quality.focal_sigma is not None
    assert quality.geometry == "rotation_only"
    assert quality.focal_sigma < 0.03
    assert abs(quality.focal_factor - 1.0) < 2 * quality.focal_sigma
