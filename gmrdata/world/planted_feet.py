"""Points of the feet that touch the ground, when they stand still, and the scale that they tell.

The body is metric and known in the camera's frame, so its feet are at R p + s t in the world, which
is linear in the scale s.  A planted foot stands still: at the true s many foot points do, at others
none.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from gmrdata.motion.ground import PLANTED_M_PER_S, SIDES
from gmrdata.motion.resample import valid_runs
from gmrdata.values.body import JOINT, BodyModel, sole_vertices, with_vertices
from gmrdata.values.camera import CameraPath
from gmrdata.values.errors import NoReconstruction
from gmrdata.values.motion import Motion
from gmrdata.world.recipe import CueEstimate, ScaleConfig

WATCHED_HZ = 60.0
"""Rate at which frames are compared to see which feet stand, nearly: of frames that follow sooner a
foot that swings slips as little as the noise of one that stands."""
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

    @property
    def soles_m(self) -> np.ndarray:
        """(T, 2, 3, 3) soles from the camera's place, in the world's axes [m]."""
        rotmats = self.camera_path.world_from_cam[:, :3, :3]
        return np.einsum("tij,tfkj->tfki", rotmats, self.points_cam_m[:, :, SOLE_POINTS])

    @property
    def mean_up(self) -> np.ndarray:
        """(3,) the person's mean up in the world, of length 1."""
        rotmats = self.camera_path.world_from_cam[:, :3, :3]
        up = np.nanmean(np.einsum("tij,tj->ti", rotmats, self.up_cam), axis=0)
        return np.asarray(up / np.linalg.norm(up))


def frames_apart(fps_hz: float) -> int:
    """How many frames apart those are that are compared to see which feet stand."""
    return max(1, round(fps_hz / WATCHED_HZ))


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


