"""`floor.json`: how wrong the pseudo ground truth itself is, by class of camera motion."""

from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from gmrdata.config import Config
from gmrdata.errors import BadRecord
from gmrdata.store import read_json


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
    """Rows of `gmrdata.evaluate.sequence_error.sequence_row`, and the reasons of the verdict."""
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
