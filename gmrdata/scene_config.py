"""The place that a clip is rendered in: what a recipe may say of it."""

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from gmrdata.config import Config

Light = Literal["sun", "overcast", "indoor"]


class SceneConfig(Config):
    """The place that the person is filmed in."""

    kind: Literal["courtyard", "street", "park", "room"] = "courtyard"
    """A paved yard with crates and pillars, a street with parked cars, a park with trees and
    hedges, or a furnished room: each with walls or hedges all round, as large as the clip needs."""
    seed: int = Field(default=0, ge=0)
    """Chooses houses, things, pictures on them, and clothes."""
    light: Light | None = None
    """Sharp sun, an overcast sky without shadows, or a room's lamp; None: sun outdoors, a lamp in a
    room."""
    hdri_path: Path | None = None
    """An equirectangular .hdr or .exr file to show as the sky; it lights nothing."""

    @model_validator(mode="after")
    def _light_reaches_the_place(self) -> "SceneConfig":
        if (self.kind == "room") != (self.lit_by == "indoor"):
            raise ValueError("light: `indoor` is for a room, and a room has no other")
        if self.kind == "room" and self.hdri_path is not None:
            raise ValueError("hdri_path: no sky is seen from a room; leave it out")
        return self

    @property
    def lit_by(self) -> Light:
        """The light, chosen or the place's own."""
        return self.light or ("indoor" if self.kind == "room" else "sun")

    @property
    def inputs(self) -> dict[str, Path]:
        """Files that the pictures depend on, by name."""
        return {} if self.hdri_path is None else {"hdri": self.hdri_path}

    def with_full_paths(self) -> "SceneConfig":
        """The same place for a process that runs in another folder."""
        if self.hdri_path is None:
            return self
        return self.model_copy(update={"hdri_path": self.hdri_path.resolve()})