def standing_soles_m(body: BodyModel, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Points of both soles (T, 2, 3, 3) [m], and which of them stand."""
    soles_m = foot_points_m(body, motion)[:, :, SOLE_POINTS]
    return soles_m, standing(soles_m, PLANTED_M_PER_S / motion.fps_hz)


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
    # Of feet that creep on while the camera travels: at rest it tells nothing of the scale.
    creep = config.creep_m_per_s / fps_hz * terms[:, 4].sum() / terms[:, 1].sum()
    sigma = float(np.hypot(_standard_error(terms, scale), creep))
    residual_m = float(np.sqrt(terms[:, 2].sum() / terms[:, 3].sum()))
    return CueEstimate("planted_feet", scale, sigma, len(stances), residual_m, person=None)


def _search(turned_m: np.ndarray, centres: np.ndarray, slip_m: float, config: ScaleConfig) -> float:
    """The scale of a logarithmic grid at which the least moving foot points move least."""
    steps_m = np.diff(turned_m.reshape(len(turned_m), -1, 3), axis=0)
    moves = np.diff(centres, axis=0)
    known = np.isfinite(steps_m).all(axis=(1, 2)) & np.isfinite(moves).all(axis=1)
    if not known.any():
        raise NoReconstruction("scale: no two frames in a row have both pose and camera")
    steps_m, moves = steps_m[known], moves[known]
    squares = (moves**2).sum(axis=1)
    moving = squares > 1e-12 * max(1e-300, float((centres[np.isfinite(centres)] ** 2).max()))
    candidates = -np.einsum("nkj,nj->nk", steps_m[moving], moves[moving]) / squares[moving, None]
    candidates = candidates[candidates > 0]
    if not moving.any():
        raise NoReconstruction("scale: the camera hardly moves, so its path has no scale")
    if candidates.size < 4:
        what = f"no foot stands still in {moving.sum()} steps of the camera from frame to frame"
        raise NoReconstruction(f"scale: {what}; the person is seen too briefly, or moves with it")
    low, high = np.percentile(candidates, [1, 99])
    grid = np.geomspace(low / 3, high * 3, config.grid_steps)
    least = (((steps_m + s * moves[:, None]) ** 2).sum(axis=2).min(axis=1) for s in grid)
    costs = [np.minimum(each, slip_m**2).sum() for each in least]
    return float(grid[int(np.argmin(costs))])


def count_stances(still: np.ndarray) -> int:
    """Unbroken runs of frames in which any point of a foot stands, of feet (T, feet, points)."""
    down = np.asarray(still.any(axis=-1))
    return sum(len(valid_runs(of_foot)) for of_foot in down.T)


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
    """(5,) sums of A.B, B.B, squared residual, weight, and |B| times the frames from the middle,
    over one stance.

    A and B are points and centres less their means over each run in which the point stands still;
    the residual of a planted point is A + s B.
    """
    sums = np.zeros(5)
    for k in range(points_m.shape[1]):
        for start, stop in valid_runs(still[:, k]):
            rows = slice(start, stop + 1)
            a = points_m[rows, k] - points_m[rows, k].mean(axis=0)
            b = centres[rows] - centres[rows].mean(axis=0)
            squares = ((a + scale * b) ** 2).sum(axis=1)
            weight = 1.0 / (1.0 + squares / config.residual_m**2)
            frames = np.abs(np.arange(len(a)) - (len(a) - 1) / 2)
            along = (a * b).sum(axis=1), (b * b).sum(axis=1)
            products = *along, squares, np.ones(len(a)), frames * np.sqrt(along[1])
            sums += [weight @ each for each in products]
    return sums


def _standard_error(terms: np.ndarray, scale: float) -> float:
    """Jackknife over stances, but not less than what the residuals themselves allow."""
    ab, bb, rr, ww, _ = terms.T
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


SAMPLES = 400
LARGEST_TILT_RAD = np.deg2rad(30.0)  # between the ground's normal and the person's mean up
LOOKS, LOOK_RAD, FEWEST_BELOW = 20, np.deg2rad(35.0), 5
"""Frames in which to look below the person, how far round the ray to them, and for how many."""
FURTHEST_FROM_ROUGH = 2.0  # factor on a rough scale: beyond it, a table or so was the ground
LOWEST_CAMERA = 0.1  # a camera nearer to the ground, as a share of the way to the feet, is too low


def ground_contact_scale(
    seen: SeenFeet, points: np.ndarray, rough_scale: float, config: ScaleConfig
) -> CueEstimate | None:
    """Scale at which planted soles are on the ground; None where too few points show the ground.

    Above their plane, seen along its normal n, the camera is n.c - d in the cameras' unit, and
    -n.(R p) metres above a planted sole p.  That needs no slow feet, and a camera that hardly
    travels will do.  Background points (N, 3) are in the unit of the cameras; the rough scale is
    right to some tens of percent.
    """
    centres, soles_m, up = seen.camera_path.centres_world_m, seen.soles_m, seen.mean_up
    slip_m = config.slip_m(seen.fps_hz)
    still = standing(soles_m + rough_scale * centres[:, None, None], slip_m)
    frames, foot = np.nonzero(still.any(axis=-1))
    if not len(frames):
        return None
    feet = centres[frames] + soles_m[frames, foot].mean(axis=1) / rough_scale
    plane = ground_plane(points, feet, up, rough_scale, config)
    if plane is None:
        return None
    normal, n_points, residual = plane.normal, len(plane.points), plane.rms
    frames, height_m, away_m = _lowest(soles_m, still, normal)
    height = centres[frames] @ normal - plane.offset
    if np.median(height_m) < LOWEST_CAMERA * np.median(away_m):
        return None
    scales = height_m / height
    scale = float(np.median(scales))
    stances = 1 + np.count_nonzero(np.diff(np.unique(frames)) > 1)
    spread = 1.4826 * float(np.median(np.abs(scales - scale))) / np.sqrt(stances)
    contact = scale * config.contact_sigma_m / float(np.median(height_m))
    plane_error = scale * residual / np.sqrt(n_points) / float(np.median(height))
    sigma = float(np.sqrt(spread**2 + contact**2 + plane_error**2))
    within = 1 / FURTHEST_FROM_ROUGH < scale / rough_scale < FURTHEST_FROM_ROUGH
    if not within or not np.isfinite(sigma):
        return None
    return CueEstimate("ground_contact", scale, sigma, n_points, residual * scale, person=None)


def above_ground_scale(
    seen: SeenFeet, points: np.ndarray, rough_scale: float, config: ScaleConfig
) -> CueEstimate | None:
    """Scale at which the body's lowest soles are on the ground in the median of all frames, whether
    or not they keep still: of who is hidden below, or never stands.  As of `ground_contact_scale`,
    but as unsure as guessed legs are."""
    centres, soles_m = seen.camera_path.centres_world_m, seen.soles_m
    known = np.isfinite(soles_m).all(axis=(1, 2, 3)) & np.isfinite(centres).all(axis=1)
    if not known.any():
        return None
    feet = centres[known] + soles_m[known].mean(axis=(1, 2)) / rough_scale
    plane = ground_plane(points, feet, seen.mean_up, rough_scale, config)
    if plane is None:
        return None
    height_m = (-soles_m[known] @ plane.normal).reshape(known.sum(), -1).max(axis=1)
    away_m = np.linalg.norm(soles_m[known], axis=-1).mean(axis=(1, 2))
    height = centres[known] @ plane.normal - plane.offset
    if np.median(height_m) < LOWEST_CAMERA * np.median(away_m) or np.median(height) <= 0:
        return None
    scale = float(np.median(height_m) / np.median(height))
    sigma = scale * config.guessed_sigma_m / float(np.median(height_m))
    n, residual_m = len(plane.points), plane.rms * scale
    return CueEstimate("above_ground", scale, sigma, n, residual_m, person=None)


def scale_by_what_is_below(
    camera_path: CameraPath, points: np.ndarray, pelvis_cam_m: np.ndarray, up_cam: np.ndarray
) -> float | None:
    """Scale at which the person is as far away as what is seen below the pelvis, mostly the ground
    before and behind; None where nothing is.  A start for `ground_contact_scale`, no cue."""
    known = np.flatnonzero(np.isfinite(camera_path.world_from_cam).all(axis=(1, 2)))
    scales = []
    for row in known[:: max(1, len(known) // LOOKS)]:
        rotmat, centre = camera_path.world_from_cam[row, :3, :3], camera_path.centres_world_m[row]
        seen = (points - centre) @ rotmat
        away, away_m = np.linalg.norm(seen, axis=1), float(np.linalg.norm(pelvis_cam_m[row]))
        rays, ray = seen / np.maximum(away, 1e-12)[:, None], pelvis_cam_m[row] / away_m
        below = (rays @ ray > np.cos(LOOK_RAD)) & (rays @ up_cam[row] < ray @ up_cam[row])
        if below.sum() >= FEWEST_BELOW:
            scales.append(away_m / float(np.median(away[below])))
    return float(np.median(scales)) if scales else None


def _lowest(
    soles_m: np.ndarray, still: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frames in which soles (T, 2, K, 3) stand still, and of each the lowest point that does: how
    far below the camera it is, and how far away [m].

    Of both feet, since a slow one may be in the air; and along the ground's normal, since a person
    who leans forward would call toes and the front foot the lowest.
    """
    depths_m = np.where(still, -soles_m @ normal, -np.inf).reshape(len(soles_m), -1)
    frames, lowest = np.flatnonzero(still.any(axis=(1, 2))), depths_m.argmax(axis=1)
    away_m = np.linalg.norm(soles_m, axis=-1).reshape(depths_m.shape)
    return frames, depths_m[frames, lowest[frames]], away_m[frames, lowest[frames]]


@dataclass(frozen=True, eq=False)
class GroundPlane:
    """The ground about planted feet."""

    normal: np.ndarray  # (3,) unit
    offset: float  # its height along the normal
    points: np.ndarray  # (N, 3) that lie on it
    rms: float  # of their distance from it


def ground_plane(
    points: np.ndarray, feet: np.ndarray, up: np.ndarray, scale: float, config: ScaleConfig
) -> GroundPlane | None:
    """The plane under feet (M, 3) that reconstructed points (N, 3) show, in a unit of so many
    metres, about a rough up (3,); None where too few of them do."""
    # The person may lean, and then the plane that was found tells up better.
    plane = None
    for _ in range(2):
        near = _near_feet(points, feet, up, scale, config)
        plane = _fit_plane(near, up, config.ground_inlier_m / scale)
        if plane is None or len(plane.points) < config.min_ground_points:
            return None
        up = plane.normal
    return plane


def _near_feet(
    points: np.ndarray, feet: np.ndarray, up: np.ndarray, scale: float, config: ScaleConfig
) -> np.ndarray:
    """Points that may be the ground, (P, 3): near planted feet, and about as low."""
    across = np.linalg.svd(up[None])[2][1:]
    tree = cKDTree(feet @ across.T)
    apart, nearest = tree.query(points @ across.T)
    above = np.abs(points @ up - feet[nearest] @ up)
    near = (apart * scale < config.ground_radius_m) & (above * scale < config.ground_height_m)
    return np.asarray(points[near])


def _fit_plane(points: np.ndarray, up: np.ndarray, tolerance: float) -> GroundPlane | None:
    """The best nearly level plane."""
    if len(points) < 3:
        return None
    # Samples of three points, then least squares with Cauchy weights.
    rng = np.random.default_rng(0)
    corners = points[rng.integers(0, len(points), (SAMPLES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals[lengths > 0] / lengths[lengths > 0, None]
    normals *= np.sign(normals @ up)[:, None]
    level = normals @ up > np.cos(LARGEST_TILT_RAD)
    normals, starts = np.r_[normals[level], up[None]], corners[lengths > 0][level][:, 0]
    offsets = np.r_[(normals[:-1] * starts).sum(axis=1), np.median(points @ up)]
    costs = [
        np.minimum(np.abs(points @ normal - offset), tolerance).sum()
        for normal, offset in zip(normals, offsets, strict=True)
    ]
    best = int(np.argmin(costs))
    normal, offset = normals[best], offsets[best]
    for _ in range(20):
        residual = points @ normal - offset
        weights = 1.0 / (1.0 + (residual / tolerance) ** 2) ** 2
        middle = weights @ points / weights.sum()
        spread = (points - middle).T @ ((points - middle) * weights[:, None])
        normal = np.linalg.eigh(spread)[1][:, 0]
        normal = normal * np.sign(normal @ up)
        offset = float(middle @ normal)
    on = np.abs(points @ normal - offset) < 2 * tolerance
    if normal @ up < np.cos(LARGEST_TILT_RAD) or not on.any():
        return None
    rms = float(np.sqrt(np.mean((points[on] @ normal - offset) ** 2)))
    return GroundPlane(normal, offset, points[on], rms)
