"""Reader of Acclaim AMC motions on their ASF skeleton: CMU's own form of its motions.

Each bone has an `axis` rotation C, in which its degrees of freedom are measured.  With M the
rotation by the AMC's angles, applied about fixed axes in the listed order, the bone turns relative
to its parent by C M C^-1, in axes that are parallel to the world's in the zero pose.  A bone starts
where its parent ends.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.errors import BadMotionFile, MissingInput
from gmrdata.motion.asf import Asf, read_asf
from gmrdata.motion.frame_rate import check_rate_hz, cmu_rate_hz
from gmrdata.motion.joint_maps import is_cmu
from gmrdata.motion.recorded import recorded_rows
from gmrdata.motion.skeleton import SourceMotion
from gmrdata.motion.text_numbers import parse_block, parse_floats, read_text

_BONE_NAME = re.compile(r"^[ \t]*([A-Za-z_]\S*)", re.MULTILINE)
_FRAME_NUMBER = re.compile(r"[0-9]+")


@dataclass(frozen=True)
class _Layout:
    """How the numbers of a frame lie, as its first occurrence in the AMC shows it."""

    bones: tuple[str, ...]
    columns: dict[str, slice]
    """Where a bone's numbers stand in a frame's row; the frame's number is column 0."""
    n_columns: int


def read_amc(
    path: Path,
    *,
    asf_path: Path | None = None,
    fps_hz: float | None = None,
    unit_m: float | None = None,
) -> SourceMotion:
    """Read an AMC motion with its ASF skeleton.

    Args:
        path: The AMC file.
        asf_path: The skeleton; without it, the file's own name or its subject's (`02_03.amc`:
            `02_03.asf`, then `02.asf`) beside it, or the only .asf there.
        fps_hz: Frame rate [Hz].  The format does not hold it; without it CMU's index decides.
        unit_m: Metres per unit, see `read_asf`.

    Raises:
        MissingInput: the AMC or its ASF is not there.
        BadMotionFile: a file is broken or truncated, the two do not belong together, or the rate of
            a file that is not CMU's was not given.
    """
    text = read_text(path)
    asf_path = asf_path if asf_path is not None else find_asf(path)
    asf = read_asf(asf_path, unit_m=unit_m)
    if fps_hz is None and not is_cmu(asf.names):
        raise BadMotionFile(f"{path}: an AMC file holds no frame rate; give it with fps_hz")
    rate_note = "CMU's index" if fps_hz is None else "given"
    fps_hz = cmu_rate_hz(path) if fps_hz is None else check_rate_hz(fps_hz, path)
    first_line, body, degrees = _body(text, asf, path)
    layout = _layout(body, asf, asf_path, path, first_line)
    table = _table(body, layout, path, first_line)
    rows, rows_notes = recorded_rows(table[:, 1:], [], is_cmu(asf.names), False, path)
    table = table[rows]
    angles = {bone: table[:, columns] for bone, columns in layout.columns.items()}
    return SourceMotion(
        names=asf.names,
        parents=asf.parents,
        offsets_m=np.array([asf.bones_m[p] if p >= 0 else np.zeros(3) for p in asf.parents]),
        tips_m=asf.bones_m,
        local_rotmats=_local_rotmats(asf, angles, len(table), degrees),
        translations_m=_translations(asf, angles["root"]),
        fps_hz=fps_hz,
        notes=(
            f"skeleton {asf_path.name}",
            f"{fps_hz:.7g} Hz ({rate_note})",
            f"{asf.unit_m:.6g} m per unit",
            *rows_notes,
        ),
    )


def find_asf(amc_path: Path) -> Path:
    """The skeleton that lies beside an AMC file.

    Raises:
        MissingInput: the AMC is not there, or no skeleton is, or several are and none has its name.
    """
    subject = amc_path.stem.rpartition("_")[0]
    named = [
        amc_path.with_name(stem + suffix)
        for stem in (amc_path.stem, subject)
        if stem
        for suffix in (".asf", ".ASF")
    ]
    for candidate in named:
        if candidate.is_file():
            return candidate
    others = [p for p in sorted(amc_path.parent.glob("*")) if p.suffix.lower() == ".asf"]
    if len(others) == 1:
        return others[0]
    raise MissingInput(
        f"{amc_path}: its skeleton {subject or amc_path.stem}.asf is not beside it; "
        "put it there or give asf_path"
    )


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
                raise BadMotionFile(
                    f"{path}:{i + 1}: {word[:40]!r} where the first frame's number is due"
                )
            return i + 1, lines[i:], degrees
    raise BadMotionFile(f"{path}: no frames; the file is truncated, fetch it again")


