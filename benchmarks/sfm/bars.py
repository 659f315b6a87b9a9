"""The bars of the COLMAP stage: each a figure, what it must keep to, and whether it does."""

from collections.abc import Sequence
from statistics import fmean
from typing import Any

from record import Bar, at_least, at_most
from sfm.score import medians, worst

MOST_SCALE_PERCENT = 3.0


def own_bars(ours: Sequence[dict[str, Any]]) -> list[Bar]:
    """Accuracy of ours."""
    mine = medians(ours)
    return [
        at_most("median OME [deg]", mine["ome_deg"], 0.03),
        at_most("median TME [mm]", mine["tme_mm"], 1.2),
        at_most("worst OME [deg]", worst(ours, "ome_deg"), 0.4),
        at_most("worst TME [mm]", worst(ours, "tme_mm"), 15.0),
        at_most("wrong scales", sum(map(_wrong_scale, ours)), 1),
        at_most("mean scale error, either way [%]", _mean_scale_percent(ours), 0.5),
        at_most("rejected sequences", sum(not row["accepted"] for row in ours), 0),
        at_most("classes without an accepted sequence", len(_unseen_classes(ours)), 0),
        at_most(
            "wrong classes", sum(row["class_measured"] != row["class_true"] for row in ours), 0
        ),
    ]


def bars_beside(ours: Sequence[dict[str, Any]], plain: Sequence[dict[str, Any]]) -> list[Bar]:
    """Ours beside the plain recipe."""
    mine, theirs = medians(ours), medians(plain)
    bars = [
        at_most(f"median {key} beside the plain recipe's", mine[key], theirs[key])
        for key in ("ome_deg", "tme_mm")
    ]
    kept = (mine["kept_share"], theirs["kept_share"])
    return [*bars, at_least("median kept share beside the plain recipe's", *kept)]


def _wrong_scale(row: dict[str, Any]) -> bool:
    """A scale that is off or outside its error bar; where none enters it is not wrong."""
    error = row["scale_error_percent"]
    if not row["accepted"] or error is None:
        return False
    return abs(error) > MOST_SCALE_PERCENT or row["scale_within_2sigma"] is False


def _mean_scale_percent(rows: Sequence[dict[str, Any]]) -> float | None:
    errors = [row["scale_error_percent"] for row in rows if row["accepted"]]
    known = [error for error in errors if error is not None]
    return abs(fmean(known)) if known else None


def _unseen_classes(rows: Sequence[dict[str, Any]]) -> set[str]:
    accepted = {row["class_true"] for row in rows if row["accepted"]}
    return {row["class_true"] for row in rows} - accepted
