"""What the recipe of a twin set may say."""

from collections.abc import Mapping
from typing import Literal

from pydantic import Field, model_validator

from gmrdata.film.set_plan import SyntheticRecipe
from gmrdata.read.threedpw_arrays import FPS_HZ
from gmrdata.read.threedpw_layout import require_name
from gmrdata.twins.twin import TwinConfig
from gmrdata.values.errors import BadSequence
from gmrdata.values.records import Config

Split = Literal["train", "validation", "test"]


class TwinRecipe(Config):
    """A rendered set, written in 3DPW's layout with 3DPW's faults."""

    recipe: Literal["threedpw_twin"]
    """Kind of recipe."""
    set: SyntheticRecipe
    """What is rendered: a recipe of kind `synthetic`, at 30 fps, as JPEG.  The id of each clip is
    the sequence's name.  `company` of its place are further annotated people; passers-by and cars
    are not annotated, as in 3DPW."""
    twin: TwinConfig = TwinConfig()
    """How the dataset's side differs from the truth, drawn by the set's seed and the name."""
    split: Split = "test"
    """Split of the sequences."""
    splits: Mapping[str, Split] = Field(default_factory=dict)
    """Another split for some, by name."""

    @model_validator(mode="after")
    def _set_fits_the_layout(self) -> "TwinRecipe":
        if self.set.film.fps_hz != FPS_HZ:
            raise ValueError(f"set.film.fps_hz: 3DPW has {FPS_HZ:g} frames a second; say so")
        if self.set.render.image_format != "jpg":
            raise ValueError("set.render.image_format: 3DPW's images are jpg")
        if self.set.camera_off or self.set.published_list:
            raise ValueError("set: name each sequence in `clips`, without camera_off or a list")
        return self

    @model_validator(mode="after")
    def _sequences_have_names(self) -> "TwinRecipe":
        names = [clip.id for clip in self.set.clips]
        for name in names:
            try:
                require_name(name)
            except BadSequence as error:
                raise ValueError(f"set.clips: {error}") from None
        unknown = sorted(self.splits.keys() - set(names))
        if unknown:
            raise ValueError(f"splits: no clips {', '.join(unknown)}")
        return self
