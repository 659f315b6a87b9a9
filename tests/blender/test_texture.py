"""A body wears a picture: each pixel has the colour that the texture coordinates say."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.film.camera_moves import look_at
from gmrdata.film.character import PersonConfig, TextureConfig
from gmrdata.film.render import RenderConfig, render_clip
from gmrdata.film.scene import SceneConfig
from gmrdata.read.body_file import save_body
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath, intrinsics_from_fov
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.errors import MissingInput, RenderFailed, StaleOutput
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import rigid

WIDTH_PX, HEIGHT_PX = 320, 180
STANDS = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
PELVIS_M = np.array([0.0, 0.0, 0.95])
CENTRE_M = np.array([[4.0, 0.0, 1.3]])
LOW_M, SIZE_M = np.array([-1.1, -1.3]), np.array([2.2, 2.2])
CELLS = 11
COLOURS = np.array([[0.9, 0.1, 0.1], [0.1, 0.9, 0.1], [0.1, 0.1, 0.9]])


def checker() -> np.ndarray:
    """Squares of 20 cm in three colours, 11 by 11; row 0 at the top."""
    row, column = np.mgrid[:CELLS, :CELLS]
    return COLOURS[(row + 2 * column + row // 2) % 3]


@pytest.fixture(scope="module")
def files(small_body: BodyModel, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A body, a clip of one frame, a checker, and coordinates that look at the body from ahead."""
    folder = tmp_path_factory.mktemp("texture")
    made = {name: folder / name for name in ("body.npz", "clip.npz", "checker.png", "uv.obj")}
    save_body(made["body.npz"], small_body)
    motion = Motion(
        np.tile(np.eye(3), (1, 23, 1, 1)), STANDS[None], PELVIS_M[None], np.zeros(10), 10.0,
        small_body.name, "neutral", "world", "stands",
    )  # fmt: skip
    pose = rigid(look_at(CENTRE_M, PELVIS_M[None]), CENTRE_M)
    intrinsics_px = intrinsics_from_fov(60.0, WIDTH_PX, HEIGHT_PX)
    camera = CameraPath(intrinsics_px, WIDTH_PX, HEIGHT_PX, pose, np.ones(1, bool))
    clip = Clip("stands", motion, np.ones(1, bool), np.full(1, -1), camera)
    save_clip(made["clip.npz"], clip, small_body.rest_pelvis_m(motion.shape))
    pixels = np.kron(checker(), np.ones((20, 20, 1)))
    cv2.imwrite(str(made["checker.png"]), (255 * pixels[..., ::-1]).astype(np.uint8))
    uv = (small_body.template_m[:, :2] - LOW_M) / SIZE_M
    lines = [f"vt {u:.9f} {v:.9f}" for u, v in uv]
    turned = [np.roll(face, k) + 1 for k, face in enumerate(small_body.faces)]
    lines += ["f " + " ".join(f"{v}/{v}" for v in face) for face in turned[::-1]]
    made["uv.obj"].write_text("\n".join(lines) + "\n")
    return made


def config_of(image: Path, uv: Path, scene: SceneConfig) -> RenderConfig:
    return RenderConfig(
        samples=1,
        jpeg_quality=100,
        depth=True,
        scene=scene,
        person=PersonConfig(texture=TextureConfig(image=image, uv=uv)),
    )


def test_each_pixel_has_the_colour_that_the_coordinates_say(
    small_body: BodyModel, files: dict[str, Path], tmp_path: Path
) -> None:
    config = config_of(files["checker.png"], files["uv.obj"], SceneConfig(light="overcast"))
    out = render_clip(
        files["clip.npz"], files["body.npz"], tmp_path / "out", config, on_frame=lambda _: None
    )
    frame = cv2.imread(str(out / "frames/00000.jpg"))[..., ::-1].astype(float)
    mask = cv2.imread(str(out / "masks/00000.png"), cv2.IMREAD_GRAYSCALE)
    depth_m = cv2.imread(str(out / "depth/00000.png"), cv2.IMREAD_UNCHANGED) / 1000.0
    y, x = np.nonzero(cv2.erode(mask, np.ones((3, 3), np.uint8)))
    camera = camera_of(load_clip(out / "clip.npz"))
    rays = np.linalg.solve(camera.intrinsics_px, np.stack([x + 0.5, y + 0.5, np.ones(len(x))]))
    world_from_cam = camera.world_from_cam[0]
    world_m = (rays * depth_m[y, x]).T @ world_from_cam[:3, :3].T + world_from_cam[:3, 3]
    rest_m = (world_m - PELVIS_M) @ STANDS + small_body.rest_pelvis_m(np.zeros(10))
    cell = (rest_m[:, :2] - LOW_M) / SIZE_M * CELLS
    # Pixels within 2 cm of the border between two squares may have either's colour.
    inside = (np.abs(cell - np.round(cell)) > 0.1).all(axis=1)
    assert inside.sum() > 500
    column, up = np.floor(cell[inside]).astype(int).T
    expected = checker()[CELLS - 1 - up, column].argmax(axis=1)
    found = frame[y[inside], x[inside]].argmax(axis=1)
    assert set(expected) == {0, 1, 2}
    assert (found == expected).mean() > 0.99
    files["checker.png"].write_bytes(files["checker.png"].read_bytes() + b"\0")
    with pytest.raises(StaleOutput, match="texture_image"):
        render_clip(files["clip.npz"], files["body.npz"], out, config)


def test_files_that_do_not_fit_are_named(
    box_place: SceneConfig, files: dict[str, Path], tmp_path: Path
) -> None:
    def fail(config: RenderConfig) -> str:
        with pytest.raises(RenderFailed) as caught:
            render_clip(
                files["clip.npz"], files["body.npz"], tmp_path / "out", config,
                on_frame=lambda _: None,
            )  # fmt: skip
        return str(caught.value)

    short = tmp_path / "short.obj"
    short.write_text("\n".join(files["uv.obj"].read_text().splitlines()[:-1]))
    assert "short.obj: has 335 triangles, but the body has 336" in fail(
        config_of(files["checker.png"], short, box_place)
    )
    broken = tmp_path / "broken.jpg"
    broken.write_bytes(b"no picture")
    assert "broken.jpg: not a picture" in fail(config_of(broken, files["uv.obj"], box_place))
    gone = config_of(tmp_path / "gone.png", files["uv.obj"], box_place)
    with pytest.raises(MissingInput, match=r"gone\.png"):
        render_clip(files["clip.npz"], files["body.npz"], tmp_path / "out", gone)
