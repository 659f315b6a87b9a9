"""Whether a person's front and back were exchanged: what the fit can't know from one frame.

Seen from behind, the landmark network at times takes left for right and front for back, and what it
says is whole in itself, so a fit to one frame is as good.  But it does not stay so: trunk and knees
leap from one frame to the next.  Where leaps follow each other, nobody can say which frames are
right.
"""

from itertools import pairwise

import numpy as np

from gmrdata.people.fit import FitConfig, fit
from gmrdata.people.landmark_body import SeenLandmarks
from gmrdata.people.landmark_network import LANDMARKS, MIRRORED_LANDMARKS, TRUNK

TRUNK_AND_KNEES = (*TRUNK, LANDMARKS.index("left_knee"), LANDMARKS.index("right_knee"))
LEAP_M = 0.12
"""Motion of these landmarks about the hips from one frame to the next, root mean square, from which
it is a leap; 0.09 at most on people who were seen right, at 15 to 60 Hz [m]."""
LEAP_WITHIN_S = 0.099  # 10 Hz is too slow: who walks moves as far from frame to frame
BETWEEN_LEAPS_S = 0.5
"""Frames between two leaps that are nearer to each other are unsure; and over a longer gap a person
may turn, so that what is seen before tells nothing of what is seen after [s]."""
AGAINST = -0.35  # cosine between where a body's left is before and after, of more than 110 degrees
MIRROR_GAIN = 0.92
"""What is left of the errors by the mirrored body, over what the seen one leaves, from which it is
believed.  Of right views: 1.1 to 3.3, and 1.01 to 1.06 of who stands still with straight limbs; of
mirrored ones the inverse."""
COMPARED_HZ, COMPARED_FRAMES = 8.0, 64
"""Of the frames by which a whole track is compared with its mirror image."""


def rate_remarks(rate_hz: float, every: int = 1) -> tuple[str, ...]:
    """What one should know of people in so many images per second, every n-th of a video's."""
    if rate_hz * LEAP_WITHIN_S > 1:
        return ()
    what = "are too few to tell where front and back were exchanged for a while"
    remedy = "; take more of them, by a smaller --every" if every > 1 else ""
    return (f"{rate_hz:.3g} images per second {what}{remedy}",)


def unsure_frames(seen: SeenLandmarks) -> np.ndarray:
    """(T,) bool: frames between leaps, and those that look the other way than most of their stretch
    without a gap."""
    gaps = np.flatnonzero(np.diff(seen.times_s) >= BETWEEN_LEAPS_S) + 1
    edges = pairwise([0, *gaps.tolist(), len(seen.times_s)])
    return np.concatenate([_unsure_of_stretch(seen.take(slice(*one))) for one in edges])


def _unsure_of_stretch(seen: SeenLandmarks) -> np.ndarray:
    n, times_s = len(seen.times_s), seen.times_s
    about_m = (seen.world_m @ seen.cam_from_ray.swapaxes(-1, -2))[:, TRUNK_AND_KNEES]
    moved_m = np.sqrt((np.diff(about_m, axis=0) ** 2).sum(-1).mean(-1))
    leaps = np.flatnonzero((moved_m > LEAP_M) & (np.diff(times_s) < LEAP_WITHIN_S)) + 1
    if not len(leaps):
        return np.zeros(n, dtype=bool)
    runs = list(pairwise([0, *leaps.tolist(), n]))
    left = about_m[:, 0::2].sum(1) - about_m[:, 1::2].sum(1)
    left /= np.maximum(np.linalg.norm(left, axis=1, keepdims=True), 1e-9)
    sure = _like_most(left, [run for run in runs if _lasts_s(run, times_s) >= BETWEEN_LEAPS_S])
    # A short run beside a sure one, which looks the same way, is as sure.
    for start, stop in (*runs, *runs[::-1]):
        known = np.flatnonzero(sure)
        apart = np.maximum(start - known, known - (stop - 1))
        if not len(known) or apart.min() <= 0:
            continue
        near = known[apart.argmin()]
        end = start if near < start else stop - 1
        is_soon = abs(times_s[near] - times_s[end]) < BETWEEN_LEAPS_S
        is_short = _lasts_s((start, stop), times_s) < BETWEEN_LEAPS_S
        if is_soon and is_short and left[near] @ left[end] > -AGAINST:
            sure[start:stop] = True
    return ~sure


def _lasts_s(run: tuple[int, int], times_s: np.ndarray) -> float:
    return float(times_s[run[1] - 1] - times_s[run[0]])


def _like_most(left: np.ndarray, runs: list[tuple[int, int]]) -> np.ndarray:
    """(T,) bool: runs that look one way, by where left is (T, 3) at their ends; the way of most."""
    kept, other = np.zeros(len(left), dtype=bool), np.zeros(len(left), dtype=bool)
    before, is_other = None, False
    for start, stop in runs:
        if before is not None and left[before] @ left[start] < AGAINST:
            is_other = not is_other
        (other if is_other else kept)[start:stop] = True
        before = stop - 1
    return kept if kept.sum() >= other.sum() else other


def mirrored(seen: SeenLandmarks) -> SeenLandmarks:
    """The same picture of a person who looks the other way, under a camera as high above."""
    swap = list(MIRRORED_LANDMARKS)
    world_m = seen.world_m[:, swap]
    sloping_m = (world_m[..., :2] @ seen.slopes[..., None])[..., 0]
    world_m[..., 2] = 2 * sloping_m - world_m[..., 2]
    return SeenLandmarks(seen.times_s, seen.rays[:, swap], world_m, seen.visibility[:, swap])


def looks_reversed(seen: SeenLandmarks, rest_joints_m: np.ndarray, config: FitConfig) -> bool:
    """Whether a body that looks the other way lies better on a track: knees, elbows, feet and face
    tell."""
    length_s = seen.times_s[-1] - seen.times_s[0]
    wanted = min(COMPARED_FRAMES, max(2, round(length_s * COMPARED_HZ)))
    rows = np.unique(np.linspace(0, len(seen.times_s) - 1, wanted).round().astype(int))
    some = seen.take(rows)
    as_seen, other = (fit(one, rest_joints_m, config) for one in (some, mirrored(some)))
    return bool(other.energies.sum() < MIRROR_GAIN * as_seen.energies.sum())
