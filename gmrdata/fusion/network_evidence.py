"""Evidence of the network: motions between frames, and how wrong they are.

The error is taken as a rate, in the body's axes, and as the sum of two Gauss-Markov processes: a
fast one, which forgets itself within a step or two, and a slow one, which lasts through a gap, such
as a pace that is thought too short.  Both grow with the speed that the network says, and with its
doubt: how far its answers to a motion, its mirror image and its reverse are apart.  Whoever moves
as nobody did in the training is doubted.  A record beside the network has what was measured on
people whom it had not seen (`network_errors`).

A walker takes many steps, and a network errs alike in each of them.  So its error where cameras see
the person is carried over to where they don't, by how like the poses are: by Gaussian process
regression (Rasmussen & Williams 2006, eq. 2.25), whose mean scipy's radial basis functions give.
Each pose tells of its mirror image, too.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass as part
from scipy.interpolate import RBFInterpolator
from scipy.spatial.transform import Rotation

from gmrdata.fusion.smoothing import ErrorProcess, SeenMotions, SeenPoses
from gmrdata.gmr.predict import DoubtedMotions
from gmrdata.values.body import MIRROR, MIRRORED, BodyModel
from gmrdata.values.motion import Motion, without_root
from gmrdata.values.records import PART, Figure, Record

DELTA_ERRORS_FILE = "delta_errors.json"
SPEEDS_M_PER_S = (0.0, 0.3, 0.8, 1.4)
"""Speeds at which errors are given, between which they are interpolated."""
SPEED_TIME_S = 1.0  # over which a speed is the mean
DOUBT_TIME_S = 0.5  # and a doubt: as long as a step or a jump
LEAST_DOUBT = 1e-9  # for its logarithm
PACE_AXES = (0.5, 0.3, 1.0)  # of a wrong pace, along left, up and front
FREE = np.array([1.0, 1.0, 1.0, 2.0, 0.5, 2.0])
"""Rates of people whom nobody sees: turns about left, up and front, and ways along them [rad/s,
m/s]."""

LIKE_M = 0.5
"""Length over which poses lose their likeness: of all joints' differences in place and speed."""
SPEED_S = 0.2  # a difference in speed counts as what it makes in this time
OVER_S = 0.1  # speeds are means over as long before and after
UNLIKE = 0.3  # variance of the part of the error that does not repeat, over that of what does
MOST_LIKE = 150  # the nearest seen motions that an unseen one is compared with, mirrored ones too
FEWEST_SEEN = 10  # motions between seen poses, below which nothing is carried over
MOST_SEEN = 5000  # of which an unseen one's nearest are sought; of more, evenly that many
ACROSS = np.array(MIRROR)
Six = Annotated[tuple[Figure, ...], Field(min_length=6, max_length=6)]


@part(frozen=True, config=PART)
class ErrorPart:
    """One of the two processes."""

    time_s: Six
    """By axis, turn first: time in which it forgets itself to 1/e [s]."""
    turn_deg_per_s: tuple[tuple[Figure, Figure, Figure], ...]
    """By speed and axis (left, up, front): standard deviation."""
    place_m_per_s: tuple[tuple[Figure, Figure, Figure], ...]


@part(frozen=True, config=PART)
class DoubtPart:
    """By how much errors are larger than the speed says, at some levels of doubt; between them
    interpolated in its logarithm."""

    turn_deg_per_s: tuple[Figure, ...]
    turn_factor: tuple[Figure, ...]
    place_m_per_s: tuple[Figure, ...]
    place_factor: tuple[Figure, ...]


class DeltaErrors(Record):
    """`delta_errors.json`."""

    format: Literal["gmrdata-delta-errors/2"] = "gmrdata-delta-errors/2"
    networks: tuple[str, ...]
    """Names of their runs."""
    fps_hz: float
    """The networks' rate."""
    people: tuple[str, ...]
    """Whom they were measured on and not trained on."""
    clips: int
    seconds: Figure
    pose_noise_deg: float
    """Root mean square error that was put on each joint [degrees]."""
    pose_noise_time_s: float
    speeds_m_per_s: tuple[Figure, ...]
    fast: ErrorPart
    slow: ErrorPart
    doubt: DoubtPart

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        n = len(self.speeds_m_per_s)
        tables = [t for p in (self.fast, self.slow) for t in (p.turn_deg_per_s, p.place_m_per_s)]
        if n < 1 or any(len(table) != n for table in tables):
            raise ValueError("its tables are not of as many speeds as `speeds_m_per_s`")
        if any(np.diff(self.speeds_m_per_s) <= 0):
            raise ValueError("`speeds_m_per_s` don't ascend")
        flat = [*self.fast.time_s, *self.slow.time_s]
        if min(flat) <= 0 or min(min(row) for table in tables for row in table) < 0:
            raise ValueError("a time or a standard deviation is not positive")
        doubt = self.doubt
        pairs = (doubt.turn_deg_per_s, doubt.turn_factor), (doubt.place_m_per_s, doubt.place_factor)
        for levels, factors in pairs:
            if not levels or len(levels) != len(factors) or min((*levels, *factors)) <= 0:
                raise ValueError("levels of doubt and their factors are not as many, and positive")
            if any(np.diff(levels) <= 0):
                raise ValueError("levels of doubt don't ascend")
        return self


