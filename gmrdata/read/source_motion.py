"""SourceMotion: a motion on its own skeleton, from BVH or ASF/AMC; its recorded rows and rate.

And `ReadConfig`: what a person says of such a file that it doesn't show.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Literal, Self, get_args

import numpy as np
from pydantic import Field, ValidationError

from gmrdata.read.numbers import bad_line
from gmrdata.values.errors import BadMotionFile, BadRecipe, MissingInput
from gmrdata.values.records import Config, first_problem
from gmrdata.values.skinning import global_rotmats, joint_positions_m

RestPose = Literal["t", "a", "arms_down", "arms_up", "along_axes", "first_frame"]
"""What a file's pose without rotations is.  The first four stand, with arms as said; along the
axes it is no pose at all; `first_frame` says that the person stands in frame 0."""


UpAxis = Literal["x", "y", "z", "-x", "-y", "-z"]
"""An axis of a file's world."""


def axis_of(name: UpAxis) -> np.ndarray:
    """(3,) the axis."""
    return np.eye(3)["xyz".index(name[-1])] * (-1.0 if name[0] == "-" else 1.0)


class ReadConfig(Config):
    """What a person says of motion files; None: each file is looked at for it."""

    fps_hz: float | None = None
    """True frame rate [Hz]."""
    unit_m: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    """Metres per unit of a BVH or ASF, or of `trans` of an .npz."""
    joint_map: dict[str, str] | Path | None = None
    """`{name in a BVH or ASF: SMPL joint}`, or a YAML or JSON file of it."""
    rest_pose: RestPose | Path | None = None
    """What the pose without rotations of a BVH or ASF is; or a BVH of the same skeleton, in whose
    first frame the person stands."""
    up: UpAxis | None = None
    """Which axis of the file's world is up."""

    @classmethod
    def of(cls, where: Path, **said: object) -> Self:
        """From what a caller says of files; BadRecipe, by their path, for what can't be."""
        if isinstance(names := said.get("joint_map"), Mapping):
            said["joint_map"] = dict(names)
        try:
            return cls.model_validate(said)
        except ValidationError as error:
            raise BadRecipe(f"{where}: {first_problem(error)}") from None

    @property
    def inputs(self) -> dict[str, Path]:
        """Files that the motion depends on, by name."""
        files = {"joint_map": self.joint_map, "rest_pose": self.rest_pose}
        return {name: file for name, file in files.items() if isinstance(file, Path)}

    @property
    def recorded(self) -> "ReadConfig":
        """The same without its files, which count in a stage's record by their content."""
        return self.model_copy(update=dict.fromkeys(self.inputs))

    def require_rest_file(self) -> None:
        """MissingInput where `rest_pose` is none of the words, and no file that is there."""
        if isinstance(self.rest_pose, Path) and not self.rest_pose.is_file():
            what = f"no such file. --rest-pose takes a BVH file, or {', '.join(get_args(RestPose))}"
            raise MissingInput(f"{self.rest_pose}: {what}")


DEFAULT_READING = ReadConfig()


@dataclass(frozen=True, eq=False)
class SourceMotion:
    """T frames of a skeleton of J joints, in the file's own axes, in metres.

    A joint's frame is parallel to the world's in the file's zero pose, so a global rotation says
    how far the joint has turned away from the zero pose.  Both formats are brought to this form, so
    the same motion has the same rotations whichever file it came from.
    """

    names: tuple[str, ...]  # (J,) a parent comes before its children
    parents: tuple[int, ...]  # (J,) -1 for the root
    offsets_m: np.ndarray  # (J, 3) joint position relative to its parent's in the zero pose [m]
    tips_m: np.ndarray
    """(J, 3) end of the joint's bone relative to the joint in the zero pose [m]; NaN if unknown."""
    local_rotmats: np.ndarray
    """(T, J, 3, 3) parent_from_joint rotations; of the root: world_from_joint."""
    translations_m: np.ndarray
    """(T, J, 3) joint position in its parent's frame [m]; of the root: in the file's world."""
    fps_hz: float
    rate_from: str  # "header", "CMU's index", "CMU's skeleton" or "given"
    notes: tuple[str, ...]  # what the reader decided (unit, rate, dropped frame), for the record
    first_row: int = 0  # of the file's rows, the one that is frame 0 here
    added_pose: np.ndarray | None = None
    """(J, 3, 3) local rotations of the rest pose in the file's frame 0, where it was dropped, or of
    another file's first frame, where a person names one."""

    @property
    def n_frames(self) -> int:
        return int(self.local_rotmats.shape[0])

    def rest_joints_m(self) -> np.ndarray:
        """Joint positions in the zero pose, root at its offset: (J, 3) [m]."""
        unturned = np.tile(np.eye(3), (1, len(self.parents), 1, 1))
        return np.asarray(joint_positions_m(self.parents, unturned, self.offsets_m)[0])

    def posed(self, rows: slice | np.ndarray = slice(None)) -> tuple[np.ndarray, np.ndarray]:
        """world_from_joint (N, J, 3, 3) and joints in the world (N, J, 3) [m] of some frames."""
        world_from_joint = global_rotmats(self.parents, self.local_rotmats[rows])
        translations_m = self.translations_m[rows]
        return world_from_joint, joint_positions_m(self.parents, world_from_joint, translations_m)


