"""What a skeleton's zero pose tells: axes, size, directions of bones, and whose skeleton it is.

`from_standing` tells a motion from a pose in which the person stands.  `own_shape` finds a skeleton
that is the body's own: whoever wrote such a file, its rotations are the body's own, so nothing is
corrected; what retargeting would find out about the feet from the motion is in them already.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gmrdata.read.source_motion import RestPose, SourceMotion, UpAxis, axis_of
from gmrdata.values.body import JOINT, JOINT_NAMES, N_JOINTS, PARENTS, BodyModel, leg_length_m
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.skinning import global_rotmats, joint_positions_m
from gmrdata.values.transforms import angles_deg, euler_rotmats, mean_rotation, smallest_rotation

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
BENT_DEG, LARGEST_HAND_DEG = 15.0, 75.0
"""From this angle off the body's on, a knee, elbow or hand is bent; below, its skeleton has another
form.  Beyond the second, what hangs on the wrist is no hand."""
LARGEST_TILT_DEG = 40.0  # how far a zero pose may lean or face away from the coordinate axes
BACKWARDS = 0.5  # of a foot's length


def check_size(rest_joints_m: np.ndarray, name: str) -> None:
    """See that a zero pose, (24, 3) [m], has human size and no limb without length."""
    leg_m = leg_length_m(rest_joints_m)
    if not SHORTEST_LEG_M <= leg_m <= LONGEST_LEG_M:
        raise BadMotionFile(
            f"{name}: in the present unit the legs are {leg_m:.4g} m long, so the unit is wrong. "
            "Leave --unit-m out, or give the file's metres per unit (0.01 centimetres, 1 metres, "
            "0.0254 inches, 0.056444 CMU)"
        )
    for start, end in LIMBS:
        if np.linalg.norm(rest_joints_m[end] - rest_joints_m[start]) < SHORTEST_LIMB_M:
            what = f"{JOINT_NAMES[start]} and {JOINT_NAMES[end]} coincide in the zero pose"
            raise BadMotionFile(f"{name}: {what}; give a --joint-map that names other joints")


def check_feet(rest_m: np.ndarray, name: str) -> None:
    """See that the feet of a zero pose (24, 3), z to the front of its left and up, point there."""
    feet_m = rest_m[pair("foot")] - rest_m[pair("ankle")]
    if (feet_m[:, 2] < -BACKWARDS * np.linalg.norm(feet_m, axis=1)).all():
        what = "the feet point backwards: left and right are exchanged, as in a left-handed file"
        remedy = "Export it with right-handed axes, or exchange left and right with --joint-map"
        raise BadMotionFile(f"{name}: {what}. {remedy}")


def pair(part: str) -> list[int]:
    """The left and the right joint of that name."""
    return [JOINT[f"left_{part}"], JOINT[f"right_{part}"]]


def middles(joints_m: np.ndarray, *parts: str) -> list[np.ndarray]:
    """Middles (..., 3) between left and right of some joints (..., 24, 3)."""
    return [joints_m[..., pair(part), :].mean(axis=-2) for part in parts]


def stands(rest_m: np.ndarray) -> bool:
    """Whether joints (24, 3) are those of a person who stands along the coordinate axes."""
    (hip_m, shoulder_m, ankle_m), left = (
        middles(rest_m, "hip", "shoulder", "ankle"),
        to_left(rest_m),
    )
    up, up_tilt_deg = nearest_axis(shoulder_m - hip_m)
    aside, left_tilt_deg = nearest_axis(left)
    tilt_deg = max(up_tilt_deg, left_tilt_deg, float(angles_deg(hip_m - ankle_m, up)))
    return bool(tilt_deg <= LARGEST_TILT_DEG and abs(up @ aside) < 0.5)


def source_from_rest_axes(rest_joints_m: np.ndarray) -> np.ndarray:
    """source_from_rest (3, 3), a rotation by multiples of 90 degrees.
    A body's rest axes are x left, y up, z front.  A file's up is y or z, and its front may be any
    axis; the zero pose of a person who stands shows which."""
    hip_m, shoulder_m = middles(rest_joints_m, "hip", "shoulder")
    up, left = nearest_axis(shoulder_m - hip_m)[0], nearest_axis(to_left(rest_joints_m))[0]
    return np.stack([left, up, np.cross(left, up)], axis=1)


def to_left(joints_m: np.ndarray) -> np.ndarray:
    """(..., 3) from the right hip to the left one of poses (..., 24, 3)."""
    return np.asarray(joints_m[..., JOINT["left_hip"], :] - joints_m[..., JOINT["right_hip"], :])


def arms_deg(rest_m: np.ndarray) -> np.ndarray:
    """(4,) how far the bones of the arms point above the level in a pose (24, 3) [deg]."""
    hip_m, shoulder_m = middles(rest_m, "hip", "shoulder")
    up = nearest_axis(shoulder_m - hip_m)[0]
    bones_m = np.array([rest_m[end] - rest_m[start] for start, end in ARMS])
    return np.asarray(np.rad2deg(np.arcsin(bones_m @ up / np.linalg.norm(bones_m, axis=1))))


def limb_corrections(
    source_rest_m: np.ndarray, body_rest_m: np.ndarray, source_hands_m: np.ndarray | None = None
) -> dict[int, np.ndarray]:
    """C (3, 3) of hips, knees, shoulders and elbows: turns the body's bone into the source's.

    Wrists and hands get the elbow's: in both rest poses they go on in the line of the forearm.  A
    knee, elbow or hand that the source's zero pose bends by more than `BENT_DEG` is bent after the
    bone above is turned.  Both zero poses are (24, 3) in rest axes [m], the source's hands (2, 3)
    left and right from the wrist; NaN: unknown.
    """
    limbs: dict[int, np.ndarray] = {}
    for start, end in LIMBS:
        own_m, source_m = (rest_m[end] - rest_m[start] for rest_m in (body_rest_m, source_rest_m))
        straight = limbs.get(PARENTS[start], np.eye(3))
        if angles_deg(straight @ own_m, source_m) < BENT_DEG:
            straight = np.eye(3)  # a thigh's twist, which is a guess, is not the shank's
        limbs[start] = smallest_rotation(straight @ own_m, source_m) @ straight
    hands, shortest_m = {}, SHORTEST_HAND * leg_length_m(source_rest_m)
    hands_m = np.full((2, 3), np.nan) if source_hands_m is None else source_hands_m
    for side, hand_m in zip(("left", "right"), hands_m, strict=True):
        elbow, wrist, hand = (JOINT[f"{side}_{part}"] for part in ("elbow", "wrist", "hand"))
        straight_m = limbs[elbow] @ (body_rest_m[hand] - body_rest_m[wrist])
        bent = np.linalg.norm(hand_m) > shortest_m  # False for NaN
        if bent and BENT_DEG < angles_deg(straight_m, hand_m) < LARGEST_HAND_DEG:
            hands[wrist] = smallest_rotation(straight_m, hand_m) @ limbs[elbow]
        hands[hand] = hands.setdefault(wrist, limbs[elbow])
    return limbs | hands


def nearest_axis(vector: np.ndarray) -> tuple[np.ndarray, float]:
    """The signed coordinate axis (3,) next to a vector, and the angle between them [deg]."""
    k = int(np.argmax(np.abs(vector)))
    axis = np.eye(3)[k] * (1.0 if vector[k] >= 0.0 else -1.0)
    return axis, float(angles_deg(vector, axis))


SPREAD_DEG = 20.0  # how far the arms of a T-pose are from the level
RAISED_DEG = 30.0  # above the level, from which arms are no pose to stand in but a rig's axes
LARGEST_HIPS_OFF_DEG = 20.0
MOST_APART = 0.02  # offset of one skeleton from that of another, over the length of all offsets
MANY_FRAMES = 200
TOLD_FROM = "turns told from"  # begins the note on a motion whose zero pose is none to stand in
USUAL_LEG_M, LIKELY_LEGS_M = 0.82, (0.5, 1.2)
"""Hip-knee-ankle of an adult, and of nearly all people whom somebody records."""


def in_metres(source: SourceMotion, joints: Mapping[int, int]) -> SourceMotion:
    """The same motion with legs of a person's length, where the reader's unit gives them another.

    The factor need not be exact: retargeting goes by the ratio of the legs.
    """
    leg_m = leg_length_m(zero_pose_m(source, joints))
    if LIKELY_LEGS_M[0] <= leg_m <= LIKELY_LEGS_M[1] or not 0.0 < leg_m < np.inf:
        return source
    grown = USUAL_LEG_M / leg_m
    return replace(
        source,
        offsets_m=source.offsets_m * grown,
        tips_m=source.tips_m * grown,
        translations_m=source.translations_m * grown,
        notes=(*source.notes, f"lengths x {grown:.4g}, as its legs have {leg_m:.3g} m"),
    )


ARMS_DEG: Mapping[RestPose, tuple[float, float]] = {
    "t": (-SPREAD_DEG, SPREAD_DEG),
    "a": (-75.0, -15.0),
    "arms_down": (-90.0, -55.0),
    "arms_up": (RAISED_DEG, 90.0),
}
"""How far the arms point above the level in a zero pose that is said to be one of these [deg]."""


def from_standing(
    source: SourceMotion,
    joints: Mapping[int, int],
    body_rest_m: np.ndarray,
    name: str,
    rest: RestPose | Path | None = None,
    said_up: UpAxis | None = None,
) -> SourceMotion:
    """The same motion, told from a zero pose in which the person stands along the axes.

    The file's own zero pose counts if it stands, with arms that hang or are spread.  Others lie
    along their bones' axes (Rokoko, Bandai Namco, LAFAN1) or reach up (Geno), or their hips turn
    beside the pelvis's joint (deep-motion-editing): then it is SOMA's T-pose on that skeleton, else
    frame 0 if that is one, else the mean of the motion's poses, in which arms hang as they mostly
    do and the trunk is held as that of the body at rest, (24, 3).  `rest` says which it is: what
    the zero pose is, or the file whose first frame is `added_pose`, where the person stands.
    `said_up` is the axis that a person says is up.

    Raises:
        BadMotionFile: the person stands in none of these, or not as `rest` says.
    """
    rest_m = zero_pose_m(source, joints)
    if isinstance(rest, str) and rest in ARMS_DEG:
        _check_arms(rest_m, rest, name)
        return replace(source, notes=(*source.notes, f"zero pose given as {rest}"))
    likely = rest is None and stands(rest_m) and arms_deg(rest_m).max() < RAISED_DEG
    if likely and _hips_off_deg(source, joints, rest_m) < LARGEST_HIPS_OFF_DEG:
        return source
    given = rest == "first_frame" or isinstance(rest, Path)
    up = _up_axis(source, joints) if said_up is None else axis_of(said_up)
    aside = np.eye(3)[1 if up[0] else 0]
    axes = np.stack([aside, up, np.cross(aside, up)], axis=1)
    for pose, said in _first_poses(source, rest):
        standing = _told_from(source, joints, pose, up, axes)
        rest_m = zero_pose_m(standing, joints)
        if stands(rest_m) and (given or np.abs(arms_deg(rest_m)).max() < SPREAD_DEG):
            return replace(standing, notes=(*source.notes, f"{TOLD_FROM} {said}"))
    if given:
        what = "the person does not stand upright in the first frame that --rest-pose names"
        raise BadMotionFile(f"{name}: {what}; leave --rest-pose out, or give another")
    rotmats = source.local_rotmats
    mean = np.stack([mean_rotation(rotmats[:, joint]) for joint in range(len(source.parents))])
    standing = _told_from(source, joints, mean, None, axes @ _frame(body_rest_m, None))
    if stands(zero_pose_m(standing, joints)):
        return replace(standing, notes=(*source.notes, f"{TOLD_FROM} the mean pose"))
    raise BadMotionFile(f"{name}: {NOWHERE_STANDING}")


NOWHERE_STANDING = (
    "the person stands (hips sideways, legs below, trunk above) neither with all rotations zero, "
    "nor in frame 0, nor in the mean of all frames, so it can't be told what the rotations mean; "
    "export the motion with a T-pose as its rest pose or its first frame, or give --rest-pose: a "
    "file of the same skeleton that begins with one"
)


def _first_poses(
    source: SourceMotion, rest: RestPose | Path | None
) -> list[tuple[np.ndarray, str]]:
    """Local rotations (J, 3, 3) in which the person may stand, and what they are.

    A rest pose that the reader dropped is the file's frame 0.  Where nobody says that the person
    stands there, the first frame of the recording may be a T-pose as well.
    """
    if rest in (None, "along_axes") and set(SOMA_T_DEG) <= set(source.names):
        return [(_soma_t_pose(source), "SOMA's T-pose")]
    added, recorded = source.added_pose, source.local_rotmats[0]
    first = recorded if added is None else added
    if isinstance(rest, Path):
        return [(first, "the first frame of rest_pose's file")]
    if rest == "first_frame":
        return [(first, "frame 0")]
    later = [] if added is None else [(recorded, f"frame {source.first_row}, a T-pose")]
    return [(first, "frame 0, a T-pose"), *later]


SOMA_T_DEG = {
    "Hips": (90, 0.2, 90), "Spine1": (90, 0.2, 90), "Spine2": (90, 6.2, 90), "Chest": (90, 0.2, 90),
    "Neck1": (90, -16.6, 90), "Head": (90, 6.7, 90), "LeftShoulder": (0, 20.2, 90),
    "LeftArm": (0, 0, 90), "LeftHand": (0, 0, 99.7), "LeftLeg": (-90, 1.1, -90),
    "LeftShin": (-90, 4.7, -90), "LeftFoot": (-90, -69.1, -90), "LeftToeBase": (-90, -73.8, -90),
}  # fmt: skip
"""How joints of SOMA's skeleton, whose BVH lies along its bones, are turned in its T-pose about z,
y and x [deg] (nv-tlabs/kimodo, assets/skeletons/somaskel77); others as their parents."""


def _soma_t_pose(source: SourceMotion) -> np.ndarray:
    """(J, 3, 3) local rotations; those of the right are mirrored, with x against the bone."""
    above, pose = [np.eye(3)], []
    for name, parent in zip(source.names, source.parents, strict=True):
        turned = above[parent + 1]
        if (left := name.replace("Right", "Left")) in SOMA_T_DEG:
            z, y, x = map(float, SOMA_T_DEG[left])
            angles_deg = (z, y, x) if left == name else (-z, -y, x + 180)
            turned = euler_rotmats("ZYX", np.array(angles_deg))
        pose.append(above[parent + 1].T @ turned)
        above.append(turned)
    return np.array(pose)


def _check_arms(rest_m: np.ndarray, said: RestPose, name: str) -> None:
    """See that a zero pose (24, 3) is the one that a person says it is."""
    if not stands(rest_m):
        what = f"with all rotations zero the person does not stand, so that is no pose {said!r}"
        raise BadMotionFile(f"{name}: {what}; give along_axes, or leave --rest-pose out")
    arms, (least, most) = float(arms_deg(rest_m).mean()), ARMS_DEG[said]
    if not least <= arms <= most:
        what = f"the arms of the zero pose point {arms:+.0f} degrees above the level"
        raise BadMotionFile(f"{name}: {what}, so it is no pose {said!r}; give another --rest-pose")


def pose_of(rest: SourceMotion, source: SourceMotion, name: str) -> np.ndarray:
    """(J, 3, 3) first pose of another file, for the joints of this one."""
    known = set(rest.names)
    if missing := [joint for joint in source.names if joint not in known]:
        what = f"the file of --rest-pose has no joint {missing[0]}"
        raise BadMotionFile(f"{name}: {what}; give one of the same skeleton")
    rows = [rest.names.index(joint) for joint in source.names]
    both = rest.offsets_m[rows[1:]], source.offsets_m[1:]
    a, b = (offsets_m / np.linalg.norm(offsets_m) for offsets_m in both)  # of any unit
    apart = np.linalg.norm(a - b, axis=1)
    if apart.max(initial=0.0) > MOST_APART:
        worst = source.names[int(apart.argmax()) + 1]
        what = f"the offset of {worst} is another in the file of --rest-pose"
        raise BadMotionFile(f"{name}: {what}; give one of the same skeleton")
    return rest.local_rotmats[0][rows]


def _hips_off_deg(source: SourceMotion, joints: Mapping[int, int], rest_m: np.ndarray) -> float:
    """How far the hips are turned beside the pelvis's joint from where the zero pose has them."""
    frames, places_m = source.posed(some_rows(source.n_frames))
    turned = frames[:, joints[JOINT["pelvis"]]]
    return float(angles_deg(to_left(joints_of(places_m, joints)), turned @ to_left(rest_m)).mean())


