"""What the stages of one video left in its folder, as far as it can be read."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gmrdata.cameras.files import CamerasQuality, Lens, SfmCameras
from gmrdata.cameras.lens.intrinsics import Intrinsics, load_intrinsics
from gmrdata.export.sources import SFM, ExportedClip, list_clips, load_exported
from gmrdata.pages.footage import NO_MARKS, Footage, Marks, direction_marks
from gmrdata.pages.solved import (
    Reader,
    Reconstruction,
    Solved,
    read_people,
    read_reconstruction,
    reasons_by_person,
)
from gmrdata.people.folder import find_mask
from gmrdata.read.frames import list_images, number_in_name
from gmrdata.read.video import VIDEO_FILE, VideoRecord
from gmrdata.solve.video_verdict import VERDICT_FILE, VideoVerdict, judge_cameras
from gmrdata.values import transforms
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadRecord, GmrdataError, MissingInput
from gmrdata.values.people import FUSED, PSEUDO_GT
from gmrdata.values.records import MAKE_AGAIN
from gmrdata.world.pseudo_gt import config_of
from gmrdata.world.quality import load_record
from gmrdata.world.recipe import PseudoGtConfig
from gmrdata.world.verdict import Verdict
from gmrdata.write.take import Performer

if TYPE_CHECKING:
    from gmrdata.pages.fusion import FusedPeople

FRAMES, MASKS, INTRINSICS = "frames", "masks", "intrinsics"
UNKNOWN_FPS_HZ = 30.0  # of a folder of images without a video's record and without a body
MARKS_PER_FRAME = 150


@dataclass(frozen=True, eq=False, kw_only=True)
class SolvedVideo(Solved):
    """A video with its T frames; of cameras alone, without people and in a unit of their own."""

    folder: Path
    images: tuple[Path | None, ...]  # (T,)
    masks: tuple[Path | None, ...]  # (T,)
    times_s: np.ndarray  # (T,)
    video: VideoRecord | None  # None of images that came from no video
    people: tuple[ExportedClip, ...]  # with what it takes to draw and to export them
    fused: "FusedPeople | None"
    """Whose motions `clips` and `people` have; None for the cameras' own."""
    camera: CameraPath | None  # of the T frames, in the shown world
    camera_verdict: Verdict | None  # on the cameras by themselves; None where nothing tells
    notes: tuple[str, ...]  # what one should know besides
    intrinsics: Intrinsics | None  # where the lens comes from; None where nothing says
    config: PseudoGtConfig  # the thresholds that were asked for

    @property
    def n_frames(self) -> int:
        return len(self.times_s) or super().n_frames

    @property
    def lens(self) -> Lens | None:
        """The distortion of the frames; None for hardly any."""
        if self.cameras is not None and self.cameras.lens is not None:
            return self.cameras.lens
        k1 = 0.0 if self.intrinsics is None else self.intrinsics.radial_k1
        return Lens(k1, 0.0, 0.0) if k1 else None

    @property
    def name(self) -> str:
        return self.folder.name

    @property
    def is_alone(self) -> bool:
        """Whether cameras were sought, and nobody's motion."""
        return not self.judged

    @property
    def is_fused(self) -> bool:
        return self.fused is not None

    @property
    def row_names(self) -> list[str]:
        return ["camera"] if self.is_alone else super().row_names

    @property
    def accepted(self) -> list[bool]:
        if not self.is_alone:
            return super().accepted
        return [self.camera_verdict is not None and self.camera_verdict.accepted]

    @property
    def unit(self) -> str:
        return "units of the reconstruction" if self.is_alone else "m"

    @property
    def cameras(self) -> CamerasQuality | None:
        if self.is_alone:
            return None if self.reconstruction is None else self.reconstruction.quality
        return super().cameras

    @property
    def world_from_cam(self) -> np.ndarray | None:
        return None if self.camera is None else self.camera.world_from_cam

    @property
    def sfm_rows(self) -> np.ndarray | None:
        if self.is_alone and self.reconstruction is not None:
            return np.arange(self.n_frames)
        return super().sfm_rows


