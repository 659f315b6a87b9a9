"""Whether cameras can be used, as far as they tell by themselves: all of them, and each of them.

Nothing here needs a body or metres.  Every check compares one figure with one threshold of the
recipe, and what fails says both.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from gmrdata.cameras.files import Agreement, CamerasQuality, SfmCameras, WeakestStep
from gmrdata.cameras.recipe import CamerasVerdictConfig
from gmrdata.values import transforms
from gmrdata.values.records import compared

if TYPE_CHECKING:
    from gmrdata.cameras.lens.intrinsics import Intrinsics


ANOTHER_PLACE = "no camera was found: the picture shows another place, beyond a cut"
NOTHING_SEEN = "no camera was found: the picture is black or even, or all of it is masked"


def camera_reasons(quality: CamerasQuality, config: CamerasVerdictConfig) -> Iterator[str]:
    """Why the cameras of a sequence can't be used."""
    registered, fewest = quality.registered_share, config.min_registered_share
    cuts, featureless = len(quality.cuts_after_frames), len(quality.featureless)
    if registered < fewest:
        known = [f"{featureless} are black or even, or wholly masked"] if featureless else []
        known += [f"the picture changes to another place {cuts} times"] if cuts else []
        few = compared("{} of the images have a camera, fewer than {}", registered, fewest, ".0%")
        yield "; ".join([few, ", ".join(known)] if known else [few])
    if quality.geometry != "full" and quality.frames < config.min_frames_in_place:
        yield (
            f"{quality.frames} frames, fewer than {config.min_frames_in_place}, do not tell a "
            "camera that stays in its place from one that travels"
        )
    yield from _travel_reasons(quality, config)
    error_px, most_px = quality.mean_reprojection_px, config.max_reprojection_px
    if error_px > most_px:
        what = "the mean reprojection error is {} px, more than {} px"
        yield compared(what, error_px, most_px, ".2f")
    if cuts / max(1, quality.frames - 1) > config.max_cuts_share:
        yield (
            f"the picture changes to another place {cuts} times: images of several takes, out of "
            "order, or black"
        )
    yield from _step_reasons(quality, config)
    yield from _focal_reasons(quality, config)
    share, least = quality.second_share, config.min_second_share
    if share is not None and share < least:
        what = "of some keyframes, solved alone, {} get a camera, fewer than {}"
        yield f"{compared(what, share, least, '.0%')}: nothing confirms the path"
    if (again := quality.agreement) is not None:
        yield from agreement_reasons("a part of the keyframes, solved alone,", again, config)


def _travel_reasons(quality: CamerasQuality, config: CamerasVerdictConfig) -> Iterator[str]:
    """Why a camera that is said to stay in its place may not: what moves before a camera at rest
    leaves most matches of each pair in their place."""
    travel, off_px = quality.travel_set_aside, quality.evidence.rotation_only_wide_median_px
    if travel is None or travel <= config.max_travel_set_aside:
        return
    if off_px > config.max_turn_wide_median_px:
        far = "the camera travels by about {} of the background's distance, more than {}"
        wide = "a turn leaves {} px in the worst pairs, more than {}"
        yield (
            f"{compared(far, travel, config.max_travel_set_aside, '.1%')}, and no path of it "
            f"holds: {compared(wide, off_px, config.max_turn_wide_median_px, '.1f')}"
        )


def agreement_reasons(what: str, again: Agreement, config: CamerasVerdictConfig) -> Iterator[str]:
    """Why cameras can't be used of which a second solution, named by `what`, says otherwise."""
    what = f"{what} gives another path: the camera "
    if (deg := again.turn_deg) > (most := config.max_again_deg):
        yield what + compared("turns {} degrees otherwise, more than {}", deg, most, ".1f")
    if (share := again.place_share) > (most := config.max_again_share):
        yield what + compared("is {} of its way off, more than {}", share, most, ".1%")


