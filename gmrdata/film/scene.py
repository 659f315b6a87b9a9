"""The place that a clip is rendered in: what a recipe may say of it."""

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from gmrdata.film.extras import Extras
from gmrdata.values import limits
from gmrdata.values.records import Config

Light = Literal["sun", "overcast", "indoor"]


class BackdropConfig(Config):
    """A .blend file that the person is filmed in.

    Its meshes, lamps and sky are taken as saved, without cameras, animation, drivers and scripts.
    All that it shows must be inside the file (in Blender: File, External Data, Pack Resources)."""

    path: Path
    scene_name: str | None = None
    """Which of the file's scenes; may be left out when it has one."""
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the clip's origin, on the ground under the middle of the motion, is in the file [m]."""
    yaw_deg: float = 0.0
    """Direction of the clip's x axis in the file, anticlockwise from the file's own [degrees]."""
    max_bounces: int = Field(default=4, ge=0, le=64)
    """How often light goes from surface to surface; with many, take 64 or more `samples`."""
    allow_collisions: bool = False
    """Film even when the person or the camera goes through something."""


class SceneConfig(Config):
    """The place that the person is filmed in."""

    kind: Literal["courtyard", "street", "park", "room", "blend"] = "courtyard"
    """A paved yard with crates and pillars, a street with parked cars, a park with trees and
    hedges, or a furnished room: each with walls or hedges all round, as large as the clip needs.
    `blend`: what the file of `backdrop` shows."""
    seed: int = Field(default=0, ge=0, le=limits.LARGEST_SEED)
    """Chooses houses, things, pictures on them, and clothes."""
    light: Light | None = None
    """Sharp sun, an overcast sky without shadows, or a room's lamp; None: sun, or the lamp."""
    hdri_path: Path | None = None
    """An equirectangular .hdr or .exr file to show as the sky; it lights nothing."""
    backdrop: BackdropConfig | None = None
    """The place of kind `blend`."""
    extras: Extras = Extras()

    @model_validator(mode="after")
    def _fits_together(self) -> "SceneConfig":
        if (self.kind == "blend") != (self.backdrop is not None):
            raise ValueError("backdrop: `kind: blend` needs one, and no other kind has one")
        if self.backdrop is not None and (self.light or self.hdri_path):
            raise ValueError("backdrop: has its own light and sky; leave light and hdri_path out")
        if (self.kind == "room") != (self.lit_by == "indoor"):
            raise ValueError("light: `indoor` is for a room, and a room has no other")
        if self.kind == "room" and self.hdri_path is not None:
            raise ValueError("hdri_path: no sky is seen from a room; leave it out")
        if self.kind == "room" and self.extras.cars:
            raise ValueError("extras.cars: a car doesn't fit a room; set it to 0")
        return self

    @property
    def lit_by(self) -> Light:
        """The light, chosen or the place's own."""
        return self.light or ("indoor" if self.kind == "room" else "sun")

    @property
    def inputs(self) -> dict[str, Path]:
        """Files that the pictures depend on, by name."""
        files = {} if self.hdri_path is None else {"hdri": self.hdri_path}
        if self.backdrop is not None:
            files["backdrop"] = self.backdrop.path
        return files | self.extras.inputs
