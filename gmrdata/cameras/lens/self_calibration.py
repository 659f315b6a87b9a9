"""The lens from the frames alone: focal length and one term of radial distortion.

A few keyframes are matched without any intrinsics, by fundamental matrices.  From each of several
focal lengths COLMAP's global mapper makes a model, in whose bundle adjustment the lens is free; a
camera that only turns has its lens from how its pictures overlap.  What explains most of the same
matches best is taken, so that a start doesn't confirm itself.
"""

import shutil
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as part

from gmrdata.cameras.colmap import (
    MIN_PARALLAX_DEG,
    FreeIntrinsic,
    bundle_adjuster,
    global_options,
    incremental_options,
    matrix_of,
    pycolmap,
    seen_by,
)
from gmrdata.cameras.files import Distortion
from gmrdata.cameras.frames import Frames, reduced
from gmrdata.cameras.lens.rolling_shutter import AXES, with_rolled_lines
from gmrdata.cameras.map.focal import (
    FREED_NOT_INDEPENDENT,
    MAX_RADIAL,
    NOT_INDEPENDENT,
    SYSTEMATIC_FOCAL,
    SYSTEMATIC_K1,
    TurningFit,
    adjust_lens,
    fit_turning,
    warp_error,
)
from gmrdata.cameras.map.rotation_only import solve_rotation_only, weigh
from gmrdata.cameras.match.keyframes import choose_keyframes
from gmrdata.cameras.match.matches import DATABASE_FILE, Matches, match_frames, matched_points
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values import limits, transforms
from gmrdata.values.camera import Lens, bent
from gmrdata.values.errors import NoReconstruction
from gmrdata.values.records import PART, Config, Figure

CameraMotion = Literal["full", "rotation_only"]
ENOUGH, ONE_FOCAL = 3, 0.01  # starts at least, and how near to each other two end, as a share
CLEARLY_WORSE = 1.1  # a cost over the best
FROM_STARTS = 2  # starts that must end at the focal length that is taken
HOPELESS = 2  # starts after which none is tried if nothing came of any
MOST_COST: dict[CameraMotion, float] = {"full": np.inf, "rotation_only": 2.0}
"""Above which it is not so: half of the matches are 2.5 px off then, at 4 to 5 for who walks."""
STILL_PX = 1.0  # median motion of the background in the worst tenth of the pairs, of a still camera
LENS_SIGMAS = 2.5  # by how many standard errors k1 must differ from 0 to be taken out
SAME_COST, SAME_K1 = 0.01, 0.03
"""As a share, and of k1: models that fit alike, with as much distortion, say what is left open."""
TURN_INLIER_PX = 3.0
TRACKS_PER_FRAME = 200  # by which the global mapper places a frame; a lens asks for more
FEWEST_FRAMES = 4  # of a model
ENOUGH_FRAMES = 1800  # in which most cameras move enough
ENOUGH_SHARE = 0.6  # of the keyframes, in a model of the first mapper
MOST_ERROR_PX = 4.0  # of an image point that a model explains
FIRST_PAIR_DEG = 4.0  # parallax of the first pair of the incremental mapper, at least
MOST_POINTS = 1500  # for the standard errors
PARTS = 5  # stretches of frames, of which one is left out at a time


