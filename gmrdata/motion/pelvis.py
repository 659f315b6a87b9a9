"""A skeleton that hangs on its head, chest, hand or foot, told from its pelvis instead."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from gmrdata.motion.rest_pose import pair, some_rows, zero_pose_m
from gmrdata.read.source_motion import SourceMotion
from gmrdata.values.body import JOINT, leg_length_m
from gmrdata.values.joint_names import line_to
from gmrdata.values.skinning import global_rotmats
from gmrdata.values.transforms import angles_deg

RIGID_M = 1e-3  # how far a joint may move in the frame of what carries it
TURNS_DEG = 2.0  # hips that turn more in the frame of a bone are not held by it
LONGEST_BONE = 0.6
"""Of the leg, from the pelvis to a joint of the trunk; a Reference joint is far, or moves."""
NO_TURN = "the root's frame is that of the bone it holds, so the file lacks the turn of"
"""Begins the note on a foot, hand or head that may be off by as much as it turns."""
_LIMBS = [*pair("hip"), *pair("shoulder")]


def on_pelvis(
    source: SourceMotion, joints: Mapping[int, int], find: Callable[[SourceMotion], dict[int, int]]
) -> tuple[SourceMotion, Mapping[int, int]]:
    """A skeleton and its joints `{SMPL joint: bone}`, with the pelvis where legs and trunk meet.

    Where the root is beyond that, or is a bone of the trunk with the legs' bone beside it, the
    skeleton is hung on the pelvis and the joints are looked for once more.  A Reference joint that
    carries both is no pelvis.
    """
    lines = [line_to(joints[limb], source.parents) for limb in _LIMBS]
    legs, parted = _shared(*lines[:2])[-1], _shared(_shared(*lines[:2]), _shared(*lines[2:]))[-1]
    chest, pelvis = _meeting(*lines[2:], lines[0]), _meeting(*lines[:2], lines[2])
    if parted in {chest, *(joints[limb] for limb in _LIMBS)} and pelvis != parted:
        hung = hung_on(source, pelvis)
        return hung, find(hung)
    if legs == parted or joints[JOINT["pelvis"]] != parted:
        return source, joints
    frames, places_m = source.posed(some_rows(source.n_frames))
    hips_m = places_m[:, joints[_LIMBS[0]]] - places_m[:, joints[_LIMBS[1]]]
    seen_m = np.einsum("tji,tj->ti", frames[:, parted], hips_m)
    if angles_deg(seen_m, seen_m.mean(axis=0)).max() < TURNS_DEG:
        return source, joints
    away_m = np.linalg.norm(places_m[:, parted] - places_m[:, legs], axis=1)
    leg_m = leg_length_m(zero_pose_m(source, joints))
    if np.ptp(away_m) > 0.1 * leg_m or away_m.max() > LONGEST_BONE * leg_m:
        return source, {**joints, JOINT["pelvis"]: legs}
    hung = hung_on(source, legs)
    return hung, find(hung)


def _shared(a: Sequence[int], b: Sequence[int]) -> list[int]:
    return [one for one, other in zip(a, b, strict=False) if one == other]


def _meeting(*lines: Sequence[int]) -> int:
    """The bone in which the ways between three bones meet: the lowest that two lines share."""
    a, b, c = lines
    return max((_shared(a, b), _shared(b, c), _shared(a, c)), key=len)[-1]


def hung_on(source: SourceMotion, pelvis: int) -> SourceMotion:
    """The same motion of a skeleton whose root is this bone.

    Bones on the way from the old root are turned round.  Such a bone keeps its frame if it holds
    the bone that now hangs on it; else it gets the frame that did, which was that of its child.
    """
    line = line_to(pelvis, source.parents)
    frames, places_m = source.posed()
    rest_m = source.rest_joints_m()
    parents = list(source.parents)
    framed = list(range(len(parents)))  # the bone whose frame each gets
    for above, below in pairwise(line):
        parents[above] = below
    parents[pelvis] = -1
    for below, bone in zip(line[1:-1], line[:-2], strict=True):
        bones_m = places_m[:, bone] - places_m[:, below]
        held_m = np.einsum("tji,tj->ti", frames[:, below], bones_m)
        if np.ptp(held_m, axis=0).max() > RIGID_M:
            framed[below] = bone
    turned = frames[:, framed]
    notes = (*source.notes, f"hung on {source.names[pelvis]} instead of {source.names[0]}")
    if np.any(turned[:, line[1]] != frames[:, line[1]]):
        notes += (f"{NO_TURN} {source.names[0]}",)
    order = sorted(range(len(parents)), key=lambda bone: len(line_to(bone, parents)))
    new = {bone: row for row, bone in enumerate(order)}
    over_bones = [max(parents[bone], 0) for bone in order]
    is_root = np.array([parents[bone] < 0 for bone in order])
    over = np.where(is_root[:, None, None], np.eye(3), turned[:, over_bones])
    starts_m = np.where(is_root[:, None], 0.0, places_m[:, over_bones])
    offsets_m = rest_m[order] - np.where(is_root[:, None], 0.0, rest_m[over_bones])
    added_pose = source.added_pose
    if added_pose is not None:
        posed = global_rotmats(source.parents, added_pose[None])[0, framed]
        over_added = np.where(is_root[:, None, None], np.eye(3), posed[over_bones])
        added_pose = over_added.swapaxes(-1, -2) @ posed[order]
    return replace(
        source,
        names=tuple(source.names[bone] for bone in order),
        parents=tuple(-1 if parents[bone] < 0 else new[parents[bone]] for bone in order),
        offsets_m=offsets_m,
        tips_m=source.tips_m[order],
        local_rotmats=over.swapaxes(-1, -2) @ turned[:, order],
        translations_m=np.einsum("tjlk,tjl->tjk", over, places_m[:, order] - starts_m),
        notes=notes,
        added_pose=added_pose,
    )
