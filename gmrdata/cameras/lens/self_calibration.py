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
FROM_STARTS = 2  # starts that end at the focal length that is taken, or the others are held to it
HOPELESS = 2  # starts after which none is tried if nothing came of any
MOST_COST: dict[CameraMotion, float] = {"full": np.inf, "rotation_only": 2.0}
"""Above which it is not so: half of the matches are 2.5 px off then, at 4 to 5 for who walks."""
STILL_PX = 1.0  # median motion of the background in the worst tenth of the pairs, of a still camera
LENS_SIGMAS = 2.5  # by how many standard errors k1 must differ from 0 to be taken out
SAME_COST = 0.01  # as a share, of models that fit alike
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


def _least_cost(tried: SelfCalibration) -> float:
    return min((start.cost for start in tried.starts if start.cost is not None), default=np.inf)


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


class _LensFit(NamedTuple):
    """A lens with its standard errors."""

    log_focal: float  # of the focal length over the longer side
    sigma: float  # its standard error
    k1: float
    k1_sigma: float


def _answer(
    motion: CameraMotion,
    tried: Sequence[StartTried],
    fits: Sequence[_Fit],
    lens_of: Callable[[_Fit], _LensFit | None],
    config: SelfCalibrationConfig,
) -> SelfCalibration:
    """The best fit's lens.  Where others end elsewhere and hardly fit worse, its error has the
    difference of their lenses; that of all others, where only one start leads to it.

    `lens_of` gives a fit's lens with its standard errors; None where the frames leave it open.
    """
    alike = sum(_spread([fits[0], fit]) < ONE_FOCAL for fit in fits)
    is_alone = alike < min(FROM_STARTS, len(config.starts))
    if is_alone and len(fits) < ENOUGH:
        return nothing_found("from each start another focal length is found", tried)
    if (best := lens_of(fits[0])) is None:
        return nothing_found("the frames leave the focal length open", tried)
    ends = [fits[0]]  # of those that end alike the best stands for all: a lens takes seconds
    for fit in fits:
        is_near = is_alone or fit.cost < CLEARLY_WORSE * fits[0].cost
        if is_near and all(_spread([end, fit]) >= ONE_FOCAL for end in ends):
            ends.append(fit)
    others = [other for other in map(lens_of, ends[1:]) if other is not None]
    apart = [abs(other.log_focal - best.log_focal) for other in others]
    sigma = float(np.hypot(best.sigma, max(apart, default=0.0)))
    reason = ""
    if sigma > config.max_sigma:
        reason = f"the frames hold the focal length only to {100 * sigma:.0f} %"
    focal = float(np.exp(best.log_focal))
    return SelfCalibration(motion, focal, sigma, best.k1, best.k1_sigma, tuple(tried), reason)


def _seen(bent_lens: _LensFit, straight: _LensFit) -> _LensFit:
    """The lens with distortion if it is seen, else the one without; distortion that is not seen may
    be there all the same, and the focal length stands in for it."""
    if abs(bent_lens.k1) >= LENS_SIGMAS * bent_lens.k1_sigma:
        return bent_lens
    apart = straight.log_focal - bent_lens.log_focal
    sigma = float(np.hypot(straight.sigma, apart))
    return _LensFit(straight.log_focal, sigma, 0.0, bent_lens.k1_sigma)


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

    def lens_of(start: _Fit, radial: bool) -> _LensFit | None:
        from_px = Lens.centred(start.focal * longer_px, keys.size_px).matrix_px
        fit = _turned(matches, from_px, config, radial=radial)
        if fit is None:
            return None
        sigma, k1_sigma = NOT_INDEPENDENT * np.sqrt(np.diag(fit.covariance))
        focal_sigma = float(np.linalg.norm([sigma, SYSTEMATIC_FOCAL, warped]))
        log_focal = float(np.log(start.focal)) + fit.log_factor
        k1_sigma = float(np.hypot(k1_sigma, SYSTEMATIC_K1))
        return _LensFit(log_focal, focal_sigma, fit.radial_k1, k1_sigma)

    def seen(start: _Fit) -> _LensFit | None:
        both, alone = lens_of(start, radial=True), lens_of(start, radial=False)
        return None if both is None or alone is None else _seen(both, alone)

    return _answer("rotation_only", tried, fits, seen, config), evidence.verdict


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

    def lens_of(fit: _Fit) -> _LensFit | None:
        thin = _thinned(fit.model)
        return _lens_of(thin, [with_rolled_lines(thin, axis, readout) for axis in AXES], longer_px)

    return _answer("full", tried, fits, lens_of, config)


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
    models: list[Any] = []
    for run in (_global, _incremental):  # the second takes longer, and hardly finds more
        out_dir = work_dir / "start"
        shutil.rmtree(out_dir, ignore_errors=True)
        out_dir.mkdir()
        models += run(database_path, keys.images[0].parent, out_dir, config)
        if any(model.num_reg_images() >= ENOUGH_SHARE * len(keys.images) for model in models):
            break
    if not models:
        return None
    model = max(models, key=lambda each: (each.num_reg_images(), each.num_points3D()))
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


