"""`floor.json`: how wrong the pseudo ground truth itself is, by class of camera motion.

A floor as the rows of a table.
"""

from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from gmrdata.values.errors import BadRecord
from gmrdata.values.files import read_json
from gmrdata.values.records import Config


class FloorGroup(Config):
    """Figures of some sequences.  Errors are of the accepted ones; None where there are none."""

    sequences: int
    """Sequences that were tried."""
    accepted: int
    """Those that may be used."""
    class_right: int
    """Those whose camera was given its true class."""
    n_motions: int
    """Motions of which the next three are means, all people's and all phases'."""
    ome_deg: float | None
    """Orientation motion error [deg]."""
    tme_mm: float | None
    """Translation motion error [mm]."""
    vme_mm: float | None
    """Vertex motion error [mm]."""
    camera_rotation_deg: float | None
    """Camera rotation error, mean of the sequences [deg]."""
    camera_path_mm: float | None
    """Camera path error, mean of the sequences [mm]."""
    abs_scale_error_percent: float | None
    """Size of the scale error, mean of the sequences in which scale enters [%]."""
    scale_stated: int
    """Sequences in which scale enters."""
    scale_within_2sigma: int
    """Those of them whose true scale is within two of the stated standard errors."""
    kept_share: float
    """Share of all people's frames that may be used, rejected sequences included, 0 to 1."""
    seconds_per_frame: float
    """Wall time of all stages per image [s]."""


class Floor(Config):
    """The file."""

    format: Literal["gmrdata-floor/1"]
    """Name and version of the format."""
    fps_hz: float
    """Rate of the motions [Hz]."""
    seed: int | None
    """What the twins were drawn by; None for given ones."""
    recipe: dict[str, Any]
    """Recipe of the pseudo ground truth."""
    sequences: tuple[dict[str, Any], ...]
    """Rows of `gmrdata.twins.pseudo_gt_error.sequence_row`, and the reasons of the verdict."""
    classes: dict[str, FloorGroup]
    """Groups by the camera's true class."""
    overall: FloorGroup
    """All sequences."""


def read_floor(path: Path) -> Floor:
    """Read a `floor.json`.

    Raises:
        MissingInput: there is no such file.
        BadRecord: it is no floor of this format.
    """
    try:
        return Floor.model_validate(read_json(path))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise BadRecord(
            f"{path}: {place}: {first['msg']}. Give the floor.json that `gmrdata floor` wrote"
        ) from None


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
