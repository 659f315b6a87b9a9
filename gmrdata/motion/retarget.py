"""Retargeting: a motion on its own skeleton -> the 24-joint SMPL tree of a given body.

Let G_j(t) be the global rotation of a source joint away from the source's zero pose, written in the
body's rest axes (x left, y up, z front; the zero pose shows them), and W the turn from those axes
to the z-up world (+90 degrees about x, so that a standing person is as in AMASS).  The body's joint
gets the global rotation

    H_j(t) = W G_j(t) C_j

with a constant C_j that turns the body's rest pose into the source's zero pose at that joint:

- hip, knee, shoulder, elbow: the smallest rotation that takes the body's rest bone (thigh, shank,
  upper arm, forearm) to the source's, where it is bent after the bone above.  Bone directions then
  are the source's, always, and without twist: palms that look down in both rest poses still do.
- ankle, foot: the zero pose may splay the legs and roll the feet with them (CMU: 20 degrees).  That
  shows in the plane through ankle, toe joint and toe tip, which is upright in a flat foot, and is
  undone.  The heading of the body's ankle-to-toe bone is made the source's; its pitch is not, as
  that only tells how high the ankle sits.  What pitch a flat foot has is read from the frames in
  which a foot stands still (CMU's subjects differ by up to 15 degrees); without such frames the
  zero pose is flat.
- neck, head: CMU's zero pose looks up; its known pitch (`joint_names.CMU_UPRIGHT_PITCH_DEG`) is
  undone.
- wrist, hand: the elbow's, so that they go on in the line of the forearm; if the source's hand is
  bent in its zero pose, by a middle finger or a tip, so is the body's.
- pelvis, spine, collars: none.  Both rest poses hold them upright.

A file whose zero pose is the body's own rest pose has the body's rotations: nothing is corrected
then, and its world and shape are kept (`own_shape`).

The zero pose is one in which the person stands; a file whose own is none is told from another
(`rest_pose.from_standing`).

Local rotations are H_parent^T H_j.  Source joints that are not in the map (CMU's hip joints, extra
spine and neck joints) thus are merged, as G is global; SMPL joints that the source lacks follow
their parents.

The path: as leg directions are the source's, feet stand still where the source's do if the middle
of the hips moves as the source's does, times the ratio of the leg lengths (hip-knee-ankle, mean of
both sides).  That ratio is all that is kept of a subject's size.  Last, the soles are put on z = 0
(`ground`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath
from typing import NoReturn

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.motion import rest_pose
from gmrdata.motion.ground import FOOT_JOINTS, foot_corrections, levelled, motion_of
from gmrdata.motion.rest_pose import (
    from_standing,
    own_shape,
    some_rows,
    source_joints_m,
    zero_pose_m,
)
from gmrdata.motion.up_axis import turn_upright
from gmrdata.read.source_motion import RestPose, SourceMotion, UpAxis
from gmrdata.values.body import JOINT, N_JOINTS, PARENTS, WORLD_FROM_REST, BodyModel, leg_length_m
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import (
    global_rotmats,
    joint_positions_m,
    posed_joints_m,
    with_ancestors,
)
from gmrdata.values.transforms import angles_deg, between, smallest_rotation

_HIPS = tuple(rest_pose.pair("hip"))


@dataclass(frozen=True)
class Residual:
    """Angles between lines of a file's own joints and the same lines of the body that it drives."""

    mean_deg: Mapping[str, float]  # over frames, of "limbs", "hip line", "shoulder line", "trunk"
    worst_deg: Mapping[str, float]  # of the same

    @property
    def figures(self) -> dict[str, float]:
        """All angles by the names that they have in manifests."""
        kinds = {"mean": self.mean_deg, "worst": self.worst_deg}
        return {
            f"{line.replace(' ', '_')}_residual_deg_{kind}": angles_deg[line]
            for line in LARGEST_RESIDUAL_DEG
            for kind, angles_deg in kinds.items()
        }


@dataclass(frozen=True, eq=False)
class Retargeting:
    """What a person may say of how a source is put on a body."""

    shape: np.ndarray | None = None
    """(S,) shape coefficients of the body; without them those of the file's skeleton if that is the
    body's own, else its mean shape."""
    upright_pitch_deg: Mapping[str, float] = field(default_factory=dict)
    """`{SMPL joint name: forward pitch}` that joints of the source have while the person stands
    upright and looks ahead [deg], where that is not the zero pose."""
    rest: RestPose | Path | None = None
    """What the source's zero pose is, or the file of a pose that stands, the source's `added_pose`;
    without it that is looked for."""
    ground: bool | None = None
    """Whether the floor is levelled and moved to z = 0; None for all but a body's own motion."""
    up: UpAxis | None = None
    """The axis of the file's world that is up; without it that of the zero pose, unless what the
    person does shows another."""
    any_up: bool = False
    """Whether a motion of which that can't be told is read as it is, and not refused."""


