"""The pose that a file's rotations are told from: one in which the person stands, in metres."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gmrdata.motion.rest_pose import (
    arms_deg,
    middles,
    nearest_axis,
    stands,
)
from gmrdata.read.source_motion import RestPose, SourceMotion
from gmrdata.values.body import JOINT, N_JOINTS, leg_length_m
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.skinning import global_rotmats, joint_positions_m
from gmrdata.values.transforms import angles_deg, mean_rotation, smallest_rotation

SPREAD_DEG = 20.0  # how far the arms of a T-pose are from the level
RAISED_DEG = 30.0  # above the level, from which arms are no pose to stand in but a rig's axes
LARGEST_HIPS_OFF_DEG = 20.0
MOST_APART = 0.02  # offset of one skeleton from that of another, over the length of all offsets
MANY_FRAMES = 200
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
    rest: RestPose | SourceMotion | None = None,
) -> SourceMotion:
    """The same motion, told from a zero pose in which the person stands along the axes.

    The file's own zero pose counts if it stands, with arms that hang or are spread.  Others lie
    along their bones' axes (Rokoko, Bandai Namco, LAFAN1) or reach up (Geno), or their hips turn
    beside the pelvis's joint (deep-motion-editing): then it is frame 0 if that is a T-pose, else
    the mean of the motion's poses, in which arms hang as they mostly do and the trunk is held as
    that of the body at rest, (24, 3).  `rest` says which it is: what the zero pose is, or a motion
    of the same skeleton whose first frame stands.

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
    given = rest == "first_frame" or isinstance(rest, SourceMotion)
    pose, said = source.local_rotmats[0], "frame 0" if given else "frame 0, a T-pose"
    if isinstance(rest, SourceMotion):
        pose, said = _pose_of(rest, source, name), "the first frame of rest_pose's file"
    up = _up_axis(source, joints)
    aside = np.eye(3)[1 if up[0] else 0]
    axes = np.stack([aside, up, np.cross(aside, up)], axis=1)
    standing = _told_from(source, joints, pose, up, axes)
    rest_m = zero_pose_m(standing, joints)
    if stands(rest_m) and (given or np.abs(arms_deg(rest_m)).max() < SPREAD_DEG):
        return replace(standing, notes=(*source.notes, f"turns told from {said}"))
    if given:
        what = "the person does not stand upright in the first frame that was given as rest_pose"
        raise BadMotionFile(f"{name}: {what}; leave rest_pose out, or give another")
    standing = _told_from(
        source, joints, _mean_pose(source), None, axes @ _frame(body_rest_m, None)
    )
    if stands(zero_pose_m(standing, joints)):
        return replace(standing, notes=(*source.notes, "turns told from the mean pose"))
    raise BadMotionFile(f"{name}: {NOWHERE_STANDING}")


NOWHERE_STANDING = (
    "the person stands (hips sideways, legs below, trunk above) neither with all rotations zero, "
    "nor in frame 0, nor in the mean of all frames, so it can't be told what the rotations mean; "
    "export the motion with a T-pose as its rest pose or its first frame, or give a rest_pose: a "
    "file of the same skeleton that begins with one"
)


def _mean_pose(source: SourceMotion) -> np.ndarray:
    """(J, 3, 3) the mean of a motion's local rotations."""
    rotmats = source.local_rotmats
    return np.stack([mean_rotation(rotmats[:, joint]) for joint in range(len(source.parents))])


def _check_arms(rest_m: np.ndarray, said: RestPose, name: str) -> None:
    """See that a zero pose (24, 3) is the one that a person says it is."""
    if not stands(rest_m):
        what = f"with all rotations zero the person does not stand, so that is no pose {said!r}"
        raise BadMotionFile(f"{name}: {what}; give along_axes, or leave rest_pose out")
    arms, (least, most) = float(arms_deg(rest_m).mean()), ARMS_DEG[said]
    if not least <= arms <= most:
        what = f"the arms of the zero pose point {arms:+.0f} degrees above the level"
        raise BadMotionFile(f"{name}: {what}, so it is no pose {said!r}; give another rest_pose")


