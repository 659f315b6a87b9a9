"""Reader of Acclaim AMC motions on their ASF skeleton, as CMU uses both (mocap.cs.cmu.edu).

Each bone has an `axis` rotation C, in which its degrees of freedom are measured.  With M the
rotation by the AMC's angles, applied about fixed axes in the listed order, the bone turns relative
to its parent by C M C^-1, in axes that are parallel to the world's in the zero pose.  A bone starts
where its parent ends.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.read.numbers import LARGEST_IN_TEXT, bad_line, parse_floats, plain_rows, read_text
from gmrdata.read.source_motion import (
    SourceMotion,
    check_rate_hz,
    cmu_rate_hz,
    cmu_subject,
    recorded_rows,
)
from gmrdata.values.errors import BadMotionFile, MissingInput
from gmrdata.values.files import visible
from gmrdata.values.joint_names import is_cmu
from gmrdata.values.transforms import between, euler_rotmats

INCH_M = 0.0254
_FRAME_NUMBER = re.compile(r"[0-9]+")
Section = list[tuple[int, list[str]]]  # lines as (line number, words)
Entries = dict[str, tuple[int, list[str]]]
"""Line number and further words by the first word of a line."""
Due = list[tuple[str, int]]  # names and numbers of values of a frame's lines; "" is its number's


@dataclass(frozen=True, eq=False)
class Asf:
    """A skeleton of bones.  Bone 0 is the root, which has no extent."""

    names: tuple[str, ...]  # (J,) "root" first, a parent before its children
    parents: tuple[int, ...]  # (J,) -1 for the root
    bones_m: np.ndarray  # (J, 3) end of each bone relative to its start, in the zero pose [m]
    world_from_axis: np.ndarray
    """(J, 3, 3) the frame C in which a bone's degrees of freedom are measured."""
    channels: tuple[str, ...]
    """(J,) per bone the axes of its angles in order, like "xz"; "" for a fixed bone."""
    root_order: tuple[str, ...]  # (6,) meaning of the root's numbers in the AMC: "tx" ... "rz"
    root_position_m: np.ndarray  # (3,) constant part of the root's position [m]
    unit_m: float  # metres per unit in the AMC
    degrees: bool


@dataclass(frozen=True)
class _Bone:
    vector: np.ndarray
    axis: np.ndarray
    channels: str


def read_asf(path: Path, *, unit_m: float | None = None) -> Asf:
    """Read a skeleton; without `unit_m`, a unit is an inch over the file's `length`, as CMU's."""
    sections = _sections(path)
    missing = [key for key in ("units", "root", "bonedata", "hierarchy") if key not in sections]
    if missing:
        raise BadMotionFile(f"{path}: no ASF file, or truncated: it has no section :{missing[0]}")
    degrees, unit_m = _read_units(_entries(sections["units"]), unit_m, path)
    root, root_order, root_position = _read_root(_entries(sections["root"]), degrees, path)
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


def _entries(section: Section) -> Entries:
    return {words[0].lower(): (line, words[1:]) for line, words in section}


def _read_units(units: Entries, unit_m: float | None, path: Path) -> tuple[bool, float]:
    """Whether angles are degrees, and metres per unit."""
    line, words = units.get("angle", (0, []))
    if not words or words[0].lower() not in ("deg", "rad"):
        raise bad_line(path, line, ":units must say 'angle deg' or 'angle rad'")
    if unit_m is None:
        line, lengths = units.get("length", (0, []))
        values = parse_floats(lengths, path, line)
        if len(values) != 1 or values[0] * LARGEST_IN_TEXT < 1.0:
            raise bad_line(path, line, ":units must give one positive 'length'; or give --unit-m")
        unit_m = INCH_M / values[0]
    return words[0].lower() == "deg", unit_m


def _axis_frame(words: list[str], degrees: bool, path: Path, line: int) -> np.ndarray:
    """C of three angles and an order of fixed axes, like `0 0 20 XYZ`: (3, 3)."""
    values = parse_floats(words[:3], path, line)
    order = words[3].lower() if len(words) == 4 else ""
    if sorted(order) != ["x", "y", "z"]:
        raise bad_line(path, line, "an axis is three angles and an order such as XYZ")
    return np.asarray(Rotation.from_euler(order, values, degrees=degrees).as_matrix())


