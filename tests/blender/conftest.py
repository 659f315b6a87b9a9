"""A place that costs nothing to paint, for renders that are about something else."""

import subprocess
import sys
from pathlib import Path

import pytest

from gmrdata.film.scene import BackdropConfig, SceneConfig
from tests.sharing import made_once


@pytest.fixture(scope="session")
def box_place(tmp_path_factory: pytest.TempPathFactory) -> SceneConfig:
    """A floor with two walls and a box some metres off, under a lamp."""

    def make(folder: Path) -> None:
        folder.mkdir()
        maker = Path(__file__).with_name("make_backdrop.py")
        words = [str(folder / "place.blend"), str(folder / "victim")]
        subprocess.run([sys.executable, str(maker), *words], check=True, capture_output=True)
        (folder / "victim").unlink(missing_ok=True)  # who makes such a file runs it

    path = made_once(tmp_path_factory, "box_place", make) / "place.blend"
    backdrop = BackdropConfig(path=path, origin_m=(5.0, 15.0, 1.0), max_bounces=0)
    return SceneConfig(kind="blend", backdrop=backdrop)
