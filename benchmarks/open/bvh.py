"""Other people's BVH files: how the read motion points its limbs, beside the file itself.

What a file says is worked out here again, from its text alone and by another way than the reader's:
a joint is known by whole names of its producer, a turn is a quaternion per channel.  Nothing of the
package is used for that, so that a mistake of the reader can't hide in what it is compared with.
"""

import re
from dataclasses import dataclass
from itertools import permutations, product
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.motion.files import read_motion
from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.errors import GmrdataError
from gmrdata.values.skinning import motion_joints_m

LIMITS_DEG = {"limbs": 1.0, "hips": 20.0, "shoulders": 30.0, "hands": 30.0}
"""Mean angle up to which a file counts as read right.  Limbs must agree; the others are of another
form in each skeleton, so only a turned or exchanged side is seen.  Feet are reported only: where a
file has no toes, or toes along the shank, the body's own are right and point elsewhere."""
PARTS = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
NAMES = {
    "MotionBuilder": ("?UpLeg", "?Leg", "?Foot", "?Arm", "?ForeArm", "?Hand"),
    "Rokoko": ("?Thigh", "?Shin", "?Foot", "?Arm", "?ForeArm", "?Hand"),
    "Xsens": ("?UpperLeg", "?LowerLeg", "?Foot", "?UpperArm", "?LowerArm", "?Hand"),
    "HipKnee": ("?Hip", "?Knee", "?Ankle", "?Shoulder", "?Elbow", "?Wrist"),
    "Poser": ("*Thigh", "*Shin", "*Foot", "*Shldr", "*ForeArm", "*Hand"),
    "DAZ": ("*ThighBend", "*Shin", "*Foot", "*ShldrBend", "*ForearmBend", "*Hand"),
    "Bandai": ("UpperLeg_#", "LowerLeg_#", "Foot_#", "UpperArm_#", "LowerArm_#", "Hand_#"),
    "SMPL": ("#_Hip", "#_Knee", "#_Ankle", "#_Shoulder", "#_Elbow", "#_Wrist"),
    "smpl": ("?_hip", "?_knee", "?_ankle", "?_shoulder", "?_elbow", "?_wrist"),
    "Unreal": ("thigh_*", "calf_*", "foot_*", "upperarm_*", "lowerarm_*", "hand_*"),
    "Biped": ("# Thigh", "# Calf", "# Foot", "# UpperArm", "# Forearm", "# Hand"),
    "Acclaim": ("*femur", "*tibia", "*foot", "*humerus", "*radius", "*hand"),
    "HipKneeHand": ("?Hip", "?Knee", "?Ankle", "?Shoulder", "?Elbow", "?Hand"),
    "Biovision": ("?UpLeg", "?LowLeg", "?Foot", "?UpArm", "?LowArm", "?Hand"),
    "MocapNET": ("*hip", "*knee", "*foot", "*shoulder", "*elbow", "*hand"),
    "MakeHuman": (
        "upperleg01.#",
        "lowerleg01.#",
        "foot.#",
        "upperarm01.#",
        "lowerarm01.#",
        "wrist.#",
    ),
    "MakeHuman 1": ("UpLeg_#", "LoLeg_#", "Foot_#", "UpArm_#", "LoArm_#", "Hand_#"),
}
"""Whole names of the joints of a side by producer: ? stands for Left, # for L, * for l."""
_PREFIX = re.compile(r"^(.*:|mixamorig\d*_?|Bip\d+[ _]|[mf]_avg_|DEF-|Character\d_)")
END_SITE = -2
AXES = {axis: np.eye(3)[row] for row, axis in enumerate("XYZ")}


@dataclass
class Skeleton:
    """A BVH file as its text says it: J joints, T frames."""

    names: list[str]
    parents: list[int]
    joints: np.ndarray  # (T, J, 3) places, in the file's unit and axes
    frame_time_s: float


