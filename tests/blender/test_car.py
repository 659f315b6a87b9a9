"""A car that drives is rigid but for its wheels, which roll."""

import numpy as np
import pytest

from blender.places.car import car_things, moved_vertices_m
from blender.places.layout import mesh_of
from gmrdata.film.walkers import CAR_SIZE_M, WHEEL_RADIUS_M, Drive
from gmrdata.values.transforms import apply, invert, rigid

ALONG_Y = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def drive(driven_m: np.ndarray) -> Drive:
    places_m = np.array([3.0, -2.0, 0.0]) + driven_m[:, None] * ALONG_Y[:, 0]
    return Drive(rigid(ALONG_Y, places_m), driven_m, np.array([3.0, -2.0]))


def test_its_size_is_what_is_planned_with():
    rng = np.random.default_rng(0)
    parts = [mesh_of(thing, rng).vertices_m for thing in car_things(np.zeros(2), 0.0, rng)]
    low, high = np.concatenate(parts).min(axis=0), np.concatenate(parts).max(axis=0)
    np.testing.assert_allclose(high - low, CAR_SIZE_M, atol=1e-9)
    np.testing.assert_allclose([*(low + high)[:2], low[2]], 0.0, atol=1e-9)


def test_the_body_is_rigid_and_the_wheels_roll_without_sliding():
    driven_m = np.array([-1.0, 0.0, 0.001, np.pi * WHEEL_RADIUS_M])
    centre_m = np.array([1.25, 0.8, WHEEL_RADIUS_M])
    up_m = np.array([0.0, 0.0, WHEEL_RADIUS_M])
    rest_m = np.array([[2.0, 0.5, 0.6], centre_m, centre_m - up_m])
    moved_m = moved_vertices_m(rest_m, [(slice(1, 3), centre_m)], drive(driven_m))
    car_m = apply(invert(drive(driven_m).world_from_car), moved_m)
    np.testing.assert_allclose(car_m[:, :2], np.tile(rest_m[:2], (4, 1, 1)), atol=1e-12)
    # Where the wheel touches the ground it stands still for a moment; half a turn later it is up.
    assert np.linalg.norm(moved_m[2, 2] - moved_m[1, 2]) < 1e-5
    np.testing.assert_allclose(car_m[3, 2], centre_m + up_m, atol=1e-12)
    # The top of a wheel goes ahead of its axle: a quarter turn on, what was behind is on top.
    behind_m = centre_m - [WHEEL_RADIUS_M, 0.0, 0.0]
    quarter = drive(np.array([0.0, np.pi / 2 * WHEEL_RADIUS_M]))
    turned_m = moved_vertices_m(behind_m[None], [(slice(0, 1), centre_m)], quarter)
    local_m = apply(invert(quarter.world_from_car), turned_m)
    np.testing.assert_allclose(local_m[1, 0], centre_m + up_m, atol=1e-12)


@pytest.mark.parametrize("yaw_rad", [0.0, 2.0])
def test_a_parked_car_is_the_same_turned(yaw_rad):
    one, two = (car_things(np.ones(2), yaw, np.random.default_rng(3)) for yaw in (0.0, yaw_rad))
    for a, b in zip(one, two, strict=True):
        assert a.solid == b.solid and a.size_m.tolist() == b.size_m.tolist()
        assert np.linalg.norm(a.centre_m - [1, 1, 0]) == pytest.approx(
            np.linalg.norm(b.centre_m - [1, 1, 0])
        )
