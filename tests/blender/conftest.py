"""Places that cost little to paint, for tests that are about something else."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from blender.textures.base import ellipses
from blender.textures.ground import sky
from gmrdata.film.scene import BackdropConfig, SceneConfig
from tests.blender.jobs import in_blender
from tests.sharing import made_once


@pytest.fixture(scope="session")
def box_place(tmp_path_factory) -> SceneConfig:
    """A floor with two walls and a box some metres off, under a lamp."""

    def make(folder: Path) -> None:
        folder.mkdir()
        maker = Path(__file__).with_name("make_backdrop.py")
        words = [str(folder / "place.blend"), str(folder / "victim")]
        in_blender(maker, *words)
        (folder / "victim").unlink(missing_ok=True)  # who makes such a file runs it

    path = made_once(tmp_path_factory, "box_place", make) / "place.blend"
    backdrop = BackdropConfig(path=path, origin_m=(5.0, 15.0, 1.0), max_bounces=0)
    return SceneConfig(kind="blend", backdrop=backdrop)


def few_ellipses(
    image: np.ndarray, half_axes_px: np.ndarray, colours: np.ndarray, rng: np.random.Generator
) -> None:
    """Every twentieth ellipse."""
    ellipses(image, half_axes_px[::20], colours[::20], rng)


@pytest.fixture(scope="module")
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
