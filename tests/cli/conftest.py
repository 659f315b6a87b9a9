"""The command line in this process, and a small demo that is run once for all tests here."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from gmrdata.cli import main
from gmrdata.cli.demo_recipe import DemoPaths
from gmrdata.read.body_file import save_body
from tests.cli.small_demos import RECIPE, demo_arguments
from tests.filming import CAMERAS_ALONE
from tests.read.videos import make_video
from tests.sharing import made_once


@pytest.fixture
def walks_command(tmp_path, small_body, write_person) -> Callable[[int], tuple[object, ...]]:
    """Writes so many short motion files, and gives the command that reads them."""

    def write(n_files: int) -> tuple[object, ...]:
        folder, body = tmp_path / "motions", tmp_path / "body.npz"
        save_body(body, small_body)
        folder.mkdir()
        for number in range(n_files):
            pelvis_m = np.linspace([0.0, 0.95, 0.0], [0.0, 0.95, 0.5], 20 + number)
            still_deg = np.zeros((20 + number, 24, 3))
            write_person(folder / f"walk{number}.bvh", small_body, still_deg, pelvis_m)
        return "motions", folder, "--body", body

    return write


@pytest.fixture(scope="session")
def recipe_path(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("recipe") / "small.yaml"
    path.write_text(yaml.safe_dump(RECIPE))
    return path


@pytest.fixture(scope="session")
def finished(tmp_path_factory, recipe_path, cmu_dir) -> DemoPaths:
    out = tmp_path_factory.mktemp("demo") / "out"
    main(demo_arguments(out, recipe_path, cmu_dir))
    return DemoPaths(out)


@pytest.fixture(scope="session")
def clips(dolly, tmp_path_factory) -> Path:
    """A folder with a walk, a video in which nothing moves, and a file that is broken."""

    def make(folder: Path) -> None:
        folder.mkdir()
        images = [cv2.imread(str(path))[..., ::-1] for path in sorted(dolly.images_dir.iterdir())]
        walk = list(map(np.ascontiguousarray, images))
        make_video(folder / "walk.mp4", walk, rate_hz=10, options={"crf": "4"})
        still = 4 * [np.full((48, 64, 3), 90, np.uint8)]
        make_video(folder / "still.MP4", still, rate_hz=10)
        (folder / "broken.mov").write_bytes(b"\x00\x00\x00\x18ftypmp42" + bytes(4000))
        (folder / "notes.txt").write_text("mine")

    return made_once(tmp_path_factory, "clips", make)


@pytest.fixture(scope="session")
def solved_videos(clips, tmp_path_factory) -> Path:
    """The folder that one process leaves of them."""

    def make(out: Path) -> None:
        with pytest.raises(SystemExit, match="1"):
            main([*map(str, ("video", clips, "--out", out, "--workers", 1)), *CAMERAS_ALONE])

    return made_once(tmp_path_factory, "solved_videos", make)
