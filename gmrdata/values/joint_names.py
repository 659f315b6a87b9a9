"""Which joint of a file stands for which joint of the SMPL tree."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from gmrdata.values.body import JOINT
from gmrdata.values.errors import BadMotionFile, GmrdataError, MissingInput
from gmrdata.values.files import parse_json
from gmrdata.values.limits import MOST_JOINT_MAP_BYTES
from gmrdata.values.plain_yaml import parse

REQUIRED = (
    "pelvis", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
    "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
)  # fmt: skip
"""Joints that a map must name; each other one follows its parent when it is not named."""


def _both_sides(names: Mapping[str, str], left: str, right: str) -> dict[str, str]:
    """Repeat `{left name: left_joint}` for the right side."""
    twins = [(n.replace(left, right, 1), j.replace("left", "right")) for n, j in names.items()]
    return {**names, **dict(twins)}


CMU_BVH = {
    "Hips": "pelvis", "LowerBack": "spine1", "Spine": "spine2", "Spine1": "spine3",
    "Neck": "neck", "Head": "head",
    **_both_sides({
        "LeftUpLeg": "left_hip", "LeftLeg": "left_knee", "LeftFoot": "left_ankle",
        "LeftToeBase": "left_foot", "LeftShoulder": "left_collar", "LeftArm": "left_shoulder",
        "LeftForeArm": "left_elbow", "LeftFingerBase": "left_wrist",
    }, "Left", "Right"),
}  # fmt: skip
"""cgspeed's conversion of CMU.  LeftHand only rolls the forearm, LeftFingerBase bends the wrist."""

CMU_ASF = {
    "root": "pelvis", "lowerback": "spine1", "upperback": "spine2", "thorax": "spine3",
    "lowerneck": "neck", "head": "head",
    **_both_sides({
        "lfemur": "left_hip", "ltibia": "left_knee", "lfoot": "left_ankle", "ltoes": "left_foot",
        "lclavicle": "left_collar", "lhumerus": "left_shoulder", "lradius": "left_elbow",
        "lhand": "left_wrist",
    }, "l", "r"),
}  # fmt: skip
"""CMU's ASF/AMC.  A bone is named here by the joint at which it starts."""

CMU_UPRIGHT_PITCH_DEG = {"neck": -16.0, "head": 16.0}
"""Global forward pitch of CMU's neck and head while a person stands upright and looks ahead.

From the T-pose that cgspeed puts in front of each file (neck -16, neck1 +21, head +11 degrees); the
medians of walking and everyday trials lie within 10 degrees of it, those of the zero pose do not.
"""

MIXAMO = {
    "Hips": "pelvis", "Spine": "spine1", "Spine1": "spine2", "Spine2": "spine3",
    "Neck": "neck", "Head": "head",
    **_both_sides({
        "LeftUpLeg": "left_hip", "LeftLeg": "left_knee", "LeftFoot": "left_ankle",
        "LeftToeBase": "left_foot", "LeftShoulder": "left_collar", "LeftArm": "left_shoulder",
        "LeftForeArm": "left_elbow", "LeftHand": "left_wrist", "LeftHandMiddle1": "left_hand",
    }, "Left", "Right"),
}  # fmt: skip
"""Mixamo's rig, and rigs with MotionBuilder's names."""

_WORDS = {
    "knee": ("knee", "shin", "calf", "lowerleg", "lowleg", "loleg", "leg"),
    "hip": ("upleg", "upperleg", "thigh", "thighbend", "hip", "leg"),
    "ankle": ("ankle", "foot"),
    "foot": ("toebase", "toes", "toe", "ball", "forefoot", "foot"),
    "shoulder": ("upperarm", "uparm", "uarm", "arm", "shldr", "shldrbend", "shoulder"),
    "collar": ("collar", "clavicle", "shoulder"),
    "elbow": ("elbow", "forearm", "forearmbend", "lowerarm", "lowarm", "loarm", "farm"),
    "wrist": ("wrist", "hand"),
    "hand": ("handmiddle", "middle", "fmiddle", "hand"),
}
"""What bones of a limb are called by Mixamo and MotionBuilder, 3ds Max, Xsens, Rokoko, Poser and
DAZ, Second Life, MakeHuman, mocopi, OptiTrack, Kinect, Reallusion, Unreal, Rigify, VRM, Biovision,
Bandai Namco and SMPL, without side, numbers and signs.  Of the words of a
joint the first counts that no joint above has: a shoulder is a collar where there is an arm."""
_KNOWN = frozenset(word for words in _WORDS.values() for word in words)
_NAMESPACE = re.compile(
    r"^(.*:|mixamorig\d*_?|character\d*_|bip\d+[ _]|j_bip_|cc_base_|[mf]_avg_|def-"
    r"|(?-i:m(?=[A-Z])))|_jnt$",
    re.IGNORECASE,
)
_HELPER = "__"  # begins a bone that only leads from one joint to the next, in MakeHuman's files
_SIDES = (
    re.compile(r"(?P<side>left|right)[ _.-]*(?P<part>.+)", re.IGNORECASE),
    re.compile(r"(?P<part>.+?)[ _.-]*(?P<side>left|right)", re.IGNORECASE),
    re.compile(r"(?P<side>[lr])[ _.-]+(?P<part>.+)", re.IGNORECASE),
    re.compile(r"(?P<part>.+)[ _.-]+(?P<side>[lr])", re.IGNORECASE),
    re.compile(r"(?P<side>[lrLR])(?P<part>[A-Z].*)"),
    re.compile(rf"(?P<side>[lr])(?P<part>{'|'.join(sorted(_KNOWN))})"),
)


