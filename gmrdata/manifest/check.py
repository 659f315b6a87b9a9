"""Check a manifest against its files: none missing, changed or extra, and all of them usable."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from gmrdata.manifest import listing
from gmrdata.manifest.current import ClipEntry, FileRecord, FolderRecord, ListManifest, Manifest
from gmrdata.manifest.listing import ListedFile
from gmrdata.manifest.read import disagreements, join_problems, read_manifest, rows_in
from gmrdata.manifest.write import recipe_sha256
from gmrdata.read.frames import number_in_name
from gmrdata.stage.progress import progress_bar
from gmrdata.values import clip as clip_file
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import load_character, load_joints
from gmrdata.values.errors import BadManifest, BadMotionFile, MissingInput, some
from gmrdata.values.files import resolve_inside, sha256_of_file
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import RIGID_TOLERANCE, are_rotations

ROTATION_TOLERANCE = 1e-6  # largest entry of R^T R - I that passes; rotations are stored in float64


def array_problems(entry: ClipEntry, clip: clip_file.Clip) -> Iterator[str]:
    """What is wrong with a clip's arrays, one line each, field first."""
    yield from disagreements(entry, clip)
    if (entry.camera_motion == "none") != (clip.camera is None):
        has = "no camera" if clip.camera is None else "a camera"
        yield f"camera_motion: is {entry.camera_motion}, but the file has {has}; correct the class"
    if clip.motion.n_frames != entry.n_frames:
        return  # rows can't be compared
    kept = rows_in(entry.kept, entry.n_frames)
    if bad := _rows(kept & ~clip.valid):
        yield f"kept: row {bad} not valid in the file; write the manifest again"
    yield from _motion_problems(clip.motion, kept)
    yield from _image_number_problems(clip.image_numbers)
    if clip.camera is not None:
        yield from _camera_problems(clip.camera)


def require_sound(path: Path, clip: clip_file.Clip) -> clip_file.Clip:
    """The clip of a file; BadMotionFile for valid rows and cameras without numbers to use.

    Rotations may be as far off as the readers of data sets let them be.
    """
    problems = list(_motion_problems(clip.motion, clip.valid))
    if clip.camera is not None:
        problems += _camera_problems(clip.camera, RIGID_TOLERANCE)
    if problems:
        raise BadMotionFile(f"{path}: {problems[0]}")
    return clip


def _motion_problems(motion: Motion, kept: np.ndarray) -> Iterator[str]:
    for key, values in (("poses", motion.rotmats), ("trans", motion.pelvis_m)):
        finite = np.isfinite(values).reshape(motion.n_frames, -1).all(axis=1)
        if bad := _rows(kept & ~finite):
            yield f"arrays.{key}: NaN or infinite in kept row {bad}; drop the rows with a reason"
    if not np.isfinite(motion.shape).all():
        yield "arrays.betas: NaN or infinite; make the clip again"


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


def _image_number_problems(image_numbers: np.ndarray) -> Iterator[str]:
    numbers = image_numbers.astype(np.int64)
    if (numbers < -1).any():
        yield "arrays.image_numbers: below -1; -1 stands for a row without image"
    if (np.diff(numbers[numbers >= 0]) <= 0).any():
        yield "arrays.image_numbers: not increasing; rows must follow the images' order"


def _camera_problems(camera: CameraPath, tolerance: float = ROTATION_TOLERANCE) -> Iterator[str]:
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
    if bad := _rows(~are_rotations(rotations, tolerance)):
        yield f"arrays.world_from_cam: no proper rotation in row {bad}; make the clip again"
    if bad := _rows(rows & (transforms[:, 3] != [0, 0, 0, 1]).any(axis=1)):
        yield f"arrays.world_from_cam: last line isn't 0 0 0 1 in row {bad}; make the clip again"


def _rows(mask: np.ndarray) -> str:
    return some(np.flatnonzero(mask).tolist())


AGAIN = "copy it again, or write the manifest again if the change is meant"


def check_manifest(path: Path, *, hashes: bool = True, files: bool = True) -> None:
    """Check format, files and arrays of a manifest; without `hashes`, sizes in place of every byte.

    Without `files` only what the manifest says of itself is checked, for one whose data set is not
    here.
    A BadManifest says all that is wrong, up to 50 problems; each names manifest, clip and field,
    and says what to do.
    """
    manifest = read_manifest(path)
    if isinstance(manifest, ListManifest):
        return
    problems = []
    with _advancing(manifest, path.name) if files else nullcontext(lambda: None) as advance:
        work = _Work(path.parent, hashes, advance)
        for clip in manifest.clips:
            lines = [*(_clip_problems(work, clip) if files else ()), *_recipe_problems(clip)]
            problems += [f"{path}: clip {clip.id}: {line}" for line in lines]
    if problems:
        raise BadManifest(join_problems(path, problems))


@dataclass(frozen=True)
class _Work:
    root: Path
    hashes: bool
    advance: Callable[[], None]


