"""Points of the feet that touch the ground, when they stand still, and the scale that they tell.

The body is metric and known in the camera's frame, so its feet are at R p + s t in the world, which
is linear in the scale s.  A planted foot stands still: at the true s many foot points do, at others
none.
"""

from dataclasses import dataclass

import numpy as np

from gmrdata.motion.resample import valid_runs
from gmrdata.values.body import JOINT, BodyModel, sole_vertices, with_vertices
from gmrdata.values.camera import CameraPath
from gmrdata.values.errors import NoReconstruction
from gmrdata.values.motion import Motion
from gmrdata.world.recipe import CueEstimate, ScaleConfig

SIDES = ("left", "right")
SOLE_POINTS = slice(2, 5)  # heel, ball and toe
SOLE_THICKNESS_M = 0.02  # rest vertices this close above a foot's lowest one belong to its sole
SOLE_END = 0.2  # share of a sole's length that is its heel, or its toes
BALL_M = 0.02  # and so near to the foot joint, seen from above, is its ball


@dataclass(frozen=True, eq=False)
class SeenFeet:
    """Feet before T cameras up to scale, NaN where they or the person are unknown."""

    camera_path: CameraPath
    points_cam_m: np.ndarray  # (T, 2, K, 3) of both, as `foot_points_m` has them, camera frame
    up_cam: np.ndarray  # (T, 3) the person's own up direction
    fps_hz: float


def foot_points_m(body: BodyModel, motion: Motion) -> np.ndarray:
    """Left and right ankle, foot joint, and the sole's heel, ball and toe, (T, 2, 5, 3) [m]."""
    from gmrdata.values.skinning import motion_joints_m, motion_vertices_m

    joints_m = motion_joints_m(body, motion)
    sole = np.array([_sole_vertices(body, motion.shape, side) for side in SIDES])
    vertices_m = motion_vertices_m(with_vertices(body, sole.ravel()), motion)
    inner = [[JOINT[f"{side}_ankle"], JOINT[f"{side}_foot"]] for side in SIDES]
    soles_m = vertices_m.reshape(-1, 2, 3, 3)
    return np.concatenate([joints_m[:, inner], soles_m], axis=2)


def standing(points_world_m: np.ndarray, slip_m: float) -> np.ndarray:
    """(T, ...) bool: points (T, ..., 3) that move less than `slip_m` to a neighbour; not NaN."""
    still = np.linalg.norm(np.diff(points_world_m, axis=0), axis=-1) < slip_m
    result = np.zeros(points_world_m.shape[:-1], dtype=bool)
    result[1:] |= still
    result[:-1] |= still
    return result


def _sole_vertices(body: BodyModel, shape: np.ndarray, side: str) -> list[int]:
    """Indices of the lowest vertices of a foot's heel, ball and toe, in the rest pose.

    A sole is round at its ends: the hindmost and the foremost vertex are 13 mm above the floor,
    which makes the camera 13 mm lower and the scale of the ground 1 % too small.
    """
    rest_m = body.rest_vertices_m(shape)
    sole = sole_vertices(body, rest_m, side, SOLE_THICKNESS_M)
    forward_m, end_m = rest_m[sole, 2], SOLE_END * np.ptp(rest_m[sole, 2])
    ball_m = body.rest_joints_m(shape)[JOINT[f"{side}_foot"]]
    apart_m = np.linalg.norm(rest_m[sole][:, [0, 2]] - ball_m[[0, 2]], axis=1)
    heel, toe = forward_m <= forward_m.min() + end_m, forward_m >= forward_m.max() - end_m
    parts = heel, apart_m <= apart_m.min() + BALL_M, toe
    return [int(sole[np.where(part, rest_m[sole, 1], np.inf).argmin()]) for part in parts]


def planted_feet_scale(
    camera_path: CameraPath, feet_cam_m: np.ndarray, fps_hz: float, config: ScaleConfig
) -> CueEstimate:
    """Scale at which feet stand still while they are planted.

    A search over s minimises, over all steps between frames, the truncated displacement of the
    foot point that moves least.  Then stances are taken at that s, and s is the least-squares
    answer to "every planted point stays at its stance's mean", with Cauchy weights, iterated.
    Points of both feet (T, 2, K, 3) are in the camera's frame [m].
    """
    turned_m = np.einsum("tij,tfkj->tfki", camera_path.world_from_cam[:, :3, :3], feet_cam_m)
    centres = camera_path.centres_world_m
    slip_m = config.slip_m(fps_hz)
    scale = _search(turned_m, centres, slip_m, config)
    for _ in range(10):
        stances = _stances(turned_m, centres, scale, slip_m)
        if len(stances) < config.min_stances:
            raise NoReconstruction(
                f"scale: only {len(stances)} planted feet found, {config.min_stances} needed; the "
                "clip is too short, or the feet are never still"
            )
        terms = np.array([_stance_terms(*stance, scale, config) for stance in stances])
        before, scale = scale, float(-terms[:, 0].sum() / terms[:, 1].sum())
        if abs(scale - before) < 1e-9 * scale:
            break
    # A camera that mostly stands has a scale that is uncertain beyond measure, not infinitely.
    speed = max(np.nanmedian(np.linalg.norm(np.diff(centres, axis=0), axis=1)) * fps_hz, 1e-12)
    sigma = float(np.hypot(_standard_error(terms, scale), config.creep_m_per_s / speed))
    residual_m = float(np.sqrt(terms[:, 2].sum() / terms[:, 3].sum()))
    return CueEstimate("planted_feet", scale, sigma, len(stances), residual_m, person=None)


