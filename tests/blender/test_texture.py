"""A body wears a picture: each pixel has the colour that the texture coordinates say."""

from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest

from gmrdata.film.character import PersonConfig, TextureConfig
from gmrdata.film.render import RenderConfig
from gmrdata.film.scene import SceneConfig
from gmrdata.values.errors import MissingInput, RenderFailed, StaleOutput
from tests.blender.jobs import (
    FACING_X,
    Job,
    camera_at,
    facing_x,
    mask_of,
    save_job,
    shrunk,
    unprojected,
)

PELVIS_M = np.array([0.0, 0.0, 0.95])
LOW_M, SIZE_M = np.array([-1.1, -1.3]), np.array([2.2, 2.2])
CELLS = 11
COLOURS = np.array([[0.9, 0.1, 0.1], [0.1, 0.9, 0.1], [0.1, 0.1, 0.9]])


def checker() -> np.ndarray:
    """Squares of 20 cm in three colours, 11 by 11; row 0 at the top."""
    row, column = np.mgrid[:CELLS, :CELLS]
    return COLOURS[(row + 2 * column + row // 2) % 3]


class Files(NamedTuple):
    job: Job
    checker: Path
    uv: Path


@pytest.fixture(scope="module")
def files(small_body, tmp_path_factory) -> Files:
    """A body, a clip of one frame, a checker, and coordinates that look at the body from ahead."""
    folder = tmp_path_factory.mktemp("texture")
    camera = camera_at([[4.0, 0.0, 1.3]], [PELVIS_M], (320, 180))
    job = save_job(folder, small_body, facing_x(small_body, [PELVIS_M]), camera)
    made = Files(job, folder / "checker.png", folder / "uv.obj")
    pixels = np.kron(checker(), np.ones((20, 20, 1)))
    cv2.imwrite(str(made.checker), (255 * pixels[..., ::-1]).astype(np.uint8))
    uv = (small_body.template_m[:, :2] - LOW_M) / SIZE_M
    lines = [f"vt {u:.9f} {v:.9f}" for u, v in uv]
    turned = [np.roll(face, k) + 1 for k, face in enumerate(small_body.faces)]
    lines += ["f " + " ".join(f"{v}/{v}" for v in face) for face in turned[::-1]]
    made.uv.write_text("\n".join(lines) + "\n")
    return made


def config_of(image: Path, uv: Path, scene: SceneConfig) -> RenderConfig:
    return RenderConfig(
        samples=1,
        jpeg_quality=100,
        depth=True,
        scene=scene,
        person=PersonConfig(texture=TextureConfig(image=image, uv=uv)),
    )


def test_each_pixel_has_the_colour_that_the_coordinates_say(small_body, files, tmp_path):
    config = config_of(files.checker, files.uv, SceneConfig(light="overcast"))
    out = files.job.render(tmp_path / "out", config)
    frame = cv2.imread(str(out / "frames/00000.jpg"))[..., ::-1].astype(float)
    y, x = np.nonzero(shrunk(mask_of(out, 0), 3))
    rest_m = (unprojected(out, 0)[y, x] - PELVIS_M) @ FACING_X + small_body.rest_pelvis_m(
        np.zeros(10)
    )
    cell = (rest_m[:, :2] - LOW_M) / SIZE_M * CELLS
    # Pixels within 2 cm of the border between two squares may have either's colour.
    inside = (np.abs(cell - np.round(cell)) > 0.1).all(axis=1)
    assert inside.sum() > 500
    column, up = np.floor(cell[inside]).astype(int).T
    expected = checker()[CELLS - 1 - up, column].argmax(axis=1)
    found = frame[y[inside], x[inside]].argmax(axis=1)
    assert set(expected) == {0, 1, 2}
    assert (found == expected).mean() > 0.99
    files.checker.write_bytes(files.checker.read_bytes() + b"\0")
    with pytest.raises(StaleOutput, match="texture_image"):
        files.job.render(out, config)


def test_files_that_do_not_fit_are_named(box_place, files, tmp_path):
    def fail(config: RenderConfig) -> str:
        with pytest.raises(RenderFailed) as caught:
            files.job.render(tmp_path / "out", config)
        return str(caught.value)

    short = tmp_path / "short.obj"
    short.write_text("\n".join(files.uv.read_text().splitlines()[:-1]))
    assert "short.obj: has 335 triangles, but the body has 336" in fail(
        config_of(files.checker, short, box_place)
    )
    broken = tmp_path / "broken.jpg"
    broken.write_bytes(b"no picture")
    assert "broken.jpg: not a picture" in fail(config_of(broken, files.uv, box_place))
    gone = config_of(tmp_path / "gone.png", files.uv, box_place)
    with pytest.raises(MissingInput, match=r"gone\.png"):
        files.job.render(tmp_path / "out", gone)
