"""Runs of valid frames, and their poses at the network's frame rate."""

from dataclasses import dataclass

import numpy as np

from gmrdata.clip import Clip
from gmrdata.errors import BadMotionFile
from gmrdata.motion.motion import Motion
from gmrdata.motion.resample import resample, valid_runs

MIN_FRAMES = 2
"""Frames that make one motion."""


@dataclass(frozen=True, eq=False)
class Run:
    """Consecutive valid frames of one clip, at the frame rate that was asked for."""

    clip_id: str
    """The clip that it comes from."""
    motion: Motion
    """The person, without gaps."""


def runs_at(clip: Clip, fps_hz: float, *, all_phases: bool) -> list[Run]:
    """Runs of a clip's valid frames at a frame rate; none of them crosses a gap.

    Where the clip's rate is k times the asked one, every k-th frame is taken as it is; all k phases
    of that, or the one that begins with the run's first frame.  Other ratios are resampled.

    Args:
        clip: The clip, at `fps_hz` or a higher rate.
        fps_hz: The frame rate to have [Hz].
        all_phases: Whether each of the clip's frames shall appear, in the runs of its phase.

    Returns:
        Runs of at least two frames; empty where the clip has none.

    Raises:
        BadMotionFile: a valid frame holds NaN or infinite numbers, or the clip's rate is lower than
            the one asked for.
    """
    check_finite(clip)
    ratio = clip.motion.fps_hz / fps_hz
    step = round(ratio)
    is_whole = abs(ratio - step) < 1e-6 * ratio
    if ratio < 1 - 1e-3:
        raise BadMotionFile(
            f"clip {clip.id}: {clip.motion.fps_hz:g} fps is lower than {fps_hz:g} fps, so frames"
            " would have to be made up. Use a source of a higher rate"
        )
    n_phases = (step if is_whole else max(1, int(ratio))) if all_phases else 1
    runs = []
    for start, stop in valid_runs(clip.valid):
        for phase in range(n_phases):
            if stop - start - phase < MIN_FRAMES:
                continue
            if is_whole:
                motion = take(clip.motion, slice(start + phase, stop, step), fps_hz)
            else:
                motion = _resampled(clip.motion, start + phase, stop, fps_hz)
            if motion.n_frames >= MIN_FRAMES:
                runs.append(Run(clip.id, motion))
    return runs


def take(motion: Motion, rows: slice, fps_hz: float) -> Motion:
    """Some frames of a motion, as they are; `fps_hz` is the rate that they then have [Hz]."""
    return Motion(
        local_rotmats=motion.local_rotmats[rows],
        root_rotmats=motion.root_rotmats[rows],
        pelvis_m=motion.pelvis_m[rows],
        shape=motion.shape,
        fps_hz=fps_hz,
        body=motion.body,
        gender=motion.gender,
        frame=motion.frame,
        source=motion.source,
    )


def check_finite(clip: Clip) -> None:
    """Refuse NaN and infinities in valid frames.

    Raises:
        BadMotionFile: there are such numbers; the message names the clip and the first frame.
    """
    motion = clip.motion
    finite = np.isfinite(motion.local_rotmats).all((1, 2, 3))
    finite &= np.isfinite(motion.root_rotmats).all((1, 2)) & np.isfinite(motion.pelvis_m).all(1)
    bad = np.flatnonzero(clip.valid & ~finite)
    if bad.size or not np.isfinite(motion.shape).all():
        where = f"frame {bad[0]}" if bad.size else "its shape"
        raise BadMotionFile(
            f"clip {clip.id}: {where} holds NaN or infinite numbers ({bad.size} frames in all)."
            " Mark such frames as not valid, or make the clip again"
        )


def _resampled(motion: Motion, start: int, stop: int, fps_hz: float) -> Motion:
    return resample(take(motion, slice(start, stop), motion.fps_hz), fps_hz)
