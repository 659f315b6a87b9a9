"""Reads what the stages left of a video or of a sequence of 3DPW, as far as it can be read."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from gmrdata.cameras.files import SfmCameras, load_cameras, load_points, load_quality
from gmrdata.cameras.lens.intrinsics import load_intrinsics
from gmrdata.cameras.match.tracks import load_tracks
from gmrdata.export.sources import (
    ExportedClip,
    UnreadClip,
    images_by_number,
    list_clips,
    load_exported,
    require_solved,
)
from gmrdata.manifest.check import require_sound
from gmrdata.pages.solved import DatasetSays, Reconstruction, SolvedSequence
from gmrdata.people.folder import find_mask
from gmrdata.read.frames import video_record
from gmrdata.read.numbers import rigid_rows
from gmrdata.read.threedpw_files import SequenceFiles
from gmrdata.solve.request import FRAMES, INTRINSICS, MASKS, SFM
from gmrdata.solve.verdict import VERDICT_FILE, VideoVerdict, judge_cameras, with_lens_error
from gmrdata.threedpw.recipe import SetPaths, ThreedpwRecipe
from gmrdata.threedpw.regenerate import SequenceVerdict
from gmrdata.threedpw.sequence import DATASET_CAMERA_FILE, PEOPLE_FILE, PeopleRecord
from gmrdata.values import transforms
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip, load_clip
from gmrdata.values.errors import BadRecord, GmrdataError, MissingInput, some
from gmrdata.values.people import DOUBTS_FILE, FUSED, PSEUDO_GT, person_file
from gmrdata.values.records import MAKE_AGAIN
from gmrdata.world.bodies import NOT_SEEN
from gmrdata.world.judge import PseudoGtQuality, load_record
from gmrdata.world.pseudo_gt import config_of
from gmrdata.world.recipe import Doubts, PseudoGtConfig, Verdict, load_dataset_camera

if TYPE_CHECKING:
    from gmrdata.pages.fusion import FusedPeople

PEOPLE = "people"
UNKNOWN_FPS_HZ = 30.0  # of a folder of images without a video's record and without a body

Read = TypeVar("Read")


class Reader:
    """Reads files, and notes what can't be read: what is lost must not cost all else."""

    def __init__(self, root: Path = Path()) -> None:
        self.root = root
        self.missing: list[str] = []

    def read(self, call: Callable[[Path], Read], path: Path, when: bool = True) -> Read | None:
        if not when:
            return None
        try:
            return call(path)
        except (GmrdataError, OSError) as error:
            self.note(str(error))
            return None

    def note(self, problem: str) -> None:
        """Pages go to others, whom the place of the folder is nothing to."""
        problem = problem.replace(f"{self.root}/", "")
        if problem not in self.missing:
            self.missing.append(problem)


def read_reconstruction(reader: Reader, sfm_dir: Path) -> Reconstruction | None:
    """What is there of it; None without cameras."""
    if (cameras := reader.read(load_cameras, sfm_dir)) is None:
        return None
    n_frames = cameras.path.n_frames
    quality, points = reader.read(load_quality, sfm_dir), reader.read(load_points, sfm_dir)
    tracks = None if points is None else reader.read(load_tracks, sfm_dir)
    # Files that were mixed together must not make a plot.
    quality_fits = quality is None or quality.frames == n_frames
    tracks_fit = tracks is None or points is None or tracks.fits(n_frames, len(points))
    if not (quality_fits and tracks_fit):
        reader.note(f"{sfm_dir}: its files are of different frames; {MAKE_AGAIN}")
    return Reconstruction(
        cameras,
        quality if quality_fits else None,
        np.zeros((0, 3)) if points is None else points,
        tracks if tracks_fit else None,
    )


def read_people(
    reader: Reader, pseudo_gt_dir: Path, record: PseudoGtQuality | None
) -> dict[int, Clip]:
    """World motions by person, of those that can be read and are of the record's frames."""
    clips: dict[int, Clip] = {}
    for person, verdict in enumerate(record.people if record else ()):
        path = pseudo_gt_dir / person_file(person)
        clip = reader.read(lambda path: require_sound(path, load_clip(path)), path)
        if clip is not None and _are_same(reader, path, clip.motion.n_frames, verdict.frames):
            clips[person] = clip
    return clips