def retarget(
    source: SourceMotion,
    joints: Mapping[int, int],
    body: BodyModel,
    said: Retargeting = Retargeting(),
    name: str = "motion",
) -> tuple[Motion, Residual]:
    """Put a source motion on a body, and measure how well it points its limbs.

    `joints` is `{SMPL joint: source joint}`, as `joint_names.find_joints` gives it.  `name` is the
    file's path in messages; the motion's `source` has its last part.
    """
    motion, residual, axes, is_own = _put_on(source, joints, body, said, name)
    world_from_file = WORLD_FROM_REST @ axes.T
    turning = turn_upright(body, motion, world_from_file, said.up, name, refused=not said.any_up)
    if turning is not None:  # once more, as the feet are told from how they stand
        turn, note = turning
        source = _turned(source, world_from_file.T @ turn @ world_from_file, note)
        motion, residual, _, is_own = _put_on(source, joints, body, replace(said, up=None), name)
    return levelled(body, motion, not is_own if said.ground is None else said.ground), residual


def _turned(source: SourceMotion, turn: np.ndarray, note: str) -> SourceMotion:
    """The same motion in a world turned by (3, 3)."""
    rotmats, translations_m = source.local_rotmats.copy(), source.translations_m.copy()
    rotmats[:, 0] = turn @ rotmats[:, 0]
    translations_m[:, 0] = translations_m[:, 0] @ turn.T
    added_pose = source.added_pose
    if added_pose is not None:
        added_pose = np.concatenate([turn @ added_pose[:1], added_pose[1:]])
    return replace(
        source,
        local_rotmats=rotmats,
        translations_m=translations_m,
        notes=(*source.notes, note),
        added_pose=added_pose,
    )


def _put_on(
    source: SourceMotion, joints: Mapping[int, int], body: BodyModel, said: Retargeting, name: str
) -> tuple[Motion, Residual, np.ndarray, bool]:
    """`retarget` as the zero pose has the world, not on the floor; also source_from_rest (3, 3),
    and whether the skeleton is the body's own."""
    own = own_shape(source, joints, body, said.shape) if said.rest is None else None
    shape = next((one for one in (own, said.shape) if one is not None), np.zeros(body.n_shape))
    shape = np.asarray(shape, dtype=np.float64)
    body_rest_m = body.rest_joints_m(shape)
    rest_pose.check_size(zero_pose_m(source, joints), name)
    if own is None:
        source = from_standing(source, joints, body_rest_m, name, said.rest, said.up)
    source_rest_m = zero_pose_m(source, joints)
    axes = rest_pose.source_from_rest_axes(source_rest_m)
    source_rest_m = source_rest_m @ axes
    rest_pose.check_feet(source_rest_m, name)
    world_from_joint = global_rotmats(source.parents, source.local_rotmats)
    paths_m = _paths_m(source, world_from_joint, joints, axes)
    corrections, feet_note = {}, "own skeleton"
    if own is None:
        feet_turned = {
            j: between(axes.T, world_from_joint[:, joints[j]], axes)
            for j in FOOT_JOINTS
            if j in joints
        }
        toe_tips_m, hands_m = _toe_tips_m(source, joints) @ axes, _hands_m(source, joints) @ axes
        feet, flat_pitch_deg = foot_corrections(
            source_rest_m, toe_tips_m, body_rest_m, feet_turned, paths_m, source.fps_hz
        )
        limbs = rest_pose.limb_corrections(source_rest_m, body_rest_m, hands_m)
        corrections = limbs | feet | _upright(said.upright_pitch_deg)
        feet_note = f"flat foot at {flat_pitch_deg:+.1f} deg"
    world_from_joint = _along_bones(source, world_from_joint, joints, name)
    local_rotmats = _local_rotmats(world_from_joint, joints, axes, corrections)
    scale = leg_length_m(body_rest_m) / leg_length_m(source_rest_m)
    pelvis_m = _pelvis_m(scale, paths_m, local_rotmats[:, 0], body_rest_m)
    motion = motion_of(body, shape, local_rotmats, pelvis_m, source.fps_hz, name)
    residual = _residual(source, joints, axes, body, motion)
    notes = [*source.notes, f"path x {scale:.4f}", feet_note, _in_words(residual)]
    motion = replace(motion, source=f"{PurePath(name).name}: {', '.join(notes)}")
    return motion, residual, axes, own is not None


