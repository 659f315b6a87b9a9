"""Other frame rates and pieces of a motion."""

from dataclasses import replace

import numpy as np

from gmrdata.values.errors import BadRecipe
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import slerp

ON_A_SAMPLE = 1e-6  # sample times closer than this to a source frame, in frames, are that frame


def resample(motion: Motion, fps_hz: float, *, start_s: float = 0.0) -> Motion:
    """A motion from `start_s` on at another rate, by slerp and linearly; exact on source frames."""
    before, after, share = _brackets(motion.n_frames, motion.fps_hz, fps_hz, start_s)
    positions, rotmats = motion.pelvis_m, motion.rotmats
    chosen = rotmats[before]
    between = share > 0.0
    if between.any():
        chosen[between] = slerp(rotmats[before[between]], rotmats[after[between]], share[between])
    pelvis_m = positions[before].copy()
    pelvis_m[between] += share[between, None] * (positions[after] - positions[before])[between]
    return replace(
        motion,
        local_rotmats=chosen[:, 1:],
        root_rotmats=chosen[:, 0],
        pelvis_m=pelvis_m,
        fps_hz=float(fps_hz),
    )


def valid_runs(valid: np.ndarray) -> list[tuple[int, int]]:
    """Runs of valid frames as (start, stop), stop not included: (T,) bool -> list."""
    edges = np.diff(np.concatenate([[0], np.asarray(valid, dtype=np.int8), [0]]))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [(int(a), int(b)) for a, b in zip(starts, stops, strict=True)]


def slice_motion(motion: Motion, start: int, stop: int) -> Motion:
    """Frames start, start + 1, ... stop - 1; BadRecipe unless 0 <= start < stop <= T."""
    if not 0 <= start < stop <= motion.n_frames:
        what = f"frames {start} to {stop} are not in a motion of {motion.n_frames} frames"
        raise BadRecipe(f"{motion.source}: {what}")
    return motion.take(slice(start, stop))


def hold_pose(motion: Motion, at_s: float, n_frames: int) -> Motion:
    """A person who holds the pose and the place of one moment, for so many frames; BadRecipe where
    the motion does not last until then."""
    row = round(at_s * motion.fps_hz)
    if not 0 <= row < motion.n_frames:
        lasts_s = (motion.n_frames - 1) / motion.fps_hz
        raise BadRecipe(f"{motion.source}: no pose to hold at {at_s:g} s, it lasts {lasts_s:.3f} s")
    held = motion.take(np.full(n_frames, row))
    return replace(held, source=f"{motion.source}, held at {row / motion.fps_hz:.3f} s")


def _brackets(
    n_frames: int, source_fps_hz: float, fps_hz: float, start_s: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Source rows before and after each new frame, and the share of the latter; both are the same
    where the new frame falls on a source frame."""
    if not (np.isfinite(fps_hz) and fps_hz > 0.0):
        raise BadRecipe(f"a frame rate of {fps_hz} Hz is not positive")
    first = start_s * source_fps_hz
    if not -ON_A_SAMPLE <= first <= n_frames - 1 + ON_A_SAMPLE:
        lasts_s = (n_frames - 1) / source_fps_hz
        raise BadRecipe(f"start_s = {start_s} s is outside a motion of {lasts_s:.3f} s")
    step = source_fps_hz / fps_hz
    count = int((n_frames - 1 - first + ON_A_SAMPLE) / step) + 1
    rows = first + np.arange(count) * step
    nearest = np.round(rows)
    rows = np.where(np.abs(rows - nearest) < ON_A_SAMPLE, nearest, rows)
    rows = np.clip(rows, 0.0, n_frames - 1)
    before = np.floor(rows).astype(int)
    share = rows - before
    return before, before + (share > 0.0), share
