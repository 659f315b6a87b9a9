"""Reader of BVH (Biovision hierarchy) files.

The zero pose is the hierarchy's offsets with all rotations zero.  A joint's rotation channels are
applied in the listed order about the joint's own moving axes (R = R1 R2 R3); its position channels
replace the offset, which for the root is what exporters write although the 1999 description adds
them (for a motion that is put on the floor afterwards the two differ by a constant shift).  Of any
other joint they are added to the offset where they are near nothing, unless more joints' are near
their offsets.  Where all offsets but the root's are nothing, the channels' medians stand for them.
"""

import re
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

import numpy as np

from gmrdata.read import source_motion
from gmrdata.read.numbers import bad_line, parse_floats, parse_table, read_text
from gmrdata.read.source_motion import DROPPED_REST, SourceMotion, recorded_rows
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.joint_names import is_cmu
from gmrdata.values.limits import MOST_JOINTS, Budget, OverBudget
from gmrdata.values.transforms import euler_rotmats

CMU_UNIT_M = 0.0254 / 0.45  # CMU's files hold inches times 0.45
CENTIMETRE_M = 0.01
MAX_FORM = {"LHipJoint", "lowerback", "LeftHip"}
"""Joints of CMU's trials in cgspeed's release for 3ds Max, which has the same unit and header."""
_CHANNEL = re.compile(r"^([XYZ])(position|rotation)$", re.IGNORECASE)


@dataclass
class Hierarchy:
    """The skeleton while it is being read."""

    names: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[list[float]] = field(default_factory=list)
    tips: list[list[float]] = field(default_factory=list)
    channels: list[list[tuple[str, str]]] = field(default_factory=list)
    """Per joint the (axis "X", kind "position" or "rotation") of each column."""
    open_blocks: list[int | None] = field(default_factory=list)
    """Joints whose braces are open; None stands for an End Site."""
    announced: int | None = None
    brace_due: bool = False
    offset_due: bool = False


def read_hierarchy(lines: list[str], path: Path) -> Hierarchy:
    """Read everything above MOTION."""
    tree = Hierarchy()
    for line_number, line in enumerate(lines, 1):
        for statement in re.findall(r"[{}]|[^{}]+", line):
            if statement.strip():
                _read_statement(tree, statement.strip(), path, line_number)
    if tree.open_blocks or tree.brace_due:
        raise bad_line(path, len(lines), "a brace of the hierarchy is not closed")
    if not tree.names:
        raise BadMotionFile(f"{path}: the hierarchy has no ROOT")
    if not any(tree.channels):
        raise BadMotionFile(f"{path}: the joints have no channels, so there is no motion to read")
    return tree


def _read_statement(tree: Hierarchy, statement: str, path: Path, line_number: int) -> None:
    keyword, rest = [*statement.split(maxsplit=1), ""][:2]
    here = tree.open_blocks[-1] if tree.open_blocks else None
    if tree.brace_due != (keyword == "{"):
        raise bad_line(path, line_number, "'{' and joints do not alternate; broken hierarchy")
    if keyword == "{":
        tree.open_blocks.append(tree.announced)
        tree.brace_due, tree.offset_due = False, True
    elif keyword == "}" and tree.open_blocks and not tree.offset_due:
        tree.open_blocks.pop()
    elif keyword.upper() in ("ROOT", "JOINT") and rest:
        _announce_joint(tree, keyword.upper(), rest, path, line_number)
    elif keyword.upper() == "END" and here is not None:
        tree.announced, tree.brace_due = None, True
    elif keyword.upper() == "OFFSET" and tree.offset_due:
        _read_offset(tree, parse_floats(rest.split(), path, line_number), path, line_number)
    elif keyword.upper() == "CHANNELS" and here is not None and not tree.channels[here]:
        tree.channels[here] = _read_channel_names(rest.split(), path, line_number)
    elif keyword != "HIERARCHY" or tree.names:
        what = f"{statement[:40]!r} is not expected here; broken hierarchy"
        raise bad_line(path, line_number, what)