def _upright(pitch_deg: Mapping[str, float]) -> dict[int, np.ndarray]:
    """What undoes the pitch that joints have in somebody upright, (3, 3) each."""
    return {
        JOINT[joint]: Rotation.from_euler("x", -forward_deg, degrees=True).as_matrix()
        for joint, forward_deg in pitch_deg.items()
    }


def _pelvis_m(
    scale: float, paths_m: Mapping[int, np.ndarray], roots: np.ndarray, body_rest_m: np.ndarray
) -> np.ndarray:
    """(T, 3) the pelvis whose hips' middle goes the source's way, enlarged by `scale` [m]."""
    middle_m = scale * sum(paths_m[hip] for hip in _HIPS) / len(_HIPS) @ WORLD_FROM_REST.T
    middle_from_pelvis_m = body_rest_m[list(_HIPS)].mean(axis=0) - body_rest_m[0]
    return np.asarray(middle_m - roots @ middle_from_pelvis_m)


def _paths_m(
    source: SourceMotion, world_from_joint: np.ndarray, joints: Mapping[int, int], axes: np.ndarray
) -> dict[int, np.ndarray]:
    """(T, 3) of the hips and of the joints of the feet, in the axes of a body at rest [m]."""
    wanted = {j: joints[j] for j in (*_HIPS, *FOOT_JOINTS) if j in joints}
    legs, parents = with_ancestors(source.parents, wanted.values())
    translations_m = source.translations_m[:, legs]
    source_m = joint_positions_m(parents, world_from_joint[:, legs], translations_m)
    return {j: source_m[:, legs.index(row)] @ axes for j, row in wanted.items()}


LARGEST_BEND_DEG = 15.0
"""How far a bone may mostly point aside from where its joint turns it, which soft joints do."""


def _along_bones(
    source: SourceMotion, world_from_joint: np.ndarray, joints: Mapping[int, int], name: str
) -> np.ndarray:
    """Global rotations (T, J, 3, 3) in which the limbs' joints follow their bones.

    A bone is where the joint at its end is.  That is not where its own joint turns it if the file
    moves the joints as well (Axis Neuron), or has others in between that bend.
    """
    turned = world_from_joint
    rows, rest_m = np.arange(source.n_frames), zero_pose_m(source, joints)
    bent = [limb for limb in rest_pose.LIMBS if _bends(source, joints, *limb)]
    joints_m = source_joints_m(source, joints, rows) if bent else np.empty(0)
    for start, end in bent:
        drawn_m = world_from_joint[:, joints[start]] @ (rest_m[end] - rest_m[start])
        bones_m = joints_m[:, end] - joints_m[:, start]
        off_deg = float(angles_deg(drawn_m, bones_m).mean())
        if not off_deg <= LARGEST_BEND_DEG:
            _refuse(name, "limbs", off_deg)
        turned = turned.copy() if turned is world_from_joint else turned
        turned[:, joints[start]] = smallest_rotation(drawn_m, bones_m) @ turned[:, joints[start]]
    return turned


def _bends(source: SourceMotion, joints: Mapping[int, int], start: int, end: int) -> bool:
    """Whether a limb's end moves against the joint at its start."""
    bone = joints[end]
    moves = source.translations_m[:, bone] - source.offsets_m[bone]
    return bool(source.parents[bone] != joints[start] or np.abs(moves).max() > 1e-6)


def _local_rotmats(
    source_rotmats: np.ndarray,
    joints: Mapping[int, int],
    axes: np.ndarray,
    corrections: Mapping[int, np.ndarray],
) -> np.ndarray:
    """(T, 24, 3, 3): the root's H and all others' H_parent^T H."""
    world_from_joint = np.empty((len(source_rotmats), N_JOINTS, 3, 3))
    local_rotmats = np.empty_like(world_from_joint)
    world_from_source = WORLD_FROM_REST @ axes.T
    for joint, parent in enumerate(PARENTS):
        own = above = world_from_joint[:, parent]
        if joint in joints:
            unturned = axes @ corrections.get(joint, np.eye(3))
            own = between(world_from_source, source_rotmats[:, joints[joint]], unturned)
        world_from_joint[:, joint] = own
        local_rotmats[:, joint] = own if parent < 0 else above.transpose(0, 2, 1) @ own
    return local_rotmats