def _read_root(
    entries: Entries, degrees: bool, path: Path
) -> tuple[_Bone, tuple[str, ...], list[float]]:
    """The root's frame, the order of its six numbers, and its constant position."""
    for key, n_words in (("order", 6), ("axis", 1), ("position", 3), ("orientation", 3)):
        if len(entries.get(key, (0, []))[1]) != n_words:
            raise BadMotionFile(f"{path}: :root needs a line '{key}' with {n_words} values")
    line, order = entries["order"]
    order = [word.lower() for word in order]
    if sorted(order) != ["rx", "ry", "rz", "tx", "ty", "tz"]:
        raise bad_line(path, line, "the root's order must hold TX TY TZ RX RY RZ once each")
    line, turn = entries["orientation"]
    axis = _axis_frame([*turn, entries["axis"][1][0]], degrees, path, line)
    channels = "".join(word[1] for word in order if word[0] == "r")
    position = parse_floats(entries["position"][1], path, entries["position"][0])
    return _Bone(np.zeros(3), axis, channels), tuple(order), position


def _read_bones(section: Section, degrees: bool, path: Path) -> dict[str, _Bone]:
    """Every begin ... end block of :bonedata, by bone name."""
    bones: dict[str, _Bone] = {}
    block: Entries | None = None
    for line, words in section:
        key = words[0].lower()
        if key == "begin" and block is None:
            block = {}
        elif key == "end" and block is not None:
            name, bone = _read_bone(block, degrees, path, line)
            if name in bones:
                raise bad_line(path, line, f"a second bone of the name {name}")
            bones[name] = bone
            block = None
        elif block is None or key in ("begin", "end"):
            raise bad_line(path, line, "'begin' and 'end' do not alternate in :bonedata")
        elif not key.startswith("("):
            block[key] = (line, words[1:])
    if block is not None:
        raise BadMotionFile(f"{path}: truncated, the last bone of :bonedata has no 'end'")
    return bones


def _read_bone(block: Entries, degrees: bool, path: Path, end_line: int) -> tuple[str, _Bone]:
    for key, n_words in (("name", 1), ("direction", 3), ("length", 1), ("axis", 4)):
        line, words = block.get(key, (end_line, []))
        if len(words) != n_words:
            raise bad_line(path, line, f"a bone needs '{key}' with {n_words} values")
    line, dof = block.get("dof", (end_line, []))
    channels = [word.lower() for word in dof]
    if not set(channels) <= {"rx", "ry", "rz"} or len(set(channels)) != len(channels):
        what = f"dof {' '.join(dof)[:40]!r}: only rx, ry and rz, once each, can be read"
        raise bad_line(path, line, what)
    line, words = block["direction"]
    direction = np.array(parse_floats(words, path, line))
    size = float(np.linalg.norm(direction))
    if size == 0.0:
        raise bad_line(path, line, "a bone's direction is zero")
    length = parse_floats(block["length"][1], path, block["length"][0])[0]
    axis = _axis_frame(block["axis"][1], degrees, path, block["axis"][0])
    dof_axes = "".join(channel[1] for channel in channels)
    return block["name"][1][0], _Bone(direction / size * length, axis, dof_axes)