def _announce_joint(tree: Hierarchy, keyword: str, name: str, path: Path, line_number: int) -> None:
    here = tree.open_blocks[-1] if tree.open_blocks else None
    if (keyword == "ROOT") != (not tree.names) or (keyword == "JOINT" and here is None):
        what = f"{keyword} {name[:40]} is not inside the one ROOT; broken hierarchy"
        raise bad_line(path, line_number, what)
    if len(tree.names) >= MOST_JOINTS:
        what = f"more than {MOST_JOINTS} joints; no person's skeleton has so many"
        raise bad_line(path, line_number, what)
    if name in tree.names:
        raise bad_line(path, line_number, f"a second joint of the name {name[:40]}")
    tree.announced, tree.brace_due = len(tree.names), True
    tree.names.append(name)
    tree.parents.append(-1 if here is None else here)
    tree.offsets.append([0.0] * 3)
    tree.tips.append([np.nan] * 3)
    tree.channels.append([])


def _read_offset(tree: Hierarchy, offset: list[float], path: Path, line_number: int) -> None:
    if len(offset) != 3:
        raise bad_line(path, line_number, f"an OFFSET has 3 numbers, not {len(offset)}")
    tree.offset_due = False
    *_, bone, here = (None, *tree.open_blocks)
    if here is not None:
        tree.offsets[here] = offset
    elif bone is not None:
        tree.tips[bone] = offset


def _read_channel_names(words: list[str], path: Path, line_number: int) -> list[tuple[str, str]]:
    matches = [_CHANNEL.match(word) for word in words[1:]]
    channels = [(m.group(1).upper(), m.group(2).lower()) for m in matches if m]
    if not words or words[0] != str(len(matches)) or len(channels) != len(matches):
        what = "CHANNELS needs its count and as many names like Xposition, Zrotation"
        raise bad_line(path, line_number, what)
    if len(set(channels)) != len(channels):
        raise bad_line(path, line_number, "a channel is listed twice")
    return channels


def read_bvh(
    path: Path,
    *,
    fps_hz: float | None = None,
    unit_m: float | None = None,
    drop_rest_frame: bool | None = None,
    fewest_frames: int = 2,
) -> SourceMotion:
    """Read a BVH file.

    Without `fps_hz`, CMU's trials (known by their joints, their `02_03` names and a header of 120
    Hz) have the rate of CMU's index, all others their header's.  Without `unit_m`, CMU files are
    0.056444 m per unit, all others centimetres.  `drop_rest_frame`: whether frame 0 is an added
    rest pose, which is left out; None looks for itself (see `recorded_rows`).
    """
    lines = read_text(path).split("\n")
    motion_line = next((i for i, line in enumerate(lines) if line.strip() == "MOTION"), None)
    if motion_line is None:
        raise BadMotionFile(f"{path}: no BVH file, or truncated: it has no line 'MOTION'")
    tree = read_hierarchy(lines[:motion_line], path)
    n_frames, frame_time, table_line = _read_motion_header(lines, motion_line + 1, path)
    table = _read_table(lines, table_line, tree, n_frames, path)
    cmu = is_cmu(tree.names) or set(tree.names) >= MAX_FORM
    unit_note = "given" if unit_m is not None else "CMU's" if cmu else "centimetres"
    unit_m = unit_m if unit_m is not None else CMU_UNIT_M if cmu else CENTIMETRE_M
    if fps_hz is not None:
        fps_hz, rate_note = source_motion.check_rate_hz(fps_hz, path), "given"
    else:
        fps_hz = source_motion.rate_of_frame_time_hz(frame_time, path, table_line)
        rate_note = "header"
        if cmu and fps_hz == 120.0 and source_motion.cmu_subject(path) is not None:
            fps_hz, rate_note = source_motion.cmu_rate_hz(path), "CMU's index"  # all say 120 Hz
    notes = (f"{fps_hz:.7g} Hz ({rate_note})", f"{unit_m:.6g} m per unit ({unit_note})")
    turns = [[c for _, c in joint] for joint in _columns(tree, "rotation")]
    rows, dropped = recorded_rows(table, turns, cmu, drop_rest_frame, path, fewest_frames)
    added_pose = _local_rotmats(tree, table[:1])[0] if DROPPED_REST in dropped else None
    translations, offsets = _translations(tree, table[rows])
    return SourceMotion(
        names=tuple(tree.names),
        parents=tuple(tree.parents),
        offsets_m=offsets * unit_m,
        tips_m=np.array(tree.tips) * unit_m,
        local_rotmats=_local_rotmats(tree, table[rows]),
        translations_m=translations * unit_m,
        fps_hz=fps_hz,
        rate_from=rate_note,
        notes=notes + dropped,
        first_row=rows.start,
        added_pose=added_pose,
    )


