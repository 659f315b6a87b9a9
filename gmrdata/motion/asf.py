"""Reader of Acclaim ASF skeletons, as CMU's files use the format (mocap.cs.cmu.edu)."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.errors import BadMotionFile
from gmrdata.motion.text_numbers import parse_floats, read_text

INCH_M = 0.0254

Section = list[tuple[int, list[str]]]
"""Lines of a section as (line number, words)."""


@dataclass(frozen=True, eq=False)
class Asf:
    """A skeleton of bones.  Bone 0 is the root, which has no extent."""

    names: tuple[str, ...]
    """(J,) bone names, "root" first, a parent before its children."""
    parents: tuple[int, ...]
    """(J,) parent of each bone, -1 for the root."""
    bones_m: np.ndarray
    """(J, 3) end of each bone relative to its start, in the zero pose [m]."""
    world_from_axis: np.ndarray
    """(J, 3, 3) the frame C in which a bone's degrees of freedom are measured."""
    channels: tuple[str, ...]
    """(J,) per bone the axes of its angles in order, like "xz"; "" for a fixed bone."""
    root_order: tuple[str, ...]
    """(6,) meaning of the root's numbers in the AMC: "tx" ... "rz"."""
    root_position_m: np.ndarray
    """(3,) constant part of the root's position [m]."""
    unit_m: float
    """Metres per unit in the AMC."""
    degrees: bool
    """Whether the skeleton's angles are degrees."""


@dataclass(frozen=True)
class _Bone:
    vector: np.ndarray
    axis: np.ndarray
    channels: str


def read_asf(path: Path, *, unit_m: float | None = None) -> Asf:
    """Read an ASF skeleton.

    Args:
        path: The file.
        unit_m: Metres per unit; without it inches divided by the file's `length`, which is CMU's
            use (0.056444 m for `length 0.45`).

    Raises:
        MissingInput: there is no such file.
        BadMotionFile: it is no ASF, or is broken or truncated.
    """
    sections = _sections(path)
    missing = [key for key in ("units", "root", "bonedata", "hierarchy") if key not in sections]
    if missing:
        raise BadMotionFile(f"{path}: no ASF file, or truncated: it has no section :{missing[0]}")
    units = {words[0].lower(): (line, words[1:]) for line, words in sections["units"]}
    degrees = _angle_unit(units, path)
    unit_m = unit_m if unit_m is not None else INCH_M / _length_scale(units, path)
    root, root_order, root_position = _read_root(sections["root"], degrees, path)
    bones = {"root": root} | _read_bones(sections["bonedata"], degrees, path)
    names, parents = _read_tree(sections["hierarchy"], bones, path)
    return Asf(
        names=names,
        parents=parents,
        bones_m=np.array([bones[name].vector for name in names]) * unit_m,
        world_from_axis=np.array([bones[name].axis for name in names]),
        channels=tuple(bones[name].channels for name in names),
        root_order=root_order,
        root_position_m=np.array(root_position) * unit_m,
        unit_m=unit_m,
        degrees=degrees,
    )


def _sections(path: Path) -> dict[str, Section]:
    """Lines by section, without comments and empty lines."""
    sections: dict[str, Section] = {}
    section: Section = []
    for line_number, line in enumerate(read_text(path).split("\n"), 1):
        words = line.partition("#")[0].split()
        if words and words[0].startswith(":"):
            section = sections.setdefault(words[0][1:].lower(), [])
        elif words:
            section.append((line_number, words))
    return sections


def _angle_unit(units: dict[str, tuple[int, list[str]]], path: Path) -> bool:
    line, words = units.get("angle", (0, []))
    if not words or words[0].lower() not in ("deg", "rad"):
        raise BadMotionFile(f"{path}:{line}: :units must say 'angle deg' or 'angle rad'")
    return words[0].lower() == "deg"


def _length_scale(units: dict[str, tuple[int, list[str]]], path: Path) -> float:
    line, words = units.get("length", (0, []))
    values = parse_floats(words, path, line)
    if len(values) != 1 or values[0] <= 0.0:
        raise BadMotionFile(
            f"{path}:{line}: :units must give one positive 'length'; or pass unit_m"
        )
    return values[0]


def _axis_frame(words: list[str], degrees: bool, path: Path, line: int) -> np.ndarray:
    """C of three angles and an order of fixed axes, like `0 0 20 XYZ`: (3, 3)."""
    values = parse_floats(words[:3], path, line)
    order = words[3].lower() if len(words) == 4 else ""
    if sorted(order) != ["x", "y", "z"]:
        raise BadMotionFile(f"{path}:{line}: an axis is three angles and an order such as XYZ")
    return np.asarray(Rotation.from_euler(order, values, degrees=degrees).as_matrix())


