"""What the recipe of a synthetic set may say."""

from typing import Literal

from pydantic import Field, model_validator

from gmrdata.character import Character
from gmrdata.config import Config
from gmrdata.film import Film
from gmrdata.geometry.programmes import Programme
from gmrdata.render import RenderConfig
from gmrdata.scene_config import SceneConfig


class SyntheticClip(Config):
    """One clip of a set."""

    id: str = Field(pattern=r"^[A-Za-z0-9_-]+$")
    """Name of the clip and of its folders."""
    trial: str | None = None
    """Name of a motion file, without suffix."""
    gait: str | None = None
    """Or kind of embedded gait."""
    programme: Programme
    """Camera programme."""
    duration_s: float | None = Field(default=None, gt=0)
    """Length to film, from the motion's start [s]; the set's when left out."""
    shape: tuple[float, ...] | None = None
    """Shape coefficients of the person, as many as the body has; `people` decides when left out."""
    scene: SceneConfig | None = None
    """The clip's place; drawn from the set's `scenes`, or that of `render`, when left out."""
    character: Character | None = None
    """A rigged character to film in this clip; that of `render`, if any, when left out."""

    @model_validator(mode="after")
    def _one_motion(self) -> "SyntheticClip":
        if (self.trial is None) == (self.gait is None):
            raise ValueError("give either `trial` or `gait`")
        return self


class PeopleConfig(Config):
    """Who is filmed."""

    vary: bool = False
    """Whether each clip has a person, skin, hair and clothes of its own, drawn by the set's seed
    and the clip's id; else a file's motion has the body's mean shape, a gait one of its own, and
    the scene's seed chooses the clothes."""
    spread: float = Field(default=1.0, ge=0, le=1.2)
    """How far shapes go from the mean; 1: as adults do in the body's own distribution."""


class SyntheticRecipe(Config):
    """A set of clips to render."""

    recipe: Literal["synthetic"]
    """Kind of recipe."""
    name: str = Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$")
    """Name of the data set."""
    version: str = "1.0.0"
    """Its version, major.minor.patch."""
    seed: int = Field(default=0, ge=0)
    """Seed of every random choice."""
    body: str = "anny"
    """Body model: "anny", or the path of an SMPL model file."""
    workers: int = Field(default=2, ge=1)
    """Worker processes, one thread each."""
    published_list: str | None = None
    """A published list whose trials are rendered, each under its programme."""
    clips: tuple[SyntheticClip, ...] = ()
    """Further clips."""
    camera_off: bool = False
    """Render each clip a second time, as `<id>_off`, with the same motion in the same place under
    a static camera (Table 6).  A static clip has no such twin."""
    min_in_frame_share: float = Field(default=0.9, ge=0, le=1)
    """A clip that has the whole person in frame in a smaller share of its frames gets a warning."""
    people: PeopleConfig = PeopleConfig()
    """Who is filmed."""
    scenes: tuple[SceneConfig, ...] = ()
    """Places of which each clip draws one, by the set's seed and its id; a place without a `seed`
    gets one of the clip's own too.  None: all clips are in the place of `render`."""
    film: Film = Film()
    """What the clips share."""
    render: RenderConfig = RenderConfig()
    """The Blender stage."""