def gather_video(folder: Path, images_dir: Path | None, body: str | None) -> SolvedVideo:
    """Read what there is of a video; what can't be read is named in `missing`.

    Args:
        images_dir: Its frames, where they are not in the folder's own `frames`.
        body: The people's body, as `load_exported` takes it.

    Raises:
        MissingInput: the folder holds neither cameras nor people.
    """
    reader = Reader()
    there = [name for name in (SFM, PSEUDO_GT, VERDICT_FILE) if (folder / name).exists()]
    if not there:
        what = "holds no sfm and no pseudo_gt, so nothing of a video was solved there"
        raise MissingInput(f"{folder}: {what}. Give the folder of `gmrdata video` or `gmrdata sfm`")
    said = reader.read(VideoVerdict.read, folder / VERDICT_FILE) if VERDICT_FILE in there else None
    record = reader.read(load_record, folder / PSEUDO_GT) if PSEUDO_GT in there else None
    clips = read_people(reader, folder / PSEUDO_GT, record)
    fused = _fused(reader, folder / FUSED, clips) if clips and (folder / FUSED).is_dir() else None
    clips = clips if fused is None else dict(fused.clips)
    people_dir = folder / (PSEUDO_GT if fused is None else FUSED)
    solved = read_reconstruction(reader, folder / SFM) if SFM in there else None
    numbers, camera = _camera_of(clips, solved)
    config = reader.read(config_of, folder / PSEUDO_GT) if PSEUDO_GT in there else None
    config = config or PseudoGtConfig()
    reasons = reasons_by_person(record)
    verdict = None if said is None else said.camera
    if PSEUDO_GT in there and record is None:
        verdict = None  # The cameras' verdict must not stand for that on the people.
    elif verdict is None and solved is not None:
        verdict = reader.read(lambda sfm_dir: _judge(sfm_dir, clips, config), folder / SFM)
    if not reasons and verdict is not None:
        reasons = (tuple(verdict.frame_reasons),)
    has_lens = (folder / INTRINSICS).is_dir()
    frames_dir = folder / FRAMES if images_dir is None else images_dir
    video = (
        reader.read(VideoRecord.read, frames_dir / VIDEO_FILE) if _has_video(frames_dir) else None
    )
    images = _images(reader, frames_dir, numbers)
    return SolvedVideo(
        record=record,
        reasons=reasons,
        clips=clips,
        reconstruction=solved,
        folder=folder,
        images=images,
        masks=_masks(reader, folder / MASKS, images),
        times_s=_times_s(video, numbers, clips),
        video=video,
        people=_people(reader, people_dir, images_dir, body) if clips else (),
        fused=fused,
        camera=camera,
        intrinsics=reader.read(load_intrinsics, folder / INTRINSICS) if has_lens else None,
        camera_verdict=verdict,
        notes=() if said is None else said.notes,
        config=config,
        # Pages go to others, whom the place of the folder is nothing to.
        missing=tuple(dict.fromkeys(one.replace(f"{folder}/", "") for one in reader.missing)),
    )


def _fused(reader: Reader, fused_dir: Path, clips: dict[int, Clip]) -> "FusedPeople | None":
    """What was made of the people with a network; None where it can't be read, or is of others."""
    # Here, since it loads torch, which the page of cameras alone does without.
    from gmrdata.pages.fusion import read_fused

    def read(folder: Path) -> "FusedPeople":
        found = read_fused(folder)
        ours, theirs = (
            {person: clip.image_numbers.tolist() for person, clip in of.items()}
            for of in (clips, found.clips)
        )
        if ours != theirs:
            what = f"is of other people or frames than {PSEUDO_GT}"
            raise BadRecord(f"{folder}: {what}; {MAKE_AGAIN}")
        return found

    return reader.read(read, fused_dir)


def _camera_of(
    clips: dict[int, Clip], solved: Reconstruction | None
) -> tuple[np.ndarray, CameraPath | None]:
    """Image numbers (T,), and the camera of the T frames, level as far as that can be told."""
    if clips:
        clip = next(iter(clips.values()))
        return clip.image_numbers, clip.camera
    if solved is None:
        return np.zeros(0, np.int64), None
    return solved.cameras.image_numbers, _levelled(solved.cameras)


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


def _judge(sfm_dir: Path, clips: dict[int, Clip], config: PseudoGtConfig) -> Verdict:
    """The verdict on cameras of which no record has one."""
    rates_hz = [clip.motion.fps_hz for clip in clips.values()]
    return judge_cameras(sfm_dir, rates_hz[0] if rates_hz else UNKNOWN_FPS_HZ, config.verdict)


def _has_video(frames_dir: Path) -> bool:
    return (frames_dir / VIDEO_FILE).is_file()


