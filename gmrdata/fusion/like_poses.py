"""What cameras show of a network's error in one pose, taken where a like pose comes unseen.

A walker takes many steps, and a network errs alike in each of them.  So its error where cameras see
the person is carried over to where they don't, by how like the poses are: by Gaussian process
regression (Rasmussen & Williams 2006, eq. 2.25), whose mean scipy's radial basis functions give.
Each pose tells of its mirror image, too.
"""

from dataclasses import replace

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial.transform import Rotation

from gmrdata.fusion.fusion import SeenMotions, SeenPoses
from gmrdata.values.body import MIRROR, MIRRORED, BodyModel
from gmrdata.values.motion import Motion, without_root

LIKE_M = 0.5
"""Length over which poses lose their likeness: of all joints' differences in place and speed."""
SPEED_S = 0.2  # a difference in speed counts as what it makes in this time
OVER_S = 0.1  # speeds are means over as long before and after
UNLIKE = 0.3  # variance of the part of the error that does not repeat, over that of what does
MOST_LIKE = 150  # the nearest seen motions that an unseen one is compared with, mirrored ones too
FEWEST_SEEN = 10  # motions between seen poses, below which nothing is carried over
ACROSS = np.array(MIRROR)


def corrected_by_like_poses(
    body: BodyModel, motion: Motion, motions: SeenMotions, seen: SeenPoses
) -> SeenMotions:
    """Motions that no camera sees, less the network's error in like poses that cameras see.

    Motions between seen poses stay as they are: there the graph has the cameras themselves.
    """
    both = seen.known[:-1] & seen.known[1:]
    if both.sum() < FEWEST_SEEN or both.all():
        return motions
    errors, noise = _seen_errors(motions, seen, both, motion.fps_hz)
    here, mirrored = _described(body, motion)
    known = np.concatenate([here[both], mirrored[both]])
    in_mirror = np.concatenate([-ACROSS, ACROSS])  # turns and steps: a turn's axis is no arrow
    known_errors = np.concatenate([errors, errors * in_mirror])
    found = np.empty((int((~both).sum()), 6))
    for part in (slice(0, 3), slice(3, 6)):
        carried = RBFInterpolator(
            known,
            known_errors[:, part],
            neighbors=min(MOST_LIKE, len(known)),
            smoothing=UNLIKE + noise[part].mean(),
            kernel="gaussian",
            epsilon=1 / (np.sqrt(2) * LIKE_M),
            degree=-1,
        )
        found[:, part] = carried(here[~both])
    turns, steps_m = motions.delta_rotmats.copy(), motions.delta_m.copy()
    turns[~both] = turns[~both] @ Rotation.from_rotvec(found[:, :3]).as_matrix()
    steps_m[~both] += found[:, 3:]
    return replace(motions, delta_rotmats=turns, delta_m=steps_m)


def _seen_errors(
    motions: SeenMotions, seen: SeenPoses, both: np.ndarray, fps_hz: float
) -> tuple[np.ndarray, np.ndarray]:
    """What the network's motions (N, 6) lack to those of the cameras, turn [rad] and step [m]; and
    the variance (6,) of the cameras' own noise in them, over that of the network's error."""
    rows = np.flatnonzero(both)
    to_root = seen.rotmats[rows].swapaxes(-1, -2)
    true_turns = to_root @ seen.rotmats[rows + 1]
    lacking = motions.delta_rotmats[rows].swapaxes(-1, -2) @ true_turns
    steps_m = (to_root @ (seen.pelvis_m[rows + 1] - seen.pelvis_m[rows])[..., None])[..., 0]
    errors = np.c_[Rotation.from_matrix(lacking).as_rotvec(), steps_m - motions.delta_m[rows]]
    place_m2 = np.trace(seen.place_covariance_m2[rows], axis1=1, axis2=2) / 3
    # Of the difference between two poses.
    noise = 2 * np.r_[[np.median(seen.turn_sigma_rad[rows] ** 2)] * 3, [np.median(place_m2)] * 3]
    own = np.median((motions.fast.sigma[rows] / fps_hz) ** 2, axis=0)
    return errors, noise / np.maximum(own, 1e-12)


def _described(body: BodyModel, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Poses at T-1 motions, and their mirror images: places of joints and speeds (T-1, n) [m]."""
    from gmrdata.values.skinning import motion_joints_m

    joints_m = motion_joints_m(body, without_root(motion))
    joints_m = joints_m - joints_m[:, :1]
    mirrored_m = joints_m[:, list(MIRRORED)] * ACROSS
    here, there = (
        _places_and_speeds(places_m.reshape(len(places_m), -1), motion.fps_hz)
        for places_m in (joints_m, mirrored_m)
    )
    return here, there


def _places_and_speeds(places_m: np.ndarray, fps_hz: float) -> np.ndarray:
    """(T-1, 2n) at the middle of each motion [m]."""
    rows, apart = np.arange(len(places_m)), max(1, round(OVER_S * fps_hz))
    before, after = (np.clip(rows + way * apart, 0, rows[-1]) for way in (-1, 1))
    speeds = (places_m[after] - places_m[before]) * fps_hz / (2 * apart)
    numbers = np.concatenate([places_m, SPEED_S * speeds], axis=1)
    return np.asarray((numbers[:-1] + numbers[1:]) / 2)
