"""People of a video: as systems estimate them, as the built-in one does, and their files."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt

from gmrdata.values.body import N_LOCAL, NEUTRAL
from gmrdata.values.camera import Lens
from gmrdata.values.errors import BadRecord
from gmrdata.values.files import write_npz
from gmrdata.values.records import MAKE_AGAIN, ArrayShapes, Record, check_shapes, read_arrays

BODIES, PSEUDO_GT, FUSED = "bodies", "pseudo_gt", "fused"
"""Folders of a sequence's people: before the camera, in the world by the cameras, and there with a
network's motions too."""
DOUBTS_FILE = "doubts.json"
"""Beside these folders: why frames must not be used, as those of odd times."""


@dataclass(frozen=True, init=False)
class PersonFiles:
    """One person of a sequence."""

    clip_path: Path  # clip with the person in the camera frame, intrinsics and image numbers
    body_path: Path

    def __init__(self, clip_path: Path | str, body_path: Path | str) -> None:
        object.__setattr__(self, "clip_path", Path(clip_path))
        object.__setattr__(self, "body_path", Path(body_path))


def person_file(number: int) -> str:
    """Name of a person's clip in a stage's folder; people are counted from 0."""
    return f"person_{number}.npz"


def stage_inputs(people: tuple[PersonFiles, ...]) -> dict[str, Path]:
    """The files by role, for a stage's record."""
    inputs: dict[str, Path] = {}
    for number, person in enumerate(people):
        inputs |= {f"clip_{number}": person.clip_path, f"body_{number}": person.body_path}
    return inputs


System = Literal[
    "vibe", "wham", "gvhmr", "gem-x", "gem-smpl", "prompt-hmr", "tram", "phalp", "slahmr",
    "sam-3d-body", "amass", "gmrdata",
]  # fmt: skip
Part = Literal["poses", "camera", "world"]
"""Of an estimate: local poses, a motion before the camera, a motion in the world.  A person whose
crop is known can stand in the world by a camera's own path, so that counts as the last."""


@dataclass(frozen=True, eq=False)
class Crop:
    """The square of each picture that a network saw, and nothing else of it.

    The same crop at the side of the picture and in its middle gives the same answer, so the root is
    as seen along the ray through the crop's middle (Yu et al., "Perspective Crop Layers", 2021).
    """

    middle_px: np.ndarray  # (T, 2)
    side_px: np.ndarray  # (T,)
    weak: np.ndarray  # (T, 3) s, tx, ty: X is seen at s (X + t) half sides from the middle
    network_px: float  # the side that it was brought to; seen so with 5000 px (HMR and its heirs)


@dataclass(frozen=True, eq=False)
class Pinhole:
    """A pinhole camera by row."""

    focal_px: np.ndarray  # (T,)
    centre_px: np.ndarray  # (T, 2) principal point


@dataclass(frozen=True, eq=False)
class InCamera:
    """A motion before the camera that the system took for the video's, over T rows."""

    root_rotmats: np.ndarray  # (T, 3, 3) cam_from_root; with a crop, along its ray
    transl_m: np.ndarray | None  # (T, 3) SMPL's transl: pelvis = transl + J0; None with a crop
    camera: Crop | Pinhole | Literal["picture", "diagonal", "own"]
    """picture: `in_picture` is all that is known; diagonal: the guess of CLIFF, a focal length of
    the picture's diagonal round its middle; own: the video's true camera."""
    size_px: tuple[float, float] | None = None
    """(width, height) of the pictures in whose pixels the camera is; None: the video's."""
    in_picture: np.ndarray | None = None
    """(T, 4) scale and shift in x and y: picture = scale * (place + shift), from -1 to 1."""


@dataclass(frozen=True, eq=False)
class InWorld:
    """A motion in the system's own world, over T rows."""

    root_rotmats: np.ndarray  # (T, 3, 3) file_from_root
    transl_m: np.ndarray  # (T, 3) SMPL's transl in the file's axes: pelvis = transl + J0
    z_up_from_file: np.ndarray  # (T, 4, 4) to a world with z up [m]
    z_up_from_cam: np.ndarray | None = None
    """(T, 4, 4) the system's own camera; its place counts with `has_camera_path` alone [m]."""
    has_camera_path: bool = False
    of_mean_shape: bool = False  # J0 is that of the mean of `betas`, not of each row's


