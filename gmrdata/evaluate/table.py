"""A scores.json as the rows of a table."""

from typing import Any


def score_rows(scores: dict[str, Any]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Headings and rows: each clip, then each class of camera motion, then all, pooled."""
    rows = [_row(clip["id"], clip["n_motions"], clip) for clip in scores["clips"]]
    for name, group in scores["camera_motion"].items():
        rows.append(_row(f"all {name}", group["n_motions"], group["pooled_over_motions"]))
    overall = scores["overall"]
    rows.append(_row("all", overall["n_motions"], overall["pooled_over_motions"]))
    return ("clip", "motions", "OME [deg]", "TME [mm]", "VME [mm]", "with no motion at all"), rows


def _row(name: str, n_motions: int, errors: dict[str, dict[str, float]]) -> tuple[str, ...]:
    ours, zero = errors["gmr"], errors["zero"]
    return (
        name,
        str(n_motions),
        f"{ours['ome_deg']:.2f}",
        f"{ours['tme_mm']:.1f}",
        f"{ours['vme_mm']:.1f}",
        f"{zero['ome_deg']:.2f} / {zero['tme_mm']:.1f} / {zero['vme_mm']:.1f}",
    )
