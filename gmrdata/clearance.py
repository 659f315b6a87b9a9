"""How near a rendered clip's camera and person come to what stands about."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from gmrdata.config import Config
from gmrdata.errors import BadRecord
from gmrdata.store import read_json, write_json

CLEARANCE_FILE = "clearance.json"


class Clearance(Config):
    """Measured in Blender against the surfaces of everything that doesn't move, but the ground."""

    camera_m: float = Field(gt=0)
    """Smallest distance of the camera's place to a surface [m]."""
    person_m: float = Field(gt=0)
    """Smallest distance of the pelvis to a surface [m]."""
    sight_share: float = Field(ge=0, le=1)
    """Share of the frames in which nothing stands between the camera and the pelvis."""

    @property
    def figures(self) -> dict[str, float]:
        """As a manifest's quality figures."""
        return {
            "camera_clearance_m": self.camera_m,
            "person_clearance_m": self.person_m,
            "clear_sight_share": self.sight_share,
        }


def save_clearance(folder: Path, clearance: Clearance) -> None:
    """Write `clearance.json`."""
    write_json(folder / CLEARANCE_FILE, clearance.model_dump())


def clearance_figures(folder: Path) -> Mapping[str, float]:
    """The figures of a rendered clip; none for a clip with nothing round it.

    Raises:
        BadRecord: the file is not a clearance.
    """
    path = folder / CLEARANCE_FILE
    if not path.is_file():
        return {}
    record: Any = read_json(path)
    try:
        return Clearance.model_validate(record).figures
    except ValidationError as error:
        raise BadRecord(f"{path}: {error.errors()[0]['msg']}; render the clip again") from None