def _are_same(reader: Reader, path: Path, n_frames: int, n_expected: int) -> bool:
    """Whether a file is of as many frames as what it lies beside; if not, it is noted."""
    if n_frames != n_expected:
        reader.note(f"{path}: is of {n_frames} frames, not {n_expected}; {MAKE_AGAIN}")
    return n_frames == n_expected


def gather_video(
    folder: Path, images_dir: Path | None = None, body: str | None = None
) -> SolvedSequence:
    """Read what there is of a video; what can't be read is named in `missing`.

    Args:
        images_dir: Its frames, where they are not in the folder's own `frames`.
        body: The people's body, as `load_exported` takes it.

    Raises:
        MissingInput: the folder holds neither cameras nor people.
    """
    require_solved(folder)
    reader, pseudo_gt_dir, verdict_path = Reader(folder), folder / PSEUDO_GT, folder / VERDICT_FILE
    has_people = pseudo_gt_dir.exists()
    said = reader.read(VideoVerdict.read, verdict_path, verdict_path.exists())
    record = reader.read(load_record, pseudo_gt_dir, has_people)
    doubts_paths = (folder / DOUBTS_FILE, folder / PEOPLE / DOUBTS_FILE)  # of a video, of 3DPW
    doubts = [reader.read(Doubts.read, path) for path in doubts_paths if path.exists()]
    clips = read_people(reader, pseudo_gt_dir, record)
    has_fused = bool(clips) and (folder / FUSED).is_dir()
    fused = reader.read(lambda fused_dir: _fused(fused_dir, clips), folder / FUSED, has_fused)
    clips = _in_their_time(clips, record, fused)
    solved = read_reconstruction(reader, folder / SFM) if (folder / SFM).exists() else None
    lens = reader.read(load_intrinsics, folder / INTRINSICS, (folder / INTRINSICS).is_dir())
    config = reader.read(config_of, pseudo_gt_dir, has_people)
    config = config or with_lens_error(PseudoGtConfig(), lens)  # of cameras alone none is kept
    judged = record is not None and bool(record.people)  # their motions may be lost
    sequence = SolvedSequence(
        name=folder.name,
        folder=folder,
        record=record,
        doubts=next((one.frames for one in doubts if one is not None), ()),
        clips=clips,
        fused=fused,
        reconstruction=solved,
        camera=_camera_of(clips) if judged or solved is None else _levelled(solved.cameras),
        intrinsics=lens,
        config=config,
        notes=() if said is None else said.notes,
    )
    if record is None and has_people:
        verdict = None  # The cameras' verdict must not stand for that on the people.
    else:
        verdict = said.camera if said is not None else _judge(reader, sequence)
    if verdict is not None and sequence.is_alone and sequence.camera is not None:
        n_frames = len(verdict.frame_reasons)
        if not _are_same(reader, verdict_path, n_frames, sequence.camera.n_frames):
            verdict = None
    sequence = replace(sequence, camera_verdict=verdict, reasons=_reasons(record, verdict))
    said_hz = (0.0 if said is None else said.fps_hz) or UNKNOWN_FPS_HZ
    frames_dir = folder / FRAMES if images_dir is None else images_dir
    sequence = _with_frames(reader, sequence, frames_dir, said_hz)
    people_dir = folder / (PSEUDO_GT if fused is None else FUSED)
    people = _people(reader, people_dir, images_dir, body, clips) if clips else ()
    return replace(sequence, people=people, missing=tuple(reader.missing))


