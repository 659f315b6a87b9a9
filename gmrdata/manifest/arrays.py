"""What a clip's arrays must satisfy before anyone trains on them or scores with them."""

from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import numpy as np

from gmrdata.manifest.current import Clip
from gmrdata.manifest.read import rows_in
from gmrdata.read.frames import number_in_name
from gmrdata.values import clip as clip_file
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import load_character, load_joints
from gmrdata.values.errors import BadMotionFile

ROTATION_TOLERANCE = 1e-6  # largest entry of R^T R - I that passes; rotations are stored in float64


def array_problems(entry: Clip, clip: clip_file.Clip) -> Iterator[str]:
    """What is wrong with a clip's arrays, one line each, field first."""
    yield from _disagreements(entry, clip)
    if clip.motion.n_frames != entry.n_frames:
        return  # rows can't be compared
    kept = rows_in(entry.kept, entry.n_frames)
    if bad := _rows(kept & ~clip.valid):
        yield f"kept: row {bad} not valid in the file; write the manifest again"
    motion = clip.motion
    poses = (motion.root_rotmats, motion.local_rotmats)
    for key, values in (*(("poses", one) for one in poses), ("trans", motion.pelvis_m)):
        finite = np.isfinite(values).reshape(entry.n_frames, -1).all(axis=1)
        if bad := _rows(kept & ~finite):
            yield f"arrays.{key}: NaN or infinite in kept row {bad}; drop the rows with a reason"
    if not np.isfinite(motion.shape).all():
        yield "arrays.betas: NaN or infinite; make the clip again"
    yield from _image_number_problems(clip.image_numbers)
    if clip.camera is not None:
        yield from _camera_problems(clip.camera)


def unmatched_rows(
    field: str, clip: clip_file.Clip, rows: np.ndarray, names: list[str]
) -> Iterator[str]:
    """Those of `rows` (T,) bool, which need a file if they have an image number, whose image or
    mask is not in the listing."""
    numbers = {number_in_name(name) for name in names}
    wanted = {int(number) for number in clip.image_numbers[rows] if number >= 0}
    if missing := sorted(wanted - numbers):
        yield f"{field}.folder: none of number {some(missing)}, which a row names; put it back"


def stray_problems(field: str, images: list[str], files: list[str]) -> Iterator[str]:
    """Masks, depths, ... that belong to no image; paths of the two listings."""
    stems = {PurePosixPath(name).with_suffix("") for name in images}
    if stray := [name for name in files if PurePosixPath(name).with_suffix("") not in stems]:
        yield f"{field}.folder: {some(stray)} belongs to no image; name it <image stem>.png"


def rows_problems(field: str, path: Path, clip: clip_file.Clip) -> Iterator[str]:
    """Whether a file of joints, or of a character's residual, is sound and has the clip's rows."""
    try:
        joints = field == "joints"
        n_rows = len(load_joints(path).visible if joints else load_character(path).in_frame)
    except BadMotionFile as error:
        yield f"{field}: {error}"
        return
    if n_rows != clip.motion.n_frames:
        yield f"{field}: {n_rows} rows, the clip has {clip.motion.n_frames}; render it again"


def _disagreements(entry: Clip, clip: clip_file.Clip) -> Iterator[str]:
    for field in ("id", "n_frames", "fps_hz", "body", "frame"):
        said, found = getattr(entry, field), getattr(clip if field == "id" else clip.motion, field)
        if said != found:
            yield f"{field}: is {said}, but the file has {found}; write the manifest again"
    if (entry.camera_motion == "none") != (clip.camera is None):
        has = "no camera" if clip.camera is None else "a camera"
        yield f"camera_motion: is {entry.camera_motion}, but the file has {has}; correct the class"


def _image_number_problems(image_numbers: np.ndarray) -> Iterator[str]:
    numbers = image_numbers.astype(np.int64)
    if (numbers < -1).any():
        yield "arrays.image_numbers: below -1; -1 stands for a row without image"
    if (np.diff(numbers[numbers >= 0]) <= 0).any():
        yield "arrays.image_numbers: not increasing; rows must follow the images' order"


def _camera_problems(camera: CameraPath) -> Iterator[str]:
    intrinsics = camera.intrinsics_px
    if not (
        np.isfinite(intrinsics).all()
        and intrinsics[0, 0] > 0
        and intrinsics[1, 1] > 0
        and np.array_equal(intrinsics[2], [0, 0, 1])
    ):
        yield "arrays.camera_intrinsics_px: not a calibration matrix; make the clip again"
    if camera.width_px <= 0 or camera.height_px <= 0:
        yield "arrays.camera_size_px: not above zero; make the clip again"
    transforms = camera.world_from_cam
    finite = np.isfinite(transforms).all(axis=(1, 2))
    if bad := _rows(camera.has_camera & ~finite):
        yield f"arrays.world_from_cam: NaN or infinite in row {bad}; set has_camera to False there"
    rows = camera.has_camera & finite
    rotations = np.where(rows[:, None, None], transforms[:, :3, :3], np.eye(3))
    skew = np.abs(rotations.transpose(0, 2, 1) @ rotations - np.eye(3)).max(axis=(1, 2))
    if bad := _rows((skew > ROTATION_TOLERANCE) | (np.linalg.det(rotations) < 0)):
        yield f"arrays.world_from_cam: no proper rotation in row {bad}; make the clip again"
    if bad := _rows(rows & (transforms[:, 3] != [0, 0, 0, 1]).any(axis=1)):
        yield f"arrays.world_from_cam: last line isn't 0 0 0 1 in row {bad}; make the clip again"


def _rows(mask: np.ndarray) -> str:
    return some(np.flatnonzero(mask).tolist())


def some(items: list[int] | list[str]) -> str:
    """The first three items for a reader, and how many more there are; "" for none."""
    return ", ".join(map(str, items[:3])) + (
        f" and {len(items) - 3} more" if len(items) > 3 else ""
    )