class SelfCalibrationConfig(Config):
    """How the lens is sought in the frames."""

    starts: tuple[float, ...] = Field(default=(0.9, 0.6, 1.4, 0.45, 2.0), min_length=1)
    """Focal lengths to start from, over the longer side, usual ones first.  The later ones are left
    out where two of three end at one focal length and the third fits worse."""
    max_image_size_px: int = Field(default=960, ge=64, le=limits.LARGEST_SIDE_PX)
    """Longer side above which frames are reduced first [px]."""
    most_keyframes: int = Field(default=22, ge=4, le=500)
    """Frames that are matched at most."""
    keyframe_step: float = Field(default=0.06, gt=0, le=0.5)
    """How far the background moves from one of them to the next, over the longer side."""
    max_features: int = Field(default=1500, ge=100, le=100_000)
    """SIFT features of each at most."""
    verification_error_px: float = Field(default=3.0, gt=0)
    """Distance from the epipolar line up to which a match is kept: a lens bends the line [px]."""
    max_sigma: float = Field(default=0.08, gt=0)
    """Standard error, as a share, above which the frames don't hold the focal length."""
    seed: int = Field(default=0, ge=0, le=2**31 - 1)
    """Seed of every random choice."""

    @property
    def sfm(self) -> SfmConfig:
        """The camera stage's recipe for matching these few frames."""
        return SfmConfig(
            max_image_size_px=self.max_image_size_px,
            keyframe_step=self.keyframe_step,
            keyframe_parallax=self.keyframe_step / 2,
            max_features=self.max_features,
            verification_error_px=self.verification_error_px,
            seed=self.seed,
        )


@part(frozen=True, config=PART)
class StartTried:
    """One start and what came of it; null where nothing did."""

    motion: CameraMotion
    start: Figure
    """Focal length over the longer side."""
    found: Figure | None
    """The same, where it ended."""
    radial_k1: Figure | None
    cost: Figure | None
    """Mean loss of all matched image points; those that are left unexplained count fully."""


@dataclass(frozen=True)
class SelfCalibration:
    """What the frames say of the lens."""

    motion: CameraMotion | None
    """What the camera does, as far as it was found out."""
    focal: float | None
    """Focal length over the longer side; None where nothing could be made of the frames."""
    focal_sigma: float
    """Its standard error, as a share; infinite without."""
    radial_k1: float
    radial_k1_sigma: float
    starts: tuple[StartTried, ...]
    reason: str
    """Why the frames don't hold the focal length; empty where they do."""

    @property
    def observable(self) -> bool:
        return not self.reason


class _Fit(NamedTuple):
    """A lens that explains the matches, in units of the picture's longer side."""

    focal: float
    k1: float
    cost: float
    frames: int
    model: Any
    """A pycolmap.Reconstruction; a TurningFit of a camera that only turns."""


def self_calibrate(
    frames: Frames, work_dir: Path, config: SelfCalibrationConfig, readout: float
) -> SelfCalibration:
    """Find the lens; the intrinsics of the frames are but a guess with the right middle.

    A rolling shutter may take a `readout` of the time from one number of an image to the next.
    """
    try:
        keys = _keyframes(frames, work_dir, config)
        matches = match_frames(keys, work_dir, config.sfm, calibrated=False)
    except NoReconstruction as error:
        return nothing_found(error.why)
    if is_still(matches):
        return nothing_found("the camera does not move")
    turning, verdict = by_turning(keys, matches, config)
    if verdict == "rotation_only":
        return turning
    mapped = by_mapping(keys, matches, work_dir, config, readout)
    better = likelier(turning, mapped, nearly_turns=verdict == "either")
    return replace(better, starts=(*turning.starts, *mapped.starts))


def likelier(
    turning: SelfCalibration, mapped: SelfCalibration, *, nearly_turns: bool
) -> SelfCalibration:
    """The lens of a camera that only turns, or of one that also moves.

    Who pans in the hand moves a little: too much for a pure turn, too little for a model, which
    then explains less than the turn does.
    """
    if turning.focal is not None and _least_cost(turning) < _least_cost(mapped):
        return turning
    nearly_turns |= mapped.focal is None
    return turning if nearly_turns and turning.focal_sigma < mapped.focal_sigma else mapped


def _least_cost(found: SelfCalibration) -> float:
    return min((start.cost for start in found.starts if start.cost is not None), default=np.inf)


def nothing_found(reason: str, starts: Sequence[StartTried] = ()) -> SelfCalibration:
    """Nothing but the reason."""
    return SelfCalibration(None, None, np.inf, 0.0, np.inf, tuple(starts), reason)


