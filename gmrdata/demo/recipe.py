"""What the demo's recipe may say."""

from typing import Literal

from pydantic import Field, model_validator

from gmrdata.config import Config
from gmrdata.film import Film
from gmrdata.geometry.programmes import Programme
from gmrdata.gmr.config import TrainConfig
from gmrdata.render import RenderConfig
from gmrdata.sequence import SequenceConfig


class DemoClip(Config):
    """One clip: who moves, and how the camera moves."""

    id: str = Field(pattern=r"^[A-Za-z0-9_-]+$")
    """Name of the clip and of its folders."""
    gait: str
    """Kind of embedded gait that is filmed when no motion files are given."""
    programme: Programme
    """Camera programme."""


class Training(Config):
    """The motions that GMR is trained on."""

    gait_count: int = Field(default=60, ge=1)
    """Embedded gait motions."""
    gait_duration_s: float = Field(default=12.0, gt=0)
    """Length of each [s]."""
    fps_hz: float = 30.0
    """Frame rate of each [Hz]; all phases at the network's rate are used."""
    max_files: int = Field(default=60, ge=0)
    """At most this many of the motion files that are given, besides those filmed."""


class DemoRecipe(Config):
    """Three clips rendered, regenerated from their frames, and a GMR trained and scored."""

    recipe: Literal["demo"]
    """Kind of recipe."""
    seed: int = Field(default=0, ge=0)
    """Seed of every random choice."""
    body: str = "anny"
    """Body model: "anny", or the path of an SMPL model file."""
    workers: int = Field(default=3, ge=1)
    """Worker processes for the clips, one thread each for rendering."""
    clips: tuple[DemoClip, ...] = Field(min_length=1)
    """The clips, in the order of the report."""
    film: Film = Film()
    """What the clips share."""
    training: Training = Training()
    """The training motions."""
    render: RenderConfig = RenderConfig()
    """The Blender stage."""
    sequence: SequenceConfig = SequenceConfig()
    """Masks, cameras, scale and world motion."""
    gmr: TrainConfig = TrainConfig()
    """The network and its training."""

    @model_validator(mode="after")
    def _masks_fit_the_body(self) -> "DemoRecipe":
        if self.render.character is not None:
            raise ValueError(
                "render.character: the demo draws its masks from the body; "
                "use a synthetic recipe for rigged characters"
            )
        return self

    @model_validator(mode="after")
    def _ids_are_unique(self) -> "DemoRecipe":
        ids = [clip.id for clip in self.clips]
        if len(ids) != len(set(ids)):
            raise ValueError(f"clip ids must be unique, these are not: {', '.join(ids)}")
        return self