@dataclass(frozen=True, eq=False)
class EstimatedPerson:
    """One person over the T rows in which the system has it."""

    name: str  # unique in the file: "person_<number>", as the file counts; letters, digits, _ and -
    frame_numbers: np.ndarray  # (T,) int, rising: which frame of the video each row is, from 0
    local_rotmats: np.ndarray  # (T, 23, 3, 3) parent_from_joint
    in_camera: InCamera | None = None
    in_world: InWorld | None = None
    betas: np.ndarray | None = None  # (T, S) of `betas_body`; None where the file has none of SMPL
    betas_body: str = NEUTRAL  # name of the BodyModel that `betas` are of
    rest_pelvis_m: np.ndarray | None = None
    """(3,) J0 of the file's own body, rest frame [m]; None where `betas` tell it."""
    cuts: frozenset[int] = frozenset()  # frames with which a new shot of the video begins
    has_own_rate: bool = False  # rows are of the file's own frame rate, not frames of a video
    lacks: Mapping[Part, str] = field(default_factory=dict)
    """What the file has not that a part needs, in words."""

    def has_betas_of(self, body: str) -> bool:
        """Whether the shape holds on a body of that name: SMPL's neutral betas on its neutral body
        alone."""
        return self.betas is not None and self.betas_body == body == NEUTRAL


SAME_RATE = 0.01  # as a share: the frames then drift by one in 100


@dataclass(frozen=True, eq=False)
class EstimatedPeople:
    """What a system's result holds of a video."""

    system: System
    files: tuple[Path, ...]  # that it was read from
    people: tuple[EstimatedPerson, ...]
    n_frames: int | None = None  # of the video, where the result tells
    fps_hz: float | None = None  # the result's own frame rate [Hz], where it has one

    def can_be_at(self, fps_hz: float) -> bool:
        """Whether its frames can be those of a video of a rate [Hz]."""
        return self.fps_hz is None or abs(self.fps_hz - fps_hz) <= SAME_RATE * fps_hz


POSES_FILE = "local_poses.json"
POSES_FORMAT = "gmrdata-poses/1"

_SHAPES: ArrayShapes = {
    "frame_numbers": ("iu", ("T",)),
    "local_rotmats": ("f", ("T", N_LOCAL, 3, 3)),
    "root_rotmats": ("f", ("T", 3, 3)),
    "pelvis_m": ("f", ("T", 3)),
}


@dataclass(frozen=True, eq=False)
class LocalPoses:
    """One person before the camera, over the T frames in which it was seen."""

    frame_numbers: np.ndarray  # (T,) int, rising: which frame of the video, counted from 0
    local_rotmats: np.ndarray  # (T, 23, 3, 3) parent_from_joint
    root_rotmats: np.ndarray  # (T, 3, 3) cam_from_root
    pelvis_m: np.ndarray  # (T, 3) before the camera, for the body's mean shape [m]

    def write(self, path: Path) -> None:
        """Write the poses as an .npz without pickled objects."""
        arrays = {key: np.asarray(getattr(self, key)) for key in _SHAPES}
        check_shapes(path, arrays, _SHAPES)
        write_npz(path, {"format": np.array(POSES_FORMAT), **arrays})

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read one person's poses; BadRecord names what is wrong with the file."""
        poses = cls(**read_arrays(path, POSES_FORMAT, _SHAPES))
        if (np.diff(poses.frame_numbers.astype(np.int64), prepend=-1) <= 0).any():
            raise BadRecord(f"{path}: its frame_numbers do not rise from 0 on; {MAKE_AGAIN}")
        return poses


class LocalPosesRecord(Record):
    """`local_poses.json`: who is in a folder of poses, and of what video."""

    format: Literal["gmrdata-local-poses/3"] = "gmrdata-local-poses/3"
    people: int = Field(ge=0)
    images: PositiveInt
    frames: PositiveInt
    """Of the video, up to the last image."""
    size_px: tuple[PositiveInt, PositiveInt]
    focal_px: tuple[PositiveFloat, PositiveFloat]
    """Of the lens that the places are seen by."""
    centre_px: tuple[float, float]
    radial: tuple[float, float]
    body: str
    """Of whose mean shape the places are."""
    doubts: tuple[str, ...]
    """Of each person why the poses may be wrong as a whole; empty where nothing says so."""

    @property
    def lens(self) -> Lens:
        return Lens(self.focal_px, self.centre_px, self.size_px, self.radial)


def load_local_poses(folder: Path) -> tuple[LocalPosesRecord, list[LocalPoses]]:
    """The people of a finished folder; MissingInput or BadRecord names the file that is wrong."""
    record = LocalPosesRecord.read(folder / POSES_FILE)
    return record, [LocalPoses.read(folder / person_file(n)) for n in range(record.people)]
