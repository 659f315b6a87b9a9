"""Which joint of a file stands for which joint of the SMPL tree."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import yaml

from gmrdata.values.body import JOINT
from gmrdata.values.errors import BadMotionFile, MissingInput

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

_MIXAMO_PREFIX = re.compile(r"^mixamorig\d*[:_]?", re.IGNORECASE)


def is_cmu(names: Sequence[str]) -> bool:
    """Whether the names are those of CMU's skeleton, in its BVH or its ASF form."""
    return {"LHipJoint", "LowerBack"} <= set(names) or {"lhipjoint", "lowerback"} <= set(names)


def find_joints(
    names: Sequence[str], joint_map: Mapping[str, str] | Path | str | None, path: Path
) -> dict[int, int]:
    """Which source joint drives each SMPL joint: `{index of the SMPL joint: of the source joint}`.

    `joint_map` is `{name in the file: SMPL joint}`, or a YAML or JSON file of it, or None for the
    built-in maps (CMU's two forms, Mixamo with or without its prefix).
    """
    if joint_map is None:
        cmu = CMU_BVH if "LHipJoint" in names else CMU_ASF
        chosen = cmu if is_cmu(names) else MIXAMO
        plain = [_MIXAMO_PREFIX.sub("", name) for name in names]
    else:
        chosen, plain = _read_map(joint_map, path), list(names)
        unknown = sorted(set(chosen) - set(names))
        if unknown:
            what = f"the joint map names {', '.join(unknown)}, which the file does not have"
            raise BadMotionFile(f"{path}: {what}. It has: {', '.join(names)}")
    index = {name: i for i, name in reversed(list(enumerate(plain)))}
    found = {joint: index[name] for name, joint in chosen.items() if name in index}
    missing = [joint for joint in REQUIRED if joint not in found]
    if missing:
        what = f"no joint is known to be {', '.join(missing)}. The file has: {', '.join(names)}"
        remedy = "Give a joint_map {name in the file: SMPL joint} with the names"
        raise BadMotionFile(f"{path}: {what}. {remedy} {', '.join(JOINT)}")
    return {JOINT[joint]: i for joint, i in found.items()}


def _read_map(joint_map: Mapping[str, str] | Path | str, path: Path) -> dict[str, str]:
    """The user's map as a checked dict."""
    loaded = joint_map if isinstance(joint_map, Mapping) else _load_map(Path(joint_map))
    entries = {str(name): str(joint) for name, joint in loaded.items()}
    wrong = sorted(set(entries.values()) - JOINT.keys())
    if wrong:
        what = f"the joint map speaks of {', '.join(wrong)}"
        raise BadMotionFile(f"{path}: {what}; SMPL's joints are {', '.join(JOINT)}")
    twice = sorted({joint for joint in entries.values() if [*entries.values()].count(joint) > 1})
    if twice:
        raise BadMotionFile(f"{path}: the joint map names {', '.join(twice)} more than once")
    return entries


def _load_map(map_path: Path) -> Mapping[str, str]:
    if not map_path.is_file():
        raise MissingInput(f"{map_path}: no such joint map")
    text = map_path.read_text(encoding="utf-8", errors="replace")
    try:
        loaded = json.loads(text) if map_path.suffix == ".json" else yaml.safe_load(text)
    except (json.JSONDecodeError, yaml.YAMLError) as error:
        raise BadMotionFile(f"{map_path}: not a readable joint map ({error})") from None
    if not isinstance(loaded, Mapping):
        raise BadMotionFile(f"{map_path}: a joint map is a list of `name in the file: SMPL joint`")
    return loaded
