"""The bars that pseudo ground truth has to meet, and the figures as text, for page and terminal."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from gmrdata.report.data import ClipFigures, ReportData, Score

BARS = {"ome_deg": 0.5, "tme_mm": 15.0, "scale_error_percent": 5.0}
"""Largest error of pseudo ground truth against the truth at 10 Hz that counts as good."""

SCALE_NOT_OBSERVABLE = "not observable (pan)"
NO_FIGURE = "–"


def verdicts(figures: ClipFigures | Mapping[str, Any]) -> dict[str, bool]:
    """Which figures of a clip meet their bars, by key; `frames_with_camera` means every frame."""
    row = asdict(figures) if isinstance(figures, ClipFigures) else figures
    met = {
        key: abs(row[key]) <= bar for key, bar in BARS.items() if row[key] is not None
    }  # a NaN compares as False, so it never meets a bar
    return met | {"frames_with_camera": row["frames_with_camera"] == row["frames"]}


def figure_texts(figures: ClipFigures | Mapping[str, Any]) -> dict[str, str]:
    """A clip's figures as text, without units, by key; `cameras` is "with camera/all frames"."""
    row = asdict(figures) if isinstance(figures, ClipFigures) else figures
    scale, camera_deg = row["scale_error_percent"], row["camera_rotation_deg"]
    return {
        "cameras": f"{row['frames_with_camera']}/{row['frames']}",
        "ome_deg": f"{row['ome_deg']:.3f}",
        "tme_mm": f"{row['tme_mm']:.2f}",
        "camera_rotation_deg": NO_FIGURE if camera_deg is None else f"{camera_deg:.3f}",
        "scale_error_percent": SCALE_NOT_OBSERVABLE if scale is None else _signed(scale),
    }


def _signed(value: float) -> str:
    return f"{value:+.2f}".replace("-", "−")


def score_texts(score: Score | Mapping[str, Any]) -> dict[str, str]:
    """A score as text, without units, by key."""
    row = asdict(score) if isinstance(score, Score) else score
    return {
        "ome_deg": f"{row['ome_deg']:.2f}",
        "tme_mm": f"{row['tme_mm']:.1f}",
        "vme_mm": f"{row['vme_mm']:.1f}",
    }


def summary(report: ReportData) -> dict[str, Any]:
    """The report's figures as plain JSON values.

    Returns:
        `clips`: a list with `id`, `camera_motion` and the fields of ClipFigures; `gmr`: per
        manifest `ome_deg`, `tme_mm`, `vme_mm` and the same under `zero_motion`; `seconds` per
        stage.
    """
    return {
        "clips": [
            {"id": clip.id, "camera_motion": clip.camera_motion} | asdict(clip.figures)
            for clip in report.clips
        ],
        "gmr": {
            score.name: asdict(score.gmr) | {"zero_motion": asdict(score.zero_motion)}
            for score in report.scores
        },
        "seconds": {stage: float(seconds) for stage, seconds in report.run.seconds.items()},
    }
