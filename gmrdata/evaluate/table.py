"""A scores.json as the rows of a table."""

from typing import Any

HEADINGS = ("clip", "motions", "OME [deg]", "TME [mm]", "VME [mm]", "with no motion at all")
FLOOR_HEADING = "pseudo ground truth's own"


def score_rows(scores: dict[str, Any]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Headings and rows: each clip, then each class of camera motion, then all, pooled."""
    rows = [_row(clip["id"], clip["n_motions"], clip, clip) for clip in scores["clips"]]
    for name, group in scores["camera_motion"].items():
        rows.append(_row(f"all {name}", group["n_motions"], group["pooled_over_motions"], group))
    overall = scores["overall"]
    rows.append(_row("all", overall["n_motions"], overall["pooled_over_motions"], overall))
    return (*HEADINGS, FLOOR_HEADING) if "floor" in overall else HEADINGS, rows


def _row(
    name: str, n_motions: int, errors: dict[str, dict[str, float]], row: dict[str, Any]
) -> tuple[str, ...]:
    ours, zero = errors["gmr"], errors["zero"]
    cells = (
        name,
        str(n_motions),
        f"{ours['ome_deg']:.2f}",
        f"{ours['tme_mm']:.1f}",
        f"{ours['vme_mm']:.1f}",
        f"{zero['ome_deg']:.2f} / {zero['tme_mm']:.1f} / {zero['vme_mm']:.1f}",
    )
    if "floor" not in row:
        return cells
    own = row["floor"]
    text = f"{own['ome_deg']:.2f} / {own['tme_mm']:.1f} / {own['vme_mm']:.1f} ({own['of']})"
    return (*cells, text)