def _lens_of(thin: Any, rolled: Sequence[Any], longer_px: int) -> _LensFit | None:
    """The lens of a model; `rolled` are the same as rolling shutters would have them.

    Many lenses bend the picture outwards in the middle and inwards at its edge.  One term can't,
    and along a short way another focal length makes up for it: phones' came out at 0.84 to 0.95 of
    the right one.  So a second term is tried, and of both what is surer is taken.
    """
    straight, one, two = (_lens_errors(thin, rolled, longer_px, terms) for terms in (0, 1, 2))
    if straight is None or one is None:
        return None
    if two is not None:
        apart = abs(two.log_focal - one.log_focal)
        at_two = _adjusted(thin, 1, longer_px * np.exp(two.log_focal))
        one = one._replace(sigma=float(np.hypot(one.sigma, apart)))
        if two.sigma < one.sigma and at_two is not None:
            k1 = float(at_two.lens[1])
            k1_sigma = float(np.hypot(one.k1_sigma, k1 - one.k1))
            one = _LensFit(two.log_focal, two.sigma, k1, k1_sigma)
    return _seen(one, straight)


def _lens_errors(thin: Any, rolled: Sequence[Any], longer_px: int, terms: int) -> _LensFit | None:
    """The lens of a model with none, one or two terms of distortion."""
    whole = _adjusted(thin, terms)
    if whole is None:
        return None
    parts = [_adjusted(part, terms) for part in _parts(thin)]
    moved = [_adjusted(one, terms) for one in rolled]
    by_covariance = FREED_NOT_INDEPENDENT * np.sqrt(np.diag(whole.covariance))
    by_chance = np.maximum(by_covariance, _jackknifed(whole, parts))
    sigma, k1_sigma = np.hypot(by_chance, _moved(whole, moved))
    return _LensFit(
        float(whole.lens[0] - np.log(longer_px)),
        float(np.hypot(sigma, SYSTEMATIC_FOCAL)),
        float(whole.lens[1]),
        float(np.hypot(k1_sigma, SYSTEMATIC_K1)),
    )


def _parts(thin: Any) -> list[Any]:
    """A model without a stretch of its frames, one after the other; none of a short one.

    Frames that are left out keep a camera, but see nothing: what they saw would hold the lens.
    """
    images, parts = sorted(thin.reg_image_ids()), []
    for left_out in np.array_split(np.array(images), PARTS) if len(images) >= 2 * PARTS else ():
        part = pycolmap.Reconstruction(thin)
        for image in map(int, left_out):
            for feature, spot in enumerate(part.image(image).points2D):
                if spot.has_point3D():
                    part.delete_observation(image, feature)
        parts.append(part)
    return parts


class _AdjustedLens(NamedTuple):
    """A model's lens."""

    lens: np.ndarray  # (2,) log of the focal length [px], and k1
    covariance: np.ndarray  # (2, 2)


def _jackknifed(whole: _AdjustedLens, parts: Sequence[_AdjustedLens | None]) -> np.ndarray:
    """(2,) standard errors by what is found without a stretch of frames (the jackknife)."""
    apart = np.array([part.lens - whole.lens for part in parts if part is not None])
    n = len(apart)
    return np.sqrt((n - 1) / n * (apart**2).sum(axis=0)) if n > 1 else np.zeros(2)


def _moved(whole: _AdjustedLens, others: Sequence[_AdjustedLens | None]) -> np.ndarray:
    """(2,) how far the lens is moved at most."""
    apart = [np.abs(one.lens - whole.lens) for one in others if one is not None]
    return np.max([np.zeros(2), *apart], axis=0)


def _adjusted(thin: Any, terms: int, focal_px: float | None = None) -> _AdjustedLens | None:
    """A model's lens, adjusted with up to two terms of distortion; at a focal length if one is
    given."""
    model = pycolmap.Reconstruction(thin)
    (camera,) = model.cameras.values()
    own_px, cx, cy, k1 = camera.params
    if terms == 2:
        camera.model = pycolmap.CameraModelId.RADIAL
    bends = {0: [0.0], 1: [k1], 2: [k1, 0.0]}[terms]
    camera.params = [own_px if focal_px is None else focal_px, cx, cy, *bends]
    images = [i for i in sorted(model.reg_image_ids()) if model.image(i).num_points3D]
    is_free = np.array([focal_px is None, terms > 0])
    free: FreeIntrinsic = "radial" if not is_free[0] else "both" if is_free[1] else "focal"
    adjusted = adjust_lens(model, images, free)
    if adjusted is None or not np.isfinite(adjusted.covariance).all():
        return None
    n_free, covariance = int(is_free.sum()), np.zeros((2, 2))
    covariance[np.ix_(is_free, is_free)] = adjusted.covariance[:n_free, :n_free]
    per_px = np.array([1.0 / camera.params[0], 1.0])
    lens = np.array([np.log(camera.params[0]), camera.params[3]])
    return _AdjustedLens(lens, covariance * np.outer(per_px, per_px))