def _images(reader: Reader, frames_dir: Path, numbers: np.ndarray) -> tuple[Path | None, ...]:
    """The image of each of T frames; a link out of the folder is none."""
    found = reader.read(list_images, frames_dir) or []
    root = frames_dir.resolve()
    by_number = {
        number_in_name(path.name): path for path in found if path.resolve().is_relative_to(root)
    }
    if len(by_number) < len(found):
        reader.missing.append(
            f"{frames_dir}: {len(found) - len(by_number)} images are links out of it"
        )
    return tuple(by_number.get(int(number)) for number in numbers)


def _masks(
    reader: Reader, masks_dir: Path, images: Sequence[Path | None]
) -> tuple[Path | None, ...]:
    """The mask of each frame; none of any without a folder of masks."""
    if not masks_dir.is_dir():
        return (None,) * len(images)
    return tuple(None if image is None else _mask(reader, masks_dir, image) for image in images)


def _mask(reader: Reader, masks_dir: Path, image: Path) -> Path | None:
    def find(folder: Path) -> Path:
        path = find_mask(folder, image)
        if not path.resolve().is_relative_to(folder.resolve()):
            raise MissingInput(f"{path}: a link out of the folder; copy the file in its place")
        return path

    return reader.read(find, masks_dir)


def _times_s(video: VideoRecord | None, numbers: np.ndarray, clips: dict[int, Clip]) -> np.ndarray:
    """(T,) times of the frames [s]: the video's own as far as it knows them all."""
    if video is not None and len(numbers):
        times_s = video.times_of(numbers)
        if np.isfinite(times_s).all() and (np.diff(times_s) > 0).all():
            return times_s
    rates_hz = [clip.motion.fps_hz for clip in clips.values()]
    return np.arange(len(numbers)) / (rates_hz[0] if rates_hz else UNKNOWN_FPS_HZ)


def _people(
    reader: Reader, folder: Path, images_dir: Path | None, body: str | None
) -> tuple[ExportedClip, ...]:
    """Everybody with the body at hand; those without are named and not drawn."""

    def load(folder: Path) -> list[ExportedClip]:
        return [load_exported(one, body=body, images=images_dir) for one in list_clips(folder)]

    there = []
    for person in reader.read(load, folder) or []:
        try:
            there.append((person, person.body)[0])
        except GmrdataError as error:
            reader.missing.append(str(error))
    return tuple(there)


def footage_of(found: SolvedVideo) -> Footage:
    """What is drawn over the frames; MissingInput where there is nothing to draw or draw over."""
    if found.camera is None:
        raise MissingInput("no camera was found, so nothing has a place in the frames")
    if not any(found.images):
        raise MissingInput("the frames are not here: give their folder with --images")
    people = tuple(
        Performer(one.id, one.clip.motion, one.body, one.clip.valid) for one in found.people
    )
    dropped = np.ones(found.n_frames, dtype=bool) if not found.reasons else ~found.kept
    return Footage(
        images=found.images,
        masks=found.masks,
        times_s=found.times_s,
        camera=found.camera,
        lens=found.lens,
        people=people,
        marks=_marks(found) if found.is_alone else NO_MARKS,
        dropped=dropped,
    )


def _marks(found: SolvedVideo) -> Marks:
    """What stands still behind cameras alone: background points in the frames that show them, of a
    camera that turns a grid of directions."""
    solved, camera = found.reconstruction, found.camera
    if solved is None or camera is None or not camera.has_camera.any():
        return NO_MARKS
    if solved.cameras.geometry != "full":
        return direction_marks(camera)
    if solved.tracks is None:
        return NO_MARKS
    row = int(camera.has_camera.argmax())
    level = camera.world_from_cam[row] @ transforms.invert(solved.cameras.path.world_from_cam[row])
    world_m = transforms.apply(level, solved.points)
    keep = _longest_seen(solved.tracks.rows, solved.tracks.points, len(world_m))
    return Marks(world_m, solved.tracks.rows[keep], solved.tracks.points[keep])


def _longest_seen(rows: np.ndarray, points: np.ndarray, n_points: int) -> np.ndarray:
    """Which observations (M,) to show: in each frame those of the points that most frames see."""
    lengths = np.bincount(points, minlength=n_points)
    order = np.lexsort((points, -lengths[points], rows))
    first = np.searchsorted(rows[order], rows[order])
    place = np.arange(len(order)) - first
    return np.sort(order[place < MARKS_PER_FRAME])
