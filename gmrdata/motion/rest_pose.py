"""What a skeleton's zero pose tells: its axes, its size, the directions of its bones."""

import numpy as np

from gmrdata.values.body import JOINT, JOINT_NAMES, leg_length_m
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.transforms import angles_deg, smallest_rotation

_LEG, _ARM = (("hip", "knee"), ("knee", "ankle")), (("shoulder", "elbow"), ("elbow", "wrist"))
LIMBS = tuple(
    (JOINT[f"{side}_{start}"], JOINT[f"{side}_{end}"])
    for side in ("left", "right")
    for start, end in (*_LEG, *_ARM)
)
"""(joint, end) of the eight bones whose directions retargeting keeps exactly."""
ARMS = (*LIMBS[2:4], *LIMBS[6:])
SHORTEST_LEG_M, LONGEST_LEG_M = 0.3, 1.5
"""Hip-knee-ankle of a small child and more than that of the tallest person."""
SHORTEST_LIMB_M, SHORTEST_HAND = 0.02, 0.05
"""Of a limb [m], and of a hand over the leg; what is shorter shows no direction."""
HAND_DEG, LARGEST_HAND_DEG = 15.0, 75.0
"""Between these angles off the body's a hand is bent; below, its skeleton has another form; above,
what hangs on the wrist is no hand."""
LARGEST_TILT_DEG = 40.0  # how far a zero pose may lean or face away from the coordinate axes


def check_size(rest_joints_m: np.ndarray, name: str) -> None:
    """See that a zero pose, (24, 3) [m], has human size and no limb without length."""
    leg_m = leg_length_m(rest_joints_m)
    if not SHORTEST_LEG_M <= leg_m <= LONGEST_LEG_M:
        raise BadMotionFile(
            f"{name}: in the present unit the legs are {leg_m:.4g} m long, so the unit is wrong; "
            "leave unit_m out, or give the file's metres per unit (0.01 centimetres, 1 metres, "
            "0.0254 inches, 0.056444 CMU)"
        )
    for start, end in LIMBS:
        if np.linalg.norm(rest_joints_m[end] - rest_joints_m[start]) < SHORTEST_LIMB_M:
            what = f"{JOINT_NAMES[start]} and {JOINT_NAMES[end]} coincide in the zero pose"
            raise BadMotionFile(f"{name}: {what}; give a joint_map that names other joints")


def middles(joints_m: np.ndarray, *parts: str) -> list[np.ndarray]:
    """Middles (..., 3) between left and right of some joints (..., 24, 3)."""
    pairs = [[JOINT[f"left_{part}"], JOINT[f"right_{part}"]] for part in parts]
    return [joints_m[..., pair, :].mean(axis=-2) for pair in pairs]


def stands(rest_m: np.ndarray) -> bool:
    """Whether joints (24, 3) are those of a person who stands along the coordinate axes."""
    (hip_m, shoulder_m, ankle_m), left = middles(rest_m, "hip", "shoulder", "ankle"), _left(rest_m)
    up, up_tilt_deg = nearest_axis(shoulder_m - hip_m)
    aside, left_tilt_deg = nearest_axis(left)
    tilt_deg = max(up_tilt_deg, left_tilt_deg, float(angles_deg(hip_m - ankle_m, up)))
    return bool(tilt_deg <= LARGEST_TILT_DEG and abs(up @ aside) < 0.5)


def source_from_rest_axes(rest_joints_m: np.ndarray) -> np.ndarray:
    """source_from_rest (3, 3), a rotation by multiples of 90 degrees.
    A body's rest axes are x left, y up, z front.  A file's up is y or z, and its front may be any
    axis; the zero pose of a person who stands shows which."""
    hip_m, shoulder_m = middles(rest_joints_m, "hip", "shoulder")
    up, left = nearest_axis(shoulder_m - hip_m)[0], nearest_axis(_left(rest_joints_m))[0]
    return np.stack([left, up, np.cross(left, up)], axis=1)


def _left(rest_m: np.ndarray) -> np.ndarray:
    return np.asarray(rest_m[JOINT["left_hip"]] - rest_m[JOINT["right_hip"]])


def arms_deg(rest_m: np.ndarray) -> np.ndarray:
    """(4,) how far the bones of the arms point above the level in a pose (24, 3) [deg]."""
    hip_m, shoulder_m = middles(rest_m, "hip", "shoulder")
    up = nearest_axis(shoulder_m - hip_m)[0]
    bones_m = np.array([rest_m[end] - rest_m[start] for start, end in ARMS])
    return np.asarray(np.rad2deg(np.arcsin(bones_m @ up / np.linalg.norm(bones_m, axis=1))))


def limb_corrections(
    source_rest_m: np.ndarray, body_rest_m: np.ndarray, source_hands_m: np.ndarray | None = None
) -> dict[int, np.ndarray]:
    """C (3, 3) of hips, knees, shoulders and elbows: turns the body's rest bone into the source's.

    Wrists and hands get the elbow's: in both rest poses they go on in the line of the forearm.  A
    hand that the source's zero pose bends by more than `HAND_DEG` is bent so.  Both zero poses are
    (24, 3) in rest axes [m], the source's hands (2, 3) left and right from the wrist; NaN: unknown.
    """
    poses_m = (body_rest_m, source_rest_m)
    limbs = {a: smallest_rotation(*(rest_m[b] - rest_m[a] for rest_m in poses_m)) for a, b in LIMBS}
    hands, shortest_m = {}, SHORTEST_HAND * leg_length_m(source_rest_m)
    hands_m = np.full((2, 3), np.nan) if source_hands_m is None else source_hands_m
    for side, hand_m in zip(("left", "right"), hands_m, strict=True):
        elbow, wrist, hand = (JOINT[f"{side}_{part}"] for part in ("elbow", "wrist", "hand"))
        straight_m = limbs[elbow] @ (body_rest_m[hand] - body_rest_m[wrist])
        bent = np.linalg.norm(hand_m) > shortest_m  # False for NaN
        if bent and HAND_DEG < angles_deg(straight_m, hand_m) < LARGEST_HAND_DEG:
            hands[wrist] = smallest_rotation(straight_m, hand_m) @ limbs[elbow]
        hands[hand] = hands.setdefault(wrist, limbs[elbow])
    return limbs | hands


def nearest_axis(vector: np.ndarray) -> tuple[np.ndarray, float]:
    """The signed coordinate axis (3,) next to a vector, and the angle between them [deg]."""
    k = int(np.argmax(np.abs(vector)))
    axis = np.eye(3)[k] * (1.0 if vector[k] >= 0.0 else -1.0)
    return axis, float(angles_deg(vector, axis))
