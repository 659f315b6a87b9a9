"""One sequence through the COLMAP stage: from frames and camera-frame bodies to world motions."""

from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.reconstruct import reconstruct
from gmrdata.people.sources import (
    MaskRcnnSource,
    MasksConfig,
    OnnxSource,
    PersonSource,
    make_masks,
    source_names,
    sources_dir,
)
from gmrdata.read.video import VideoConfig, VideoRecord, as_frames, video_record
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.values.clip import Clip, camera_of, load_clip
from gmrdata.values.people import PersonFiles
from gmrdata.values.records import Config
from gmrdata.world.picture_fit import PeopleMasks
from gmrdata.world.pseudo_gt import make_pseudo_gt
from gmrdata.world.recipe import PseudoGtConfig
from gmrdata.world.verdict import Doubts

DOUBTS_FILE = "doubts.json"
MAX_RATE_ERROR = 0.05
"""Share by which the rate of a body may differ from that of the video."""
MAX_STEP_ERROR = 0.25
"""Share by which the time between two images may differ from that between the body's rows."""


class SequenceConfig(Config):
    """The stages of one sequence."""

    masks: MasksConfig = MasksConfig()
    """Masks of what moves; the body's silhouette unless other sources are named."""
    sfm: SfmConfig = SfmConfig()
    pseudo_gt: PseudoGtConfig = PseudoGtConfig()


def regenerate_sequence(
    frames: Path,
    people: tuple[PersonFiles, ...],
    out_dir: Path,
    config: SequenceConfig,
    *,
    dataset_camera_path: Path | None = None,
    doubts_path: Path | None = None,
    left_out: Collection[int] = (),
    video: VideoConfig | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Make `out_dir/masks` (and `masks_by`), `out_dir/sfm` and, the result, `out_dir/pseudo_gt`.

    `frames` is a folder of numbered images, or a video file, of which `video` says the part; the
    intrinsics of the first of the people are kept; the other files are those of `make_pseudo_gt`.
    Frames of a video have times: where bodies are of others, the verdict says so.
    """
    frames = as_frames(frames, out_dir / "frames", video, run=run)
    sfm_dir = out_dir / "sfm"
    masks_dir = make_masks(
        frames, out_dir / "masks", config.masks, people=people, left_out=left_out, run=run
    )
    clips = [load_clip(person.clip_path) for person in people]
    intrinsics_px = camera_of(clips[0]).intrinsics_px
    reconstruct(frames, masks_dir, intrinsics_px, sfm_dir, config.sfm, left_out=left_out, run=run)
    if doubts_path is None:
        doubts_path = _doubts_of_video(frames, clips, out_dir)
    return make_pseudo_gt(
        sfm_dir,
        people,
        out_dir / "pseudo_gt",
        config.pseudo_gt,
        dataset_camera_path=dataset_camera_path,
        doubts_path=doubts_path,
        seen=people_masks(masks_dir, config.masks),
        run=run,
    )


def people_masks(masks_dir: Path, config: MasksConfig) -> PeopleMasks | None:
    """Masks of people among a sequence's that were made without its bodies; outlines before boxes.

    None where there are none: silhouettes lie on the bodies by themselves, and nobody knows what is
    in a folder.
    """
    found: dict[bool, PeopleMasks] = {}
    for name, source in zip(source_names(config.sources), config.sources, strict=True):
        if isinstance(source, PersonSource | MaskRcnnSource | OnnxSource):
            boxed = isinstance(source, OnnxSource)
            masks = PeopleMasks(sources_dir(masks_dir) / name, source.dilate_px, boxed)
            found.setdefault(boxed, masks)
    return found.get(False, found.get(True))


def _doubts_of_video(frames: Path, clips: list[Clip], out_dir: Path) -> Path | None:
    """A `Doubts` record in `out_dir` if the frames' video gives reason to one, else None."""
    video = video_record(frames)
    path = out_dir / DOUBTS_FILE
    doubts = None if video is None else video_doubts(video, clips)
    if doubts is None or not (doubts.sequence or any(map(any, doubts.frames))):
        path.unlink(missing_ok=True)
        return None
    doubts.write(path)
    return path


def video_doubts(video: VideoRecord, clips: list[Clip]) -> Doubts:
    """What speaks against bodies on a video's frames: lost frames, and times that are others."""
    sequence = [
        f"{lost}, so that body and image may not belong together" for lost in lost_frames(video)
    ]
    steps_s = [np.diff(video.times_of(clip.image_numbers), prepend=np.nan) for clip in clips]
    # Speeds are computed from the body's rate, so they are wrong by as much as it is.
    for clip, step_s in zip(clips, steps_s, strict=True):
        fps_hz = clip.motion.fps_hz
        if np.isfinite(step_s).any() and (
            abs(np.nanmedian(step_s) * fps_hz - 1.0) > MAX_RATE_ERROR
        ):
            shown_hz = 1.0 / np.nanmedian(step_s)
            sequence.append(f"the body has {fps_hz:g} frames per second, the video {shown_hz:g}")
            return Doubts(frames=_no_doubts(clips), sequence=tuple(sequence))
    frames = tuple(
        tuple(_odd_step(step_s, clip.motion.fps_hz) for step_s in of_clip.tolist())
        for clip, of_clip in zip(clips, steps_s, strict=True)
    )
    return Doubts(frames=frames, sequence=tuple(sequence))


def lost_frames(video: VideoRecord) -> Iterator[str]:
    """What a video lost, in words; nothing for a whole one."""
    if video.n_lost:
        yield f"{video.n_lost} of the video's {video.n_expected} frames could not be decoded"


def _no_doubts(clips: list[Clip]) -> tuple[tuple[str, ...], ...]:
    return tuple(len(clip.image_numbers) * ("",) for clip in clips)


def _odd_step(step_s: float, fps_hz: float) -> str:
    """Why a frame must not be used that is shown so long after the one before; else empty."""
    if not abs(step_s * fps_hz - 1.0) > MAX_STEP_ERROR:  # NaN where it is not known
        return ""
    return f"shown {step_s:.3f} s after the image before, not {1 / fps_hz:.3f} s"
