"""Recovered world motions against the truth of their twins: the rows of the table."""

from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from gmrdata.clip import Clip, load_clip
from gmrdata.errors import StageFailed
from gmrdata.evaluate.pseudo_gt_error import PseudoGtError, compare_clips

FPS_HZ = 10.0
"""Rate of the scores; the twins have three times as much, so all three phases count."""


def true_clips(truth_dir: Path, name: str) -> list[Clip]:
    """The exact clips of a twin's people."""
    paths = sorted(truth_dir.glob(f"{name}.p*.npz"), key=lambda path: path.name)
    return [load_clip(path) for path in paths]


def score(
    name: str,
    class_true: str,
    clips: Sequence[Clip],
    truth: Sequence[Clip],
    *,
    accepted: bool,
    seconds: float,
    class_measured: str | None = None,
    scale: float | None = None,
    scale_sigma: float | None = None,
) -> dict[str, Any]:
    """A row: motion errors of the person who fares worst, scale error of the camera, kept share.

    Args:
        name: The sequence.
        class_true: What its camera does.
        clips: The people as they were recovered, in the order of `truth`; none where nothing was.
        truth: The exact people.
        accepted: Whether the recipe vouches for the sequence.
        seconds: Wall time [s].
        class_measured: Class of the recovered path, where the recipe says one.
        scale: Metres per unit of the recovered path, where the recipe says so.
        scale_sigma: Its stated standard error, same unit.
    """
    errors = [error for error in map(error_of, clips, truth) if error is not None]
    scale_error_percent = _first([error.scale_error_percent for error in errors])
    return {
        "id": name,
        "class_true": class_true,
        "class_measured": class_measured,
        "accepted": accepted,
        "ome_deg": _largest([error.ome_deg for error in errors]),
        "tme_mm": _largest([error.tme_mm for error in errors]),
        "scale_error_percent": _figure(scale_error_percent),
        "scale_within_2sigma": within_2sigma(scale_error_percent, scale, scale_sigma),
        "kept_share": _figure(kept_share(clips, truth)),
        "seconds": round(seconds, 2),
        "camera_rotation_deg": _largest([error.camera_rotation_deg for error in errors]),
    }


def error_of(clip: Clip, truth: Clip) -> PseudoGtError | None:
    """Errors of one person at 10 fps over the kept frames; None where no two follow each other."""
    if clip.motion.frame != "world" or not clip.valid.any():
        return None
    try:
        return compare_clips(clip, truth, fps_hz=FPS_HZ)
    except StageFailed:
        return None


def within_2sigma(
    scale_error_percent: float | None, scale: float | None, sigma: float | None
) -> bool | None:
    """Whether the true scale is inside the stated error bar; None where there is none."""
    if scale_error_percent is None or scale is None or sigma is None:
        return None
    true_scale = scale / (1 + scale_error_percent / 100)
    return bool(abs(scale - true_scale) <= 2 * sigma)


def kept_share(clips: Sequence[Clip], truth: Sequence[Clip]) -> float:
    """Share of all frames of all people that can be used."""
    kept = sum(int(clip.valid.sum()) for clip in clips)
    return kept / sum(clip.motion.n_frames for clip in truth)


def medians(rows: Sequence[dict[str, Any]]) -> dict[str, float | None]:
    """Medians over the accepted rows of the errors, and over all rows of the kept share."""
    accepted = [row for row in rows if row["accepted"]]
    figures = {key: _median(accepted, key) for key in ("ome_deg", "tme_mm", "scale_error_percent")}
    return figures | {"kept_share": _median(rows, "kept_share")}


def worst(rows: Sequence[dict[str, Any]], key: str) -> float | None:
    """Largest of a figure over the accepted rows."""
    return max((row[key] for row in rows if row["accepted"] and row[key] is not None), default=None)


def _median(rows: Sequence[dict[str, Any]], key: str) -> float | None:
    known = [abs(row[key]) for row in rows if row[key] is not None]
    return float(f"{median(known):.6g}") if known else None


def _largest(values: Sequence[float | None]) -> float | None:
    return _figure(max((value for value in values if value is not None), default=None))


def _first(values: Sequence[float | None]) -> float | None:
    return next((value for value in values if value is not None), None)


def _figure(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(f"{value:.6g}")
