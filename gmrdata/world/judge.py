"""Whether a pseudo ground truth can be used: the whole sequence, and each of its frames.

Every check compares one figure with one threshold of the recipe, and what fails says both.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gmrdata.values.clip import Clip
from gmrdata.world.frame_checks import frame_reasons, jumps, without_short_runs
from gmrdata.world.recipe import VerdictConfig
from gmrdata.world.scale import ScaleEstimate
from gmrdata.world.verdict import Verdict, dropped_ranges


def judge(
    clip: Clip,
    sfm_quality: dict[str, Any],
    sfm_rows: np.ndarray,
    estimate: ScaleEstimate,
    config: VerdictConfig,
    *,
    unusable: Sequence[str] | None = None,
    doubts: Sequence[str] = (),
    tracked: np.ndarray | None = None,
) -> Verdict:
    """Judge a pseudo ground truth by its own figures.

    Args:
        clip: The pseudo ground truth: T frames, world frame, with its cameras.
        sfm_quality: The reconstruction's `quality.json`.
        sfm_rows: (T,) row of the reconstruction for each frame; -1 for a frame without an image.
        estimate: The metric scale.
        config: The thresholds.
        unusable: T texts: why the data set itself doesn't vouch for a frame; empty where it does.
        doubts: Why the data set's sequence can't be used at all.
        tracked: (T, 4, 4) metric world_from_cam of the data set; NaN where unknown.
    """
    reasons = frame_reasons(clip, sfm_quality, sfm_rows, config, unusable=unusable, tracked=tracked)
    reasons = without_short_runs(reasons, round(config.min_run_s * clip.motion.fps_hz))
    vouched = sum(not reason for reason in unusable) if unusable is not None else len(reasons)
    kept_share = sum(not reason for reason in reasons) / max(1, vouched)
    jump_share = float(np.mean(jumps(clip, config))) if len(reasons) > 1 else 0.0
    failed = [
        *doubts,
        *_sequence_reasons(sfm_quality, jump_share, kept_share, config),
        *_scale_reasons(estimate, config),
    ]
    return Verdict(not failed, tuple(failed), tuple(dropped_ranges(reasons)), len(reasons))


def _sequence_reasons(
    sfm_quality: dict[str, Any],
    jump_share: float,
    kept_share: float,
    config: VerdictConfig,
) -> list[str]:
    registered = float(sfm_quality.get("registered_share", 1.0))
    error_px = float(sfm_quality.get("mean_reprojection_px", 0.0))
    cuts = len(sfm_quality.get("cuts_after_frames", []))
    cuts_share = cuts / max(1, int(sfm_quality.get("frames", 2)) - 1)
    checks = [
        (
            registered < config.min_registered_share,
            f"{registered:.0%} of the images have a camera, fewer than "
            f"{config.min_registered_share:.0%}{_without_camera(sfm_quality)}",
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
    factor, sigma = sfm_quality.get("focal_factor"), sfm_quality.get("focal_sigma")
    if factor is not None and sigma is not None:
        beyond = abs(factor - 1.0) - config.max_focal_deviation
        checks.append(
            (
                beyond > config.focal_sigmas * sigma,
                f"the background asks for a focal length {factor:.2f} times the given one "
                f"(standard error {sigma:.2f}, at most {config.max_focal_deviation:.0%} off "
                "is right)",
            )
        )
    return [reason for fails, reason in checks if fails]


def _scale_reasons(estimate: ScaleEstimate, config: VerdictConfig) -> list[str]:
    if estimate.scale is None or estimate.sigma is None:
        return []
    share = estimate.sigma / estimate.scale
    apart = estimate.disagreement or 0.0
    reasons = []
    if estimate.matters and share > config.max_scale_sigma_share:
        reasons.append(
            f"the metric scale is uncertain by {share:.1%}, more than "
            f"{config.max_scale_sigma_share:.1%}"
        )
    if apart > config.max_cue_disagreement:
        reasons.append(
            f"two cues of the scale are {apart:.1f} standard errors apart, more than "
            f"{config.max_cue_disagreement:g}"
        )
    return reasons


def _without_camera(sfm_quality: dict[str, Any]) -> str:
    """What is known of the images without a camera."""
    featureless = len(sfm_quality.get("featureless", []))
    cuts = len(sfm_quality.get("cuts_after_frames", []))
    known = [f"{featureless} are black or even, or wholly masked"] if featureless else []
    known += [f"the picture changes to another place {cuts} times"] if cuts else []
    return f"; {', '.join(known)}" if known else ""
