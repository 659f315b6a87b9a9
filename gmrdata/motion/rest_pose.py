"""What a skeleton's zero pose tells: its axes, its size, the directions of its bones."""

import numpy as np

from gmrdata.values.body import JOINT, JOINT_NAMES
from gmrdata.values.errors import BadMotionFile

_LEG, _ARM = (("hip", "knee"), ("knee", "ankle")), (("shoulder", "elbow"), ("elbow", "wrist"))
LIMBS = tuple(
    (JOINT[f"{side}_{start}"], JOINT[f"{side}_{end}"])
    for side in ("left", "right")
    for start, end in (*_LEG, *_ARM)
)
"""(joint, end) of the eight bones whose directions retargeting keeps exactly."""
_LEGS = (*LIMBS[:2], *LIMBS[4:6])
SHORTEST_LEG_M, LONGEST_LEG_M = 0.3, 1.5
"""Hip-knee-ankle of a small child and more than that of the tallest person."""
SHORTEST_LIMB_M = 0.02
LARGEST_TILT_DEG = 40.0  # how far a zero pose may lean or face away from the coordinate axes


def leg_length_m(rest_joints_m: np.ndarray) -> float:
    """Hip-knee-ankle length, mean of both sides: (24, 3) rest joints -> metres."""
    bones_m = [rest_joints_m[end] - rest_joints_m[start] for start, end in _LEGS]
    return float(sum(np.linalg.norm(bone_m) for bone_m in bones_m) / 2)


def check_size(rest_joints_m: np.ndarray, name: str) -> None:
    """See that a zero pose, (24, 3) [m], has human size and no limb without length."""
    leg_m = leg_length_m(rest_joints_m)
    if not SHORTEST_LEG_M <= leg_m <= LONGEST_LEG_M:
        raise BadMotionFile(
            f"{name}: in the present unit the legs are {leg_m:.4g} m long, so the unit is wrong; "
            "give the file's metres per unit with unit_m (0.01 centimetres, 1 metres, 0.0254 "
            "inches, 0.056444 CMU)"
        )
    for start, end in LIMBS:
        if np.linalg.norm(rest_joints_m[end] - rest_joints_m[start]) < SHORTEST_LIMB_M:
            what = f"{JOINT_NAMES[start]} and {JOINT_NAMES[end]} coincide in the zero pose"
            raise BadMotionFile(f"{name}: {what}; give a joint_map that names other joints")


def source_from_rest_axes(rest_joints_m: np.ndarray, name: str) -> np.ndarray:
    """source_from_rest (3, 3), a rotation by multiples of 90 degrees.
    A body's rest axes are x left, y up, z front.  A file's up is y or z, and its front may be any
    axis; the zero pose shows which."""

    def both(part: str) -> np.ndarray:
        return np.asarray(rest_joints_m[[JOINT[f"left_{part}"], JOINT[f"right_{part}"]]])

    hip_m = both("hip").mean(axis=0)
    trunk, legs = both("shoulder").mean(axis=0) - hip_m, both("ankle").mean(axis=0) - hip_m
    up, up_tilt_deg = _nearest_axis(trunk)
    left, left_tilt_deg = _nearest_axis(-np.diff(both("hip"), axis=0)[0])
    legs_deg = _angle_deg(-legs, up)
    if max(up_tilt_deg, left_tilt_deg, legs_deg) > LARGEST_TILT_DEG or abs(up @ left) > 0.5:
        raise BadMotionFile(
            f"{name}: with all rotations zero the skeleton is not a person standing along the axes "
            "(hips sideways, legs below, trunk above), so its rotations can't be compared with a "
            "T-pose; export the motion again with the T-pose as rest pose"
        )
    return np.stack([left, up, np.cross(left, up)], axis=1)


def minimal_rotation(from_vector: np.ndarray, to_vector: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) by the smallest angle that turns one direction (3,) into another."""
    from scipy.spatial.transform import Rotation  # slow to load; who wants `LIMBS` needs none

    a = from_vector / np.linalg.norm(from_vector)
    b = to_vector / np.linalg.norm(to_vector)
    axis = np.cross(a, b)
    sine, cosine = np.linalg.norm(axis), a @ b
    angle_rad = np.arctan2(sine, cosine)
    if sine < 1e-12:  # any axis across does
        axis, angle_rad = np.cross(a, np.eye(3)[np.argmin(np.abs(a))]), np.pi * (cosine < 0.0)
    return np.asarray(Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle_rad).as_matrix())


def limb_corrections(source_rest_m: np.ndarray, body_rest_m: np.ndarray) -> dict[int, np.ndarray]:
    """C (3, 3) of hips, knees, shoulders and elbows: turns the body's rest bone into the source's.
    Both zero poses are (24, 3) in rest axes [m]."""
    poses_m = (body_rest_m, source_rest_m)
    return {a: minimal_rotation(*(rest_m[b] - rest_m[a] for rest_m in poses_m)) for a, b in LIMBS}


def _nearest_axis(vector: np.ndarray) -> tuple[np.ndarray, float]:
    """The signed coordinate axis (3,) next to a vector, and the angle between them [deg]."""
    k = int(np.argmax(np.abs(vector)))
    axis = np.eye(3)[k] * (1.0 if vector[k] >= 0.0 else -1.0)
    return axis, _angle_deg(vector, axis)


def _angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))
