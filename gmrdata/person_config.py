"""What a recipe may say of how the filmed person looks."""

from pathlib import Path

from pydantic import Field

from gmrdata.config import Config


class TextureConfig(Config):
    """A picture that the body wears, such as those of the SMPL literature."""

    image: Path
    """The picture, .png or .jpg."""
    uv: Path
    """Picture coordinates of the body's faces: an .obj, or an .npz with `vt` (N, 2) and `ft` (F, 3)
    as some model files have them."""


class PersonConfig(Config):
    """How the person looks."""

    seed: int | None = Field(default=None, ge=0)
    """Chooses skin, hair and clothes; None: the scene's seed does."""
    texture: TextureConfig | None = None
    """A picture instead of painted skin and clothes."""

    @property
    def inputs(self) -> dict[str, Path]:
        """Files that the pictures depend on, by name."""
        if self.texture is None:
            return {}
        return {"texture_image": self.texture.image, "texture_uv": self.texture.uv}

    def with_full_paths(self) -> "PersonConfig":
        """The same person for a process that runs in another folder."""
        if self.texture is None:
            return self
        texture = TextureConfig(image=self.texture.image.resolve(), uv=self.texture.uv.resolve())
        return self.model_copy(update={"texture": texture})
