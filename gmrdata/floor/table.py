"""A floor as the rows of a table."""

from typing import Any

from gmrdata.evaluate.floor_record import Floor, FloorGroup

HEADINGS = (
    "sequence",
    "class",
    "measured",
    "OME [deg]",
    "TME [mm]",
    "VME [mm]",
    "cam. rot. [deg]",
    "cam. path [mm]",
    "scale err. [%]",
    "in 2 sigma",
    "kept",
    "s/frame",
)


def floor_rows(floor: Floor) -> list[tuple[str, ...]]:
    """Rows for `HEADINGS`: each sequence, each class, all."""
    rows = [_sequence(row) for row in floor.sequences]
    rows += [_group(f"all {name}", name, group) for name, group in floor.classes.items()]
    return [*rows, _group("all", "", floor.overall)]


def notes(floor: Floor) -> list[str]:
    """How the table is read, and why sequences were rejected."""
    lines = [
        f"Motions at {floor.fps_hz:g} fps in all phases, between kept frames. A sequence with "
        "several people shows the one who fares worst; `all` rows are means over everyone's "
        "motions, and the mean size of the scale errors, of what was accepted."
    ]
    rejected = [row for row in floor.sequences if not row["accepted"]]
    return lines + [f"{row['id']}: rejected: {'; '.join(row['reasons'])}" for row in rejected]


def _sequence(row: dict[str, Any]) -> tuple[str, ...]:
    inside = {None: "-", True: "yes", False: "no"}[row["scale_within_2sigma"]]
    return (
        row["id"],
        row["class_true"],
        row["class_measured"] or "-",
        *_errors(row),
        _signed(row["scale_error_percent"]),
        inside,
        f"{100 * row['kept_share']:.1f} %",
        f"{row['seconds'] / row['frames']:.2f}",
    )


def _group(title: str, class_true: str, group: FloorGroup) -> tuple[str, ...]:
    return (
        f"{title}, {group.accepted} of {group.sequences} accepted",
        class_true,
        f"{group.class_right} of {group.sequences} right",
        *_errors(group.model_dump()),
        _text(group.abs_scale_error_percent, 2),
        f"{group.scale_within_2sigma} of {group.scale_stated}" if group.scale_stated else "-",
        f"{100 * group.kept_share:.1f} %",
        f"{group.seconds_per_frame:.2f}",
    )


def _errors(figures: dict[str, Any]) -> tuple[str, ...]:
    return (
        _text(figures["ome_deg"], 3),
        _text(figures["tme_mm"], 2),
        _text(figures["vme_mm"], 2),
        _text(figures["camera_rotation_deg"], 3),
        _text(figures["camera_path_mm"], 1),
    )


def _text(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _signed(value: float | None) -> str:
    return "-" if value is None else f"{value:+.2f}"
