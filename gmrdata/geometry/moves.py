"""Where a camera goes and where it looks: the parts that camera programmes are made of.

Azimuths are those of the direction from the middle of the subject's path to the camera.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.geometry.look_at import look_at
from gmrdata.geometry.subject_path import SubjectPath
from gmrdata.geometry.transforms import rigid

SLOWEST_M_PER_S = 0.3
"""Speed of a travelling camera whose subject stays in place."""


def station(
    subject: SubjectPath, azimuth_rad: float, distance_m: float, height_m: float
) -> np.ndarray:
    """A place (3,) for the camera, on the ground `distance_m` from the path's middle [m]."""
    place = subject.centre_m + distance_m * _direction(azimuth_rad)
    return np.array([place[0], place[1], height_m])


def at_rest(subject: SubjectPath, place_m: np.ndarray) -> np.ndarray:
    """Centres (T, 3) of a camera that stays at a place (3,) [m]."""
    return np.tile(place_m, (len(subject.time_s), 1))


def circle(
    subject: SubjectPath, middle_rad: float, rate_rad_per_s: float, radius_m: float, height_m: float
) -> np.ndarray:
    """Centres (T, 3) on a circle, at the azimuth `middle_rad` in the middle of the clip [m]."""
    angles_rad = middle_rad + rate_rad_per_s * subject.time_s
    return np.stack([station(subject, angle, radius_m, height_m) for angle in angles_rad])


def line(
    subject: SubjectPath,
    place_m: np.ndarray,
    along_rad: float,
    speed_m_per_s: float | None,
    share: float,
) -> np.ndarray:
    """Centres (T, 3) on a straight line through a place (3,) in the middle of the clip [m].

    Args:
        subject: The subject.
        place_m: The place, world [m].
        along_rad: Direction of the line; the camera takes the sense of it that goes with the
            subject.
        speed_m_per_s: Speed in that sense; None: `share` of the subject's along the line.
        share: See there.
    """
    along = _direction(along_rad)
    heading = _direction(subject.heading_rad)
    along = along if along @ heading >= 0 else -along
    if speed_m_per_s is None:
        own_m_per_s = share * subject.speed_m_per_s * float(along @ heading)
        speed_m_per_s = max(own_m_per_s, SLOWEST_M_PER_S)
    return np.asarray(place_m + speed_m_per_s * subject.time_s[:, None] * along)


def looking_ahead(subject: SubjectPath, centres_m: np.ndarray, place_m: np.ndarray) -> np.ndarray:
    """Cameras (T, 4, 4) of one orientation: from a place (3,) to the middle of the path."""
    return rigid(look_at(place_m, subject.centre_m), centres_m)


def following(subject: SubjectPath, centres_m: np.ndarray) -> np.ndarray:
    """Cameras (T, 4, 4) that turn to the subject."""
    return rigid(look_at(centres_m, subject.target_m), centres_m)


def held(
    subject: SubjectPath, world_from_cam: np.ndarray, drift_m: float, shake_deg: float
) -> np.ndarray:
    """Cameras (T, 4, 4) with a hand's unrest on them; the same for amplitudes of zero."""
    unsteady = world_from_cam.copy()
    if drift_m > 0:
        unsteady[:, :3, 3] += drift_m * subject.waves[:, :3]
    if shake_deg > 0:
        shake = Rotation.from_rotvec(np.deg2rad(shake_deg) * subject.waves[:, 3:])
        unsteady[:, :3, :3] = unsteady[:, :3, :3] @ shake.as_matrix()
    return unsteady


def _direction(angle_rad: float) -> np.ndarray:
    return np.array([np.cos(angle_rad), np.sin(angle_rad), 0.0])
