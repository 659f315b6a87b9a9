"""What speaks against a sequence besides its cameras: its video, its lens, people not seen."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from gmrdata.cameras.lens.intrinsics import Intrinsics
from gmrdata.solve.request import SolveConfig
from gmrdata.values.clip import Clip
from gmrdata.values.frame_set import VideoRecord
from gmrdata.world.bodies import unseen_reasons
from gmrdata.world.verdict import Doubts

DOUBTS_FILE = "doubts.json"
MAX_RATE_ERROR = 0.05
"""Share by which the rate of a body may differ from that of the video."""
MAX_STEP_ERROR = 0.25
"""Share by which the time between two images may differ from that between the body's rows."""
MOST_OFF = 0.99  # of a deviation, as a share


def with_lens_error(config: SolveConfig, lens: Intrinsics) -> SolveConfig:
    """The same, but that a focal length nobody gave may be off by two of its standard errors."""
    if lens.source == "given":
        return config
    thresholds = config.pseudo_gt.verdict
    most = max(thresholds.max_focal_deviation, min(2 * lens.focal_sigma, MOST_OFF))
    thresholds = thresholds.model_copy(update={"max_focal_deviation": most})
    return config.model_copy(
        update={"pseudo_gt": config.pseudo_gt.model_copy(update={"verdict": thresholds})}
    )


def lost_frames(video: VideoRecord | None) -> Iterator[str]:
    """What a video lost, in words; nothing for a whole one."""
    if video is not None and video.n_lost:
        yield f"{video.n_lost} of the video's {video.n_expected} frames could not be decoded"


def write_doubts(
    out_dir: Path, clips: Sequence[Clip], video: VideoRecord | None, lens: Intrinsics | None
) -> Path | None:
    """`doubts.json` on people before the camera: what the video's times and losses say.

    Of a system's people, whose lens is found beside them, also frames without a pose and what the
    lens says.  None without a record where bodies are given with their lens, and nothing is said.
    """
    path, doubts = out_dir / DOUBTS_FILE, video_doubts(video, clips)
    if lens is not None:
        frames = tuple(
            tuple(one or other for one, other in zip(mine, its, strict=True))
            for mine, its in zip(unseen_reasons(clips), doubts.frames, strict=True)
        )
        doubts = Doubts(frames=frames, sequence=(*doubts.sequence, *lens.objections))
    elif not (doubts.sequence or any(map(any, doubts.frames))):
        path.unlink(missing_ok=True)
        return None
    doubts.write(path)
    return path


def video_doubts(video: VideoRecord | None, clips: Sequence[Clip]) -> Doubts:
    """What speaks against bodies on a video's frames: lost frames, and times that are others."""
    nothing = tuple(len(clip.image_numbers) * ("",) for clip in clips)
    if video is None:
        return Doubts(frames=nothing, sequence=())
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
            return Doubts(frames=nothing, sequence=tuple(sequence))
    frames = tuple(
        tuple(_odd_step(step_s, clip.motion.fps_hz) for step_s in of_clip.tolist())
        for clip, of_clip in zip(clips, steps_s, strict=True)
    )
    return Doubts(frames=frames, sequence=tuple(sequence))


def _odd_step(step_s: float, fps_hz: float) -> str:
    """Why a frame must not be used that is shown so long after the one before; else empty."""
    if not abs(step_s * fps_hz - 1.0) > MAX_STEP_ERROR:  # NaN where it is not known
        return ""
    return f"shown {step_s:.3f} s after the image before, not {1 / fps_hz:.3f} s"
