"""How far two paths agree, and what a second solution must not be mistaken for."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.cameras.check.agreement import agreement, least_extent
from gmrdata.values.transforms import rigid

N = 20
TIME = np.linspace(0.0, 1.0, N)[:, None]


def path() -> np.ndarray:
    """A camera that goes 2 units to the side and turns by 30 degrees."""
    turns = Rotation.from_rotvec(np.deg2rad(30) * TIME * [0.0, 1.0, 0.0]).as_matrix()
    return rigid(turns, 2.0 * TIME * [1.0, 0.0, 0.0])


def elsewhere(cameras: np.ndarray) -> np.ndarray:
    """The same path in another world and unit."""
    moved = rigid(Rotation.from_rotvec([0.3, -2.0, 1.0]).as_matrix(), np.array([5.0, 1.0, 2.0]))
    other = moved @ cameras
    other[:, :3, 3] *= 3.7
    return other


def test_the_same_path_in_another_world_agrees_and_gaps_do_not_count() -> None:
    other = elsewhere(path())
    other[::2] = np.nan
    found = agreement(path(), other, 0.0)
    assert found is not None and found.cameras == N // 2
    assert found.turn_deg < 1e-6 and found.place_share < 1e-9


def test_another_turn_and_another_way_are_told_in_degrees_and_shares() -> None:
    turned = path()
    turned[:, :3, :3] @= Rotation.from_rotvec(np.deg2rad(6) * (TIME > 0.5) * [1, 0, 0]).as_matrix()
    found = agreement(path(), elsewhere(turned), 0.0)
    assert found is not None and found.turn_deg == pytest.approx(3.0, abs=0.01)
    bowed = path()
    bowed[:, 2, 3] += 0.4 * np.sin(np.pi * TIME[:, 0])
    found = agreement(path(), elsewhere(bowed), 0.0)
    spread = 0.4 * np.sin(np.pi * TIME[:, 0]).std() / 2.0
    assert found is not None and found.place_share == pytest.approx(spread, rel=0.03)
    backward = path()
    backward[:, :3, 3] *= -1
    found = agreement(path(), backward, 0.0)
    assert found is not None and found.place_share > 0.25


def test_a_camera_that_hardly_travels_need_not_have_a_path() -> None:
    rng = np.random.default_rng(0)
    shaky = [path() for _ in range(2)]
    for cameras in shaky:
        cameras[:, :3, 3] = rng.normal(0, 0.01, (N, 3))
    points = rng.normal([0.0, 0.0, 10.0], 0.1, (500, 3))
    least = least_extent(shaky[0], points, 0.1)
    assert least == pytest.approx(1.0, rel=0.05) and least_extent(shaky[0], points[:0], 0.1) == 0
    found = agreement(*shaky, least)
    assert found is not None and found.place_share < 0.03
    found = agreement(*shaky, 0.0)
    assert found is not None and found.place_share > 0.1


def test_too_few_common_cameras_say_nothing() -> None:
    few = path()
    few[3:] = np.nan
    assert agreement(path(), few, 0.0) is None
