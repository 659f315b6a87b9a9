"""Which geometry the matches speak for: a camera that only turns, or one that also moves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gmrdata.cameras.files import Evidence
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values.records import figure

if TYPE_CHECKING:
    from gmrdata.cameras.matches import Matches
    from gmrdata.cameras.rotation_only import RotationOnly
    from gmrdata.cameras.solution import Solution

PANORAMIC = ("PANORAMIC", "PLANAR_OR_PANORAMIC")
PARALLAX_GROWTH = 2.5
"""Residuals of the worst tenth of pairs over those of the best, above which parallax may show.
Measured: 1.2 for a still camera, 1.5-1.7 for pans, 3.4 for a hand-held one that moves by 3 cm."""
PARALLAX_PX = 0.5
"""Residuals of the worst tenth of pairs below which parallax does no harm [px]."""
CLEARLY_BETTER = 0.7
"""Six degrees of freedom must lower the median residual to this share to be worth them."""
VAGUE_FOCAL = 0.02
"""A model whose focal length is uncertain by more, as a share, is held by little parallax."""


def weigh(turning: RotationOnly, matches: Matches, config: SfmConfig) -> Evidence:
    """Judge a pure rotation by its residuals."""
    medians_px = turning.pair_medians_px
    median_px = figure(np.median(turning.residuals_px))
    wide_px = figure(np.percentile(medians_px, 90))
    near_px = figure(np.percentile(medians_px, 10))
    share = figure(np.mean(turning.residuals_px < config.rotation_only_inlier_px))
    fits = (
        median_px <= config.rotation_only_median_px
        and wide_px <= config.rotation_only_wide_median_px
        and share >= config.rotation_only_share
    )
    parallax = wide_px > max(PARALLAX_PX, PARALLAX_GROWTH * near_px)
    said = "a pure rotation explains" if fits else "a pure rotation does not explain"
    doubt = (
        f", but residuals grow with the baseline (from {near_px} px), which may be parallax"
        if fits and parallax
        else ""
    )
    return Evidence(
        verdict="full" if not fits else "either" if parallax else "rotation_only",
        reason=(
            f"{said} the matches: median residual {median_px} px "
            f"(threshold {config.rotation_only_median_px}), in the worst tenth of the pairs "
            f"{wide_px} px (threshold {config.rotation_only_wide_median_px}), "
            f"{100 * share:.0f} % of the matches within {config.rotation_only_inlier_px} px "
            f"(threshold {100 * config.rotation_only_share:.0f} %){doubt}"
        ),
        rotation_only_median_px=median_px,
        rotation_only_wide_median_px=wide_px,
        rotation_only_near_median_px=near_px,
        rotation_only_share=share,
        panoramic_pairs_share=figure(
            np.mean([pair.configuration in PANORAMIC for pair in matches.pairs])
        ),
        pairs=len(matches.pairs),
        features_per_frame=figure(np.median([len(points) for points in matches.keypoints_px])),
    )


def explains_better(mapped: Solution | None, turning: RotationOnly, config: SfmConfig) -> bool:
    """Whether six degrees of freedom are worth it where a pure rotation fits as well."""
    if mapped is None or mapped.has_camera.sum() < turning.has_camera.sum():
        return False
    agree = turning.residuals_px < config.rotation_only_inlier_px
    threshold_px = CLEARLY_BETTER * np.median(turning.residuals_px[agree])
    return bool(np.median(mapped.errors_px) < threshold_px)


def is_bent(mapped: Solution, turning: RotationOnly, config: SfmConfig) -> bool:
    """Whether a model of a camera that hardly travels is less to be trusted than a pure rotation.

    Over a way that is short beside the distance of the background, turning and travelling look
    alike, and a mapper may trade one for the other: on a hand-held pan of 39 degrees it found
    0.25 m of travel for 0.05 m, and rotations that were off by 7 %, at 0.35 px.  Such a model asks
    for another focal length than the true one, or can't tell which it needs.
    """
    if not mapped.has_camera.any() or not len(mapped.points):
        return False
    centres = mapped.world_from_cam[mapped.has_camera, :3, 3]
    distance = np.median(np.linalg.norm(mapped.points - centres.mean(axis=0), axis=1))
    extent = np.linalg.norm(centres[:, None] - centres[None], axis=-1).max()
    turns_px = np.median(turning.residuals_px)
    if extent >= config.small_travel_share * distance or turns_px > config.small_travel_median_px:
        return False
    if mapped.focal is None or mapped.focal.sigma is None:
        return True
    sigma = mapped.focal.sigma
    return sigma > VAGUE_FOCAL or abs(mapped.focal.factor - 1.0) > 3 * sigma