def _step_reasons(quality: CamerasQuality, config: CamerasVerdictConfig) -> Iterator[str]:
    if (step := quality.weakest_step) is None:
        return
    failed = list(_hold_reasons(step, config))
    yield from failed
    if failed and step.moving_share >= config.moving_background:
        yield (
            f"the background itself moves, up to {step.moving_share:.0%} of what two frames share: "
            "water, a crowd or leaves, which masks may keep out"
        )


def _hold_reasons(step: WeakestStep, config: CamerasVerdictConfig) -> Iterator[str]:
    hold = f"the cameras up to row {step.after} and those from row {step.before} on hardly hold "
    together, most = step.loose_moving_share, config.max_loose_moving_share
    if (ratio := step.distance_ratio) > config.max_distance_ratio:
        apart = (
            "what one keyframe sees is {} times as far away as what the next one sees, more than "
            "{}: pieces of different scale"
        )
        yield compared(apart, ratio, config.max_distance_ratio, ".0f")
    if step.loose_share > config.max_loose_share:
        loose = "each other: {} of their way is open, more than {}; the two may differ in scale"
        yield hold + compared(loose, step.loose_share, config.max_loose_share, ".2%")
    elif together > most:
        moves = "which together is {}, more than {}; they may follow what moves"
        yield (
            f"{hold}each other: {step.loose_share:.2%} of their way is open, and up to "
            f"{step.moving_share:.0%} of what two frames share moves otherwise than they say, "
        ) + compared(moves, together, most, ".3%")


def _focal_reasons(quality: CamerasQuality, config: CamerasVerdictConfig) -> Iterator[str]:
    factor, sigma = quality.focal_factor, quality.focal_sigma
    # Both are null where the background holds no focal length: nothing was measured then.
    if factor is None or sigma is None:
        return
    if abs(factor - 1.0) - config.max_focal_deviation > config.focal_sigmas * sigma:
        yield (
            f"the background asks for a focal length {factor:.2f} times the one in use "
            f"(standard error {sigma:.2f}; {config.max_focal_deviation:.0%} and "
            f"{config.focal_sigmas:g} of these may be off)"
        )


def lens_reasons(
    cameras: SfmCameras, lens: "Intrinsics", config: CamerasVerdictConfig
) -> Iterator[str]:
    """Why cameras can't be used for want of a known lens."""
    yield from lens.objections
    # Points at known places hold the turns of a camera that travels, unless its lens is a guess.
    if cameras.geometry == "full" and not lens.is_guess:
        return
    spread_deg = turn_spread_deg(cameras.path.world_from_cam)
    off_deg, most_deg = lens.focal_sigma * spread_deg, config.max_focal_turn_deg
    if off_deg > most_deg:
        what = (
            f"the focal length is known to ±{lens.focal_sigma:.0%} only, so the camera's turns, "
            f"{spread_deg:.1f} degrees about their mean, are to ±{{}} degrees, more than {{}}; "
            "give it (--focal, --fov, --intrinsics)"
        )
        yield compared(what, off_deg, most_deg, ".1f")


def lens_notes(cameras: SfmCameras, lens: "Intrinsics") -> list[str]:
    """What the lens leaves uncertain where nobody knows it and the frames don't tell."""
    if not lens.is_guess:
        return []
    off_deg = lens.focal_sigma * turn_spread_deg(cameras.path.world_from_cam)
    return [
        f"the focal length, {lens.focal_px:.0f} px, is a guess to ±{lens.focal_sigma:.0%}: the "
        f"camera's turns are to ±{off_deg:.1f} degrees, distances from the camera and the metric "
        f"scale to ±{lens.focal_sigma:.0%}"
    ]


def turn_spread_deg(world_from_cam: np.ndarray) -> float:
    """Root mean square of the angles of cameras (T, 4, 4) to their mean orientation; 0 for none."""
    known = world_from_cam[np.isfinite(world_from_cam[:, 0, 0])]
    if not len(known):
        return 0.0
    off_rad = transforms.turns_about_mean_rad(known[:, :3, :3])
    return float(np.rad2deg(np.sqrt((off_rad**2).mean())))


