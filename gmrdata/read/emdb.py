"""EMDB's sequences: `P0/09_outdoor_walk/P0_09_outdoor_walk_data.pkl` and the like, as arrays.

Layout after EMDB's own description (Kaufmann et al. 2023).  Nothing that a pickle asks for is run.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read import numbers
from gmrdata.read.safe_pickle import load_plain
from gmrdata.values.body import WORLD_FROM_REST
from gmrdata.values.errors import MissingInput
from gmrdata.values.files import files_inside, visible
from gmrdata.values.transforms import rigid

FPS_HZ = 30.0  # rate of the images and all arrays [Hz]
WORLD_FROM_EMDB = rigid(WORLD_FROM_REST, np.zeros(3))
"""(4, 4): EMDB's world is y-up, ours z-up."""
LARGEST_FILE_BYTES = 1 << 29  # EMDB's own files have some ten million bytes
GENDERS = ("female", "male", "neutral")


def find_sequences(root: Path) -> list[Path]:
    """The `*_data.pkl` of each sequence, sorted; links that lead out of the folder are left out."""
    paths = files_inside(root, visible(root.glob("P*/*/*_data.pkl")))
    if not paths:
        remedy = "Name the folder that holds EMDB's P0 to P9"
        raise MissingInput(f"{root}: no P*/<sequence>/*_data.pkl. {remedy}")
    return paths


@dataclass(frozen=True, eq=False)
class EmdbSequence:
    """One person and one moving camera over N frames at 30 Hz, in EMDB's y-up world."""

    name: str  # `P0_09_outdoor_walk`
    emdb1: bool  # in EMDB 1, on which poses are scored
    emdb2: bool  # in EMDB 2, on which global trajectories are scored
    gender: str  # of the SMPL body: "female", "male" or "neutral"
    good: np.ndarray  # (N,) bool: frames in which the person is in view; `good_frames_mask`
    poses_rad: np.ndarray
    """(N, 72) axis-angle of the 24 SMPL joints, the first three world_from_root [rad]."""
    trans_m: np.ndarray
    """(N, 3) SMPL's transl in the world [m].  Not the pelvis: that is `trans` + J0(betas)."""
    betas: np.ndarray  # (10,) SMPL shape
    intrinsics_px: np.ndarray  # (3, 3) calibration matrix [px]
    cam_from_world: np.ndarray  # (N, 4, 4) rigid transforms [m], OpenCV camera axes; `extrinsics`
    width_px: int
    height_px: int

    @property
    def n_frames(self) -> int:
        return len(self.trans_m)


def read_emdb(path: Path) -> EmdbSequence:
    """Read one `*_data.pkl`.  NaN in poses and cameras is kept; `gmrdata.motion.emdb` drops it."""
    numbers.check_file(path, LARGEST_FILE_BYTES, "EMDB")
    content = load_plain(path)
    with numbers.checked(path, "get the file again from EMDB"):
        return _sequence(content)


def _sequence(content: Any) -> EmdbSequence:
    smpl, camera = (_typed(content, k, (dict,), "a dictionary") for k in ("smpl", "camera"))
    n_frames = _whole(content, "n_frames", most=10_000_000)
    width_px, height_px = (_whole(camera, key, most=100_000) for key in ("width", "height"))
    poses = (("poses_root", 3), ("poses_body", 69))
    betas = _floats(smpl, "betas", 10)
    if not numbers.usable_rows(betas[None]).all():
        raise numbers.WrongContent("betas are not finite")
    gender = numbers.text_of(numbers.value_of(content, "gender"), "gender").lower()
    if gender not in GENDERS:
        raise numbers.WrongContent(f"gender is {gender[:20]!r}, expected {', '.join(GENDERS)}")
    flags = [_typed(content, f"emdb{n}", (bool, np.bool_), "True or False") for n in (1, 2)]
    good = numbers.any_array_of(numbers.value_of(content, "good_frames_mask"), "good_frames_mask")
    if good.shape != (n_frames,) or good.dtype.kind not in "biu":
        what = f"{numbers.kind_of(good)}, expected {n_frames} of True, False"
        raise numbers.WrongContent(f"good_frames_mask is {what}")
    return EmdbSequence(
        name=numbers.text_of(numbers.value_of(content, "name"), "name"),
        emdb1=bool(flags[0]),
        emdb2=bool(flags[1]),
        gender=gender,
        good=good != 0,
        poses_rad=np.hstack([_floats(smpl, key, n_frames, size) for key, size in poses]),
        trans_m=_floats(smpl, "trans", n_frames, 3),
        betas=betas,
        intrinsics_px=numbers.pinhole_of(numbers.value_of(camera, "intrinsics"), "intrinsics"),
        cam_from_world=_floats(camera, "extrinsics", n_frames, 4, 4),
        width_px=width_px,
        height_px=height_px,
    )


def _typed(content: Any, key: str, kinds: tuple[type, ...], expected: str) -> Any:
    value = numbers.value_of(content, key)
    if not isinstance(value, kinds):
        raise numbers.WrongContent(f"{key} is {numbers.kind_of(value)}, expected {expected}")
    return value


def _floats(content: Any, key: str, *shape: int) -> np.ndarray:
    return numbers.floats_of(numbers.value_of(content, key), key, shape)


def _whole(content: Any, key: str, most: int) -> int:
    value = numbers.value_of(content, key)
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_whole or not 1 <= value <= most:
        raise numbers.WrongContent(f"{key} is {value!r:.40}, expected a whole number from 1")
    return int(value)
