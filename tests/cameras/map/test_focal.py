"""The focal length that a reconstruction or a pan chooses: COLMAP's synthetic ones, filmed and
drawn ones whose camera is known."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gmrdata.cameras.colmap import bundle_adjuster, pycolmap
from gmrdata.cameras.files import Distortion, load_quality
from gmrdata.cameras.map import focal, rotation_only
from gmrdata.cameras.map.focal import (
    FREED_NOT_INDEPENDENT,
    SYSTEMATIC_FOCAL,
    FreedFocal,
    freed_focal,
    turning_focal,
    with_lens,
)
from gmrdata.cameras.map.rotation_only import solve_rotation_only
from gmrdata.cameras.match.matches import Matches
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values.camera import Lens
from tests.cameras.drawn_models import synthetic, turning_matches


def pinhole(seed: int, frames: int = 12) -> Any:
    """Cameras without distortion all round a cloud of points."""
    params = [700.0, 700.0, 270.0, 480.0]
    camera = pycolmap.Camera(model="PINHOLE", width=540, height=960, params=params)
    return synthetic(seed, frames, 200, camera)


def with_focal(model: Any, factor: float) -> Any:
    """The model as a bundle adjustment with a wrong focal length leaves it."""
    wrong = pycolmap.Reconstruction(model)
    (camera,) = wrong.cameras.values()
    camera.focal_length_x *= factor
    camera.focal_length_y *= factor
    bundle_adjuster(wrong).solve()
    return wrong


def distorted(model: Any, k1: float, k2: float = 0.0) -> Any:
    """The model with its image points where a lens with that distortion shows them."""
    (camera,) = model.cameras.values()
    focal_px, centre_px = camera.params[:2], camera.params[2:]
    for image in model.images.values():
        for seen in image.points2D:
            at = (seen.xy - centre_px) / focal_px
            seen.xy = centre_px + focal_px * at * (1 + k1 * (at @ at) + k2 * (at @ at) ** 2)
    return model


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_right_intrinsics_are_kept_within_the_standard_error(seed):
    freed = freed_focal(with_focal(pinhole(seed), 1.0))
    assert freed is not None and freed.radial_k1 is not None and freed.radial_k1_sigma is not None
    assert 0.0125 < freed.sigma < 0.02
    assert abs(freed.factor - 1.0) < 1.5 * freed.sigma
    assert abs(freed.radial_k1) < 2 * freed.radial_k1_sigma < 0.1


@pytest.mark.parametrize("factor", [2.2, 1.3, 1.05, 1 / 1.05, 1 / 1.3, 1 / 2.2])
def test_wrong_intrinsics_are_undone(factor):
    freed = freed_focal(with_focal(pinhole(3), factor))
    assert freed is not None
    assert freed.factor == pytest.approx(1 / factor, rel=0.01)


def test_the_standard_error_is_that_of_many_noises():
    """Errors of single image points are independent here, so the covariance is right as it is."""
    found = [freed_focal(with_focal(pinhole(seed), 1.0)) for seed in range(10, 20)]
    factors = np.array([freed.factor for freed in found if freed is not None])
    stated = np.array([freed.sigma for freed in found if freed is not None])
    by_noise = np.sqrt(stated**2 - SYSTEMATIC_FOCAL**2) / FREED_NOT_INDEPENDENT
    pulls = (factors - 1.0) / by_noise
    assert 0.5 < pulls.std() < 1.7


def test_the_model_stays_as_it_is_and_the_figures_repeat():
    model = with_focal(pinhole(4), 1.1)
    before = {i: model.image(i).cam_from_world().matrix() for i in model.reg_image_ids()}
    first, second = freed_focal(model), freed_focal(model)
    assert first == second
    (camera,) = model.cameras.values()
    assert camera.focal_length_x == pytest.approx(770.0)
    for i, matrix in before.items():
        assert np.array_equal(model.image(i).cam_from_world().matrix(), matrix)


@pytest.mark.parametrize("k1", [0.06, -0.2])
def test_distortion_is_measured_and_is_not_taken_for_a_focal_length(k1):
    model = distorted(pinhole(5), k1)
    bundle_adjuster(model).solve()
    freed = freed_focal(model)
    assert freed is not None and freed.radial_k1 is not None and freed.radial_k1_sigma is not None
    assert abs(freed.radial_k1 - k1) < 2 * freed.radial_k1_sigma < 0.1
    assert abs(freed.factor - 1.0) < 2 * freed.sigma


def test_a_lens_with_two_focal_lengths_is_kept():
    model = pinhole(6)
    (camera,) = model.cameras.values()
    fx, fy, cx, cy = camera.params
    for image in model.images.values():
        for seen in image.points2D:
            seen.xy = [seen.xy[0], cy + 1.1 * (seen.xy[1] - cy)]
    camera.params = [fx, 1.1 * fy, cx, cy]
    freed = freed_focal(model)
    assert freed is not None and abs(freed.factor - 1.0) < 0.01


@pytest.mark.parametrize("stretch", [1.0, 1.1])
def test_a_lens_is_found_and_its_image_points_are_put_right(stretch):
    """On pixels that are square and such that are not."""
    truth = pinhole(7)
    (camera,) = truth.cameras.values()
    bare = [point.xy.copy() for point in truth.image(1).points2D]
    model = distorted(pycolmap.Reconstruction(truth), 0.2, 0.1)
    fx, fy, cx, cy = camera.params
    (given,) = model.cameras.values()
    given.params = [fx, stretch * fy, cx, cy]
    for image in model.images.values():
        for seen in image.points2D:
            seen.xy = [seen.xy[0], cy + stretch * (seen.xy[1] - cy)]
    seen_px = np.array([point.xy for point in model.image(1).points2D])
    bundle_adjuster(model).solve()
    bent, lens = with_lens(model, SfmConfig().distortion)
    assert lens is not None and lens.explains > 0.05
    model.update_point_3d_errors()
    bent.update_point_3d_errors()
    assert bent.compute_mean_reprojection_error() < 0.97 * model.compute_mean_reprojection_error()
    # Both terms lean on each other; what counts is where they put a point.
    for r in (0.15, 0.3):
        shift = lens.k1 * r**3 + lens.k2 * r**5
        assert shift == pytest.approx(0.2 * r**3 + 0.1 * r**5, abs=0.2 / fx)
    matrix = np.array([[fx, 0, cx], [0, stretch * fy, cy], [0, 0, 1]])
    matches = Matches([seen_px, np.zeros((0, 2))], [])
    for of, most_px in ((Distortion(0.2, 0.1, 0.1), 1e-6), (lens, 0.2)):
        straight_px, none_px = matches.without(of, matrix).keypoints_px
        straight_px[:, 1] = cy + (straight_px[:, 1] - cy) / stretch
        assert np.median(np.linalg.norm(straight_px - bare, axis=1)) < most_px
        assert none_px.shape == (0, 2)


@pytest.mark.parametrize(("frames", "k2"), [(12, 0.0), (12, 0.003), (4, -0.2), (12, -4.0)])
def test_no_lens_is_taken_that_hardly_helps_has_few_points_or_folds_the_picture(frames, k2):
    model = distorted(pinhole(8, frames), 0.0, k2)
    bundle_adjuster(model).solve()
    same, lens = with_lens(model, SfmConfig().distortion)
    assert same is model and lens is None


def test_nothing_is_said_of_an_empty_model():
    assert freed_focal(pycolmap.Reconstruction()) is None


@pytest.mark.parametrize(
    ("kind", "factor", "geometry", "sigmas"),
    [
        ("arc", 1.0, "full", 3),
        ("arc", 1.3, "full", 3),
        ("arc", 1 / 1.3, "full", 3),
        ("pan", 1.0, "rotation_only", 2),
    ],
)
def test_a_film_names_its_focal_length(kind, factor, geometry, sigmas, film, tmp_path):
    filmed = film(kind, 12)
    given = replace(filmed, intrinsics_px=filmed.intrinsics_px * [[factor], [factor], [1.0]])
    given.intrinsics_px[:2, 2] = filmed.intrinsics_px[:2, 2]
    quality = load_quality(given.solved(tmp_path / "o", SfmConfig(max_features=1200)))
    assert quality.focal_factor is not None and quality.focal_sigma is not None
    assert quality.geometry == geometry
    assert quality.focal_sigma < 0.03
    assert abs(quality.focal_factor - 1 / factor) < sigmas * quality.focal_sigma


LENS = Lens((600.0, 620.0), (270.0, 480.0), (540, 960))
INTRINSICS_PX = LENS.matrix_px


def freed(matches: Matches, factor: float) -> FreedFocal | None:
    """What the matches ask for where the focal length is given wrong by a factor."""
    wrong_px = INTRINSICS_PX.copy()
    wrong_px[[0, 1], [0, 1]] *= factor
    turning = solve_rotation_only(matches, wrong_px, 2.0, np.random.default_rng(0))
    return turning_focal(turning, matches, wrong_px)


@pytest.mark.parametrize("factor", [1.3, 1.0, 1 / 1.3])
def test_exact_matches_give_the_exact_focal_length(factor):
    found = freed(turning_matches(LENS, 20.0, 0.0), factor)
    assert found is not None
    assert found.factor == pytest.approx(1 / factor, rel=1e-5)


@pytest.mark.parametrize("factor", [1.3, 1.0, 1 / 1.3])
@pytest.mark.parametrize("turn_deg", [8.0, 40.0])
def test_noise_and_a_drift_in_the_hand_stay_within_the_standard_error(turn_deg, factor):
    for seed in range(3):
        found = freed(turning_matches(LENS, turn_deg, 0.4, seed, drift_m=0.01), factor)
        assert found is not None and found.sigma is not None
        assert found.sigma < 0.06
        assert abs(found.factor - 1 / factor) < 2 * found.sigma


def test_a_camera_that_does_not_turn_says_nothing():
    assert freed(turning_matches(LENS, 0.0, 0.4), 1.0) is None
    assert freed(turning_matches(LENS, 0.0, 0.0), 1.0) is None


def test_a_camera_that_stays_is_not_fitted(monkeypatch):
    """Of a long video a fit whose answer would mean nothing took minutes."""
    monkeypatch.setattr(focal, "fit_turning", lambda *_, **__: pytest.fail("was fitted"))
    assert freed(turning_matches(LENS, 0.0, 0.4), 1.0) is None


def test_of_many_pairs_fewer_matches_are_taken(monkeypatch):
    matches = turning_matches(LENS, 30.0, 0.4)
    monkeypatch.setattr(rotation_only, "MOST_MATCHES", 35 * len(matches.pairs))
    turning = solve_rotation_only(matches, INTRINSICS_PX, 2.0, np.random.default_rng(0))
    rows, _, _ = focal._gather(turning, matches, INTRINSICS_PX)
    _, of_each = np.unique(rows, axis=0, return_counts=True)
    assert len(of_each) == len(matches.pairs) and 35 <= of_each.max() < 2 * 35
    found = freed(matches, 1.3)
    assert found is not None and abs(found.factor - 1 / 1.3) < 2 * found.sigma < 0.12


def test_wrong_matches_are_outvoted():
    matches = turning_matches(LENS, 30.0, 0.4)
    rng = np.random.default_rng(1)
    for points_px in matches.keypoints_px:
        wrong = rng.random(len(points_px)) < 0.1
        points_px[wrong] += rng.normal(0, 40, (int(wrong.sum()), 2))
    found = freed(matches, 1.3)
    assert found is not None and found.sigma is not None
    assert abs(found.factor - 1 / 1.3) < 2 * found.sigma


@pytest.mark.parametrize("seed", range(3))
def test_a_turn_of_half_a_degree_says_next_to_nothing(seed):
    """A phone held still before people, by 0.3 degrees either way, was said to have half its focal
    length, to 3 %."""
    found = freed(turning_matches(LENS, 0.6, 0.1, seed, drift_m=0.005), 1.0)
    assert found is not None and found.sigma > 0.3