def gather_sequence(
    verdict: SequenceVerdict,
    message: str,
    files: SequenceFiles | None,
    recipe: ThreedpwRecipe,
    paths: SetPaths,
) -> SolvedSequence:
    """The same of a sequence of 3DPW, and what the data set says of it."""
    reader = Reader(paths.root)
    name = "" if files is None else files.name
    folder, pseudo_gt_dir = paths.sequence_dir(name), paths.pseudo_gt_dir(name)
    people_dir = folder / PEOPLE
    is_read = files is not None and people_dir.is_dir()
    people = reader.read(PeopleRecord.read, people_dir / PEOPLE_FILE, is_read)
    doubts = reader.read(Doubts.read, people_dir / DOUBTS_FILE, is_read)
    by_set = () if doubts is None else doubts.frames
    # What an earlier run left of a sequence that now failed is not this run's answer.
    record = reader.read(load_record, pseudo_gt_dir, files is not None and not message)
    is_solved = record is not None and record.cameras is not None
    clips = read_people(reader, pseudo_gt_dir, record) if is_solved else {}
    camera, theirs_path = _camera_of(clips), people_dir / DATASET_CAMERA_FILE
    theirs = reader.read(load_dataset_camera, theirs_path, is_solved)
    if theirs is not None and camera is not None:
        fits = _are_same(reader, theirs_path, len(theirs), camera.n_frames)
        theirs = np.where(rigid_rows(theirs)[:, None, None], theirs, np.nan) if fits else None
    return SolvedSequence(
        name=verdict.sequence,  # as it stands in the data set: any text
        folder=None if files is None else folder,
        record=record,
        reasons=_reasons(record, None) or by_set,
        doubts=by_set,
        clips=clips,
        reconstruction=read_reconstruction(reader, folder / SFM) if is_solved else None,
        camera=camera,
        config=recipe.of_sequence(verdict.sequence).pseudo_gt,
        dataset=DatasetSays(verdict, message, files, people, theirs, recipe.intrinsics),
        missing=tuple(reader.missing),
    )


def _reasons(
    record: PseudoGtQuality | None, verdict: Verdict | None
) -> tuple[tuple[str, ...], ...]:
    """Why frames of each person are dropped; without people, those of the camera."""
    if record is not None and record.people:
        return tuple(tuple(person.frame_reasons) for person in record.people)
    return () if verdict is None else (tuple(verdict.frame_reasons),)


def _fused(fused_dir: Path, clips: Mapping[int, Clip]) -> "FusedPeople":
    """What was made of the people with a network; BadRecord where it is of others."""
    # Here, since it loads torch, which the page of cameras alone does without.
    from gmrdata.pages.fusion import read_fused

    fused = read_fused(fused_dir)
    ours, theirs = (
        {person: clip.image_numbers.tolist() for person, clip in of.items()}
        for of in (clips, fused.clips)
    )
    if ours != theirs:
        what = f"is of other people or frames than {PSEUDO_GT}"
        raise BadRecord(f"{fused_dir}: {what}; {MAKE_AGAIN}")
    return fused


def _in_their_time(
    clips: Mapping[int, Clip], record: PseudoGtQuality | None, fused: "FusedPeople | None"
) -> dict[int, Clip]:
    """Everybody's motion, without a place before and after the frames that tell of the person.

    A fused motion is `valid` in frames with a camera alone: the others are filled in.  One that
    was shown nowhere, in a world of its own, has no place in that of the cameras.
    """
    shown = {}
    for person, clip in (clips if fused is None else fused.clips).items():
        valid = clip.valid
        if fused is not None:
            sigmas = fused.sigmas[person]
            told = np.isfinite(sigmas["place_sigma_m"]).all(axis=1)
            told &= clip.camera is None or bool(valid.any())
            valid = sigmas["has_camera"]
        else:
            assert record is not None
            reasons = record.people[person].frame_reasons
            rows = [row for row, reason in enumerate(reasons) if reason != NOT_SEEN]
            told = np.zeros(len(valid), dtype=bool)
            told[slice(rows[0], rows[-1] + 1) if rows else slice(0)] = True
        pelvis_m = np.where(told[:, None], clip.motion.pelvis_m, np.nan)
        motion = replace(clip.motion, pelvis_m=pelvis_m)
        shown[person] = replace(clip, motion=motion, valid=valid)
    return shown


def _camera_of(clips: Mapping[int, Clip]) -> CameraPath | None:
    """The camera of the T frames, as the people's clips have it."""
    return next((clip.camera for clip in clips.values() if clip.camera is not None), None)