def zero_pose_m(source: SourceMotion, joints: Mapping[int, int]) -> np.ndarray:
    """(24, 3) SMPL's joints in the zero pose of a source [m]; NaN where it has none."""
    return joints_of(source.rest_joints_m(), joints)


def joints_of(values: np.ndarray, bones: Mapping[int, int]) -> np.ndarray:
    """Values (..., B, 3) of bones as values (..., 24, 3) of joints; NaN where there is no bone."""
    joints = np.full((*values.shape[:-2], N_JOINTS, 3), np.nan)
    joints[..., list(bones), :] = values[..., list(bones.values()), :]
    return joints


def _up_axis(source: SourceMotion, joints: Mapping[int, int]) -> np.ndarray:
    """The signed coordinate axis (3,) along which the trunk is held over the motion."""
    rows = some_rows(source.n_frames)
    hips_m, shoulders_m = middles(source_joints_m(source, joints, rows), "hip", "shoulder")
    return nearest_axis(np.median(shoulders_m - hips_m, axis=0))[0]


def some_rows(n_frames: int) -> np.ndarray:
    """Rows that are enough to see how a motion is."""
    return np.linspace(0, n_frames - 1, min(n_frames, MANY_FRAMES)).astype(np.int64)


def source_joints_m(
    source: SourceMotion, joints: Mapping[int, int], rows: np.ndarray
) -> np.ndarray:
    """(N, 24, 3) places of SMPL's joints in some frames of a source [m]; NaN where it has none."""
    return joints_of(source.posed(rows)[1], joints)


