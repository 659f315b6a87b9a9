"""The truth of twins, and the rows of `gmrdata.twins.pseudo_gt_error` put together."""

from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

from gmrdata.values.clip import Clip, load_clip


def true_clips(truth_dir: Path, name: str) -> list[Clip]:
    """The exact clips of a twin's people."""
    paths = sorted(truth_dir.glob(f"{name}.p*.npz"), key=lambda path: path.name)
    return [load_clip(path) for path in paths]


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
