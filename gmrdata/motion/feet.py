"""Corrections of ankles and toes: a flat foot of the source becomes a flat foot of the body."""

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.body.tree import JOINT
from gmrdata.motion.rest_pose import minimal_rotation

PLANTED_M_PER_S = 0.2
"""A foot counts as standing while its ankle and its toe joint are slower."""
SHORTEST_STAND_S = 0.1
LARGEST_SPREAD_DEG = 15.0
"""Quartile distance of the pitch of standing feet, beyond which it says nothing about flat ones."""
LARGEST_PITCH_DEG = 20.0
SMALLEST_SPLAY_DEG = 8.0
LARGEST_SPLAY_MISMATCH_DEG = 4.0

SIDES = ("left", "right")


def foot_corrections(
    rest_joints_m: np.ndarray,
    toe_tips_m: np.ndarray,
    body_rest_joints_m: np.ndarray,
    rotations: Mapping[int, np.ndarray],
    positions_m: Mapping[int, np.ndarray],
    fps_hz: float,
) -> tuple[dict[int, np.ndarray], float]:
    """C of the ankle and foot joints.

    Args:
        rest_joints_m: (24, 3) zero pose of the source in rest axes (x left, y up, z front) [m].
        toe_tips_m: (2, 3) toe tip relative to the toe joint in the zero pose, left and right [m];
            NaN where unknown.
        body_rest_joints_m: (24, 3) rest joints of the body, whose soles are level [m].
        rotations: `{SMPL joint: (T, 3, 3)}` G of the ankles and toe joints that the source has.
        positions_m: `{SMPL joint: (T, 3)}` their positions [m], y up.
        fps_hz: Frame rate [Hz].

    Returns:
        `{SMPL joint: (3, 3)}` for the ankles and feet, and the pitch of a flat foot relative to the
        zero pose that was found in the motion [deg].
    """
    flat = {
        side: _flat_frame(rest_joints_m, body_rest_joints_m, tip, side)
        for side, tip in zip(SIDES, toe_tips_m, strict=True)
    }
    pitches_deg = {
        part: _planted_pitch_deg(part, flat, rotations, positions_m, fps_hz)
        for part in ("ankle", "foot")
    }
    corrections = {}
    for side in SIDES:
        frame = flat[side]
        unturned = _heading(_foot_bone(body_rest_joints_m, side)).T
        for part, pitch_deg in pitches_deg.items():
            level = Rotation.from_euler("x", pitch_deg, degrees=True).as_matrix()
            corrections[JOINT[f"{side}_{part}"]] = frame @ level @ unturned
    return corrections, pitches_deg["ankle"]


def _foot_bone(rest_joints_m: np.ndarray, side: str) -> np.ndarray:
    """Ankle to toe joint (3,) [m]."""
    bone = rest_joints_m[JOINT[f"{side}_foot"]] - rest_joints_m[JOINT[f"{side}_ankle"]]
    return np.asarray(bone)


def _heading(bone: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) about y that takes z to a bone's horizontal direction."""
    return np.asarray(Rotation.from_euler("y", np.arctan2(bone[0], bone[2])).as_matrix())


def _flat_frame(
    rest_joints_m: np.ndarray, body_rest_joints_m: np.ndarray, toe_tip_m: np.ndarray, side: str
) -> np.ndarray:
    """Axes of a foot in the zero pose, (3, 3): x sideways, y off the floor, z to the toes."""
    bone = _foot_bone(rest_joints_m, side)
    if not np.all(np.isfinite(bone)):  # no toe joint: as the body's
        return _heading(_foot_bone(body_rest_joints_m, side))
    leg = rest_joints_m[JOINT[f"{side}_ankle"]] - rest_joints_m[JOINT[f"{side}_hip"]]
    roll = _roll(leg, bone, toe_tip_m)
    return roll @ _heading(roll.T @ bone)


def _roll(leg: np.ndarray, foot_bone: np.ndarray, toe_bone: np.ndarray) -> np.ndarray:
    """How the zero pose tilts a foot sideways together with its leg: (3, 3), else identity.

    Only a clear splay counts, and only if the foot's own plane is tilted by the same angle: in a
    zero pose with flat feet, toes that point a little outwards tilt that plane, too.
    """
    splay_deg = np.rad2deg(np.arctan2(leg[0], -leg[1]))
    sideways = np.cross(toe_bone, foot_bone)
    if abs(splay_deg) < SMALLEST_SPLAY_DEG or not np.linalg.norm(sideways) > 0.0:
        return np.eye(3)
    tilt_deg = np.rad2deg(np.arctan2(sideways[1], np.hypot(sideways[0], sideways[2])))
    if abs(tilt_deg - splay_deg) > LARGEST_SPLAY_MISMATCH_DEG:
        return np.eye(3)
    return minimal_rotation(sideways * [1.0, 0.0, 1.0], sideways)


def _planted_pitch_deg(
    part: str,
    flat: Mapping[str, np.ndarray],
    rotations: Mapping[int, np.ndarray],
    positions_m: Mapping[int, np.ndarray],
    fps_hz: float,
) -> float:
    """Pitch of the foot's z axis, toes up, while it stands still; 0 where it can't be told."""
    pitches = []
    for side in SIDES:
        ankle, foot, joint = (JOINT[f"{side}_{p}"] for p in ("ankle", "foot", part))
        if ankle in positions_m and foot in positions_m:
            still = _is_slow(positions_m[ankle], fps_hz) & _is_slow(positions_m[foot], fps_hz)
            toes_up = (rotations[joint][still] @ flat[side][:, 2])[:, 1]
            pitches.append(np.rad2deg(np.arcsin(np.clip(toes_up, -1.0, 1.0))))
    found = np.concatenate(pitches) if pitches else np.empty(0)
    if found.size < SHORTEST_STAND_S * fps_hz:
        return 0.0
    lower, median, upper = np.percentile(found, [25, 50, 75])
    flat_feet = upper - lower <= LARGEST_SPREAD_DEG and abs(median) <= LARGEST_PITCH_DEG
    return float(median) if flat_feet else 0.0


def _is_slow(path_m: np.ndarray, fps_hz: float) -> np.ndarray:
    """(T,) bool: frames in which a point (T, 3) hardly moves."""
    return np.asarray(
        np.linalg.norm(np.gradient(path_m, axis=0), axis=1) * fps_hz < PLANTED_M_PER_S
    )