def forward(path: Path) -> Skeleton:
    """Places of all joints, word by word from the file."""
    head, _, motion = path.read_text(errors="replace").partition("MOTION")
    words = iter(head.replace("{", " { ").replace("}", " } ").split())
    names: list[str] = []
    parents: list[int] = []
    offsets: list[np.ndarray] = []
    channels: list[list[str]] = []
    line: list[int] = []  # open joints; END_SITE inside the end of a bone
    for word in words:
        if word.upper() in ("ROOT", "JOINT"):
            parents.append(line[-1] if line else -1)
            name = [next(words)]
            while (more := next(words)) != "{":
                name.append(more)
            names.append(" ".join(name))
            channels.append([])
            line.append(len(names) - 1)
        elif word.upper() == "END":
            while next(words) != "{":
                pass
            line.append(END_SITE)
        elif word == "}":
            line.pop()
        elif word.upper() == "OFFSET":
            offset = np.array([float(next(words)) for _ in range(3)])
            offsets += [offset] if line[-1] != END_SITE else []
        elif word.upper() == "CHANNELS":
            channels[line[-1]] = [next(words) for _ in range(int(next(words)))]
    after = motion.split()
    at = after.index("Time:")
    table = np.array(after[at + 2 :], dtype=float)
    table = table.reshape(-1, sum(len(found) for found in channels))
    return _posed(names, parents, offsets, channels, table, float(after[at + 1]))


def _posed(
    names: list[str],
    parents: list[int],
    offsets: list[np.ndarray],
    channels: list[list[str]],
    table: np.ndarray,
    frame_time_s: float,
) -> Skeleton:
    places = np.zeros((len(table), len(names), 3))
    turns: list[np.ndarray] = []
    column = 0
    for joint, parent in enumerate(parents):
        place = np.tile(offsets[joint], (len(table), 1))
        turn = np.tile([1.0, 0.0, 0.0, 0.0], (len(table), 1))
        for channel in channels[joint]:
            numbers = table[:, column]
            column += 1
            if channel.lower().endswith("position"):
                place[:, "XYZ".index(channel[0].upper())] = numbers
            else:
                half = np.deg2rad(numbers)[:, None] / 2
                turn = _times(
                    turn, np.hstack([np.cos(half), np.sin(half) * AXES[channel[0].upper()]])
                )
        if parent >= 0:
            place = places[:, parent] + _turned(turns[parent], place)
            turn = _times(turns[parent], turn)
        places[:, joint] = place
        turns.append(turn)
    return Skeleton(names, parents, places, frame_time_s)


def _times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Product of quaternions (T, 4), w first."""
    real = a[:, :1] * b[:, :1] - (a[:, 1:] * b[:, 1:]).sum(axis=1, keepdims=True)
    rest = a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])
    return np.hstack([real, rest])


def _turned(turn: np.ndarray, vector: np.ndarray) -> np.ndarray:
    twice = 2 * np.cross(turn[:, 1:], vector)
    return vector + turn[:, :1] * twice + np.cross(turn[:, 1:], twice)


def known_joints(names: list[str]) -> tuple[str, dict[str, int]]:
    """The producer's scheme, and the row of each of 12 joints; ("", {}) for unknown names."""
    rows = {
        re.sub(r"_\d+$", "", _PREFIX.sub("", name)): row
        for row, name in reversed(list(enumerate(names)))
    }
    for scheme, parts in NAMES.items():
        found = {}
        for part, form in zip(PARTS, parts, strict=True):
            for side in ("left", "right"):
                lower = "_" in form
                word = side if lower and form.startswith("?_") else side.capitalize()
                name = form.replace("?", word).replace("#", side[0].upper()).replace("*", side[0])
                if name in rows:
                    found[f"{side}_{part}"] = rows[name]
        if len(found) == 2 * len(PARTS):
            return scheme, found
    return "", {}


def measured(path: Path, body: BodyModel) -> dict[str, Any]:
    """One file: what it says, beside what was read."""
    try:
        motion = read_motion(path, body, ground=False)
    except GmrdataError as error:
        return {"file": path.name, "found": "refused", "why": str(error).splitlines()[0][-300:]}
    file = forward(path)
    scheme, rows = known_joints(file.names)
    if not rows:
        return {"file": path.name, "found": "unknown", "why": "its names are not in this list"}
    file_rows = slice(len(file.joints) - motion.n_frames, None)
    wanted = _directions(file.joints[file_rows], rows)
    wanted |= _ends(file, rows, file_rows)
    got = _directions(motion_joints_m(body, motion), dict(JOINT))
    got |= _body_ends(motion_joints_m(body, motion))
    axes = _axes(wanted["limbs"], got["limbs"])
    figures = {}
    for what in wanted:
        angles_deg = _angles_deg(wanted[what] @ axes.T, got[what])
        figures[what] = float(np.nanmean(angles_deg)) if np.isfinite(angles_deg).any() else None
    rate_off = abs(motion.fps_hz * file.frame_time_s - 1.0)
    trunk = np.median(got["trunk"][:, 0], axis=0)
    misses = [what for what, most in LIMITS_DEG.items() if (figures[what] or 0.0) > most]
    misses += ["rate"] if rate_off > 1e-3 and "CMU" not in motion.source else []
    return {
        "file": path.name,
        "found": f"wrong: {', '.join(misses)}" if misses else "right",
        "names": scheme,
        "frames": motion.n_frames,
        "fps_hz": round(motion.fps_hz, 3),
        "up": round(float(trunk[2] / np.linalg.norm(trunk)), 2),
        **{
            f"{what}_deg": None if value is None else round(value, 3)
            for what, value in figures.items()
        },
    }