def _levelled(cameras: SfmCameras) -> CameraPath:
    """Cameras alone, turned so that their own upright is z in the mean, from the first place on."""
    known = cameras.path.world_from_cam[cameras.path.has_camera]
    if not len(known):
        return cameras.path
    up = -known[:, :3, 1].mean(axis=0)
    forward = known[0, :3, 2]
    axes = [np.cross(forward, up), forward, up]
    across, _, up = (axis / max(float(np.linalg.norm(axis)), 1e-12) for axis in axes)
    rotmat = np.stack([across, np.cross(up, across), up])
    level = transforms.rigid(rotmat, -rotmat @ known[0, :3, 3])
    return replace(cameras.path, world_from_cam=level @ cameras.path.world_from_cam)


def _judge(reader: Reader, solved: SolvedSequence) -> Verdict | None:
    """The verdict on cameras of which no record has one."""
    if solved.folder is None or solved.reconstruction is None:
        return None
    config, rate_hz = solved.config.verdict, solved.fps_hz if solved.clips else UNKNOWN_FPS_HZ
    return reader.read(lambda folder: judge_cameras(folder, rate_hz, config), solved.folder / SFM)


def _with_frames(
    reader: Reader, solved: SolvedSequence, frames_dir: Path, said_hz: float
) -> SolvedSequence:
    """With the image, the mask and the time of each of the T frames."""
    assert solved.folder is not None
    numbers = np.zeros(0, np.int64)
    if solved.clips:
        numbers = next(iter(solved.clips.values())).image_numbers
    elif solved.reconstruction is not None:
        numbers = solved.reconstruction.cameras.image_numbers
    video = reader.read(video_record, frames_dir)
    times_s = np.arange(len(numbers)) / (solved.fps_hz if solved.clips else said_hz)
    if video is not None and len(numbers):
        own_s = video.times_of(numbers)  # the video's own, as far as it knows them all
        if np.isfinite(own_s).all() and (np.diff(own_s) > 0).all():
            times_s = own_s
    images = _images(reader, frames_dir, numbers)
    masks_dir = solved.folder / MASKS
    masks = tuple(
        None if image is None else reader.read(lambda d, i=image: _mask(d, i), masks_dir)  # type: ignore[misc]
        for image in (images if masks_dir.is_dir() else (None,) * len(images))
    )
    return replace(solved, images=images, masks=masks, times_s=times_s)


def _mask(masks_dir: Path, image: Path) -> Path:
    path = find_mask(masks_dir, image)
    if not path.resolve().is_relative_to(masks_dir.resolve()):
        raise MissingInput(f"{path}: a link out of the folder; copy the file in its place")
    return path


def _images(reader: Reader, frames_dir: Path, numbers: np.ndarray) -> tuple[Path | None, ...]:
    """The image of each of T frames; a link out of the folder is none."""
    images = reader.read(images_by_number, frames_dir) or {}
    root, wanted = frames_dir.resolve(), numbers.tolist()
    inside = {n: path for n, path in images.items() if path.resolve().is_relative_to(root)}
    if len(inside) < len(images):
        reader.note(f"{frames_dir}: {len(images) - len(inside)} images are links out of it")
    if images and (lacking := [n for n in wanted if n >= 0 and n not in images]):
        reader.note(f"{frames_dir}: no image of number {some(lacking)}")
    return tuple(map(inside.get, wanted))


def _people(
    reader: Reader, folder: Path, images_dir: Path | None, body: str | None,
    clips: Mapping[int, Clip],
) -> tuple[ExportedClip, ...]:  # fmt: skip
    """Everybody with the body at hand; those without are named and not drawn.  Motions are those
    of `clips`: of ten minutes each takes 35 MB."""
    motions = {clip.id: clip.motion for clip in clips.values()}

    def load(files: UnreadClip) -> ExportedClip:
        person = load_exported(files, body=body, images=images_dir)
        _ = person.body  # what it lacks is said here
        motion = motions.get(person.clip.id, person.clip.motion)
        return replace(person, clip=replace(person.clip, motion=motion))

    listed = reader.read(list_clips, folder) or []
    there = (reader.read(lambda _, one=files: load(one), files.clip_path) for files in listed)  # type: ignore[misc]
    return tuple(person for person in there if person is not None)