def frame_tests(
    quality: CamerasQuality,
    sfm_rows: np.ndarray,
    has_camera: np.ndarray,
    config: CamerasVerdictConfig,
) -> list[tuple[np.ndarray, str]]:
    """What each of T frames must pass, (T,) bool, and the reason where it doesn't; in order.
    `sfm_rows` (T,) are rows of the reconstruction, -1 for a frame without an image."""
    # An interpolated camera has none of its own; it is marked, and held by its neighbours.
    enough = np.isin(sfm_rows, quality.interpolated)
    enough |= np.array(quality.inliers_per_frame)[sfm_rows] >= config.min_inliers
    return [
        (sfm_rows >= 0, "it has no image"),
        (~_behind_cut(quality, sfm_rows, has_camera), ANOTHER_PLACE),
        (has_camera | ~np.isin(sfm_rows, quality.featureless), NOTHING_SEEN),
        (has_camera, "no camera was found"),
        (enough, f"fewer than {config.min_inliers} inliers"),
    ]


def _behind_cut(
    quality: CamerasQuality, sfm_rows: np.ndarray, has_camera: np.ndarray
) -> np.ndarray:
    """(T,) bool: frames of a stretch between two cuts in which no frame has a camera."""
    cuts = np.array(quality.cuts_after_frames, dtype=int)
    stretch = np.searchsorted(cuts, sfm_rows)
    placed = np.unique(stretch[has_camera])
    return ~np.isin(stretch, placed) & (len(cuts) > 0)


def jump_cause(
    world_from_cam: np.ndarray, quality: CamerasQuality, config: CamerasVerdictConfig
) -> str:
    """Why cameras (T, 4, 4) jump, as far as their path and its figures tell."""
    if is_out_of_order(world_from_cam, config.out_of_order_rows):
        return "images out of order"
    if any(_focal_reasons(quality, config)):
        return "the focal length is wrong, and the cameras with it"
    return "images are missing, or the cameras are wrong"


def is_out_of_order(world_from_cam: np.ndarray, most_rows: int) -> bool:
    """Whether the nearest to most of the cameras (T, 4, 4) are more rows from them than that."""
    from scipy.spatial import KDTree

    rows = np.flatnonzero(np.isfinite(world_from_cam[:, 0, 0]))
    if len(rows) < 4 * most_rows:
        return False
    centres, turns = world_from_cam[rows, :3, 3], world_from_cam[rows, :3, :3].reshape(-1, 9)
    extent = np.linalg.norm(np.ptp(centres, axis=0))
    # Where it only turns, the places say nothing.
    places = (centres - centres.mean(axis=0)) / extent if extent > 0 else np.zeros((len(rows), 3))
    _, nearest = KDTree(np.c_[places, turns]).query(np.c_[places, turns], k=2)
    return bool(np.median(np.abs(rows[nearest[:, 1]] - rows)) > most_rows)


def turns_too_fast(
    world_from_cam: np.ndarray, fps_hz: float, config: CamerasVerdictConfig
) -> np.ndarray:
    """(T - 1,) bool: steps between frames over which no camera turns that somebody holds."""
    # A comparison with NaN is False: an unknown step is no jump.
    turn_deg = np.rad2deg(transforms.angles_rad(relative_moves(world_from_cam, 1)[:, :3, :3]))
    return np.asarray(turn_deg * fps_hz > config.max_turn_deg_per_s)


def both_sides(steps: np.ndarray, step: int, n: int) -> np.ndarray:
    """(n,) bool: frames at either end of a marked step."""
    first, last = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    first[: max(0, n - step)], last[step:] = steps, steps
    return first | last


def relative_moves(world_from_cam: np.ndarray, step: int) -> np.ndarray:
    """(T - step, 4, 4) motion over `step` frames, in the axes of the first camera of each."""
    return np.asarray(transforms.invert(world_from_cam[:-step]) @ world_from_cam[step:])
