"""People of a video as some system estimates them: before the camera, in the world, or both."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

System = Literal["vibe", "wham", "gvhmr", "tram", "phalp", "slahmr", "amass", "gmrdata"]
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
    betas_body: str = "smpl-neutral"  # name of the BodyModel that `betas` are of
    rest_pelvis_m: np.ndarray | None = None
    """(3,) J0 of the file's own body, rest frame [m]; None where `betas` tell it."""
    cuts: frozenset[int] = frozenset()  # frames with which a new shot of the video begins
    has_own_rate: bool = False  # rows are of the file's own frame rate, not frames of a video
    lacks: Mapping[Part, str] = field(default_factory=dict)
    """What the file has not that a part needs, in words."""


@dataclass(frozen=True, eq=False)
class EstimatedPeople:
    """What a system's result holds of a video."""

    system: System
    files: tuple[Path, ...]  # that it was read from
    people: tuple[EstimatedPerson, ...]
    n_frames: int | None = None  # of the video, where the result tells
    fps_hz: float | None = None  # the result's own frame rate [Hz], where it has one