def _pose_of(rest: SourceMotion, source: SourceMotion, name: str) -> np.ndarray:
    """(J, 3, 3) first pose of another file, for the joints of this one."""
    known = set(rest.names)
    if missing := [joint for joint in source.names if joint not in known]:
        what = f"the file of rest_pose has no joint {missing[0]}"
        raise BadMotionFile(f"{name}: {what}; give one of the same skeleton")
    rows = [rest.names.index(joint) for joint in source.names]
    both = rest.offsets_m[rows[1:]], source.offsets_m[1:]
    a, b = (offsets_m / np.linalg.norm(offsets_m) for offsets_m in both)  # of any unit
    apart = np.linalg.norm(a - b, axis=1)
    if apart.max(initial=0.0) > MOST_APART:
        worst = source.names[int(apart.argmax()) + 1]
        what = f"the offset of {worst} is another in the file of rest_pose"
        raise BadMotionFile(f"{name}: {what}; give one of the same skeleton")
    return rest.local_rotmats[0][rows]


def _hips_off_deg(source: SourceMotion, joints: Mapping[int, int], rest_m: np.ndarray) -> float:
    """How far the hips are turned beside the pelvis's joint from where the zero pose has them."""
    rows = some_rows(source.n_frames)
    joints_m = source_joints_m(source, joints, rows)
    lines = joints_m[:, JOINT["left_hip"]] - joints_m[:, JOINT["right_hip"]]
    turned = global_rotmats(source.parents, source.local_rotmats[rows])[:, joints[JOINT["pelvis"]]]
    at_rest = turned @ (rest_m[JOINT["left_hip"]] - rest_m[JOINT["right_hip"]])
    return float(angles_deg(lines, at_rest).mean())


def zero_pose_m(source: SourceMotion, joints: Mapping[int, int]) -> np.ndarray:
    """(24, 3) SMPL's joints in the zero pose of a source [m]; NaN where it has none."""
    rest_m = np.full((N_JOINTS, 3), np.nan)
    rest_m[list(joints)] = source.rest_joints_m()[list(joints.values())]
    return rest_m


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
    world_from_joint = global_rotmats(source.parents, source.local_rotmats[rows])
    all_m = joint_positions_m(source.parents, world_from_joint, source.translations_m[rows])
    joints_m = np.full((len(rows), N_JOINTS, 3), np.nan)
    joints_m[:, list(joints)] = all_m[:, list(joints.values())]
    return joints_m


def _frame(joints_m: np.ndarray, up: np.ndarray | None) -> np.ndarray:
    """Axes (3, 3) of a pose (24, 3): left by the hips, up given or by the trunk, and front."""
    left = joints_m[JOINT["left_hip"]] - joints_m[JOINT["right_hip"]]
    hips_m, shoulders_m = middles(joints_m, "hip", "shoulder")
    front = np.cross(left, shoulders_m - hips_m if up is None else up)
    upright = np.cross(front, left) if up is None else up
    axes = np.stack([np.cross(upright, front), upright, front], axis=1)
    return np.asarray(axes / np.linalg.norm(axes, axis=0))


def _below(joint: int, parents: Sequence[int]) -> list[int]:
    """A joint and all that hang on it."""
    found = [joint]
    for child in range(joint + 1, len(parents)):
        if parents[child] in found:
            found.append(child)
    return found


def _told_from(
    source: SourceMotion,
    joints: Mapping[int, int],
    pose: np.ndarray,
    up: np.ndarray | None,
    axes: np.ndarray,
) -> SourceMotion:
    """The same motion with local rotations `pose` (J, 3, 3) for its zero pose, set along `axes`."""
    turned = global_rotmats(source.parents, pose[None])
    posed_m = joint_positions_m(source.parents, turned, source.offsets_m)[0]
    joints_m = np.full((N_JOINTS, 3), np.nan)
    joints_m[list(joints)] = posed_m[list(joints.values())]
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
    )