def _read_tree(
    section: Section, bones: dict[str, _Bone], path: Path
) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Names and parents, in the order in which :hierarchy reaches the bones from the root."""
    names, parents = ["root"], [-1]
    for line, words in section:
        if words[0].lower() in ("begin", "end") and len(words) == 1:
            continue
        if words[0] not in names:
            raise bad_line(path, line, f"{words[0][:40]} has no parent yet in :hierarchy")
        parent = names.index(words[0])
        for name in words[1:]:
            if name not in bones or name in names:
                what = f"bone {name[:40]} is not in :bonedata, or has two parents"
                raise bad_line(path, line, what)
            names.append(name)
            parents.append(parent)
    lost = sorted(set(bones) - set(names))
    if lost:
        raise BadMotionFile(f"{path}: :hierarchy does not reach the bones {', '.join(lost)}")
    return tuple(names), tuple(parents)


def read_amc(
    path: Path,
    *,
    asf_path: Path | None = None,
    fps_hz: float | None = None,
    unit_m: float | None = None,
) -> SourceMotion:
    """Read an AMC motion with its ASF skeleton.

    Without `asf_path`, the skeleton beside it has the longest name with which the file's begins
    (`02_03.amc`: `02_03.asf`, then `02.asf`), or is the only .asf there and has no other subject's
    number.  The format does not hold the frame rate; without `fps_hz` CMU's index decides, and
    others of its skeleton have 120 Hz.
    """
    text = read_text(path)
    asf_path = asf_path if asf_path is not None else find_asf(path)
    asf = read_asf(asf_path, unit_m=unit_m)
    if fps_hz is None and not is_cmu(asf.names):
        raise BadMotionFile(f"{path}: an AMC file holds no frame rate; give it with --fps-hz")
    rate_note = "CMU's skeleton" if cmu_subject(path) is None else "CMU's index"
    rate_note = rate_note if fps_hz is None else "given"
    fps_hz = cmu_rate_hz(path) if fps_hz is None else check_rate_hz(fps_hz, path)
    notes = (f"skeleton {asf_path.name}", f"{fps_hz:.7g} Hz ({rate_note})")
    first_line, body, degrees = _body(text, asf, path)
    columns = _bone_columns(body, asf, asf_path, path, first_line)
    table = _table(body, columns, path, first_line)
    rows, rows_notes = recorded_rows(table[:, 1:], [], is_cmu(asf.names), False, path)
    table = table[rows]
    angles = {bone: table[:, span] for bone, span in columns.items()}
    # Each bone starts at its parent's end.
    starts_m = np.array([asf.bones_m[p] if p >= 0 else np.zeros(3) for p in asf.parents])
    translations_m = np.tile(starts_m, (len(table), 1, 1))
    moves = [asf.root_order.index(word) for word in ("tx", "ty", "tz")]
    translations_m[:, 0] = angles["root"][:, moves] * asf.unit_m + asf.root_position_m
    return SourceMotion(
        names=asf.names,
        parents=asf.parents,
        offsets_m=starts_m,
        tips_m=asf.bones_m,
        local_rotmats=_local_rotmats(asf, angles, len(table), degrees),
        translations_m=translations_m,
        fps_hz=fps_hz,
        rate_from=rate_note,
        notes=(*notes, f"{asf.unit_m:.6g} m per unit", *rows_notes),
        first_row=rows.start,
    )


def find_asf(amc_path: Path) -> Path:
    """The skeleton that lies beside an AMC file."""
    stem = amc_path.stem.lower()
    skeletons = sorted(p for p in visible(amc_path.parent.glob("*")) if p.suffix.lower() == ".asf")
    there = [path for path in skeletons if path.is_file()]
    named = [
        path for path in there if re.match(f"{re.escape(path.stem.lower())}(?![a-z0-9])", stem)
    ]
    if named:
        return max(named, key=lambda path: len(path.stem))
    if len(there) == 1 and not _is_anothers(there[0], amc_path):
        return there[0]
    what = f"its skeleton {amc_path.stem.rpartition('_')[0] or amc_path.stem}.asf is not beside it"
    others = f" ({', '.join(path.name for path in there)})" if there else ""
    remedy = "put it there, under a name with which the AMC's begins"
    raise MissingInput(f"{amc_path}: {what}{others}; {remedy}")


def _is_anothers(asf_path: Path, amc_path: Path) -> bool:
    """Whether a skeleton has the number of another of CMU's subjects than the motion has."""
    number, subject = re.match("[0-9]{1,3}(?=_|$)", asf_path.stem), cmu_subject(amc_path)
    return number is not None and subject is not None and int(number[0]) != subject


def _body(text: str, asf: Asf, path: Path) -> tuple[int, list[str], bool]:
    """Line number of the first frame, the lines from there on, and whether angles are degrees."""
    degrees = asf.degrees
    lines = text.split("\n")
    for i, line in enumerate(lines):
        word = line.strip()
        if word.upper() in (":DEGREES", ":RADIANS"):
            degrees = word.upper() == ":DEGREES"
        if word and not word.startswith(("#", ":")):
            if not _FRAME_NUMBER.fullmatch(word):
                raise bad_line(path, i + 1, f"{word[:40]!r} where the first frame's number is due")
            return i + 1, lines[i:], degrees
    raise BadMotionFile(f"{path}: no frames; the file is truncated, fetch it again")


