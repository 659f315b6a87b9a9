"""Whether a pseudo ground truth can be used: the whole sequence, and each of its frames.

Every check compares one figure with one threshold of the recipe, and what fails says both.  The
figures come from records without defaults: one that is missing is an error before anything is
judged.
"""

from collections.abc import Sequence

import numpy as np

from gmrdata.cameras.files import CamerasQuality
from gmrdata.values.clip import Clip
from gmrdata.world.frame_checks import frame_reasons, jumps, without_short_runs
from gmrdata.world.recipe import VerdictConfig
from gmrdata.world.scale import ScaleEstimate
from gmrdata.world.verdict import Verdict, dropped_ranges


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
    """Judge a pseudo ground truth by its own figures.

    Args:
        clip: The pseudo ground truth: T frames, world frame, with its cameras.
        quality: The reconstruction's figures.
        sfm_rows: (T,) row of the reconstruction for each frame; -1 for a frame without an image.
        estimate: The metric scale.
        config: The thresholds.
        unusable: T texts: why the data set itself doesn't vouch for a frame; empty where it does.
        doubts: Why the data set's sequence can't be used at all.
        dataset_camera: (T, 4, 4) metric world_from_cam of the data set; NaN where unknown.
    """
    reasons = frame_reasons(
        clip, quality, sfm_rows, config, unusable=unusable, dataset_camera=dataset_camera
    )
    reasons = without_short_runs(reasons, round(config.min_run_s * clip.motion.fps_hz))
    vouched = sum(not reason for reason in unusable) if unusable is not None else len(reasons)
    kept_share = sum(not reason for reason in reasons) / max(1, vouched)
    jump_share = float(np.mean(jumps(clip, config))) if len(reasons) > 1 else 0.0
    failed = [
        *doubts,
        *_sequence_reasons(quality, jump_share, kept_share, config),
        *_focal_reasons(quality, config),
        *_scale_reasons(estimate, config),
    ]
    return Verdict(not failed, tuple(failed), tuple(dropped_ranges(reasons)), len(reasons))


def _sequence_reasons(
    quality: CamerasQuality, jump_share: float, kept_share: float, config: VerdictConfig
) -> list[str]:
    registered, error_px = quality.registered_share, quality.mean_reprojection_px
    cuts = len(quality.cuts_after_frames)
    cuts_share = cuts / max(1, quality.frames - 1)
    checks = [
        (
            registered < config.min_registered_share,
            f"{registered:.0%} of the images have a camera, fewer than "
            f"{config.min_registered_share:.0%}{_without_camera(quality)}",
        ),
        (
            error_px > config.max_reprojection_px,
            f"the mean reprojection error is {error_px:.2f} px, more than "
            f"{config.max_reprojection_px:g} px",
        ),
        (
            cuts_share > config.max_cuts_share,
            f"the picture changes to another place {cuts} times: images out of order, black, or "
            "of several takes",
        ),
        (
            jump_share > config.max_cuts_share,
            f"the camera jumps at {jump_share:.0%} of the steps between images: images out of "
            "order, or missing",
        ),
        (
            kept_share < config.min_kept_share,
            f"{kept_share:.0%} of the data set's valid frames can be used, fewer than "
            f"{config.min_kept_share:.0%}",
        ),
    ]
    return [reason for fails, reason in checks if fails]


def _focal_reasons(quality: CamerasQuality, config: VerdictConfig) -> list[str]:
    factor, sigma = quality.focal_factor, quality.focal_sigma
    # Both are null where the background holds no focal length: then nothing was measured against
    # the given one, and the reprojection error alone speaks of it.  One null is no record.
    if factor is None or sigma is None:
        return []
    if abs(factor - 1.0) - config.max_focal_deviation <= config.focal_sigmas * sigma:
        return []
    return [
        f"the background asks for a focal length {factor:.2f} times the given one "
        f"(standard error {sigma:.2f}, at most {config.max_focal_deviation:.0%} off is right)"
    ]


def _scale_reasons(estimate: ScaleEstimate, config: VerdictConfig) -> list[str]:
    # No scale: it does not enter, since the camera stays in place.  Where it enters and no cue
    # tells it, there is no pseudo ground truth to be judged.
    if estimate.scale is None or estimate.sigma is None:
        return []
    share, apart = estimate.sigma / estimate.scale, estimate.disagreement
    reasons = []
    if estimate.matters and share > config.max_scale_sigma_share:
        reasons.append(
            f"the metric scale is uncertain by {share:.1%}, more than "
            f"{config.max_scale_sigma_share:.1%}"
        )
    if apart is not None and apart > config.max_cue_disagreement:
        reasons.append(
            f"two cues of the scale are {apart:.1f} standard errors apart, more than "
            f"{config.max_cue_disagreement:g}"
        )
    return reasons


def _without_camera(quality: CamerasQuality) -> str:
    """What is known of the images without a camera."""
    featureless, cuts = len(quality.featureless), len(quality.cuts_after_frames)
    known = [f"{featureless} are black or even, or wholly masked"] if featureless else []
    known += [f"the picture changes to another place {cuts} times"] if cuts else []
    return f"; {', '.join(known)}" if known else ""
