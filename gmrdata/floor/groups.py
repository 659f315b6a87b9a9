"""Rows of sequences put together: by the camera's true class, and all."""

from collections.abc import Iterable, Sequence
from typing import Any

from gmrdata.evaluate.floor_record import FloorGroup

Row = dict[str, Any]


def by_class(rows: Sequence[Row]) -> dict[str, FloorGroup]:
    """A group for each true class, in alphabetical order."""
    names = sorted({str(row["class_true"]) for row in rows})
    return {name: group([row for row in rows if row["class_true"] == name]) for name in names}


def group(rows: Sequence[Row]) -> FloorGroup:
    """Figures of some sequences.

    Args:
        rows: At least one, as `gmrdata.evaluate.sequence_error.sequence_row` gives them.
    """
    accepted = [row for row in rows if row["accepted"]]
    people = [person for row in accepted for person in row["people"]]
    scaled = [row for row in accepted if row["scale_error_percent"] is not None]
    seen = sum(row["frames"] * len(row["people"]) for row in rows)
    kept = sum(person["kept_frames"] for row in rows for person in row["people"])
    return FloorGroup(
        sequences=len(rows),
        accepted=len(accepted),
        class_right=sum(row["class_measured"] == row["class_true"] for row in rows),
        n_motions=sum(person["n_motions"] for person in people),
        ome_deg=_over_motions(people, "ome_deg"),
        tme_mm=_over_motions(people, "tme_mm"),
        vme_mm=_over_motions(people, "vme_mm"),
        camera_rotation_deg=_mean(row["camera_rotation_deg"] for row in accepted),
        camera_path_mm=_mean(row["camera_path_mm"] for row in accepted),
        abs_scale_error_percent=_mean(abs(row["scale_error_percent"]) for row in scaled),
        scale_stated=len(scaled),
        scale_within_2sigma=sum(row["scale_within_2sigma"] is True for row in scaled),
        kept_share=_figure(kept / seen),
        seconds_per_frame=_figure(
            sum(row["seconds"] for row in rows) / sum(row["frames"] for row in rows)
        ),
    )


def _over_motions(people: Sequence[Row], key: str) -> float | None:
    """Mean over all motions of all people."""
    known = [person for person in people if person[key] is not None]
    n_motions = sum(person["n_motions"] for person in known)
    if not n_motions:
        return None
    return _figure(sum(person[key] * person["n_motions"] for person in known) / n_motions)


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return _figure(sum(known) / len(known)) if known else None


def _figure(value: float) -> float:
    return float(f"{value:.6g}")
