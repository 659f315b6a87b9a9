"""The figures of a pseudo ground truth as plain JSON, for its `quality.json`."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from gmrdata.clip import Clip, camera_of
from gmrdata.geometry.motion_class import MotionClass, MotionFigures, classify
from gmrdata.pseudogt.config import PseudoGtConfig
from gmrdata.pseudogt.verdict import Verdict
from gmrdata.sfm.scale import ScaleEstimate


def quality_of(
    clips: Sequence[Clip],
    verdicts: Sequence[Verdict],
    estimate: ScaleEstimate,
    sfm_quality: dict[str, Any],
    config: PseudoGtConfig,
) -> dict[str, Any]:
    """The reconstruction's figures, those of the scale, the camera's class, and each verdict.

    Args:
        clips: Each person in the world, before frames were dropped.
        verdicts: What was decided of each.
        estimate: The metric scale.
        sfm_quality: The reconstruction's `quality.json`.
        config: The recipe.
    """
    camera_motion, figures = camera_class(clips, config)
    return sfm_quality | {
        "scale": _figure(estimate.scale),
        "scale_sigma": _figure(estimate.sigma),
        "scale_matters": estimate.matters,
        "scale_disagreement": _figure(estimate.disagreement),
        "scale_cues": [_rounded(asdict(cue)) for cue in estimate.cues],
        "camera_motion": camera_motion,
        "camera_motion_figures": _rounded(asdict(figures)),
        "people": [
            verdict.as_record(clip.id) for clip, verdict in zip(clips, verdicts, strict=True)
        ],
    }


def camera_class(
    clips: Sequence[Clip], config: PseudoGtConfig
) -> tuple[MotionClass, MotionFigures]:
    """Class of the one camera, round the person who is known in most frames."""
    clip = max(clips, key=lambda clip: clip.valid.sum())
    world_from_cam = camera_of(clip).world_from_cam[clip.valid]
    return classify(
        world_from_cam, clip.motion.pelvis_m[clip.valid], clip.motion.fps_hz, config.motion_class
    )


def _rounded(values: dict[str, Any]) -> dict[str, Any]:
    return {key: _figure(v) if isinstance(v, float) else v for key, v in values.items()}


def _figure(value: float | None) -> float | None:
    """Six digits; None for what isn't finite, which JSON has no word for."""
    return None if value is None or not np.isfinite(value) else float(f"{value:.6g}")