def _frame(joints_m: np.ndarray, up: np.ndarray | None) -> np.ndarray:
    """Axes (3, 3) of a pose (24, 3): left by the hips, up given or by the trunk, and front."""
    left = to_left(joints_m)
    hips_m, shoulders_m = middles(joints_m, "hip", "shoulder")
    front = np.cross(left, shoulders_m - hips_m if up is None else up)
    upright = np.cross(front, left) if up is None else up
    axes = np.stack([np.cross(upright, front), upright, front], axis=1)
    return np.asarray(axes / np.linalg.norm(axes, axis=0))


def _below(joint: int, parents: Sequence[int]) -> list[int]:
    """A joint and all that hang on it."""
    branch = [joint]
    for child in range(joint + 1, len(parents)):
        if parents[child] in branch:
            branch.append(child)
    return branch


def _told_from(
    source: SourceMotion,
    joints: Mapping[int, int],
    pose: np.ndarray,
    up: np.ndarray | None,
    axes: np.ndarray,
) -> SourceMotion:
    """The same motion with local rotations `pose` (J, 3, 3) for its zero pose, set along `axes`."""
    turned = global_rotmats(source.parents, pose[None])
    joints_m = joints_of(joint_positions_m(source.parents, turned, source.offsets_m)[0], joints)
    zero = axes @ _frame(joints_m, up).T @ turned[0]
    if up is None and JOINT["spine1"] in joints:
        # The mean pose of a dance may be twisted: shoulders are set over the hips.
        line = joints_m[JOINT["left_shoulder"]] - joints_m[JOINT["right_shoulder"]]
        untwist = smallest_rotation(axes @ _frame(joints_m, up).T @ line, axes[:, 0])
        trunk = _below(joints[JOINT["spine1"]], source.parents)
        zero[trunk] = untwist @ zero[trunk]
    above = np.concatenate([np.eye(3)[None], zero])[np.array(source.parents) + 1]
    return replace(
        source,
        offsets_m=np.einsum("jkl,jl->jk", above, source.offsets_m),
        tips_m=np.einsum("jkl,jl->jk", zero, source.tips_m),
        translations_m=np.einsum("jkl,tjl->tjk", above, source.translations_m),
        local_rotmats=above @ source.local_rotmats @ zero.swapaxes(1, 2),
        added_pose=None,  # its frames are not these
    )