def seen_motions(motions: DoubtedMotions, fps_hz: float, errors: DeltaErrors) -> SeenMotions:
    """A network's motions with their errors, by their own speed and doubt."""
    speeds = mean_speeds_m_per_s(motions.delta_m, fps_hz)
    factors = doubt_factors(motions.doubt, fps_hz, errors.doubt)
    levels = errors.speeds_m_per_s
    fast, slow = (process_at(one, speeds, levels) for one in (errors.fast, errors.slow))
    fast, slow = (replace(one, sigma=one.sigma * factors) for one in (fast, slow))
    return SeenMotions(motions.delta_rotmats, motions.delta_m, fast, slow)


def process_at(one: ErrorPart, speeds: np.ndarray, levels: Sequence[float]) -> ErrorProcess:
    """One of the two processes of motions with speeds (T-1,), given at levels of speed [m/s]."""
    tables = np.deg2rad(one.turn_deg_per_s), np.array(one.place_m_per_s)
    sigma = np.concatenate(tables, axis=1)
    at = [np.interp(speeds, levels, column) for column in sigma.T]
    return ErrorProcess(np.stack(at, axis=1), np.array(one.time_s))


def doubt_factors(doubt: np.ndarray, fps_hz: float, part: DoubtPart) -> np.ndarray:
    """Factors (T-1, 6) on the errors of motions whose doubt is (T-1, 2) [rad/s, m/s]."""
    about = np.log(mean_doubts(doubt, fps_hz) + LEAST_DOUBT)
    levels = np.deg2rad(part.turn_deg_per_s), np.array(part.place_m_per_s)
    factors = [
        np.interp(column, np.log(level), factor)
        for column, level, factor in zip(
            about.T, levels, (part.turn_factor, part.place_factor), strict=True
        )
    ]
    return np.repeat(np.stack(factors, axis=1), 3, axis=1)


def mean_doubts(doubt: np.ndarray, fps_hz: float) -> np.ndarray:
    """Root mean squares of doubts (T-1, 2) over `DOUBT_TIME_S` about each motion."""
    return np.sqrt(_window_means(doubt**2, round(DOUBT_TIME_S * fps_hz / 2)))


def mean_speeds_m_per_s(delta_m: np.ndarray, fps_hz: float) -> np.ndarray:
    """Speeds (T-1,) of motions (T-1, 3), each the mean over `SPEED_TIME_S` about it."""
    speeds = np.linalg.norm(delta_m, axis=1) * fps_hz
    return _window_means(speeds[:, None], round(SPEED_TIME_S * fps_hz / 2))[:, 0]


def _window_means(values: np.ndarray, reach: int) -> np.ndarray:
    """Means (T, C) over up to `reach` rows to either side; fewer at the ends."""
    rows = np.arange(len(values))
    start, stop = np.maximum(rows - reach, 0), np.minimum(rows + reach + 1, len(values))
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return np.asarray((sums[stop] - sums[start]) / (stop - start)[:, None])


def steps_of(frames: np.ndarray) -> np.ndarray:
    """(T - 1, 1) bool: steps that begin or end in some frames, (T,) bool."""
    return np.asarray((frames[1:] | frames[:-1])[:, None])


def widened(motions: SeenMotions, unseen: np.ndarray, factor: float) -> SeenMotions:
    """Motions whose errors are larger by a factor where they begin or end in an unseen frame."""
    factors = np.where(steps_of(unseen), factor, 1.0)
    fast, slow = (replace(p, sigma=p.sigma * factors) for p in (motions.fast, motions.slow))
    return replace(motions, fast=fast, slow=slow)


def free_where_hidden(motions: SeenMotions, hidden: np.ndarray) -> SeenMotions:
    """Motions that may be any that people make where they begin or end in a hidden frame: what a
    network sees in poses that are made up says nothing of the way."""
    sigma = np.hypot(motions.fast.sigma, steps_of(hidden) * FREE)
    fast = replace(motions.fast, sigma=sigma)
    return replace(motions, fast=fast)


def with_pace_errors(motions: SeenMotions, fps_hz: float, share: float) -> SeenMotions:
    """Motions whose slow error is larger by a share of their speed: mostly forward."""
    speeds = mean_speeds_m_per_s(motions.delta_m, fps_hz)
    more = np.zeros_like(motions.slow.sigma)
    more[:, 3:] = share * speeds[:, None] * PACE_AXES
    slow = replace(motions.slow, sigma=np.hypot(motions.slow.sigma, more))
    return replace(motions, slow=slow)