DROPPED_REST = "added rest pose in frame 0 dropped"
REST_FRAME_JUMP_DEG = 10.0
"""A first frame without any root rotation is an added rest pose if a joint then jumps this far."""
ROOTS = 3
"""Of so many first joints the first that turns is the root: a Reference may stand still above."""


def recorded_rows(
    table: np.ndarray,
    rotation_columns: Sequence[Sequence[int]],
    cmu: bool,
    drop_rest_frame: bool | None,
    path: Path,
    fewest_frames: int = 2,
) -> tuple[slice, tuple[str, ...]]:
    """The recorded rows of a file's table of channels.

    cgspeed's CMU files begin with a T-pose.  A recorded root is never turned by exactly nothing; in
    a recording that does start at rest the next frame is close to it, after the added pose comes a
    jump. Some CMU trials (09_10) hold rows of nothing but zeros before or after the recording.

    The table is (T, C), angles in degrees; `rotation_columns` are those of each joint, root first.
    In CMU's files rows of zeros are rows without data.  With `drop_rest_frame` None it is looked
    for whether row 0 is an added rest pose.
    """
    empty = np.asarray(~table.any(axis=1)) if cmu else np.zeros(len(table), dtype=bool)
    if drop_rest_frame is None:
        drop_rest_frame = _starts_with_rest_frame(table, rotation_columns, empty)
    filled = np.flatnonzero(~empty[1:]) + 1 if drop_rest_frame else np.flatnonzero(~empty)
    if len(filled) < fewest_frames:
        what = f"{len(filled)} recorded frames are no motion; it takes at least {fewest_frames}"
        raise BadMotionFile(f"{path}: {what}")
    start, stop = int(filled[0]), int(filled[-1]) + 1
    if empty[start:stop].any():
        gap = start + int(np.argmax(empty[start:stop]))
        raise BadMotionFile(f"{path}: frame {gap} holds no data, all is zero; split the file there")
    notes = (DROPPED_REST,) if drop_rest_frame else ()
    n_empty = len(table) - (stop - start) - len(notes)
    return slice(start, stop), notes + ((f"{n_empty} empty frames dropped",) if n_empty else ())


def _starts_with_rest_frame(
    table: np.ndarray, rotation_columns: Sequence[Sequence[int]], empty: np.ndarray
) -> bool:
    """Whether row 0 is a pose that was put in front of a recording."""
    later = np.flatnonzero(~empty[1:]) + 1
    if not len(later):
        return False
    first_joints = [list(columns) for columns in rotation_columns[:ROOTS]]
    turning = (joint for joint in first_joints if (table[:, joint] != table[0, joint]).any())
    root = next(turning, [])
    if not root or table[0, root].any() or not table[later[0], root].any():
        return False
    angles_deg = table[:, [column for columns in rotation_columns for column in columns]]
    turn_deg = angles_deg[later[0]] - angles_deg[0]
    return bool(np.abs((turn_deg + 180.0) % 360.0 - 180.0).max() > REST_FRAME_JUMP_DEG)


