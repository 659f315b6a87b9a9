"""Other frame rates and pieces of a motion."""

from dataclasses import dataclass, replace

import numpy as np

from gmrdata.values.errors import BadRecipe
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import slerp

ON_A_SAMPLE = 1e-6  # sample times closer than this to a source frame, in frames, are that frame


def resample(motion: Motion, fps_hz: float, *, start_s: float = 0.0) -> Motion:
    """A motion from `start_s` on at another rate, by slerp and linearly; exact on source frames."""
    rows = _brackets(motion.n_frames, motion.fps_hz, fps_hz, start_s)
    return replace(rows.moved(motion), fps_hz=float(fps_hz))


def resample_valid(valid: np.ndarray, source_fps_hz: float, fps_hz: float) -> np.ndarray:
    """(T,) bool: which frames of `resample` lie on or between valid ones (N,)."""
    rows = _brackets(len(valid), source_fps_hz, fps_hz, 0.0)
    return valid[rows.before] & valid[rows.after]


@dataclass(frozen=True, eq=False)
class Between:
    """Which of N rows each of T wanted ones lies between."""

    before: np.ndarray  # (T,) int
    after: np.ndarray  # (T,) int; the same row where it is one of the N
    past: np.ndarray  # (T,) how far it is past the first of them
    apart: np.ndarray | float = 1.0  # (T,) how far those are apart

    @property
    def share(self) -> np.ndarray:
        """(T,) of the row after it, from 0 to 1."""
        return self.past / self.apart

    def turned(self, rotmats: np.ndarray) -> np.ndarray:
        """Rotations (N, ..., 3, 3) at the wanted rows, by slerp; exact on the N."""
        wanted, gaps = rotmats[self.before], self.past > 0.0
        if gaps.any():
            ends = rotmats[self.before[gaps]], rotmats[self.after[gaps]]
            wanted[gaps] = slerp(*ends, self.share[gaps])
        return wanted

    def placed(self, values: np.ndarray) -> np.ndarray:
        """Values (N, ...) at the wanted rows, linearly; exact on the N."""
        past, apart = (
            np.reshape(one, (-1, *[1] * (values.ndim - 1))) for one in (self.past, self.apart)
        )
        start = values[self.before]
        return np.asarray(start + (values[self.after] - start) / apart * past)

    def moved(self, motion: Motion) -> Motion:
        """A motion of the N rows at the wanted ones: turned and placed."""
        rotmats = self.turned(motion.rotmats)
        return replace(
            motion,
            local_rotmats=rotmats[:, 1:],
            root_rotmats=rotmats[:, 0],
            pelvis_m=self.placed(motion.pelvis_m),
        )


def between_known(known: np.ndarray, wanted: np.ndarray) -> Between:
    """Wanted numbers (T,) between known ones (N,), which rise; beyond those the ends rest."""
    at = np.clip(wanted, known[0], known[-1])
    after = np.searchsorted(known, at)
    before = np.where(known[after] == at, after, after - 1)
    return Between(before, after, at - known[before], np.maximum(known[after] - known[before], 1))


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


def _brackets(n_frames: int, source_fps_hz: float, fps_hz: float, start_s: float) -> Between:
    """The source's rows round each new frame."""
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
    return Between(before, before + (share > 0.0), share)