def is_still(matches: Matches) -> bool:
    """Whether the background stays where it is in the picture."""
    medians_px = []
    for pair in matches.pairs:
        before_px, after_px = matches.ends_px(pair)
        medians_px.append(np.median(np.linalg.norm(after_px - before_px, axis=1)))
    return bool(np.percentile(medians_px, 90) < STILL_PX)


def _keyframes(frames: Frames, work_dir: Path, config: SelfCalibrationConfig) -> Frames:
    """A few reduced frames between which the background moves; of long clips the middle, all of
    which are looked at where that moves too little."""
    n, most = len(frames.images), config.most_keyframes
    if n > ENOUGH_FRAMES:
        first = (n - ENOUGH_FRAMES) // 2
        middle = frames.some(np.arange(first, first + ENOUGH_FRAMES))
        with suppress(NoReconstruction):
            keys = _keyframes(middle, work_dir / "middle", config)
            if len(keys.images) == most:
                return keys
    rows = choose_keyframes(frames, config.sfm).rows
    rows = rows[:: 2 if len(rows) > 1.5 * most else 1]
    first = max(0, (len(rows) - most) // 2)
    keys = frames.some(rows[first : first + most])
    return reduced(keys, config.max_image_size_px, work_dir / "reduced")


def _tried(
    motion: CameraMotion, config: SelfCalibrationConfig, fit_from: Callable[[float], _Fit | None]
) -> tuple[list[StartTried], list[_Fit]]:
    """Starts until they settle on one focal length, and what they found, the best first."""
    tried: list[StartTried] = []
    fits: list[_Fit] = []
    for start in config.starts:
        fit = fit_from(start)
        if fit is None:
            tried.append(StartTried(motion, start, None, None, None))
        else:
            tried.append(StartTried(motion, start, fit.focal, fit.k1, fit.cost))
            fits.append(fit)
        if _is_settled(fits):
            break
        if len(tried) >= HOPELESS and all(fit.cost > MOST_COST[motion] for fit in fits):
            break
    return tried, _ranked(fits)


def _ranked(fits: Sequence[_Fit]) -> list[_Fit]:
    """The best first; of those that fit alike, the one with least distortion.

    A wrong focal length is made up for by a distortion that isn't there: along a short way one of
    0.67 with -0.05 fits as well as the right one of 1.01 with -0.01.
    """
    least = min((fit.cost for fit in fits), default=0.0)
    alike = (1 + SAME_COST) * least
    return sorted(fits, key=lambda f: (f.cost > alike, abs(f.k1) if f.cost <= alike else f.cost))


def _is_settled(fits: Sequence[_Fit]) -> bool:
    """Whether the best is found twice, and nothing else among three or more comes near to it."""
    if len(fits) < ENOUGH:
        return False
    best = min(fits, key=lambda fit: fit.cost)
    same = [fit for fit in fits if _spread([best, fit]) < ONE_FOCAL]
    others = [fit for fit in fits if _spread([best, fit]) >= ONE_FOCAL]
    return len(same) > 1 and all(fit.cost > CLEARLY_WORSE * best.cost for fit in others)


def _spread(fits: Sequence[_Fit]) -> float:
    """Largest difference of focal lengths from the first's, as a share."""
    return float(max(abs(np.log(fit.focal / fits[0].focal)) for fit in fits))


def _answer(
    motion: CameraMotion,
    tried: Sequence[StartTried],
    fits: Sequence[_Fit],
    errors: Callable[[bool], tuple[float, float, float, float] | None],
    config: SelfCalibrationConfig,
) -> SelfCalibration:
    """The best fit with its standard errors, with distortion where the frames ask for it.

    `errors` gives log of the focal length over the longer side, its standard error, k1 and its
    standard error, with k1 free or not; None where the frames leave them open.
    """
    ends = sum(_spread([fits[0], fit]) < ONE_FOCAL for fit in fits)
    if ends < min(FROM_STARTS, len(config.starts)):
        return nothing_found("from each start another focal length is found", tried)
    both, alone = errors(True), errors(False)
    if both is None or alone is None:
        return nothing_found("the frames leave the focal length open", tried)
    log_focal, sigma, k1, k1_sigma = both
    if abs(k1) < LENS_SIGMAS * k1_sigma:
        # Distortion that is not seen may be there all the same, and the other stands in for it.
        apart = alone[0] - log_focal
        log_focal, sigma, k1 = alone[0], float(np.hypot(alone[1], apart)), 0.0
    most = (1 + SAME_COST) * fits[0].cost
    alike = [f for f in fits if f.cost < most and abs(f.k1 - fits[0].k1) < SAME_K1]
    sigma = float(np.hypot(sigma, _spread([fits[0], *alike])))
    reason = ""
    if sigma > config.max_sigma:
        reason = f"the frames hold the focal length only to {100 * sigma:.0f} %"
    focal = float(np.exp(log_focal))
    return SelfCalibration(motion, focal, sigma, k1, k1_sigma, tuple(tried), reason)


def by_turning(
    keys: Frames, matches: Matches, config: SelfCalibrationConfig
) -> tuple[SelfCalibration, str]:
    """The lens of a camera that only turns, and what `weigh` says of that."""
    longer_px = max(keys.size_px)

    def fit_from(start: float) -> _Fit | None:
        given_px = Lens.centred(start * longer_px, keys.size_px).matrix_px
        fit = _turned(matches, given_px, config, radial=True)
        if fit is None:
            return None
        focal = start * float(np.exp(fit.log_factor))
        return _Fit(focal, fit.radial_k1, fit.cost, len(keys.images), fit)

    tried, fits = _tried("rotation_only", config, fit_from)
    if not fits or fits[0].cost > MOST_COST["rotation_only"]:
        return nothing_found("no turn of the camera explains the matches", tried), "full"
    best = fits[0]
    given_px = Lens.centred(best.focal * longer_px, keys.size_px).matrix_px
    straight = matches.without(Distortion(best.k1, 0.0, 0.0), given_px)
    rng = np.random.default_rng(config.seed)
    turning = solve_rotation_only(straight, given_px, TURN_INLIER_PX, rng)
    evidence = weigh(turning, straight, config.sfm)

    warped = warp_error(turning, longer_px, best.focal * longer_px)

    def errors(radial: bool) -> tuple[float, float, float, float] | None:
        fit = _turned(matches, given_px, config, radial=radial)
        if fit is None:
            return None
        sigma, k1_sigma = NOT_INDEPENDENT * np.sqrt(np.diag(fit.covariance))
        focal_sigma = float(np.linalg.norm([sigma, SYSTEMATIC_FOCAL, warped]))
        log_focal = float(np.log(best.focal)) + fit.log_factor
        return log_focal, focal_sigma, fit.radial_k1, float(np.hypot(k1_sigma, SYSTEMATIC_K1))

    return _answer("rotation_only", tried, fits, errors, config), evidence.verdict


def _turned(
    matches: Matches, given_px: np.ndarray, config: SelfCalibrationConfig, *, radial: bool
) -> TurningFit | None:
    rng = np.random.default_rng(config.seed)
    turning = solve_rotation_only(matches, given_px, TURN_INLIER_PX, rng)
    return fit_turning(turning, matches, given_px, radial=radial)


def by_mapping(
    keys: Frames, matches: Matches, work_dir: Path, config: SelfCalibrationConfig, readout: float
) -> SelfCalibration:
    """The lens of a camera that also moves; COLMAP's `database.db` lies in `work_dir`."""
    longer_px, n_matched = max(keys.size_px), int(matched_points(matches).sum())

    def fit_from(start: float) -> _Fit | None:
        model = _mapped(start * longer_px, keys, work_dir, config)
        if model is None:
            return None
        (camera,) = model.cameras.values()
        cost = _cost(model, n_matched)
        focal = float(camera.params[0]) / longer_px
        return _Fit(focal, float(camera.params[3]), cost, model.num_reg_images(), model)

    tried, fits = _tried("full", config, fit_from)
    if not fits or fits[0].frames < FEWEST_FRAMES:
        return nothing_found("no model of the background could be built", tried)
    thin = _thinned(fits[0].model)
    rolled = [with_rolled_lines(thin, axis, readout) for axis in AXES]

    def errors(radial: bool) -> tuple[float, float, float, float] | None:
        return _lens_errors(thin, rolled, longer_px, radial=radial)

    return _answer("full", tried, fits, errors, config)


def _mapped(
    start_px: float, keys: Frames, work_dir: Path, config: SelfCalibrationConfig
) -> Any | None:
    """The largest model that a mapper makes from a focal length, with its lens adjusted."""
    database_path = work_dir / "start.db"
    shutil.copyfile(work_dir / DATABASE_FILE, database_path)
    with closing(pycolmap.Database.open(database_path)) as database:
        for camera in database.read_all_cameras():
            camera.params = [start_px, *camera.params[1:3], 0.0]
            camera.has_prior_focal_length = True
            database.update_camera(camera)
    found: list[Any] = []
    for run in (_global, _incremental):  # the second takes longer, and hardly finds more
        out_dir = work_dir / "start"
        shutil.rmtree(out_dir, ignore_errors=True)
        out_dir.mkdir()
        found += run(database_path, keys.images[0].parent, out_dir, config)
        if any(model.num_reg_images() >= ENOUGH_SHARE * len(keys.images) for model in found):
            break
    if not found:
        return None
    model = max(found, key=lambda each: (each.num_reg_images(), each.num_points3D()))
    for _ in range(2):
        bundle_adjuster(model, free="both", max_iterations=100, tolerance=1e-7).solve()
        model.update_point_3d_errors()
        pycolmap.ObservationManager(model).filter_all_points3D(MOST_ERROR_PX, MIN_PARALLAX_DEG)
    (camera,) = model.cameras.values()
    sound = camera.params[0] > 0 and np.isfinite(camera.params).all() and model.num_points3D() > 0
    return model if sound and abs(camera.params[3]) < MAX_RADIAL else None


def _global(
    database_path: Path, images_dir: Path, out_dir: Path, config: SelfCalibrationConfig
) -> list[Any]:
    options = global_options(config.sfm, free_lens=True)
    options.mapper.track_required_tracks_per_view = TRACKS_PER_FRAME
    return list(pycolmap.global_mapping(database_path, images_dir, out_dir, options).values())


def _incremental(
    database_path: Path, images_dir: Path, out_dir: Path, config: SelfCalibrationConfig
) -> list[Any]:
    options = incremental_options(config.sfm, free_lens=True)
    options.min_model_size = FEWEST_FRAMES
    options.mapper.init_min_tri_angle = FIRST_PAIR_DEG
    return list(pycolmap.incremental_mapping(database_path, images_dir, out_dir, options).values())


def _cost(model: Any, n_matched: int) -> float:
    """Mean loss of all matched image points, of which a model explains only some."""
    (camera,) = model.cameras.values()
    focal_px, cx, cy, k1 = camera.params
    total, count = 0.0, 0
    for image in map(model.image, sorted(model.reg_image_ids())):
        _, seen_px, points = seen_by(model, image)
        points_cam = transforms.apply(matrix_of(image.cam_from_world()), points)
        flat = bent(points_cam[:, :2] / points_cam[:, 2:], k1)
        apart_px = focal_px * flat + [cx, cy] - seen_px
        total += float(_loss((apart_px**2).sum(axis=1)).sum())
        count += len(points)
    missed = max(0, n_matched - count)
    return (total + missed * float(_loss(np.array(np.inf)))) / max(1, n_matched)


def _loss(error2_px: np.ndarray) -> np.ndarray:
    return np.log1p(np.minimum(error2_px, MOST_ERROR_PX**2))


def _thinned(model: Any) -> Any:
    """A copy with fewer points, those that most frames see."""
    thin = pycolmap.Reconstruction(model)
    ids = sorted(thin.point3D_ids(), key=lambda i: (-thin.point3D(i).track.length(), i))
    for point in ids[MOST_POINTS:]:
        thin.delete_point3D(point)
    return thin


def _lens_errors(
    thin: Any, rolled: Sequence[Any], longer_px: int, *, radial: bool
) -> tuple[float, float, float, float] | None:
    """Log of the focal length over the longer side, its standard error, k1 and its own; `rolled`
    are the same models as rolling shutters would have them."""
    whole = _adjusted(thin, sorted(thin.reg_image_ids()), radial)
    if whole is None:
        return None
    lens, covariance = whole
    spread = np.hypot(_spread_of_parts(thin, lens, radial), _moved_by_lines(rolled, lens, radial))
    sigma, k1_sigma = np.sqrt(FREED_NOT_INDEPENDENT**2 * np.diag(covariance) + spread**2)
    return (
        float(lens[0] - np.log(longer_px)),
        float(np.hypot(sigma, SYSTEMATIC_FOCAL)),
        float(lens[1]),
        float(np.hypot(k1_sigma, SYSTEMATIC_K1)),
    )


def _spread_of_parts(thin: Any, lens: np.ndarray, radial: bool) -> np.ndarray:
    """(2,) standard errors by leaving out a stretch of frames after the other (the jackknife)."""
    images = sorted(thin.reg_image_ids())
    if len(images) < 2 * PARTS:
        return np.zeros(2)
    found = []
    for left_out in np.array_split(np.array(images), PARTS):
        rest = [image for image in images if image not in left_out]
        part = _adjusted(thin, rest, radial)
        if part is not None:
            found.append(part[0])
    if len(found) < 2:
        return np.zeros(2)
    apart = np.array(found) - lens
    return np.sqrt((len(found) - 1) / len(found) * (apart**2).sum(axis=0))


def _moved_by_lines(rolled: Sequence[Any], lens: np.ndarray, radial: bool) -> np.ndarray:
    """(2,) how far a usual rolling shutter moves the lens, along the axis that it moves it more."""
    adjusted = [_adjusted(one, sorted(one.reg_image_ids()), radial) for one in rolled]
    apart = [np.abs(one[0] - lens) for one in adjusted if one is not None]
    return np.max([np.zeros(2), *apart], axis=0)


def _adjusted(thin: Any, images: list[int], radial: bool) -> tuple[np.ndarray, np.ndarray] | None:
    """Log of the focal length and k1 (2,) of some of a model's frames, and their covariance."""
    model = pycolmap.Reconstruction(thin)
    (camera,) = model.cameras.values()
    if not radial:
        camera.params = [*camera.params[:3], 0.0]
    for point in sorted(model.point3D_ids()):
        track = model.point3D(point).track.elements
        here = sum(element.image_id in images for element in track)
        if here < min(3, len(track)):
            model.delete_point3D(point)
    free: FreeIntrinsic = "both" if radial else "focal"
    adjusted = adjust_lens(model, images, free)
    if adjusted is None or not np.isfinite(adjusted.covariance).all():
        return None
    n_free, covariance = len(adjusted.covariance), np.zeros((2, 2))
    covariance[:n_free, :n_free] = adjusted.covariance
    per_px = np.array([1.0 / camera.params[0], 1.0])
    lens = np.array([np.log(camera.params[0]), camera.params[3]])
    return lens, covariance * np.outer(per_px, per_px)
