"""Which bone of a rigged character stands for which joint of the SMPL tree."""

import re
from collections import Counter
from collections.abc import Container, Mapping, Sequence
from pathlib import Path

from gmrdata.values.body import JOINT, JOINT_NAMES, PARENTS
from gmrdata.values.errors import BadCharacter
from gmrdata.values.joint_names import CMU_ASF, CMU_BVH, MIXAMO, REQUIRED, is_cmu

SMPL = {name: name for name in JOINT_NAMES} | {
    re.sub("^left", "l", re.sub("^right", "r", name)): name for name in JOINT_NAMES
}
"""`left_hip` as in SMPL's papers and `L_Hip` as in its FBX files."""
_PREFIX = re.compile(r"^(.*:|mixamorig\d*_?|[mf]_avg_|def-)")
_SUFFIX = re.compile(r"[._]\d+$")


def _with_sides(middle: Mapping[str, str], sided: Mapping[str, str]) -> dict[str, str]:
    """`sided` has names with `{}` for the letter l or r, and joints without their side."""
    sides = {
        name.format(letter): f"{side}_{joint}"
        for side, letter in (("left", "l"), ("right", "r"))
        for name, joint in sided.items()
    }
    return {**middle, **sides}


UNREAL = _with_sides(
    {
        "pelvis": "pelvis", "spine_01": "spine1", "spine_02": "spine2", "spine_03": "spine3",
        "neck_01": "neck", "head": "head",
    },
    {
        "thigh_{}": "hip", "calf_{}": "knee", "foot_{}": "ankle", "ball_{}": "foot",
        "clavicle_{}": "collar", "upperarm_{}": "shoulder", "lowerarm_{}": "elbow",
        "hand_{}": "wrist", "middle_01_{}": "hand",
    },
)  # fmt: skip
"""The mannequin of Unreal Engine."""

RIGIFY = _with_sides(
    {
        "spine": "pelvis", "spine.001": "spine1", "spine.002": "spine2", "spine.003": "spine3",
        "spine.004": "neck", "spine.006": "head",
    },
    {
        "thigh.{}": "hip", "shin.{}": "knee", "foot.{}": "ankle", "toe.{}": "foot",
        "shoulder.{}": "collar", "upper_arm.{}": "shoulder", "forearm.{}": "elbow",
        "hand.{}": "wrist", "f_middle.01.{}": "hand",
    },
)  # fmt: skip
"""Blender's Rigify: its metarig, and its deforming bones with `DEF-` before the name."""


def _in_small_letters(*namings: Mapping[str, str]) -> tuple[dict[str, str], ...]:
    return tuple({name.casefold(): joint for name, joint in n.items()} for n in namings)


CMU_NAMINGS = _in_small_letters(CMU_BVH, CMU_ASF)
NAMINGS = _in_small_letters(MIXAMO, SMPL, UNREAL, RIGIFY)
"""`{bone: SMPL joint}`, in small letters."""


def find_bones(
    names: Sequence[str],
    parents: Sequence[int],
    joint_map: Mapping[str, str] | None,
    path: Path,
) -> dict[int, int]:
    """`{index of the SMPL joint: index of the bone}`: which bone drives with which joint.

    Args:
        names: The bones' names.  A namespace (`mixamorig:`), `DEF-`, and a number that a converter
            put behind each name (`mixamorig:Hips_01`) are overlooked, and so are capitals.
        parents: Index of each bone's parent, -1 for none.
        joint_map: `{bone: SMPL joint}` with exact names, or None for the known namings.

    Raises:
        BadCharacter: a joint that is needed has no bone, the map is wrong for this file, or the
            bones hang together in another way than the joints.
    """
    found = _by_name(names) if joint_map is None else _by_map(names, joint_map, path)
    missing = [joint for joint in REQUIRED if joint not in found]
    if missing:
        raise BadCharacter(
            f"{path}: no bone is known to be {', '.join(missing)}. Give a joint_map "
            f"{{bone: joint}} in the recipe, such as joint_map: {{{names[0] if names else 'Hips'}: "
            f"pelvis, ...}}. Its bones are {', '.join(names)}. The joints are {', '.join(JOINT)}"
        )
    bones = {JOINT[joint]: bone for joint, bone in found.items()}
    _check_tree(bones, names, parents, path)
    return dict(sorted(bones.items()))


def joint_of_bone(bones: Mapping[int, int], parents: Sequence[int]) -> list[int]:
    """The joint that each bone moves with: its own, or that of the nearest bone above that has one.

    Bones above and beside the pelvis move with the pelvis (0).
    """
    own = {bone: joint for joint, bone in bones.items()}
    return [own.get(_nearest(bone, parents, own), 0) for bone in range(len(parents))]


def _nearest(number: int, parents: Sequence[int], wanted: Container[int]) -> int:
    """A bone or joint, or the nearest one above it, that is wanted; -1 where none is."""
    while number >= 0 and number not in wanted:
        number = parents[number]
    return number


def _by_name(names: Sequence[str]) -> dict[str, int]:
    """`{joint: bone}` by the naming that knows most of the needed joints."""
    small = [_PREFIX.sub("", name.casefold()) for name in names]
    best: dict[str, int] = {}
    for plain in (small, [_SUFFIX.sub("", name) for name in small]):
        index = {name: bone for bone, name in reversed(list(enumerate(plain)))}
        for naming in CMU_NAMINGS if is_cmu(names) else NAMINGS:
            found = {joint: index[name] for name, joint in naming.items() if name in index}
            if _needed(found) > _needed(best):
                best = found
    return best


def _needed(found: Mapping[str, int]) -> int:
    return sum(joint in found for joint in REQUIRED)


def _by_map(names: Sequence[str], joint_map: Mapping[str, str], path: Path) -> dict[str, int]:
    unknown = [name for name in joint_map if name not in names]
    if unknown:
        raise BadCharacter(
            f"{path}: joint_map names the bones {', '.join(unknown)}, which it does not have. "
            f"Its bones are {', '.join(names)}"
        )
    joints = Counter(joint_map.values())
    wrong = sorted(joints.keys() - JOINT.keys())
    if wrong:
        raise BadCharacter(
            f"{path}: joint_map speaks of the joints {', '.join(wrong)}; there are "
            f"{', '.join(JOINT)}"
        )
    twice = sorted(joint for joint, count in joints.items() if count > 1)
    if twice:
        raise BadCharacter(f"{path}: joint_map gives {', '.join(twice)} more than one bone")
    return {joint: names.index(name) for name, joint in joint_map.items()}


def _check_tree(
    bones: Mapping[int, int], names: Sequence[str], parents: Sequence[int], path: Path
) -> None:
    """See that each joint's bone hangs on the bone of the joint above."""
    own = {bone: joint for joint, bone in bones.items()}
    for joint, bone in bones.items():
        wanted = _nearest(PARENTS[joint], PARENTS, bones)
        above = _nearest(parents[bone], parents, own)
        if own.get(above, -1) != wanted:
            upper = names[bones[wanted]] if wanted >= 0 else "no other joint's bone"
            raise BadCharacter(
                f"{path}: the bone {names[bone]} of {JOINT_NAMES[joint]} hangs on "
                f"{names[above] if above >= 0 else 'no bone'}, not on {upper}; "
                "give a joint_map that names other bones, or export the deforming skeleton"
            )