def _layout(body: list[str], asf: Asf, asf_path: Path, path: Path, first_line: int) -> _Layout:
    """Bones and columns of the first frame, checked against the skeleton."""
    columns: dict[str, slice] = {}
    column = 1
    for line_number, line in enumerate(body[1:], first_line + 1):
        words = line.split()
        if not words:
            continue
        if _FRAME_NUMBER.fullmatch(words[0]):
            break
        name = words[0]
        if name not in asf.names or name in columns:
            raise BadMotionFile(
                f"{path}:{line_number}: bone {name[:40]} is not in {asf_path.name}, or comes "
                "twice; "
                "the AMC belongs to another skeleton: give its asf_path"
            )
        due = 6 if name == "root" else len(asf.channels[asf.names.index(name)])
        if len(words) - 1 != due:
            raise BadMotionFile(
                f"{path}:{line_number}: {len(words) - 1} values for {name}, where {asf_path.name} "
                "has "
                f"{due} degrees of freedom; give the asf_path that belongs to this AMC"
            )
        columns[name] = slice(column, column + due)
        column += due
    lost = [n for n, dof in zip(asf.names, asf.channels, strict=True) if dof and n not in columns]
    if lost:
        raise BadMotionFile(
            f"{path}: its frames have no {', '.join(lost)}, which {asf_path.name} has; "
            "the file is truncated, or its skeleton is another one: give asf_path"
        )
    return _Layout(tuple(columns), columns, column)


def _table(body: list[str], layout: _Layout, path: Path, first_line: int) -> np.ndarray:
    """(T, n_columns): one row per frame."""
    text = "\n".join(body)
    names = _BONE_NAME.findall(text)
    n_frames, rest = divmod(len(names), len(layout.bones))
    values = parse_block(_BONE_NAME.sub("", text))
    regular = (
        values is not None
        and rest == 0
        and values.size == n_frames * layout.n_columns
        and names == list(layout.bones) * n_frames
    )
    if not regular or values is None:
        _explain(body, layout, path, first_line)
        raise BadMotionFile(f"{path}: the frames are not regular; fetch the file again")
    table = values.reshape(n_frames, layout.n_columns)
    jumps = np.flatnonzero(np.diff(table[:, 0]) != 1.0)
    if jumps.size:
        before, after = table[jumps[0], 0], table[jumps[0] + 1, 0]
        raise BadMotionFile(
            f"{path}: frame {after:g} follows frame {before:g}; frames are missing. Split the file "
            "there, or fetch it again"
        )
    return table


def _explain(body: list[str], layout: _Layout, path: Path, first_line: int) -> None:
    """Find the line at which the frames stop being regular, and raise with it."""
    due = [("", 0), *((bone, c.stop - c.start) for bone, c in layout.columns.items())]
    position, last_line = 0, first_line
    for line_number, line in enumerate(body, first_line):
        words = line.split()
        if not words:
            continue
        last_line = line_number
        name, n_values = due[position % len(due)]
        if name == "" and not (len(words) == 1 and _FRAME_NUMBER.fullmatch(words[0])):
            raise BadMotionFile(
                f"{path}:{line_number}: {line[:40]!r} where a frame's number is due"
            )
        if name and (words[0] != name or len(words) - 1 != n_values):
            raise BadMotionFile(
                f"{path}:{line_number}: {line[:40]!r} where {name} with {n_values} values is due; "
                "fetch the file again"
            )
        parse_floats(words[1:] if name else words, path, line_number)
        position += 1
    if position % len(due):
        raise BadMotionFile(
            f"{path}:{last_line}: the last frame is not complete; the file is truncated"
        )


def _local_rotmats(
    asf: Asf, angles: dict[str, np.ndarray], n_frames: int, degrees: bool
) -> np.ndarray:
    """(T, J, 3, 3): C M C^-1 of every bone."""
    rotmats = np.broadcast_to(np.eye(3), (n_frames, len(asf.names), 3, 3)).copy()
    for bone, name in enumerate(asf.names):
        axes = asf.channels[bone]
        if not axes or name not in angles:
            continue
        values = angles[name]
        if name == "root":
            values = values[:, [i for i, word in enumerate(asf.root_order) if word[0] == "r"]]
        turned = Rotation.from_euler(axes, values, degrees=degrees).as_matrix()
        frame = asf.world_from_axis[bone]
        rotmats[:, bone] = frame @ turned.reshape(-1, 3, 3) @ frame.T
    return rotmats


def _translations(asf: Asf, root: np.ndarray) -> np.ndarray:
    """(T, J, 3) [m]: each bone starts at its parent's end."""
    starts = np.array([asf.bones_m[p] if p >= 0 else np.zeros(3) for p in asf.parents])
    translations = np.tile(starts, (len(root), 1, 1))
    columns = [asf.root_order.index(word) for word in ("tx", "ty", "tz")]
    translations[:, 0] = root[:, columns] * asf.unit_m + asf.root_position_m
    return translations
