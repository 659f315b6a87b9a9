"""The lens of clips whose lens is known and not told: its error, and whether that is stated.

A wrong one that is given must be objected to where the frames show it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from real.clips import RealClip
from video.clips import FACTS_FILE, FRAMES_FOLDER, MASKS_FOLDER, VideoFacts

from gmrdata.cameras.lens.intrinsics import (
    GivenIntrinsics,
    Intrinsics,
    IntrinsicsConfig,
    find_intrinsics,
    load_intrinsics,
)
from gmrdata.read.frames import read_frames
from gmrdata.stage.run import Run
from gmrdata.stage.store import stage_seconds

WRONG_FACTORS = (0.75, 1.35)
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


@dataclass(frozen=True)
class WrongFocalRow:
    """A clip to which a wrong focal length is given."""

    clip: str
    factor: float
    """What is given, over the truth."""
    observable: bool
    certified: bool
    """Whether it passes although the frames show the focal length."""
    said: str


@dataclass(frozen=True)
class KnownLens:
    """A clip, and the lens that it was filmed with."""

    name: str
    programme: str
    frames_dir: Path
    masks_dir: Path | None
    focal_px: float
    radial_k1: float


def rendered_lens(clip_dir: Path) -> KnownLens:
    """A rendered clip, with its own masks."""
    facts = VideoFacts.read(clip_dir / FACTS_FILE)
    frames_dir, masks_dir = clip_dir / FRAMES_FOLDER, clip_dir / MASKS_FOLDER
    lens = facts.focal_px, facts.radial_k1
    return KnownLens(facts.name, facts.programme, frames_dir, masks_dir, *lens)


def dancer_lens(clip: RealClip) -> KnownLens:
    """The phone before the dancer, whole pictures."""
    focal_px = clip.facts.focal_px[0]
    return KnownLens("dancer", "hand", clip.folder / "frames", None, focal_px, 0.0)


def focal_row(known: KnownLens, out_dir: Path) -> FocalRow:
    """What the frames say of the lens when nobody gives it."""
    made, lens = _found(known, out_dir, None)
    return FocalRow(
        clip=known.name,
        programme=known.programme,
        source=lens.source,
        observable=bool(lens.focal_observable),
        focal_px=round(lens.focal_px, 1),
        error_percent=round(100 * float(np.log(lens.focal_px / known.focal_px)), 2),
        sigma_percent=round(100 * lens.focal_sigma, 2),
        radial_k1=round(lens.radial_k1, 4),
        k1_error=round(lens.radial_k1 - known.radial_k1, 4),
        seconds=stage_seconds(made),
    )


def wrong_focal_row(known: KnownLens, factor: float, out_dir: Path) -> WrongFocalRow:
    """What is said of a wrong focal length that somebody gives."""
    _, lens = _found(known, out_dir, GivenIntrinsics(focal_px=factor * known.focal_px))
    shown, said = bool(lens.focal_observable), " ".join(lens.objections)
    return WrongFocalRow(known.name, factor, shown, shown and not said, said)


def _found(
    known: KnownLens, out_dir: Path, given: GivenIntrinsics | None
) -> tuple[Path, Intrinsics]:
    config, run = IntrinsicsConfig(), Run(redo=True)
    frames, masks_dir = read_frames(known.frames_dir), known.masks_dir
    made = find_intrinsics(frames, masks_dir, out_dir, config, given=given, run=run)
    return made, load_intrinsics(made)


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