def is_cmu(names: Sequence[str]) -> bool:
    """Whether the names are those of CMU's skeleton, in its BVH or its ASF form."""
    bare = set(map(_bare, names))
    return {"LHipJoint", "LowerBack"} <= bare or {"lhipjoint", "lfemur"} <= bare


def find_joints(
    names: Sequence[str],
    parents: Sequence[int],
    joint_map: Mapping[str, str] | Path | str | None,
    path: Path,
) -> dict[int, int]:
    """Which source joint drives each SMPL joint: `{index of the SMPL joint: of the source joint}`.

    `joint_map` is `{name in the file: SMPL joint}`, or a YAML or JSON file of it, or None for the
    names that are known (see `joints_by_name`).  One that names less than all of `REQUIRED` counts
    before the names that are known; else it alone counts.
    """
    if joint_map is None:
        bone_of = joints_by_name(names, parents)
    else:
        loaded = joint_map if isinstance(joint_map, Mapping) else _load_map(Path(joint_map))
        bone_of = mapped_joints(names, loaded, path, BadMotionFile)
        if not set(REQUIRED) <= set(bone_of):
            bone_of = joints_by_name(names, parents, bone_of)
    if missing := [joint for joint in REQUIRED if joint not in bone_of]:
        what = f"no joint is known to be {', '.join(missing)}. The file has: {', '.join(names)}"
        remedy = "Name these in a file `name in the file: SMPL joint` with --joint-map; joints are"
        raise BadMotionFile(f"{path}: {what}. {remedy} {', '.join(JOINT)}")
    return {JOINT[joint]: i for joint, i in bone_of.items()}


def joints_by_name(
    names: Sequence[str], parents: Sequence[int], said: Mapping[str, int] = MappingProxyType({})
) -> dict[str, int]:
    """`{SMPL joint: number of the bone}` for bones by their names and by what hangs on what.

    Those that a person `said` are so, and their bones are no others.  CMU's two forms have maps of
    their own.  All others go by `_WORDS`; the pelvis is what carries both legs, and the spine leads
    from there to what carries both arms.
    """
    if is_cmu(names):
        bare = [_bare(name) for name in names]
        cmu = CMU_BVH if "LHipJoint" in bare else CMU_ASF
        bone_of = {joint: bare.index(name) for name, joint in cmu.items() if name in bare}
        return {j: bone for j, bone in bone_of.items() if bone not in said.values()} | dict(said)
    lines = [line_to(bone, parents) for bone in range(len(names))]
    words_of = [_side_and_word(name) for name in names]
    bone_of = dict(said)
    # Of bones with one word the nearest to the root counts, then the first by name: sides agree.
    order = sorted(range(len(names)), key=lambda bone: (len(lines[bone]), names[bone]))
    for side in ("left", "right"):
        free = {
            words_of[bone][1]: bone
            for bone in reversed(order)
            if words_of[bone][0] == side and bone not in said.values()
        }
        for joint, words in _WORDS.items():
            if f"{side}_{joint}" in said:
                continue
            if word := next((word for word in words if word in free), None):
                bone_of[f"{side}_{joint}"] = free.pop(word)
    if {"left_hip", "right_hip", "left_shoulder", "right_shoulder"} <= set(bone_of):
        middle = {bone: word for bone in order for side, word in [words_of[bone]] if not side}
        trunk = _middle(bone_of, lines, middle).items()
        bone_of |= {j: bone for j, bone in trunk if j not in said and bone not in said.values()}
    return bone_of