@contextmanager
def _advancing(manifest: Manifest, name: str) -> Iterator[Callable[[], None]]:
    """The function that counts a file on a progress bar, which there is for many files."""
    folders = [part for clip in manifest.clips for part in listing.folders_of(clip).values()]
    n_files = sum(1 + len(listing.files_of(clip)) for clip in manifest.clips)
    n_files += sum(1 + folder.count for folder in folders)
    with progress_bar(shown=n_files > listing.BAR_FROM) as bar:
        task = bar.add_task(f"checking {name}", total=n_files)
        yield lambda: bar.advance(task)


def _clip_problems(work: _Work, entry: ClipEntry) -> Iterator[str]:
    """One line per problem, field first."""
    names: dict[str, list[str]] = {}
    for field, record in listing.folders_of(entry).items():
        files, problems = _listing(work, field, record)
        names[field] = [file.path for file in files]
        yield from problems
        if files:
            yield from _folder_problems(work, field, record, files)
    for field, listed in names.items():
        if field != "images" and names.get("images") and listed:
            yield from stray_problems(field, names["images"], listed)
    for field, file in listing.files_of(entry).items():
        yield from _file_problems(work, field, file)
    yield from _arrays_problems(work, entry, names)


def _recipe_problems(entry: ClipEntry) -> Iterator[str]:
    recipe = entry.recipe
    if recipe and recipe.sha256 != recipe_sha256(recipe.stage, recipe.config, recipe.inputs):
        yield "recipe.sha256: isn't the hash of the recipe beside it; write the manifest again"


def _arrays_problems(work: _Work, entry: ClipEntry, names: dict[str, list[str]]) -> Iterator[str]:
    yield from _file_problems(work, "arrays", entry.arrays)
    try:
        clip = clip_file.load_clip(resolve_inside(work.root, entry.arrays.path))
    except (ValueError, MissingInput):
        return  # said above
    except BadMotionFile as error:
        yield f"arrays: {error}; {AGAIN}"
        return
    yield from array_problems(entry, clip)
    if clip.motion.n_frames != entry.n_frames:
        return  # rows can't be compared
    kept = rows_in(entry.kept, entry.n_frames)
    to_next = np.append(np.ones(entry.n_frames - 1, dtype=bool), False)
    rows_with = {"images": np.ones_like(kept), "flow": kept & to_next}
    for name, files in names.items():
        if files:
            yield from unmatched_rows(name, clip, rows_with.get(name, kept), files)
    for field in ("joints", "character"):
        if (record := getattr(entry, field)) is not None:
            with suppress(ValueError, MissingInput):  # said where its hash was compared
                yield from rows_problems(field, resolve_inside(work.root, record.path), clip)


def _file_problems(
    work: _Work, field: str, said: FileRecord | ListedFile, folder: str | None = None
) -> Iterator[str]:
    """Of a file on its own, or of one of the listing of a `folder`."""
    work.advance()
    name = said.path if folder is None else f"{folder}/{said.path}"
    try:
        inside = work.root if folder is None else resolve_inside(work.root, folder)
        file = resolve_inside(inside, said.path)
    except ValueError as error:
        yield f"{field}.{'path' if folder is None else 'folder'}: {error}"
        return
    if not file.is_file():
        yield f"{field}: {name} is missing; {AGAIN}"
    elif (found_bytes := file.stat().st_size) != said.size_bytes:
        yield f"{field}: {name} has {found_bytes} bytes, not {said.size_bytes}; {AGAIN}"
    elif work.hashes and (sha256 := sha256_of_file(file)) != said.sha256:
        yield f"{field}: {name} has sha256 {sha256}, not {said.sha256}; {AGAIN}"


def _listing(work: _Work, field: str, record: FolderRecord) -> tuple[list[ListedFile], list[str]]:
    """The listing's lines, none if it can't be trusted, and what is wrong with it."""
    if problems := list(_file_problems(work, f"{field}.listing", record.listing)):
        return [], problems
    try:
        files = listing.read_listing(work.root / record.listing.path)
    except BadManifest as error:
        return [], [f"{field}.listing: {error}"]
    total_bytes = sum(file.size_bytes for file in files)
    if (len(files), total_bytes) != (record.count, record.size_bytes):
        problems.append(
            f"{field}: the listing has {len(files)} files of {total_bytes} bytes, not "
            f"{record.count} of {record.size_bytes}; write the manifest again"
        )
    return files, problems


def _folder_problems(
    work: _Work, field: str, record: FolderRecord, files: list[ListedFile]
) -> Iterator[str]:
    try:
        present = listing.files_below(resolve_inside(work.root, record.folder))
    except (ValueError, MissingInput) as error:
        yield f"{field}.folder: {error}; {AGAIN}"
        return
    if extra := some(sorted(set(present) - {file.path for file in files})):
        yield f"{field}.folder: {extra} not in the listing; remove it or write a new version"
    for file in files:
        yield from _file_problems(work, field, file, record.folder)
