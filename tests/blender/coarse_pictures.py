"""Places whose pictures have few pixels and few leaves, for tests of what stands where."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from blender.textures.base import ellipses
from blender.textures.ground import sky


def few_ellipses(
    image: np.ndarray, half_axes_px: np.ndarray, colours: np.ndarray, rng: np.random.Generator
) -> None:
    """Every twentieth ellipse."""
    ellipses(image, half_axes_px[::20], colours[::20], rng)


@contextmanager
def coarse_pictures() -> Iterator[None]:
    """Paint little, which is most of the work; what stands where follows the same rules."""
    with pytest.MonkeyPatch.context() as patch:
        for kind in ("courtyard", "street", "park"):
            patch.setattr(f"blender.places.{kind}.GROUND_PX", 384)
            patch.setattr(f"blender.places.{kind}.sky", lambda _w, _h, rng: sky(64, 32, rng))
        patch.setattr("blender.places.room.FLOOR_PX", 384)
        patch.setattr("blender.places.park.HEDGE_PX_PER_M", 20.0)
        patch.setattr("blender.places.room.WALL_PX_PER_M", 30.0)
        patch.setattr("blender.places.props.WALL_PX_PER_M", 20.0)
        patch.setattr("blender.places.props.PROP_PX_PER_M", 120.0)
        patch.setattr("blender.textures.props.LEAVES", 100)
        for textures in ("ground", "road"):
            patch.setattr(f"blender.textures.{textures}.ellipses", few_ellipses)
        yield
