"""Keyframes that jump out of their path begin again between their neighbours."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.cameras.frames import Frames
from gmrdata.cameras.map import refinement as jumps_module
from gmrdata.cameras.map.refinement import FEWEST, jumps, mend_jumps
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values import transforms
from tests.cameras.drawn_models import (
    INTRINSICS_PX,
    SIZE_PX,
    drawn_points,
    model_of,
    places_of,
    seen_px,
)

N_FRAMES, JUMPED = 15, 6
FRAMES = Frames(
    [Path(f"{number:04d}.png") for number in range(1, N_FRAMES + 1)], None, INTRINSICS_PX, SIZE_PX
)

CONFIG = SfmConfig()
JUMP = CONFIG.mapping.jump


def walk(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Places (T, 3) of somebody who walks on with an unsteady hand, at uneven times (T,)."""
    rng = np.random.default_rng(seed)
    numbers = np.cumsum(rng.integers(1, 5, 20))
    return numbers[:, None] * [0.05, 0, 0.02] + rng.normal(0, 0.004, (20, 3)), numbers


@given(st.integers(0, 2**32 - 1), st.integers(1, 18))
def test_only_what_lies_far_from_the_path_has_jumped(seed: int, at: int) -> None:
    places, numbers = walk(seed)
    places[at] += [0, 0.2, 0]
    assert jumps(places, numbers, JUMP)[0] == at
    # Its neighbours may look as if they had: the middle between them and it is off as well.
    assert set(jumps(places, numbers, JUMP)) <= {at - 1, at, at + 1}


@given(st.integers(0, 2**32 - 1), st.floats(0, 6.0), st.floats(1e-3, 1e3))
def test_a_jump_is_one_in_any_frame_and_unit(seed: int, turn_rad: float, unit: float) -> None:
    places, numbers = walk(seed)
    places[9] += [0, 0.2, 0]
    turned = unit * Rotation.from_euler("y", turn_rad).apply(places)
    np.testing.assert_array_equal(jumps(turned, numbers, JUMP), jumps(places, numbers, JUMP))


def test_few_cameras_do_not_tell_what_is_usual() -> None:
    places, numbers = walk(0)
    places[2] += [0, 9, 0]
    assert not len(jumps(places[: FEWEST - 1], numbers[: FEWEST - 1], JUMP))
    assert not len(jumps(np.zeros((0, 3)), np.zeros(0), JUMP))
    assert not len(jumps(np.zeros((10, 3)), np.arange(10), JUMP))  # a camera at rest


@pytest.fixture
def stuck() -> tuple[Any, np.ndarray]:
    """A model in which one camera looks elsewhere, from elsewhere, and its true places (T, 3)."""
    rng = np.random.default_rng(0)
    places = np.linspace(0, 2.0, N_FRAMES)[:, None] * [1, 0, 0.2]
    places += rng.normal(0, 0.01, (N_FRAMES, 3))
    cameras = transforms.rigid(np.tile(np.eye(3), (N_FRAMES, 1, 1)), places)
    points = drawn_points(200, rng)
    image_px = seen_px(cameras, points) + rng.normal(0, 0.2, (N_FRAMES, 200, 2))
    cameras[JUMPED, :3, :3] = Rotation.from_euler("xyz", [0.4, 1.2, 0.9]).as_matrix()
    cameras[JUMPED, :3, 3] += [0.0, 1.0, 0.5]
    return model_of(cameras, points, image_px), places


def test_a_camera_that_adjustment_leaves_elsewhere_comes_back(stuck: tuple[Any, Any]) -> None:
    model, places = stuck
    mended = mend_jumps(model, FRAMES, CONFIG)
    left = places_of(model)
    assert np.linalg.norm(left[JUMPED] - places[JUMPED]) > 0.5  # what adjustment alone does
    found = places_of(mended)
    fit = transforms.fit_similarity(places, found, scale=True)
    assert np.linalg.norm(fit.apply(found) - places, axis=1).max() < 0.01


def test_less_cost_is_not_enough_where_points_are_lost(
    stuck: tuple[Any, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Points behind the camera can cost less: one every tenth frame came out 383 mm off for 12."""
    model, _ = stuck
    counts = iter([200, 199, 198, 197])
    monkeypatch.setattr(jumps_module, "_explained", lambda *_: next(counts))
    assert mend_jumps(model, FRAMES, CONFIG) is model


def test_points_behind_the_camera_are_not_explained(stuck: tuple[Any, Any]) -> None:
    model, _ = stuck
    before = jumps_module._explained(model, 2.0)
    assert before == pytest.approx((N_FRAMES - 1) * 200, rel=0.01)
    for point in model.points3D.values():
        point.xyz = -point.xyz
    assert jumps_module._explained(model, 1e9) == 0


def test_a_path_without_a_jump_stays_as_it_is(stuck: tuple[Any, Any]) -> None:
    model, places = stuck
    jumps_module._put(model, JUMPED + 1, transforms.rigid(np.eye(3), places[JUMPED]))
    before = places_of(model)
    assert mend_jumps(model, FRAMES, CONFIG) is model
    np.testing.assert_array_equal(places_of(model), before)


def test_a_camera_that_has_lost_its_points_stays_where_it_is(stuck: tuple[Any, Any]) -> None:
    model, _ = stuck
    for row, spot in enumerate(model.image(JUMPED + 1).points2D):
        if spot.has_point3D():
            model.delete_observation(JUMPED + 1, row)
    jumps_module._adjusted(model)
    before = places_of(model)
    assert mend_jumps(model, FRAMES, CONFIG) is model
    np.testing.assert_array_equal(places_of(model), before)
