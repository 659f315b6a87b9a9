"""The base of every recipe model."""

from pydantic import BaseModel, ConfigDict


class Config(BaseModel):
    """A frozen recipe: unknown keys are errors, so a typing mistake can't pass as a default."""

    model_config = ConfigDict(frozen=True, extra="forbid")
