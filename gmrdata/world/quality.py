"""What a manifest says of a pseudo ground truth: its quality record, and why rows are dropped.

The figures of a pseudo ground truth as plain JSON, for its `quality.json`.
"""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.cameras.files import QUALITY_FILE
from gmrdata.manifest.current import Quality
from gmrdata.values.camera_motion import MotionClass, MotionFigures, classify
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.files import read_json
from gmrdata.values.rows import texts_of
from gmrdata.world.recipe import PseudoGtConfig
from gmrdata.world.scale import ScaleEstimate
from gmrdata.world.verdict import Verdict


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


def load_record(pseudo_gt_dir: Path) -> dict[str, Any]:
    """The figures of a pseudo ground truth (`quality.json`)."""
    return dict(read_json(pseudo_gt_dir / QUALITY_FILE))


def quality_record(record: dict[str, Any], person: int) -> Quality:
    """A person's quality record.

    Args:
        record: What `load_record` gave.
        person: Which person, from 0.
    """
    judged = record["people"][person]
    inliers = record.get("inliers_per_frame")
    return Quality(
        geometry=record.get("geometry"),
        verdict="accepted" if judged["accepted"] else "rejected",
        reasons=tuple(judged["reasons"]),
        scale=record.get("scale"),
        scale_sigma=record.get("scale_sigma"),
        registered_share=record.get("registered_share"),
        reprojection_error_px=record.get("mean_reprojection_px"),
        inliers=None if inliers is None else float(np.mean(inliers)),
        figures=_figures(record, judged),
    )


def dropped_reasons(record: dict[str, Any], person: int) -> list[str]:
    """Why each row of a person's clip is dropped, (T,) texts: all rows of a rejected one."""
    judged = record["people"][person]
    reasons = judged_reasons(judged)
    if not judged["accepted"]:
        rejected = f"the sequence is rejected: {'; '.join(judged['reasons'])}"
        reasons = [reason or rejected for reason in reasons]
    return reasons


def judged_reasons(judged: dict[str, Any]) -> list[str]:
    """Why each frame of one person is dropped by itself, (T,) texts; empty where it isn't."""
    runs = ((run["start"], run["stop"], run["reason"]) for run in judged["dropped"])
    return texts_of(runs, judged["frames"])


def _figures(record: dict[str, Any], judged: dict[str, Any]) -> dict[str, float]:
    """The class's figures and the scale's cues by name, as far as they are known."""
    figures: dict[str, Any] = {"kept_share": judged["kept_share"]}
    figures |= {
        f"camera_{name}": value
        for name, value in record.get("camera_motion_figures", {}).items()
        if not isinstance(value, bool)
    }
    if "interpolated" in record:
        figures["interpolated_frames"] = len(record["interpolated"])
    figures["scale_disagreement_sigma"] = record.get("scale_disagreement")
    for cue in record.get("scale_cues", ()):
        name = cue["name"] if cue["person"] is None else f"{cue['name']}_p{cue['person']}"
        figures |= {f"scale_{name}": cue["scale"], f"scale_{name}_sigma": cue["sigma"]}
    return {name: float(value) for name, value in figures.items() if value is not None}