SAME_M = 1e-4
"""How far a joint of the zero pose may be from the body's."""
MOST_COEFFICIENTS = 16
"""Of a shape that is looked for: 69 numbers of a skeleton must not be free to fit any other."""


def own_shape(
    source: SourceMotion,
    joints: Mapping[int, int],
    body: BodyModel,
    shape: np.ndarray | None = None,
) -> np.ndarray | None:
    """(S,) the shape in which the body's rest pose is the source's zero pose; None for another's.

    It is `shape` or none where that is given.  Else least squares find it, since rest joints are
    linear in it; coefficients that move no joint are zero.
    """
    if len(joints) < N_JOINTS or not _is_same_tree(source, joints):
        return None
    zero_m = zero_pose_m(source, joints)
    found_m = _from_pelvis(zero_m @ source_from_rest_axes(zero_m))
    for tried in (np.zeros(body.n_shape), _fitted(body, found_m)) if shape is None else (shape,):
        offsets_m = found_m - _from_pelvis(body.rest_joints_m(tried))
        if np.abs(offsets_m).max() <= SAME_M:
            return tried
    return None


def _fitted(body: BodyModel, found_m: np.ndarray) -> np.ndarray:
    """The shape (S,) whose rest joints (24, 3) are nearest, all seen from the pelvis."""
    shape = np.zeros(body.n_shape)
    directions_m = _from_pelvis(body.joint_shape_dirs_m[..., :MOST_COEFFICIENTS])
    offsets_m = found_m - _from_pelvis(body.joints_template_m)
    columns_m = directions_m.reshape(offsets_m.size, -1)
    fitted = np.linalg.lstsq(columns_m, offsets_m.ravel(), rcond=1e-6)[0]
    shape[: len(fitted)] = fitted
    return shape


def _is_same_tree(source: SourceMotion, joints: Mapping[int, int]) -> bool:
    """Whether joints hang on each other as the body's do, and none moves but by turning."""
    below = range(1, N_JOINTS)
    if any(source.parents[joints[joint]] != joints[PARENTS[joint]] for joint in below):
        return False
    rows = [joints[joint] for joint in below]
    moves_m = source.translations_m[:, rows] - source.offsets_m[rows]
    return bool(np.abs(moves_m).max() <= SAME_M)


def _from_pelvis(joints_m: np.ndarray) -> np.ndarray:
    return np.asarray(joints_m - joints_m[:1])