def _bare(name: str) -> str:
    """`mixamorig:LeftUpLeg_03` -> `LeftUpLeg`."""
    return re.sub(r"[._ ]\d+$", "", _NAMESPACE.sub("", name))


def _side_and_word(name: str) -> tuple[str, str]:
    """`mixamorig:LeftUpLeg_03` -> ("left", "upleg"); without a side ("", word)."""
    plain = _bare(name)
    side, word = "", plain
    if name.startswith(_HELPER):
        return "", ""
    if match := next(filter(None, (form.fullmatch(plain) for form in _SIDES)), None):
        side, word = "left" if match["side"][0] in "lL" else "right", match["part"]
    return side, re.sub("[^a-z]", "", word.lower())


def line_to(bone: int, parents: Sequence[int]) -> list[int]:
    """The bones from the root down to this one."""
    line = [bone]
    while parents[line[-1]] >= 0:
        line.append(parents[line[-1]])
    return line[::-1]


def _middle(
    bone_of: Mapping[str, int], lines: Sequence[list[int]], words: Mapping[int, str]
) -> dict[str, int]:
    """The pelvis, and what is there of spine, neck and head, of bones without a side."""
    shared = []  # the line down to what carries both legs, and both arms
    for joint in ("hip", "shoulder"):
        both = zip(lines[bone_of[f"left_{joint}"]], lines[bone_of[f"right_{joint}"]], strict=False)
        shared.append([left for left, right in both if left == right])
    to_pelvis, to_chest = shared
    # Some rigs hang the legs on a bone of their own beside the spine.
    both = zip(to_pelvis, to_chest, strict=False)
    to_pelvis = [bone for bone, other in both if bone == other]
    if not to_pelvis:
        return {}
    spine = to_chest[len(to_pelvis) :]
    if len(spine) > 3:
        spine = [spine[0], spine[len(spine) // 2], spine[-1]]
    middle = {"pelvis": to_pelvis[-1]} | {f"spine{n}": bone for n, bone in enumerate(spine, 1)}
    above = [bone for bone in words if lines[bone][: len(to_chest)] == to_chest != lines[bone]]
    # Rigify calls the neck and the head spine, too.
    necks = [bone for bone in above if words[bone] in ("neck", "spine")]
    heads = [bone for bone in above if words[bone] == "head"] or necks[:0:-1]
    ends = {"neck": necks[:1], "head": heads[:1]}
    return middle | {joint: bones[0] for joint, bones in ends.items() if bones}


def mapped_joints(
    names: Sequence[str], joint_map: Mapping[str, str], path: Path, error: type[GmrdataError]
) -> dict[str, int]:
    """`{SMPL joint: number of the bone}` as a person's map has it; an error names what can't be."""
    entries = {str(name): str(joint) for name, joint in joint_map.items()}
    joints = Counter(entries.values())
    if wrong := sorted(joints.keys() - JOINT.keys()):
        what = f"the joint map speaks of {', '.join(wrong)}"
        raise error(f"{path}: {what}; SMPL's joints are {', '.join(JOINT)}")
    if twice := sorted(joint for joint, count in joints.items() if count > 1):
        raise error(f"{path}: the joint map names {', '.join(twice)} more than once")
    if unknown := sorted(entries.keys() - set(names)):
        what = f"the joint map names {', '.join(unknown)}, which the file does not have"
        raise error(f"{path}: {what}. It has: {', '.join(names)}")
    return {joint: names.index(name) for name, joint in entries.items()}


def _load_map(map_path: Path) -> Mapping[str, str]:
    if not map_path.is_file():
        raise MissingInput(f"{map_path}: no such joint map")
    if map_path.stat().st_size > MOST_JOINT_MAP_BYTES:
        raise BadMotionFile(
            f"{map_path}: larger than {MOST_JOINT_MAP_BYTES} bytes; no joint map is"
        )
    text = map_path.read_text(encoding="utf-8-sig", errors="replace")
    try:
        loaded = parse_json(text) if map_path.suffix == ".json" else parse(text)[0]
    except (ValueError, RecursionError) as error:
        raise BadMotionFile(f"{map_path}: not a readable joint map ({error})") from None
    if not isinstance(loaded, Mapping):
        raise BadMotionFile(f"{map_path}: a joint map is a list of `name in the file: SMPL joint`")
    return loaded
