"""The lens of clips whose lens is known and not told: its error, and whether that is stated."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from real.clips import RealClip
from video.clips import FACTS_FILE, FRAMES_FOLDER, MASKS_FOLDER, VideoFacts

from gmrdata.cameras.intrinsics import IntrinsicsConfig, find_intrinsics, load_intrinsics
from gmrdata.stage.run import Run
from gmrdata.stage.store import stage_seconds

MOST_ERROR_PERCENT, LEAST_IN_2_SIGMA, MOST_K1_ERROR = 3.0, 0.9, 0.02


@dataclass(frozen=True)
class FocalRow:
    """One clip."""

    clip: str
    programme: str
    source: str
    observable: bool
    focal_px: float
    error_percent: float
    sigma_percent: float
    radial_k1: float
    k1_error: float
    seconds: float


def rendered_row(clip_dir: Path, out_dir: Path) -> FocalRow:
    """The lens of a rendered clip, with its own masks."""
    facts = VideoFacts.read(clip_dir / FACTS_FILE)
    masks_dir, k1 = clip_dir / MASKS_FOLDER, facts.radial_k1
    frames_dir = clip_dir / FRAMES_FOLDER
    return _row(facts.name, facts.programme, frames_dir, masks_dir, facts.focal_px, k1, out_dir)


def dancer_row(clip: RealClip, out_dir: Path) -> FocalRow:
    """The lens of the phone before the dancer, whole pictures."""
    focal_px = clip.facts.focal_px[0]
    return _row("dancer", "hand", clip.folder / "frames", None, focal_px, 0.0, out_dir)


def _row(
    name: str,
    programme: str,
    frames_dir: Path,
    masks_dir: Path | None,
    focal_px: float,
    radial_k1: float,
    out_dir: Path,
) -> FocalRow:
    made = find_intrinsics(frames_dir, masks_dir, out_dir, IntrinsicsConfig(), run=Run(redo=True))
    lens = load_intrinsics(made)
    return FocalRow(
        clip=name,
        programme=programme,
        source=lens.source,
        observable=bool(lens.focal_observable),
        focal_px=round(lens.focal_px, 1),
        error_percent=round(100 * float(np.log(lens.focal_px / focal_px)), 2),
        sigma_percent=round(100 * lens.focal_sigma, 2),
        radial_k1=round(lens.radial_k1, 4),
        k1_error=round(lens.radial_k1 - radial_k1, 4),
        seconds=stage_seconds(made),
    )


def focal_figures(rows: Sequence[FocalRow]) -> dict[str, Any]:
    """What stands in the record; errors of the focal length where the frames show it."""
    shown = [row for row in rows if row.observable]
    errors = np.array([abs(row.error_percent) for row in shown])
    inside = [abs(row.error_percent) <= 2 * row.sigma_percent for row in rows]
    bent = [abs(row.k1_error) for row in shown if abs(row.radial_k1 - row.k1_error) > 0]
    return {
        "focal_error_percent_median": round(float(np.median(errors)), 3) if shown else None,
        "focal_in_2_sigma_share": round(float(np.mean(inside)), 3),
        "focal_observable": len(shown),
        "k1_error_max": max(bent, default=None),
        "focal_clips": [vars(row) for row in rows],
    }