def _read_table(
    lines: list[str], start: int, tree: Hierarchy, n_frames: int, path: Path
) -> np.ndarray:
    """The numbers (T, columns); BadMotionFile for more than a file of its size may stand for."""
    try:  # each joint becomes a matrix in each frame, though few may have a column
        Budget.of(path).take_numbers(9 * n_frames * len(tree.names))
    except OverBudget as error:
        raise BadMotionFile(f"{path}: {error}; cut it into parts") from None
    n_columns = sum(len(channels) for channels in tree.channels)
    return parse_table(lines[start:], n_columns, n_frames, path, start + 1)


def _read_motion_header(lines: list[str], start: int, path: Path) -> tuple[int, str, int]:
    """Frame count, frame time, and its line's number, after which the numbers begin."""
    filled = [i for i in range(start, min(start + 20, len(lines))) if lines[i].strip()][:2]
    keys = [lines[i].partition(":") for i in filled]
    if [key.strip().lower() for key, _, _ in keys] != ["frames", "frame time"]:
        raise bad_line(path, start + 1, "'Frames:' and 'Frame Time:' must follow MOTION")
    number = keys[0][2].strip()
    if not (number.isascii() and number.isdigit() and len(number) < 9):
        raise bad_line(path, filled[0] + 1, f"{number[:40]!r} is no number of frames")
    return int(number), keys[1][2].strip(), filled[1] + 1


def _columns(tree: Hierarchy, wanted: str) -> list[list[tuple[str, int]]]:
    """Per joint, the (axis, column in the table) of its channels of one kind."""
    column = count()
    numbered = [[(axis, kind, next(column)) for axis, kind in names] for names in tree.channels]
    return [[(axis, n) for axis, kind, n in names if kind == wanted] for names in numbered]


def _local_rotmats(tree: Hierarchy, table: np.ndarray) -> np.ndarray:
    """(T, J, 3, 3)."""
    rotmats = np.broadcast_to(np.eye(3), (len(table), len(tree.names), 3, 3)).copy()
    for joint, channels in enumerate(_columns(tree, "rotation")):
        if channels:
            axes, columns = zip(*channels, strict=True)
            rotmats[:, joint] = euler_rotmats("".join(axes), table[:, list(columns)])
    return rotmats


def _translations(tree: Hierarchy, table: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (T, J, 3) in the file's unit, offsets where no channel says others; and offsets."""
    offsets, columns = np.array(tree.offsets), _columns(tree, "position")
    translations = np.tile(offsets, (len(table), 1, 1))
    for joint, channels in enumerate(columns):
        for axis, column in channels:
            translations[:, joint, "XYZ".index(axis)] = table[:, column]
    # Some programs write how far joints are from their offsets, and then along all three axes.
    placed = np.array([j > 0 and len(channels) == 3 for j, channels in enumerate(columns)])
    usual = np.median(translations, axis=0)
    place, move, size = (np.linalg.norm(one, axis=1) for one in (usual, usual - offsets, offsets))
    is_small, is_near = placed & (2 * place < size), placed & (2 * move < size)
    if is_small.sum() > is_near.sum():  # not where hips alone stand near nothing
        translations[:, is_small] += offsets[is_small]
    if not offsets[1:].any():
        offsets[1:] = np.median(translations[:, 1:], axis=0)
    return translations, offsets
