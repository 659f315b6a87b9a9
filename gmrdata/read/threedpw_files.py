"""3DPW's files: where they are, and a sequence's arrays with their real meanings.

3DPW/imageFiles/<sequence>/image_00000.jpg, image_00001.jpg, ...
3DPW/sequenceFiles/{train,validation,test}/<sequence>.pkl

They are found without ever leaving the root folder, and nothing of a .pkl is run.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read import numbers
from gmrdata.read.safe_pickle import load_plain
from gmrdata.values.body import SMPL_SHAPES
from gmrdata.values.errors import BadSequence, MissingInput

FPS_HZ, IMU_HZ = 30.0, 60.0
"""Rates of the images and arrays, and of the IMUs with `poses_60Hz` and `trans_60Hz` [Hz]."""
N_KEYPOINTS = 18  # OpenPose's COCO keypoints in `poses2d`
GENDERS = {"f": "female", "m": "male"}  # 3DPW's letters for the gender of a person's SMPL body


@dataclass(frozen=True, eq=False)
class ThreedpwPerson:
    """One person over the N frames of a sequence, in 3DPW's world.

    That world is y-up and drifts: only relative to `SequenceArrays.cam_from_world` of the same
    frame is a person where the image shows them.
    """

    poses_rad: np.ndarray
    """(N, 72) axis-angle of the 24 SMPL joints, `poses`; the first are world_from_root [rad]."""
    trans_m: np.ndarray
    """(N, 3) SMPL's `transl` in the world [m].  Not the pelvis: that is `trans` + J0(betas)."""
    betas: np.ndarray
    """(S,) SMPL shape; S is 10, and longer in some files: a body takes as many as it has."""
    gender: str  # "female" or "male"; `genders` in the files, `gender` in the readme
    campose_valid: np.ndarray  # (N,) bool: the camera of this frame was aligned to this person
    poses2d_px: np.ndarray
    """(N, 18, 3) OpenPose keypoints: x [px], y [px], confidence; all zero where fewer than 6 joints
    were found.  The files have (N, 3, 18)."""
    poses_60hz_rad: np.ndarray | None = None  # (M, 72) as `poses_rad`, at the IMUs' 60 Hz
    trans_60hz_m: np.ndarray | None = None  # (M, 3) as `trans_m`, at 60 Hz
    joints_world_m: np.ndarray | None = None
    """(N, 24, 3) SMPL joints in the world [m]; `jointPositions`, (N, 72) in the files."""
    betas_clothed: np.ndarray | None = None  # (S,) shape of the clothed template
    template_clothed_m: np.ndarray | None = None
    """(V, 3) clothed template, rest frame [m]; V is SMPL's 6890."""


@dataclass(frozen=True, eq=False)
class SequenceArrays:
    """A sequence file: one camera and one or two people, N frames at 30 Hz.

    Row t of every array but the 60 Hz ones belongs to `image_{t:05d}.jpg`.
    """

    name: str  # the name that stands in the file
    intrinsics_px: np.ndarray
    """(3, 3) calibration matrix K [px]; pixel (0, 0) is the outer corner of the top-left pixel."""
    cam_from_world: np.ndarray
    """(N, 4, 4) rigid transforms [m], OpenCV camera axes; `cam_poses`, world to camera."""
    img_frame_ids: np.ndarray
    """(N,) rows of the **60 Hz** arrays (0, 2, 4, ...), not numbers of images."""
    people: tuple[ThreedpwPerson, ...]

    @property
    def n_frames(self) -> int:
        return len(self.cam_from_world)


LARGEST_FILE_BYTES = 1 << 29
"""3DPW's own files have some ten million bytes; what is far larger is something else."""


