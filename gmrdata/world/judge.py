"""Whether a pseudo ground truth can be used: the whole sequence, and each of its frames.

Every check compares one figure with one threshold of the recipe, and what fails says both.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.cameras.files import CamerasQuality
from gmrdata.values import transforms
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.rows import first_reasons, text_runs
from gmrdata.world.recipe import VerdictConfig
from gmrdata.world.scale import ScaleEstimate
from gmrdata.world.verdict import Verdict, verdict_of

ANOTHER_PLACE = "no camera was found: the picture shows another place, beyond a cut"
NOTHING_SEEN = "no camera was found: the picture is black or even, or all of it is masked"


def judge(
    clip: Clip,
    quality: CamerasQuality,
    sfm_rows: np.ndarray,
    estimate: ScaleEstimate,
    config: VerdictConfig,
    *,
    unusable: Sequence[str] | None = None,
    doubts: Sequence[str] = (),
    dataset_camera: np.ndarray | None = None,
) -> Verdict:
    """Judge a pseudo ground truth, a clip of T frames in the world, by its own figures.

    Args:
        sfm_rows: (T,) row of the reconstruction for each frame; -1 for a frame without an image.
        unusable: T texts: why the data set itself doesn't vouch for a frame; empty where it does.
        doubts: Why the data set's sequence can't be used at all.
        dataset_camera: (T, 4, 4) metric world_from_cam of the data set; NaN where unknown.
    """
    own = [""] * len(clip.valid) if unusable is None else unusable
    reasons = frame_reasons(clip, quality, sfm_rows, config, own, dataset_camera)
    reasons = without_short_runs(reasons, round(config.min_run_s * clip.motion.fps_hz))
    kept_share = sum(not reason for reason in reasons) / max(1, list(own).count(""))
    jump_share = float(np.mean(jumps(clip, config))) if len(reasons) > 1 else 0.0
    failed = [
        *doubts,
        *_sequence_reasons(quality, jump_share, kept_share, config),
        *_focal_reasons(quality, config),
        *_scale_reasons(estimate, config),
    ]
    return verdict_of(clip.id, not failed, failed, reasons)


def _sequence_reasons(
    quality: CamerasQuality, jump_share: float, kept_share: float, config: VerdictConfig
) -> Iterator[str]:
    registered, fewest = quality.registered_share, config.min_registered_share
    cuts, featureless = len(quality.cuts_after_frames), len(quality.featureless)
    if registered < fewest:
        known = [f"{featureless} are black or even, or wholly masked"] if featureless else []
        known += [f"the picture changes to another place {cuts} times"] if cuts else []
        few = f"{registered:.0%} of the images have a camera, fewer than {fewest:.0%}"
        yield "; ".join([few, ", ".join(known)] if known else [few])
    error_px, most_px = quality.mean_reprojection_px, config.max_reprojection_px
    if error_px > most_px:
        yield f"the mean reprojection error is {error_px:.2f} px, more than {most_px:g} px"
    if cuts / max(1, quality.frames - 1) > config.max_cuts_share:
        yield (
            f"the picture changes to another place {cuts} times: images out of order, black, or "
            "of several takes"
        )
    if jump_share > config.max_cuts_share:
        at = f"at {jump_share:.0%} of the steps between images"
        yield f"the camera jumps {at}: images out of order, or missing"
    if kept_share < config.min_kept_share:
        can = f"{kept_share:.0%} of the data set's valid frames can be used"
        yield f"{can}, fewer than {config.min_kept_share:.0%}"


def _focal_reasons(quality: CamerasQuality, config: VerdictConfig) -> Iterator[str]:
    factor, sigma = quality.focal_factor, quality.focal_sigma
    # Both are null where the background holds no focal length: nothing was measured then.
    if factor is None or sigma is None:
        return
    if abs(factor - 1.0) - config.max_focal_deviation > config.focal_sigmas * sigma:
        yield (
            f"the background asks for a focal length {factor:.2f} times the given one "
            f"(standard error {sigma:.2f}, at most {config.max_focal_deviation:.0%} off is right)"
        )


def _scale_reasons(estimate: ScaleEstimate, config: VerdictConfig) -> Iterator[str]:
    # No scale: the camera stays in place.  Where it moves and no cue tells, nothing is judged.
    if estimate.scale is None or estimate.sigma is None:
        return
    share, most = estimate.sigma / estimate.scale, config.max_scale_sigma_share
    if estimate.matters and share > most:
        yield f"the metric scale is uncertain by {share:.1%}, more than {most:.1%}"
    apart, furthest = estimate.disagreement or 0.0, config.max_cue_disagreement
    if apart > furthest:
        yield f"two cues of the scale are {apart:.1f} standard errors apart, more than {furthest:g}"


def frame_reasons(
    clip: Clip,
    quality: CamerasQuality,
    sfm_rows: np.ndarray,
    config: VerdictConfig,
    unusable: Sequence[str],
    dataset_camera: np.ndarray | None,
) -> list[str]:
    """Why each of the T frames must not be used; empty where it may.  Arguments as in `judge`."""
    camera = camera_of(clip)
    n, has_camera = camera.n_frames, camera.has_camera
    # An interpolated camera has none of its own; it is marked, and held by its neighbours.
    enough = np.isin(sfm_rows, quality.interpolated)
    enough |= np.array(quality.inliers_per_frame)[sfm_rows] >= config.min_inliers
    tests = [
        (sfm_rows >= 0, "it has no image"),
        (~_behind_cut(quality, sfm_rows, has_camera), ANOTHER_PLACE),
        (has_camera | ~np.isin(sfm_rows, quality.featureless), NOTHING_SEEN),
        (has_camera, "no camera was found"),
        (clip.valid, "the body is not known"),
        (enough, f"fewer than {config.min_inliers} inliers"),
        (~_both_sides(jumps(clip, config), 1, n), "the camera jumps"),
    ]
    if dataset_camera is not None:
        step = max(1, round(config.window_s * clip.motion.fps_hz))
        apart_deg, apart_m = window_differences(camera.world_from_cam, dataset_camera, step)
        # A comparison with NaN is False: what is unknown doesn't disagree.
        off = (apart_deg > config.max_window_deg) | (apart_m > config.max_window_m)
        tests.append((~_both_sides(off, step, n), "the camera moves otherwise than the data set's"))
    return first_reasons(unusable, tests)


def jumps(clip: Clip, config: VerdictConfig) -> np.ndarray:
    """(T - 1,) bool: steps between frames that are too far for a camera that somebody holds."""
    steps = relative_moves(camera_of(clip).world_from_cam, 1)
    metres_per_s = np.linalg.norm(steps[:, :3, 3], axis=1) * clip.motion.fps_hz
    degrees_per_s = angles_deg(steps) * clip.motion.fps_hz
    # A comparison with NaN is False: an unknown step is no jump.
    return (metres_per_s > config.max_speed_m_per_s) | (degrees_per_s > config.max_turn_deg_per_s)


def _behind_cut(
    quality: CamerasQuality, sfm_rows: np.ndarray, has_camera: np.ndarray
) -> np.ndarray:
    """(T,) bool: frames of a stretch between two cuts in which no frame has a camera."""
    cuts = np.array(quality.cuts_after_frames, dtype=int)
    stretch = np.searchsorted(cuts, sfm_rows)
    placed = np.unique(stretch[has_camera])
    return ~np.isin(stretch, placed) & (len(cuts) > 0)


def _both_sides(steps: np.ndarray, step: int, n: int) -> np.ndarray:
    """(n,) bool: frames at either end of a marked step."""
    first, last = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    first[: n - step], last[step:] = steps, steps
    return first | last


def without_short_runs(reasons: list[str], min_run: int) -> list[str]:
    """The reasons, with one more for runs of fewer usable frames than `min_run`."""
    n = len(reasons)
    for start, stop, reason in text_runs(reasons):
        if not reason and stop - start < min(min_run, n):
            short = f"only {stop - start} usable frames in a row"
            reasons = [*reasons[:start], *[short] * (stop - start), *reasons[stop:]]
    return reasons


def relative_moves(world_from_cam: np.ndarray, step: int) -> np.ndarray:
    """(T - step, 4, 4) motion over `step` frames, in the axes of the first camera of each."""
    return np.asarray(transforms.invert(world_from_cam[:-step]) @ world_from_cam[step:])


def angles_deg(moves: np.ndarray) -> np.ndarray:
    """(N,) rotation angles of transforms (N, 4, 4) [degrees]; NaN where unknown."""
    known = np.isfinite(moves).all(axis=(1, 2))
    angles = np.full(len(moves), np.nan)
    if known.any():
        angles[known] = Rotation.from_matrix(moves[known, :3, :3]).magnitude()
    return np.rad2deg(angles)


def window_differences(
    world_from_cam: np.ndarray, dataset_camera: np.ndarray, step: int
) -> tuple[np.ndarray, np.ndarray]:
    """How differently two cameras (T, 4, 4) turn and move over `step` frames, (T - step,) [deg, m].

    NaN where one is unknown.
    """
    ours, theirs = relative_moves(world_from_cam, step), relative_moves(dataset_camera, step)
    apart_m = np.linalg.norm(ours[:, :3, 3] - theirs[:, :3, 3], axis=1)
    return angles_deg(transforms.invert(ours) @ theirs), apart_m