LARGEST_RESIDUAL_DEG = {"limbs": 1.0, "hip line": 20.0, "shoulder line": 30.0, "trunk": 30.0}
"""Mean angle between the file's own lines and the body's, above which the file is misread."""


def _residual(
    source: SourceMotion,
    joints: Mapping[int, int],
    axes: np.ndarray,
    body: BodyModel,
    motion: Motion,
) -> Residual:
    """Mean and worst angle between lines of the file's joints and the same of the body.

    Raises:
        BadMotionFile: a line is off by more than the form of two skeletons explains.
    """
    rows = some_rows(source.n_frames)
    found_m = source_joints_m(source, joints, rows) @ axes @ WORLD_FROM_REST.T
    rest_m = body.rest_joints_m(motion.shape)
    posed_m, _ = posed_joints_m(rest_m, motion.rotmats[rows], motion.pelvis_m[rows], PARENTS)
    wanted, got = _lines(found_m), _lines(posed_m)
    mean_deg, worst_deg = {}, {}
    for line, most_deg in LARGEST_RESIDUAL_DEG.items():
        off_deg = angles_deg(wanted[line], got[line])
        mean_deg[line] = round(float(off_deg.mean()), 3)
        worst_deg[line] = round(float(off_deg.max()), 3)
        if not mean_deg[line] <= most_deg:
            _refuse(motion.source, line, mean_deg[line])
    return Residual(mean_deg, worst_deg)


def _refuse(name: str, line: str, off_deg: float) -> NoReturn:
    what = f"the {line} would be {off_deg:.1f} degrees off the file's own"
    why = "its joints turn in another way than their names say"
    raise BadMotionFile(f"{name}: {what}; {why}: give --joint-map or --rest-pose")


def _in_words(residual: Residual) -> str:
    said = [
        f"{line} {residual.mean_deg[line]:.1f} ({residual.worst_deg[line]:.1f})"
        for line in LARGEST_RESIDUAL_DEG
    ]
    return f"residual mean (worst) in deg: {', '.join(said)}"


def _lines(joints_m: np.ndarray) -> dict[str, np.ndarray]:
    """Bones and lines (T, N, 3) between joints (T, 24, 3)."""
    ends = {
        "limbs": rest_pose.LIMBS,
        "hip line": [(JOINT["right_hip"], JOINT["left_hip"])],
        "shoulder line": [(JOINT["right_shoulder"], JOINT["left_shoulder"])],
    }
    lines = {
        line: np.stack([joints_m[:, end] - joints_m[:, start] for start, end in pairs], axis=1)
        for line, pairs in ends.items()
    }
    hips_m, shoulders_m = rest_pose.middles(joints_m, "hip", "shoulder")
    return lines | {"trunk": (shoulders_m - hips_m)[:, None]}


def _toe_tips_m(source: SourceMotion, joints: Mapping[int, int]) -> np.ndarray:
    """(2, 3) left and right toe tip from the toe joint, in the source's axes; NaN if unknown."""
    tips_m = np.full((2, 3), np.nan)
    for row, joint in enumerate(rest_pose.pair("foot")):
        if joint in joints:
            toe = joints[joint]
            children = [child for child, parent in enumerate(source.parents) if parent == toe]
            tips_m[row] = source.offsets_m[children[0]] if children else source.tips_m[toe]
    return tips_m


def _hands_m(source: SourceMotion, joints: Mapping[int, int]) -> np.ndarray:
    """(2, 3) left and right hand in the zero pose, from the wrist, in the source's axes.

    To the middle finger where it is known, else to the middle of what hangs on the wrist but a
    thumb, else to the tip; NaN if unknown.
    """
    rest_m, hands_m = source.rest_joints_m(), np.full((2, 3), np.nan)
    for row, side in enumerate(("left", "right")):
        wrist, finger = joints[JOINT[f"{side}_wrist"]], joints.get(JOINT[f"{side}_hand"])
        ends = [child for child, parent in enumerate(source.parents) if parent == wrist]
        ends = [end for end in ends if "thumb" not in source.names[end].lower()]
        ends = ends if finger is None else [finger]
        if ends:
            hands_m[row] = rest_m[ends].mean(axis=0) - rest_m[wrist]
        else:
            hands_m[row] = source.tips_m[wrist]
    return hands_m
