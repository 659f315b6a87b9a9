"""Metres per unit of a reconstruction, with an error bar, from independent cues.

The person is metric, so their planted feet stand still and on the triangulated ground at the true
scale only.  A data set's own metric camera drifts, but tells the path's length over short times.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from scipy.special import log_ndtr, ndtri_exp

from gmrdata.cameras.files import Geometry
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.errors import NoReconstruction
from gmrdata.values.motion import Motion
from gmrdata.world.planted_feet import (
    SeenFeet,
    above_ground_scale,
    foot_points_m,
    frames_apart,
    ground_contact_scale,
    planted_feet_scale,
    scale_by_what_is_below,
)
from gmrdata.world.recipe import CueEstimate, ScaleConfig

FEWEST_WINDOWS = 5
GROUND_STARTS = (1.0, 1.4, 0.7, 2.0)
"""Of a scale by what is seen below the person, which was 0.6 to 1 of the true one."""
SAME_SCALE = 0.05
ALIKE_SIGMAS = 3.0  # between feet that seem to stand on no ground and it, to believe them as well


def short_windows_scale(
    camera_path: CameraPath, dataset_camera: np.ndarray, fps_hz: float, config: ScaleConfig
) -> CueEstimate | None:
    """Scale at which both cameras travel equally far in equal short times.

    Each window's displacement is taken in the axes of its first camera, so neither path needs the
    other's world.  The slow drift of the data set's path (T, 4, 4) is an error that windows within
    `drift_time_s` share.  None where fewer than five windows are known, or the camera stays.
    """
    step = max(1, round(config.window_s * fps_hz))
    if camera_path.n_frames - step < FEWEST_WINDOWS:
        return None
    moves, moves_m = _moves(camera_path.world_from_cam, step), _moves(dataset_camera, step)
    known = np.isfinite(moves).all(axis=1) & np.isfinite(moves_m).all(axis=1)
    moves, moves_m = moves[known], moves_m[known]
    power = float((moves**2).sum())
    if len(moves) < FEWEST_WINDOWS or power <= 0:
        return None
    if (scale := float((moves * moves_m).sum()) / power) <= 0:
        return None
    residual_m = float(np.sqrt(np.mean((moves_m - scale * moves) ** 2)))
    independent = max(1.0, known.sum() / fps_hz / config.drift_time_s)
    # One axis of the residual points along the way, on average over the windows.
    length = np.sqrt(power / len(moves))
    along = config.drift_m_per_s * step / fps_hz / length
    sigma = float(np.hypot(residual_m / length / np.sqrt(independent), along))
    return CueEstimate("short_windows", scale, sigma, len(moves), residual_m, person=None)


def _moves(world_from_cam: np.ndarray, step: int) -> np.ndarray:
    """Displacements (T - step, 3) over `step` frames, in the axes of the first camera of each."""
    centres = world_from_cam[:, :3, 3]
    return np.einsum("tji,tj->ti", world_from_cam[:-step, :3, :3], centres[step:] - centres[:-step])


@dataclass(frozen=True)
class ScaleEstimate:
    """Fused metric scale."""

    scale: float | None
    """Metres per unit; None where the camera stays in place or travels less than can be told."""
    sigma: float | None  # Standard error of `scale`; widened where the cues disagree
    cues: tuple[CueEstimate, ...]
    matters: bool = True
    """Whether `sigma` makes the camera's speed wrong by over `slow_m_per_s`, or its way while
    nobody is seen by over `unseen_move_m`."""
    size_sigmas: tuple[float, ...] = ()  # By person: standard error of the body's size, as a share

    @property
    def disagreement(self) -> float | None:
        """Largest difference of two cues, in its standard errors; None for one cue.

        Of several pairs it is the difference that is as unlikely for one: of 92 right cues some two
        are 3.5 standard errors apart in two of five sequences.
        """
        if len(self.cues) < 2:
            return None
        scales, covariance = _of_cues(self.cues, self.size_sigmas)
        first, second = np.triu_indices(len(scales), 1)
        spread = covariance.diagonal()
        sigmas = np.sqrt(spread[first] + spread[second] - 2 * covariance[first, second])
        apart = float((np.abs(scales[first] - scales[second]) / sigmas).max())
        # In logarithms: beyond 38 standard errors a float holds no probability.
        log_tail = min(log_ndtr(-apart) + np.log(len(first)), -np.log(2))
        return float(abs(ndtri_exp(log_tail)))

    @property
    def sizes(self) -> tuple[tuple[float, float], ...]:
        """By person: by how much larger it is likely to be than the body that stands for it, by the
        scale that all share, and the standard error of that, as a share.  Who is alone, or of a
        known size, keeps the body's.

        Least squares in logarithms: a cue is the scale less the size of its person, which is 1 but
        for its error.
        """
        n = len(self.size_sigmas)
        precision, pull = (
            np.diag([1e-9, *(max(s, LEAST_SIZE) ** -2.0 for s in self.size_sigmas)]),
            np.zeros(n + 1),
        )
        for cue in self.cues:
            if self.scale is None or cue.scale <= 0 or cue.sigma <= 0:
                continue
            row = np.zeros(n + 1)
            row[0] = 1.0
            if cue.person is not None and cue.person < n:
                row[1 + cue.person] = -1.0
            weight = (cue.scale / cue.sigma) ** 2
            precision += weight * np.outer(row, row)
            pull += weight * row * np.log(cue.scale / self.scale)
        covariance = np.linalg.inv(precision)
        logs = (covariance @ pull)[1:]
        return tuple(
            zip(np.exp(logs).tolist(), np.sqrt(covariance.diagonal()[1:]).tolist(), strict=True)
        )


LEAST_SIZE = 1e-4  # standard error of a size that is known, as a share
LEAST_VARIANCE = 1e-30  # of a scale that is said to be exact
NO_SCALE = ScaleEstimate(None, None, (), matters=False)


@dataclass(frozen=True, eq=False)
class SeenPerson:
    """A person in front of T cameras up to scale, NaN where they or the person are unknown."""

    motion: Motion  # T frames, camera frame
    body: BodyModel
    camera_path: CameraPath
    size_sigma: float = 0.0  # standard error of the body's size, as a share


def estimate_scale(
    people: Sequence[SeenPerson],
    geometry: Geometry,
    config: ScaleConfig,
    *,
    points: np.ndarray | None = None,
    dataset_camera: np.ndarray | None = None,
) -> ScaleEstimate:
    """Metric scale of a camera path from one or more who walk before it, over the same T frames.

    None is given of a camera that travels less than the cues can tell, and so little that it does
    not matter; and unless the geometry is "full".  NoReconstruction where no cue finds a scale.

    Args:
        points: (N, 3) background points in the cameras' unit, for the cue of the ground.
        dataset_camera: (T, 4, 4) metric world_from_cam, right over short times; NaN where unknown.
    """
    if geometry != "full":
        return NO_SCALE
    fps_hz, path = people[0].motion.fps_hz, _known_to_any(people)
    cues: list[CueEstimate] = []
    reasons: list[str] = []
    for number, person in enumerate(people):
        if not person.camera_path.has_camera.any():
            continue
        try:
            cues += [replace(cue, person=number) for cue in _of_person(person, points, config)]
        except NoReconstruction as error:
            reasons.append(str(error))
    if dataset_camera is not None:
        windows = short_windows_scale(path, dataset_camera, fps_hz, config)
        cues += [] if windows is None else [windows]
    if not cues:
        raise NoReconstruction("; ".join(dict.fromkeys(reasons)))
    size_sigmas = tuple(person.size_sigma for person in people)
    estimate = fuse(tuple(cues), config.body_share, size_sigmas)
    scale, sigma = estimate.scale or 0.0, estimate.sigma or 0.0
    matters = _matters(path, sigma, fps_hz, config)
    # The path is shorter than its error bar, or not much longer, and both are small.
    vague = not matters and sigma > config.vague_share * scale
    if scale <= 0 and not vague:
        what = f"feet would stand still at {scale:.2g} ± {sigma:.2g} m a unit"
        raise NoReconstruction(f"scale: {what}, so they don't tell it")
    known = replace(estimate, scale=None, sigma=None) if vague else estimate
    return replace(known, matters=matters)


def _matters(path: CameraPath, sigma: float, fps_hz: float, config: ScaleConfig) -> bool:
    """Whether an error of the scale makes the camera's speed wrong, or its way through frames that
    are not known."""
    rows = np.flatnonzero(np.isfinite(path.centres_world_m).all(axis=1))
    moves = np.linalg.norm(np.diff(path.centres_world_m[rows], axis=0), axis=1)
    follow = np.diff(rows) == 1
    speed = fps_hz * moves[follow].mean() if follow.any() else 0.0
    unseen = moves[~follow].max(initial=0.0)
    return bool(sigma * speed > config.slow_m_per_s or sigma * unseen > config.unseen_move_m)


def with_focal_error(estimate: ScaleEstimate, focal_sigma: float) -> ScaleEstimate:
    """The estimate with what a focal length's standard error, as a share of it, adds to its own.

    A person seen at another focal length is as much further away, and with them the whole path.
    """
    if estimate.scale is None or estimate.sigma is None or focal_sigma == 0:
        return estimate
    return replace(estimate, sigma=float(np.hypot(estimate.sigma, focal_sigma * estimate.scale)))


def _of_person(
    person: SeenPerson, points: np.ndarray | None, config: ScaleConfig
) -> list[CueEstimate]:
    """The cues of one person's feet; the ground's needs a rough scale to begin with.

    Planted feet give it or, where they find no ground, as feet that creep don't, what is seen below
    the person; the ground itself must confirm that.  Where feet stand on no ground, as they are
    hidden or never still, the person is somewhere above it.  Hidden feet are guessed where they
    would be before the camera: they keep still there, and their scale is about 0.
    """
    every = frames_apart(person.motion.fps_hz)
    at = slice(int(person.camera_path.has_camera.argmax()), None, every)  # from the first known row
    path = person.camera_path.at_rows(at)
    motion = person.motion.take(at, person.motion.fps_hz / every)
    feet_cam_m, up_cam = foot_points_m(person.body, motion), motion.root_rotmats[:, :, 1]
    seen = SeenFeet(path, feet_cam_m, up_cam, motion.fps_hz)
    feet, why = None, None
    try:
        feet = planted_feet_scale(path, feet_cam_m, motion.fps_hz, config)
    except NoReconstruction as error:
        why = error
    if points is None:
        return _found(feet, None, why)

    def ground_at(rough: float) -> CueEstimate | None:
        return ground_contact_scale(seen, points, rough, config)

    ground = None if feet is None or feet.scale <= 0 else ground_at(feet.scale)
    below = None if ground else scale_by_what_is_below(path, points, motion.pelvis_m, up_cam)
    if below is not None and feet is not None:
        ground = _confirmed(ground_at, below)
    if ground is not None or below is None:
        return _found(feet, ground, why)
    above = _confirmed(lambda rough: above_ground_scale(seen, points, rough, config), below)
    if above is not None and feet is not None:
        apart = abs(above.scale - feet.scale) / float(np.hypot(above.sigma, feet.sigma))
        tell = feet.sigma < above.sigma and apart < ALIKE_SIGMAS
        feet = feet if tell else None
    return _found(feet, above, why)


def _found(
    feet: CueEstimate | None, ground: CueEstimate | None, why: NoReconstruction | None
) -> list[CueEstimate]:
    """The cues that there are; why feet tell nothing where there are none."""
    if feet is None and ground is None:
        assert why is not None
        raise why
    return [cue for cue in (feet, ground) if cue is not None]


def _confirmed(
    ground_at: Callable[[float], CueEstimate | None], rough: float
) -> CueEstimate | None:
    """The ground from about a rough scale, where it is found again from its own."""
    for share in GROUND_STARTS:
        first = ground_at(share * rough)
        again = None if first is None else ground_at(first.scale)
        if first and again and abs(again.scale / first.scale - 1) < SAME_SCALE:
            return again
    return None


def _known_to_any(people: Sequence[SeenPerson]) -> CameraPath:
    """The cameras of the frames in which anybody's motion is known."""
    paths = [person.camera_path.world_from_cam for person in people]
    known = reduce(lambda mine, other: np.where(np.isfinite(mine), mine, other), paths)
    return replace(people[0].camera_path, world_from_cam=known)


