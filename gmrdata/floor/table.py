"""A floor as the rows of a table."""

from typing import Any

from gmrdata.evaluate.floor_record import Floor, FloorGroup

HEADINGS = (
    "sequence",
    "class",
    "measured",
    "accepted",
    "OME [deg]",
    "TME [mm]",
    "VME [mm]",
    "camera [deg]",
    "camera [mm]",
    "scale [%]",
    "2 sigma",
    "kept",
    "s/frame",
)
ANSWERS = {None: "-", True: "yes", False: "no"}


def floor_rows(floor: Floor) -> list[tuple[str, ...]]:
    """Rows for `HEADINGS`: each sequence, each class, all."""
    rows = [_sequence(row) for row in floor.sequences]
    rows += [_group(f"all {name}", name, group) for name, group in floor.classes.items()]
    return [*rows, _group("all", "", floor.overall)]


def notes(floor: Floor) -> list[str]:
    """How the table is read, and why sequences were rejected."""
    lines = [
        f"Motions at {floor.fps_hz:g} fps in all phases, between kept frames; of several people "
        "a sequence shows the one who fares worst. `all`, of what was accepted: OME, TME, VME over "
        "everyone's motions, camera errors and sizes of scale errors over the sequences."
    ]
    rejected = [row for row in floor.sequences if not row["accepted"]]
    return lines + [f"{row['id']}: rejected: {'; '.join(row['reasons'])}" for row in rejected]


def _sequence(row: dict[str, Any]) -> tuple[str, ...]:
    return (
        row["id"],
        row["class_true"],
        row["class_measured"] or "-",
        ANSWERS[row["accepted"]],
        *_errors(row),
        _signed(row["scale_error_percent"]),
        ANSWERS[row["scale_within_2sigma"]],
        f"{100 * row['kept_share']:.1f}%",
        f"{row['seconds'] / row['frames']:.2f}",
    )


def _group(title: str, class_true: str, group: FloorGroup) -> tuple[str, ...]:
    return (
        title,
        class_true,
        f"{group.class_right}/{group.sequences} right",
        f"{group.accepted}/{group.sequences}",
        *_errors(group.model_dump()),
        _text(group.abs_scale_error_percent, 2),
        f"{group.scale_within_2sigma}/{group.scale_stated}" if group.scale_stated else "-",
        f"{100 * group.kept_share:.1f}%",
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