def corrected_by_like_poses(
    body: BodyModel, motion: Motion, motions: SeenMotions, seen: SeenPoses
) -> SeenMotions:
    """Motions that no camera sees, less the network's error in like poses that cameras see.

    Motions between seen poses stay as they are: there the graph has the cameras themselves.
    """
    both = seen.known[:-1] & seen.known[1:]
    if both.sum() < FEWEST_SEEN or both.all():
        return motions
    errors, noise = _seen_errors(motions, seen, both, motion.fps_hz)
    here, mirrored = _described_poses(body, motion)
    every = -(-len(errors) // MOST_SEEN)
    errors = errors[::every]
    known = np.concatenate([here[both][::every], mirrored[both][::every]])
    in_mirror = np.concatenate([-ACROSS, ACROSS])  # turns and steps: a turn's axis is no arrow
    known_errors = np.concatenate([errors, errors * in_mirror])
    unseen_errors = np.empty((int((~both).sum()), 6))
    for axes in (slice(0, 3), slice(3, 6)):
        carried = RBFInterpolator(
            known,
            known_errors[:, axes],
            neighbors=min(MOST_LIKE, len(known)),
            smoothing=UNLIKE + noise[axes].mean(),
            kernel="gaussian",
            epsilon=1 / (np.sqrt(2) * LIKE_M),
            degree=-1,
        )
        unseen_errors[:, axes] = carried(here[~both])
    turns, steps_m = motions.delta_rotmats.copy(), motions.delta_m.copy()
    turns[~both] = turns[~both] @ Rotation.from_rotvec(unseen_errors[:, :3]).as_matrix()
    steps_m[~both] += unseen_errors[:, 3:]
    return replace(motions, delta_rotmats=turns, delta_m=steps_m)


def _seen_errors(
    motions: SeenMotions, seen: SeenPoses, both: np.ndarray, fps_hz: float
) -> tuple[np.ndarray, np.ndarray]:
    """What the network's motions (N, 6) lack to those of the cameras, turn [rad] and step [m]; and
    the variance (6,) of the cameras' own noise in them, over that of the network's error."""
    rows = np.flatnonzero(both)
    to_root = seen.rotmats[rows].swapaxes(-1, -2)
    true_turns = to_root @ seen.rotmats[rows + 1]
    lacking = motions.delta_rotmats[rows].swapaxes(-1, -2) @ true_turns
    steps_m = (to_root @ (seen.pelvis_m[rows + 1] - seen.pelvis_m[rows])[..., None])[..., 0]
    errors = np.c_[Rotation.from_matrix(lacking).as_rotvec(), steps_m - motions.delta_m[rows]]
    shift_m2 = seen.shift_m[rows] @ seen.shift_m[rows].swapaxes(-1, -2)
    lost = -np.expm1(-1 / (fps_hz * seen.shift_time_s))  # of what they have in common
    covariance_m2 = seen.place_covariance_m2[rows] + lost * shift_m2
    place_m2 = np.trace(covariance_m2, axis1=1, axis2=2) / 3
    # Of the difference between two poses.
    noise = 2 * np.r_[[np.median(seen.turn_sigma_rad[rows] ** 2)] * 3, [np.median(place_m2)] * 3]
    own = np.median((motions.fast.sigma[rows] / fps_hz) ** 2, axis=0)
    return errors, noise / np.maximum(own, 1e-12)


def _described_poses(body: BodyModel, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Poses at T-1 motions, and their mirror images: places of joints and speeds (T-1, n) [m]."""
    from gmrdata.values.skinning import motion_joints_m

    joints_m = motion_joints_m(body, without_root(motion))
    joints_m = joints_m - joints_m[:, :1]
    mirrored_m = joints_m[:, list(MIRRORED)] * ACROSS
    here, there = (
        _places_and_speeds(places_m.reshape(len(places_m), -1), motion.fps_hz)
        for places_m in (joints_m, mirrored_m)
    )
    return here, there


def _places_and_speeds(places_m: np.ndarray, fps_hz: float) -> np.ndarray:
    """(T-1, 2n) at the middle of each motion [m]."""
    rows, apart = np.arange(len(places_m)), max(1, round(OVER_S * fps_hz))
    before, after = (np.clip(rows + way * apart, 0, rows[-1]) for way in (-1, 1))
    speeds = (places_m[after] - places_m[before]) * fps_hz / (2 * apart)
    numbers = np.concatenate([places_m, SPEED_S * speeds], axis=1)
    return np.asarray((numbers[:-1] + numbers[1:]) / 2)