def _directions(joints: np.ndarray, rows: dict[str, int]) -> dict[str, np.ndarray]:
    """(T, N, 3) directions between joints (T, J, 3)."""

    def lines(*pairs: tuple[str, str]) -> np.ndarray:
        return np.stack([joints[:, rows[b]] - joints[:, rows[a]] for a, b in pairs], axis=1)

    bones = (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))
    sides = ("left", "right")
    middle = lines(("left_hip", "left_shoulder"), ("right_hip", "right_shoulder"))
    return {
        "limbs": lines(*((f"{s}_{a}", f"{s}_{b}") for s in sides for a, b in bones)),
        "hips": lines(("right_hip", "left_hip")),
        "shoulders": lines(("right_shoulder", "left_shoulder")),
        "trunk": middle.mean(axis=1, keepdims=True),
    }


def _ends(file: Skeleton, rows: dict[str, int], used: slice) -> dict[str, np.ndarray]:
    """Hands and feet of the file, to the middle of what hangs on them but a thumb; tips of bones
    are no evidence, as exporters make them up."""
    ends = {}
    for what, part in (("hands", "wrist"), ("feet", "ankle")):
        lines = []
        for side in ("left", "right"):
            joint = rows[f"{side}_{part}"]
            below = [row for row, parent in enumerate(file.parents) if parent == joint]
            below = [row for row in below if "humb" not in file.names[row]]
            line = np.full_like(file.joints[used, joint], np.nan)
            if below:
                line = (file.joints[:, below].mean(axis=1) - file.joints[:, joint])[used]
            short = np.linalg.norm(line, axis=1, keepdims=True) < 0.01 * np.ptp(file.joints[0])
            lines.append(np.where(short, np.nan, line))
        ends[what] = np.stack(lines, axis=1)
    return ends


def _body_ends(joints: np.ndarray) -> dict[str, np.ndarray]:
    pairs = {"hands": ("wrist", "hand"), "feet": ("ankle", "foot")}
    return {
        what: np.stack(
            [
                joints[:, JOINT[f"{s}_{b}"]] - joints[:, JOINT[f"{s}_{a}"]]
                for s in ("left", "right")
            ],
            axis=1,
        )
        for what, (a, b) in pairs.items()
    }


def _angles_deg(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    cosine = (a * b).sum(axis=-1) / np.linalg.norm(a, axis=-1) / np.linalg.norm(b, axis=-1)
    sine = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.asarray(
        np.rad2deg(
            np.arctan2(sine / np.linalg.norm(a, axis=-1) / np.linalg.norm(b, axis=-1), cosine)
        )
    )


def _axes(wanted: np.ndarray, got: np.ndarray) -> np.ndarray:
    """The one of the 24 turns by right angles that takes the file's axes to the world's."""
    turns = []
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        turn = np.eye(3)[list(order)] * np.array(signs)[:, None]
        if np.linalg.det(turn) > 0:
            turns.append(turn)
    return min(turns, key=lambda turn: float(_angles_deg(wanted @ turn.T, got).mean()))


def figures(rows: list[dict[str, Any]]) -> dict[str, int]:
    """How many files were tried, read right, refused, read wrongly."""
    kinds = [row["found"].partition(":")[0] for row in rows]
    return {
        "bvh_tried": len(rows),
        "bvh_right": kinds.count("right"),
        "bvh_refused": kinds.count("refused"),
        "bvh_wrong": kinds.count("wrong"),
        "bvh_unknown": kinds.count("unknown"),
    }