def read_sequence_file(path: Path) -> SequenceArrays:
    """Read one `sequenceFiles/<split>/<sequence>.pkl` (protocol 2, Latin-1), without its images.

    Layout after 3DPW's readme; where files differ from it, both are read: `genders` or `gender`,
    `poses2d` or `poses2D`, (N, 3, 18) or (N, 18, 3).  NaN in poses and cameras is kept: see
    `gmrdata.read.threedpw` for which frames can be used.
    """
    numbers.check_file(path, LARGEST_FILE_BYTES, "3DPW")
    content = load_plain(path)
    with numbers.checked(path, "get the file again from 3DPW"):
        return _sequence(content)


def _sequence(content: Any) -> SequenceArrays:
    cam_poses = numbers.value_of(content, "cam_poses")
    cam_from_world = _floats(cam_poses, "cam_poses", (None, 4, 4))
    n_frames = len(cam_from_world)
    if n_frames == 0:
        raise numbers.WrongContent("cam_poses is empty: the sequence has no frames")
    ids = numbers.value_of(content, "img_frame_ids")
    ids = numbers.array_of(ids, "img_frame_ids", (n_frames,), "iu")
    poses = numbers.value_of(content, "poses")
    if not isinstance(poses, list | tuple) or not poses:
        expected = "expected a list with one array per person"
        raise numbers.WrongContent(f"poses is {numbers.kind_of(poses)}, {expected}")
    intrinsics = numbers.value_of(content, "cam_intrinsics")
    return SequenceArrays(
        name=numbers.text_of(numbers.value_of(content, "sequence"), "sequence"),
        intrinsics_px=numbers.pinhole_of(intrinsics, "cam_intrinsics"),
        cam_from_world=cam_from_world,
        img_frame_ids=ids.astype(np.int64),
        people=tuple(_person(content, index, len(poses), n_frames) for index in range(len(poses))),
    )


def _person(content: dict[Any, Any], index: int, n_people: int, n_frames: int) -> ThreedpwPerson:
    def one(*keys: str) -> Any:
        values = numbers.value_of(content, *keys)
        if not isinstance(values, list | tuple) or len(values) != n_people:
            expected = f"expected a list for {n_people} people, as poses"
            raise numbers.WrongContent(f"{keys[0]} is {numbers.kind_of(values)}, {expected}")
        return values[index]

    def floats(key: str, *shape: int | None) -> np.ndarray:
        return _floats(one(key), f"{key}[{index}]", shape)

    def optional(key: str, *shape: int | None) -> np.ndarray | None:
        return floats(key, *shape) if content.get(key) is not None else None

    valid = numbers.array_of(one("campose_valid"), f"campose_valid[{index}]", (n_frames,), "biu")
    joints_m = optional("jointPositions", n_frames, 72)
    betas = floats("betas", None)
    if len(betas) < SMPL_SHAPES or not np.isfinite(betas).all():
        expected = f"expected {SMPL_SHAPES} finite ones"
        raise numbers.WrongContent(f"betas[{index}] has {len(betas)} values, {expected}")
    gender = numbers.text_of(one("genders", "gender"), f"genders[{index}]").lower()
    if gender not in GENDERS | {name: name for name in GENDERS.values()}:
        raise numbers.WrongContent(f"genders[{index}] is {gender[:20]!r}, expected 'm' or 'f'")
    keypoints = one("poses2d", "poses2D")  # (N, 3, 18) in the files, (N, 18, 3) in the readme
    if isinstance(keypoints, np.ndarray) and keypoints.shape[1:] == (3, N_KEYPOINTS):
        keypoints = keypoints.transpose(0, 2, 1)
    keypoints_px = _floats(keypoints, f"poses2d[{index}]", (n_frames, N_KEYPOINTS, 3))
    return ThreedpwPerson(
        poses_rad=floats("poses", n_frames, 72),
        trans_m=floats("trans", n_frames, 3),
        betas=betas,
        gender=GENDERS.get(gender, gender),
        campose_valid=valid != 0,
        poses2d_px=keypoints_px.copy("C"),
        poses_60hz_rad=optional("poses_60Hz", None, 72),
        trans_60hz_m=optional("trans_60Hz", None, 3),
        joints_world_m=None if joints_m is None else joints_m.reshape(n_frames, 24, 3),
        betas_clothed=optional("betas_clothed", None),
        template_clothed_m=optional("v_template_clothed", None, 3),
    )