def _read_root(
    section: Section, degrees: bool, path: Path
) -> tuple[_Bone, tuple[str, ...], list[float]]:
    """The root's frame, the order of its six numbers, and its constant position."""
    entries = {words[0].lower(): (line, words[1:]) for line, words in section}
    for key, n_words in (("order", 6), ("axis", 1), ("position", 3), ("orientation", 3)):
        if len(entries.get(key, (0, []))[1]) != n_words:
            raise BadMotionFile(f"{path}: :root needs a line '{key}' with {n_words} values")
    line, order = entries["order"]
    order = [word.lower() for word in order]
    if sorted(order) != ["rx", "ry", "rz", "tx", "ty", "tz"]:
        raise BadMotionFile(
            f"{path}:{line}: the root's order must hold TX TY TZ RX RY RZ once each"
        )
    line, turn = entries["orientation"]
    axis = _axis_frame([*turn, entries["axis"][1][0]], degrees, path, line)
    channels = "".join(word[1] for word in order if word[0] == "r")
    position = parse_floats(entries["position"][1], path, entries["position"][0])
    return _Bone(np.zeros(3), axis, channels), tuple(order), position


def _read_bones(section: Section, degrees: bool, path: Path) -> dict[str, _Bone]:
    """Every begin ... end block of :bonedata, by bone name."""
    bones: dict[str, _Bone] = {}
    block: dict[str, tuple[int, list[str]]] | None = None
    for line, words in section:
        key = words[0].lower()
        if key == "begin" and block is None:
            block = {}
        elif key == "end" and block is not None:
            name, bone = _read_bone(block, degrees, path, line)
            if name in bones:
                raise BadMotionFile(f"{path}:{line}: a second bone of the name {name}")
            bones[name] = bone
            block = None
        elif block is None or key in ("begin", "end"):
            raise BadMotionFile(f"{path}:{line}: 'begin' and 'end' do not alternate in :bonedata")
        elif not key.startswith("("):
            block[key] = (line, words[1:])
    if block is not None:
        raise BadMotionFile(
            f"{path}: the last bone of :bonedata has no 'end'; the file is truncated"
        )
    return bones


def _read_bone(
    block: dict[str, tuple[int, list[str]]], degrees: bool, path: Path, end_line: int
) -> tuple[str, _Bone]:
    for key, n_words in (("name", 1), ("direction", 3), ("length", 1), ("axis", 4)):
        line, words = block.get(key, (end_line, []))
        if len(words) != n_words:
            raise BadMotionFile(f"{path}:{line}: a bone needs '{key}' with {n_words} values")
    line, dof = block.get("dof", (end_line, []))
    channels = [word.lower() for word in dof]
    if not set(channels) <= {"rx", "ry", "rz"} or len(set(channels)) != len(channels):
        raise BadMotionFile(
            f"{path}:{line}: dof {' '.join(dof)[:40]!r}: only rx, ry and rz, once each, can be read"
        )
    line, words = block["direction"]
    direction = np.array(parse_floats(words, path, line))
    size = float(np.linalg.norm(direction))
    if size == 0.0:
        raise BadMotionFile(f"{path}:{line}: a bone's direction is zero")
    length = parse_floats(block["length"][1], path, block["length"][0])[0]
    axis = _axis_frame(block["axis"][1], degrees, path, block["axis"][0])
    return block["name"][1][0], _Bone(
        direction / size * length, axis, "".join(channel[1] for channel in channels)
    )


def _read_tree(
    section: Section, bones: dict[str, _Bone], path: Path
) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Names and parents, in the order in which :hierarchy reaches the bones from the root."""
    names, parents = ["root"], [-1]
    for line, words in section:
        if words[0].lower() in ("begin", "end") and len(words) == 1:
            continue
        if words[0] not in names:
            raise BadMotionFile(f"{path}:{line}: {words[0][:40]} has no parent yet in :hierarchy")
        parent = names.index(words[0])
        for name in words[1:]:
            if name not in bones or name in names:
                raise BadMotionFile(
                    f"{path}:{line}: bone {name[:40]} is not in :bonedata, or has two parents"
                )
            names.append(name)
            parents.append(parent)
    lost = sorted(set(bones) - set(names))
    if lost:
        raise BadMotionFile(f"{path}: :hierarchy does not reach the bones {', '.join(lost)}")
    return tuple(names), tuple(parents)