def fuse(
    cues: tuple[CueEstimate, ...],
    common_share: float = 0.0,
    size_sigmas: tuple[float, ...] = (),
) -> ScaleEstimate:
    """Mean of the cues, weighted by the inverse of their covariance: those of one person have the
    error of its size in common.

    Where they scatter more than their errors allow, the error of the mean is widened by the square
    root of chi-square per degree of freedom (Birge 1932).  An error that they share, as a share of
    the scale, is not lowered by their number.
    """
    scales, covariance = _of_cues(cues, size_sigmas)
    own = np.array([cue.sigma for cue in cues]) ** 2
    precision = np.linalg.inv(covariance)
    weights = precision.sum(axis=0) / precision.sum()
    scale = float(weights @ scales)
    chi_square = float((scales - scale) @ precision @ (scales - scale))
    widened = max(1.0, chi_square / max(1, len(cues) - 1))
    of_sizes = float(weights @ (covariance - np.diag(own)) @ weights)
    variance = float(weights**2 @ own) * widened + of_sizes + (common_share * scale) ** 2
    return ScaleEstimate(scale, float(np.sqrt(variance)), cues, size_sigmas=size_sigmas)


def _of_cues(
    cues: tuple[CueEstimate, ...], size_sigmas: tuple[float, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """The cues' scales (N,), and their covariance (N, N).

    The error of a size is taken as a share of one scale for all cues.  As a share of each cue's own
    the lower of two that differ would seem surer, and their mean would be below both.
    """
    scales = np.array([cue.scale for cue in cues])
    own = np.array([cue.sigma for cue in cues]) ** 2
    people = np.array([-1 if cue.person is None else cue.person for cue in cues])
    shares = np.array([size_sigmas[one] if 0 <= one < len(size_sigmas) else 0.0 for one in people])
    middle = float(np.average(scales, weights=1 / np.maximum(own, LEAST_VARIANCE)))
    common = np.where(people[:, None] == people, np.outer(shares, shares) * middle**2, 0.0)
    return scales, common + np.diag(own)