def _floats(value: Any, what: str, shape: tuple[int | None, ...]) -> np.ndarray:
    return numbers.array_of(value, what, shape, "fiu").astype(np.float64)


SPLITS = ("train", "validation", "test")
IMAGES_DIR, SEQUENCES_DIR = "imageFiles", "sequenceFiles"
SEQUENCE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
"""What a sequence may be called: one path component that can't climb or hide."""


@dataclass(frozen=True)
class SequenceFiles:
    """Where one sequence is; nothing of it was opened yet."""

    root: Path
    name: str
    split: str

    @property
    def pickle_path(self) -> Path:
        return self.root / SEQUENCES_DIR / self.split / f"{self.name}.pkl"

    @property
    def image_dir(self) -> Path:
        return self.root / IMAGES_DIR / self.name

    def image_path(self, row: int) -> Path:
        """The image of a row of the 30 Hz arrays; `img_frame_ids` plays no part in it."""
        return self.image_dir / f"image_{row:05d}.jpg"


def find_sequences(root: Path) -> list[SequenceFiles]:
    """All sequences in the three splits, by split and name; their files are not opened."""
    if not root.is_dir():
        raise MissingInput(f"{root}: no such folder; give the one that holds {IMAGES_DIR}")
    folder = root / SEQUENCES_DIR
    if not folder.is_dir():
        remedy = f"give 3DPW's root folder, which holds {IMAGES_DIR} and {SEQUENCES_DIR}"
        raise MissingInput(f"{root}: has no folder {SEQUENCES_DIR}; {remedy}")
    require_inside(root, folder)
    splits = [split for split in SPLITS if (folder / split).is_dir()]
    files = []
    for split in splits:
        require_inside(root, folder / split)
        names = sorted(path.stem for path in (folder / split).glob("*.pkl"))
        files += [SequenceFiles(root, name, split) for name in names if not name.startswith(".")]
    if not files:
        lack = f"no .pkl in {', '.join(splits)}"
        lack = lack if splits else f"none of {', '.join(SPLITS)} is in it"
        raise MissingInput(f"{folder}: {lack}; unpack 3DPW's sequenceFiles.zip there")
    return files


def find_sequence(root: Path, name: str) -> SequenceFiles:
    """One sequence by a name like `courtyard_arguing_00`, in whichever split it is."""
    require_name(name)
    sequences = find_sequences(root)
    named = [files for files in sequences if files.name == name]
    if not named:
        what = f"no sequence {name!r} in {', '.join(SPLITS)} ({len(sequences)} others)"
        raise MissingInput(f"{root}: {what}; `gmrdata threedpw list` shows the names")
    require_one_split(name, named)
    return named[0]


def require_name(name: str) -> None:
    """Refuse names that are no single plain path component."""
    if not SEQUENCE_NAME.fullmatch(name):
        like = "those are like courtyard_arguing_00, without folders and suffix"
        raise BadSequence(f"{name!r} is no name of a sequence; {like}")


def require_one_split(name: str, sequences: list[SequenceFiles]) -> None:
    """Refuse a name that `require_name` does, and a sequence that is in several splits, since its
    images can belong to only one."""
    require_name(name)
    splits = [files.split for files in sequences if files.name == name]
    if len(splits) > 1:
        raise BadSequence(f"{name}: is in {' and '.join(splits)}; keep one of the files")


def require_inside(root: Path, path: Path) -> None:
    """Refuse a path that a link or `..` leads out of the root, which may be a link itself."""
    try:
        leads_to = path.resolve()
    except (OSError, RuntimeError) as error:  # links that point at each other
        raise BadSequence(f"{path}: can't be followed ({error}); put the file there") from None
    if not leads_to.is_relative_to(root.resolve()):
        remedy = "put the file itself there, or give the folder that really holds the dataset"
        raise BadSequence(f"{path}: is, or passes, a link out of {root}; {remedy} as root")
