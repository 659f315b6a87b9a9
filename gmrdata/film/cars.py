"""Where cars drive: straight lines along one side of the place, clear of everyone."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gmrdata.film.walkers import FROM_CAMERA_M, PEOPLE_APART_M, Shot, no_way, place_in_sight
from gmrdata.values.transforms import rigid

CAR_SIZE_M = np.array([4.1, 1.82, 1.45])  # (3,) length, width over the wheels, height of a car [m]
WHEEL_RADIUS_M = 0.31
SPEEDS_M_PER_S = (3.0, 8.0)
HALF_DRIVE_M = 8.5
"""A car comes to rest this far from the middle of its way, so that it stays between the houses."""
BRAKING_M_PER_S2 = 4.5
CAR_SEEN = (0.1, 0.5)
"""Least share of the frames with a car's middle in the image, or this many seconds if less."""
BEHIND_M = 6.0
BESIDE_M = 5.0
CARS_APART_M = 0.8
TRIES = 3000


@dataclass(frozen=True, eq=False)
class Drive:
    """A car's way.  Its frame: x ahead, y to its left, z up, the origin on the ground below it."""

    world_from_car: np.ndarray  # (T, 4, 4) rigid transforms [m]
    driven_m: np.ndarray  # (T,) way from the middle of the drive [m]: what the wheels have turned
    middle_m: np.ndarray  # (2,) middle of the drive, world [m]

    @property
    def ahead(self) -> np.ndarray:
        """(2,) unit vector of its direction, world."""
        return np.asarray(self.world_from_car[0, :2, 0])

    @property
    def aside(self) -> np.ndarray:
        """(2,) unit vector to its left, world."""
        return np.array([-self.ahead[1], self.ahead[0]])

    @property
    def centres_m(self) -> np.ndarray:
        """(T, 3) middle of the body, world [m]."""
        return self.world_from_car[:, :3, 3] + [0.0, 0.0, CAR_SIZE_M[2] / 2]

    @property
    def ground_m(self) -> np.ndarray:
        """(N, 2) points of the lane it needs, its whole drive long [m]."""
        reach_m = HALF_DRIVE_M + CAR_SIZE_M[0] / 2
        along_m = np.linspace(-reach_m, reach_m, 41)
        middle_m = self.middle_m + along_m[:, None] * self.ahead
        return np.concatenate([middle_m + y * self.aside for y in (-0.5, 0.5)])


def way_driven_m(time_s: np.ndarray, speed_m_per_s: float) -> np.ndarray:
    """Way from the middle (T,) [m] at times before and after it [s], at constant speed but for a
    start from rest and a stop `HALF_DRIVE_M` from the middle."""
    braking_m = speed_m_per_s**2 / (2 * BRAKING_M_PER_S2)
    even_s = (HALF_DRIVE_M - braking_m) / speed_m_per_s
    since_s = np.abs(time_s)
    slow_s = np.clip(since_s - even_s, 0.0, speed_m_per_s / BRAKING_M_PER_S2)
    way_m = speed_m_per_s * (np.minimum(since_s, even_s) + slow_s)
    return np.sign(time_s) * (way_m - BRAKING_M_PER_S2 / 2 * slow_s**2)


def drive_past(
    name: str,
    shot: Shot,
    people_m: Sequence[np.ndarray],
    cars: Sequence[Drive],
    rng: np.random.Generator,
) -> Drive:
    """A drive across the first camera's line of sight, clear of everyone: paths (T, 3) and cars.

    It is parallel to the longer side of the area that everyone covers: a street runs along that.
    Where nothing can cross, as in a street that is filmed along its length, it passes beside.
    """
    walked_m = [path[:, :2] for path in (*shot.subjects_m, *people_m)]
    filmed_m = [camera.centres_world_m[:, :2] for camera in shot.cameras]
    covered_m = np.concatenate([*walked_m, *filmed_m, *(car.ground_m for car in cars)])
    axis = int(np.ptp(covered_m[:, 1]) > np.ptp(covered_m[:, 0]))
    for attempt in range(TRIES):
        drive = _sample_drive(shot, axis, 0.0 if attempt < TRIES // 2 else BESIDE_M, rng)
        sides_m = np.ptp(np.concatenate([covered_m, drive.ground_m]), axis=0)
        if (
            sides_m[axis] > sides_m[1 - axis] + 1.0
            and all(car_distance_m(drive, path).min() >= PEOPLE_APART_M for path in walked_m)
            and all(car_distance_m(drive, path).min() >= FROM_CAMERA_M for path in filmed_m)
            and all(_pass_each_other(drive, car) for car in cars)
            and shot.sees(drive.centres_m, *CAR_SEEN)
        ):
            return drive
    raise no_way(name, "a camera that moves less")


def car_distance_m(drive: Drive, path_m: np.ndarray) -> np.ndarray:
    """(T,) distance on the ground from the car's sides to a moving point (T, 2) [m]; 0 inside."""
    away_m = path_m - drive.world_from_car[:, :2, 3]
    local_m = np.abs(np.stack([away_m @ drive.ahead, away_m @ drive.aside], axis=-1))
    return np.asarray(np.linalg.norm(np.maximum(local_m - CAR_SIZE_M[:2] / 2, 0.0), axis=1))


def _sample_drive(shot: Shot, axis: int, beside_m: float, rng: np.random.Generator) -> Drive:
    """Through a place in sight, shifted by up to `beside_m` across the drive."""
    row = round(rng.uniform(0.2, 0.8) * (shot.n_frames - 1))
    middle_m, _ = place_in_sight(shot, row, CAR_SIZE_M[1] / 2, BEHIND_M, rng)
    middle_m[1 - axis] += rng.uniform(-beside_m, beside_m)
    heading_rad = axis * np.pi / 2 + np.pi * int(rng.integers(2))
    cos, sin = np.round(np.cos(heading_rad)), np.round(np.sin(heading_rad))
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    time_s = (np.arange(shot.n_frames) - row) / shot.fps_hz
    driven_m = way_driven_m(time_s, float(rng.uniform(*SPEEDS_M_PER_S)))
    places_m = np.append(middle_m, 0.0) + driven_m[:, None] * turn[:, 0]
    return Drive(rigid(turn, places_m), driven_m, middle_m)


def _pass_each_other(drive: Drive, other: Drive) -> bool:
    """Both are parallel to the same side of the place."""
    away_m = np.abs(drive.world_from_car[:, :2, 3] - other.world_from_car[:, :2, 3])
    along = int(abs(drive.ahead[1]) > 0.5)
    room_m = away_m[:, [along, 1 - along]] - CAR_SIZE_M[:2]
    return bool((room_m.max(axis=1) >= CARS_APART_M).all())