CMU_60_HZ_SUBJECTS = frozenset({33, 34, 42, 60, 61, 62, 74, 75, 77, 79, 80, 87, 88, 89, 136})
"""Subjects that CMU's index lists with 60 fps, whatever their files say; all others have 120."""
CMU_TRIAL = re.compile(r"([0-9]{2,3})_([0-9]{2})(?=_|$)")
"""CMU's file names: subject_trial; AMASS appends `_poses` or `_stageii`."""
LOWEST_HZ, HIGHEST_HZ = 1.0, 1000.0
USUAL_HZ = (24, 25, 30, 50, 60, 90, 100, 120, 144, 240)  # of recorders
LOWEST_HEADER_HZ = 5.0  # nobody records a person with less; a header that says so was never set


def is_trial(name: str) -> bool:
    """Whether a name is one of CMU's trials, `subject_trial`, like 02_03 or 143_18."""
    return CMU_TRIAL.fullmatch(name) is not None


def in_cmu(path: PurePath) -> bool:
    """Whether a path has a folder of CMU's motions in it, like `CMU` or `cmu_smplh`: a file's as it
    is typed or where links lead.  AMASS's other sets may have names like CMU's trials."""
    paths = (path.absolute(), path.resolve()) if isinstance(path, Path) else (path,)
    return any(part.lower().startswith("cmu") for one in paths for part in one.parts)


def cmu_subject(path: Path) -> int | None:
    """Subject number in a file name like CMU's `02_03.amc` or `62_11_poses.npz`, else None."""
    match = CMU_TRIAL.match(path.stem)
    return int(match.group(1)) if match else None


def cmu_rate_hz(path: Path) -> float:
    """Frame rate of a CMU file by its subject: 60 or 120 [Hz]."""
    return 60.0 if cmu_subject(path) in CMU_60_HZ_SUBJECTS else 120.0


def rate_of_frame_time_hz(text: str, path: Path, line_number: int) -> float:
    """Frame rate of a BVH `Frame Time`, with the rounding of the printed number undone.

    `.0083333` stands for everything from .00833325 to .00833335, and 120 Hz lies in there; so does
    29.97 Hz and no whole rate in .0333667.  In .017 lie 58, 59 and 60 Hz, of which one is usual;
    .004 is 250 Hz, of which it is no rounding, and not 240.
    """
    try:
        frame_time_s = float(text)
    except ValueError:
        raise bad_line(path, line_number, f"frame time {text[:40]!r} is not a number") from None
    if not 1 / HIGHEST_HZ <= frame_time_s <= 1 / LOWEST_HEADER_HZ:
        rates = f"{LOWEST_HEADER_HZ:g} to {HIGHEST_HZ:g} Hz"
        what = f"a frame time of {text[:40]} s is no rate from {rates}"
        raise bad_line(path, line_number, f"{what}; give the true rate with --fps-hz")
    mantissa, _, exponent = text.strip().lower().partition("e")
    decimals = len(mantissa.partition(".")[2]) - (int(exponent) if exponent else 0)
    # Many programs print single precision; and 1/256 lies exactly between two numbers of 7 digits.
    half_step_s = (0.5 * 10.0**-decimals + np.spacing(np.float32(frame_time_s)) / 2) * (1 + 1e-6)
    # Rates as people write them: whole, a television's, or with few decimals.
    whole_hz, *decimal_hz = (round(1 / frame_time_s, n) for n in range(4))
    televisions_hz = round(1.001 / frame_time_s) * 1000 / 1001
    likely_hz = [whole_hz, round(televisions_hz, 3), *decimal_hz, televisions_hz]
    usual_hz, fitting_hz = (
        [float(hz) for hz in some if abs(1 / hz - frame_time_s) <= half_step_s]
        for some in (USUAL_HZ, likely_hz)
    )
    is_rounded = abs(whole_hz * frame_time_s - 1) > 1e-9
    if is_rounded and len(usual_hz) == 1:
        return usual_hz[0]
    return fitting_hz[0] if fitting_hz else 1 / frame_time_s


def check_rate_hz(fps_hz: float, path: Path) -> float:
    if not LOWEST_HZ <= fps_hz <= HIGHEST_HZ:
        what = f"a frame rate of {fps_hz:g} Hz is not from {LOWEST_HZ:g} to {HIGHEST_HZ:g} Hz"
        raise BadMotionFile(f"{path}: {what}; give the true rate with --fps-hz")
    return float(fps_hz)