def _search(turned_m: np.ndarray, centres: np.ndarray, slip_m: float, config: ScaleConfig) -> float:
    """The scale of a logarithmic grid at which the least moving foot points move least."""
    steps_m = np.diff(turned_m, axis=0).reshape(len(turned_m) - 1, -1, 3)
    moves = np.diff(centres, axis=0)
    known = np.isfinite(steps_m).all(axis=(1, 2)) & np.isfinite(moves).all(axis=1)
    if not known.any():
        raise NoReconstruction("scale: no two frames in a row have both pose and camera")
    steps_m, moves = steps_m[known], moves[known]
    squares = (moves**2).sum(axis=1)
    moving = squares > 1e-12 * max(1e-300, float((centres[np.isfinite(centres)] ** 2).max()))
    candidates = -np.einsum("nkj,nj->nk", steps_m[moving], moves[moving]) / squares[moving, None]
    candidates = candidates[candidates > 0]
    if candidates.size < 4:
        raise NoReconstruction("scale: the camera hardly moves, so its path has no scale")
    low, high = np.percentile(candidates, [1, 99])
    grid = np.geomspace(low / 3, high * 3, config.grid_steps)
    least = (((steps_m + s * moves[:, None]) ** 2).sum(axis=2).min(axis=1) for s in grid)
    costs = [np.minimum(each, slip_m**2).sum() for each in least]
    return float(grid[int(np.argmin(costs))])


def _stances(
    turned_m: np.ndarray, centres: np.ndarray, scale: float, slip_m: float
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Stances of each foot at a scale, as (points (n, K, 3) [m], centres (n, 3), planted (n-1, K)).
    A foot is down between two frames if one of its points stands still between them."""
    world_m = turned_m + scale * centres[:, None, None]
    still = np.linalg.norm(np.diff(world_m, axis=0), axis=-1) < slip_m
    return [
        (turned_m[start : stop + 1, foot], centres[start : stop + 1], still[start:stop, foot])
        for foot in range(turned_m.shape[1])
        for start, stop in valid_runs(still[:, foot].any(axis=1))
    ]


def _stance_terms(
    points_m: np.ndarray, centres: np.ndarray, still: np.ndarray, scale: float, config: ScaleConfig
) -> np.ndarray:
    """(4,) sums of A.B, B.B, squared residual and weight over one stance.

    A and B are points and centres less their means over each run in which the point stands still;
    the residual of a planted point is A + s B.
    """
    sums = np.zeros(4)
    for k in range(points_m.shape[1]):
        for start, stop in valid_runs(still[:, k]):
            rows = slice(start, stop + 1)
            a = points_m[rows, k] - points_m[rows, k].mean(axis=0)
            b = centres[rows] - centres[rows].mean(axis=0)
            squares = ((a + scale * b) ** 2).sum(axis=1)
            weight = 1.0 / (1.0 + squares / config.residual_m**2)
            products = (a * b).sum(axis=1), (b * b).sum(axis=1), squares
            sums += [*(weight @ each for each in products), weight.sum()]
    return sums


def _standard_error(terms: np.ndarray, scale: float) -> float:
    """Jackknife over stances, but not less than what the residuals themselves allow."""
    ab, bb, rr, ww = terms.T
    n = len(terms)
    residual_variance = rr.sum() / ww.sum()
    # Points of one foot move together: a stance counts as its mean weight per point, not their sum.
    from_residuals = np.sqrt(residual_variance / bb.sum())
    if n < 3:
        return float(2.0 * from_residuals)
    others = bb.sum() - bb
    if not (others > 0).all():
        return scale  # one stance holds the scale alone, and nothing says how far it is off
    left_out = -(ab.sum() - ab) / others
    jackknife = np.sqrt((n - 1) / n * ((left_out - left_out.mean()) ** 2).sum())
    return float(max(jackknife, from_residuals, 1e-12 * scale))
