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
_MIDDLE = ("pelvis", "spine1", "spine2", "spine3", "neck", "head")
_SIDED = ("hip", "knee", "ankle", "foot", "collar", "shoulder", "elbow", "wrist", "hand")


def _naming(middle: str, sided: str) -> dict[str, str]:
    """The bones of the joints `_MIDDLE` and, with `{}` for the letter l or r, `_SIDED`."""
    sides = {
        bone.format(side[0]): f"{side}_{joint}"
        for side in ("left", "right")
        for bone, joint in zip(sided.split(), _SIDED, strict=True)
    }
    return dict(zip(middle.split(), _MIDDLE, strict=True)) | sides


UNREAL = _naming(
    "pelvis spine_01 spine_02 spine_03 neck_01 head",
    "thigh_{} calf_{} foot_{} ball_{} clavicle_{} upperarm_{} lowerarm_{} hand_{} middle_01_{}",
)
"""The mannequin of Unreal Engine."""
RIGIFY = _naming(
    "spine spine.001 spine.002 spine.003 spine.004 spine.006",
    "thigh.{} shin.{} foot.{} toe.{} shoulder.{} upper_arm.{} forearm.{} hand.{} f_middle.01.{}",
)
"""Blender's Rigify: its metarig, and its deforming bones with `DEF-` before the name."""
CMU_NAMINGS = (CMU_BVH, CMU_ASF)
NAMINGS = (MIXAMO, SMPL, UNREAL, RIGIFY)


def find_bones(
    names: Sequence[str], parents: Sequence[int], joint_map: Mapping[str, str] | None, path: Path
) -> dict[int, int]:
    """`{index of the SMPL joint: index of the bone}`: which bone drives with which joint.

    A namespace (`mixamorig:`), `DEF-`, capitals, and a number that a converter put behind each name
    (`mixamorig:Hips_01`) are overlooked, but not by a joint_map `{bone: SMPL joint}`.  The bones
    must hang together as the joints do, and those of `REQUIRED` must be there.
    """
    found = _by_name(names) if joint_map is None else _by_map(names, joint_map, path)
    if missing := [joint for joint in REQUIRED if joint not in found]:
        raise BadCharacter(
            f"{path}: no bone is known to be {', '.join(missing)}. Give a joint_map "
            f"{{bone: joint}} in the recipe, such as joint_map: {{{names[0] if names else 'Hips'}: "
            f"pelvis, ...}}. Its bones are {', '.join(names)}. The joints are {', '.join(JOINT)}"
        )
    bones = {JOINT[joint]: bone for joint, bone in found.items()}
    _check_tree(bones, names, parents, path)
    return dict(sorted(bones.items()))


def joint_of_bone(bones: Mapping[int, int], parents: Sequence[int]) -> list[int]:
    """The joint that each bone moves with: its own, of the nearest bone above, or the pelvis."""
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
            small_naming = {name.casefold(): joint for name, joint in naming.items()}
            found = {joint: index[name] for name, joint in small_naming.items() if name in index}
            best = max(best, found, key=lambda known: sum(joint in known for joint in REQUIRED))
    return best


def _by_map(names: Sequence[str], joint_map: Mapping[str, str], path: Path) -> dict[str, int]:
    if unknown := [name for name in joint_map if name not in names]:
        what = f"joint_map names the bones {', '.join(unknown)}, which it does not have"
        raise BadCharacter(f"{path}: {what}. Its bones are {', '.join(names)}")
    joints = Counter(joint_map.values())
    if wrong := sorted(joints.keys() - JOINT.keys()):
        what = f"joint_map speaks of the joints {', '.join(wrong)}"
        raise BadCharacter(f"{path}: {what}; there are {', '.join(JOINT)}")
    if twice := sorted(joint for joint, count in joints.items() if count > 1):
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