def _bone_columns(
    body: list[str], asf: Asf, asf_path: Path, path: Path, first_line: int
) -> dict[str, slice]:
    """Columns of each bone in a frame's row, by the first frame; they must fit the skeleton."""
    columns: dict[str, slice] = {}
    column = 1
    for line_number, words in _filled_lines(body[1:], first_line + 1):
        name = words[0]
        if _FRAME_NUMBER.fullmatch(name):
            break
        if name not in asf.names or name in columns:
            what = f"bone {name[:40]} is not in {asf_path.name}, or comes twice; the AMC belongs to"
            raise bad_line(
                path, line_number, f"{what} another skeleton: put {path.stem}.asf beside it"
            )
        due = 6 if name == "root" else len(asf.channels[asf.names.index(name)])
        if len(words) - 1 != due:
            what = f"{len(words) - 1} values for {name}, where {asf_path.name} has {due} degrees of"
            raise bad_line(
                path, line_number, f"{what} freedom; put this AMC's own {path.stem}.asf beside it"
            )
        columns[name] = slice(column, column + due)
        column += due
    lost = [n for n, dof in zip(asf.names, asf.channels, strict=True) if dof and n not in columns]
    if lost:
        what = f"its frames have no {', '.join(lost)}, which {asf_path.name} has; the file is"
        raise BadMotionFile(
            f"{path}: {what} truncated, or has another skeleton: put {path.stem}.asf beside it"
        )
    return columns


def _table(body: list[str], columns: dict[str, slice], path: Path, first_line: int) -> np.ndarray:
    """(T, C): one row per frame."""
    due = [("", 1), *((bone, c.stop - c.start) for bone, c in columns.items())]
    table = _plain_table([line for line in body if line], due)
    if table is None:
        table = _closely_read_table(body, due, path, first_line)
    jumps = np.flatnonzero(np.diff(table[:, 0]) != 1.0)
    if jumps.size:
        before, after = table[jumps[0], 0], table[jumps[0] + 1, 0]
        what = f"frame {after:g} follows frame {before:g}; frames are missing"
        raise BadMotionFile(f"{path}: {what}. Split the file there, or fetch it again")
    return table


def _plain_table(lines: list[str], due: Due) -> np.ndarray | None:
    """The table of frames that all have the same lines, as files mostly have; else None."""
    columns = [lines[n :: len(due)] for n in range(len(due))]
    if len(lines) % len(due) or not all(number.isdigit() for number in columns[0]):
        return None
    blocks = []
    for (name, n_values), column in zip(due, columns, strict=True):
        block = plain_rows(column, n_values, f"{name} " if name else "")
        if block is None:
            return None
        blocks.append(block)
    return np.concatenate(blocks, axis=1)


def _closely_read_table(body: list[str], due: Due, path: Path, first_line: int) -> np.ndarray:
    """The table read line by line, with an error that says which line is wrong."""
    values: list[float] = []
    pairs = zip(_filled_lines(body, first_line), cycle(due), strict=False)
    for (line_number, words), (name, n_values) in pairs:
        line = body[line_number - first_line]
        if not name and not (len(words) == 1 and _FRAME_NUMBER.fullmatch(words[0])):
            raise bad_line(path, line_number, f"{line[:40]!r} where a frame's number is due")
        if name and (words[0] != name or len(words) - 1 != n_values):
            what = f"{line[:40]!r} where {name} with {n_values} values is due"
            raise bad_line(path, line_number, f"{what}; fetch the file again")
        values += parse_floats(words[1:] if name else words, path, line_number)
    if name != due[-1][0]:
        raise bad_line(path, line_number, "the last frame is not complete; the file is truncated")
    return np.reshape(values, (-1, sum(n_values for _, n_values in due)))


def _filled_lines(lines: list[str], first_line: int) -> Iterator[tuple[int, list[str]]]:
    numbered = ((number, line.split()) for number, line in enumerate(lines, first_line))
    return ((number, words) for number, words in numbered if words)


def _local_rotmats(
    asf: Asf, angles: dict[str, np.ndarray], n_frames: int, degrees: bool
) -> np.ndarray:
    """(T, J, 3, 3): C M C^-1 of every bone."""
    rotmats = np.broadcast_to(np.eye(3), (n_frames, len(asf.names), 3, 3)).copy()
    turns = [i for i, word in enumerate(asf.root_order) if word[0] == "r"]
    angles = angles | {"root": angles["root"][:, turns]}
    to_deg = 1.0 if degrees else 180.0 / np.pi
    for bone in (n for n, axes in enumerate(asf.channels) if axes):
        turned = euler_rotmats(asf.channels[bone], angles[asf.names[bone]] * to_deg)
        frame = asf.world_from_axis[bone]
        rotmats[:, bone] = between(frame, turned, frame.T)
    return rotmats
