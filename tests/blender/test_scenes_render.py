"""Real renders of other places, lights and skies, at a small size."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.film.camera_moves import look_at
from gmrdata.film.render import RenderConfig, render_clip
from gmrdata.film.scene import SceneConfig
from gmrdata.read.body_file import save_body
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath, intrinsics_from_fov
from gmrdata.values.clip import Clip, save_clip
from gmrdata.values.errors import MissingInput, RenderFailed, StaleOutput
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import rigid

WIDTH_PX, HEIGHT_PX = 320, 180
STANDS = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
CENTRE_M = np.array([[5.0, 0.0, 1.5]])


def save_view(folder: Path, body: BodyModel, target_m: tuple[float, float, float]) -> Path:
    """A clip of one frame: someone at the origin, a camera five metres off, and where it looks."""
    motion = Motion(
        np.tile(np.eye(3), (1, 23, 1, 1)),
        STANDS[None],
        np.array([[0.0, 0.0, 0.95]]),
        np.zeros(body.n_shape),
        10.0,
        body.name,
        "neutral",
        "world",
        "stands",
    )
    pose = rigid(look_at(CENTRE_M, np.array([target_m])), CENTRE_M)
    intrinsics_px = intrinsics_from_fov(60.0, WIDTH_PX, HEIGHT_PX)
    camera = CameraPath(intrinsics_px, WIDTH_PX, HEIGHT_PX, pose, np.ones(1, bool))
    path = folder / "clip.npz"
    clip = Clip("stands", motion, np.ones(1, bool), np.full(1, -1), camera)
    save_clip(path, clip, body.rest_pelvis_m(motion.shape))
    return path


@pytest.fixture(scope="module")
def body_path(small_body: BodyModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("body") / "body.npz"
    save_body(path, small_body)
    return path


def picture(clip_path: Path, body_path: Path, out_dir: Path, scene: SceneConfig) -> np.ndarray:
    config = RenderConfig(samples=4, scene=scene, jpeg_quality=98)
    render_clip(clip_path, body_path, out_dir, config, on_frame=lambda _: None)
    return np.asarray(cv2.imread(str(out_dir / "frames/00000.jpg"), cv2.IMREAD_COLOR))


@pytest.mark.parametrize("light", ["overcast", None])
def test_a_room_and_a_street_without_shadows_have_much_to_see(
    small_body: BodyModel, body_path: Path, tmp_path: Path, light: str | None
) -> None:
    clip_path = save_view(tmp_path, small_body, (0.0, 0.0, 0.95))
    scene = SceneConfig.model_validate({"kind": "street" if light else "room", "light": light})
    frame = picture(clip_path, body_path, tmp_path / "out", scene)
    mask = cv2.imread(str(tmp_path / "out/masks/00000.png"), cv2.IMREAD_GRAYSCALE)
    outside = np.where(cv2.dilate(mask, np.ones((5, 5), np.uint8)) == 0, 255, 0).astype(np.uint8)
    assert len(cv2.SIFT.create().detect(frame, outside)) > 300
    assert (frame.max(axis=2) < 12).mean() < 0.1  # not dark
    assert (frame.min(axis=2) > 250).mean() < 0.1  # not burnt out
    assert 40 < frame.mean() < 190


def test_the_sky_is_the_file(small_body: BodyModel, body_path: Path, tmp_path: Path) -> None:
    """Looking up along -x, where a sky with a colour for each half of the compass shows both."""
    clip_path = save_view(tmp_path, small_body, (4.9, 0.0, 1.9))
    sky_path = tmp_path / "sky.hdr"
    linear = np.zeros((16, 32, 3), np.float32)
    linear[:, :16], linear[:, 16:] = (0.0, 0.0, 0.25), (0.25, 0.0, 0.0)  # red, then blue
    assert cv2.imwrite(str(sky_path), linear)
    scene = SceneConfig(hdri_path=sky_path)
    out_dir = tmp_path / "out"
    frame = picture(clip_path, body_path, out_dir, scene)
    bright = round(255 * (1.055 * 0.25 ** (1 / 2.4) - 0.055))
    colours = {tuple(np.round(frame[20, x] / bright).astype(int).tolist()) for x in (40, 280)}
    assert colours == {(0, 0, 1), (1, 0, 0)}
    linear[:] = 0.5
    assert cv2.imwrite(str(sky_path), linear)
    with pytest.raises(StaleOutput, match=r"inputs\.hdri"):
        picture(clip_path, body_path, out_dir, scene)


def test_skies_that_are_not_there(small_body: BodyModel, body_path: Path, tmp_path: Path) -> None:
    clip_path = save_view(tmp_path, small_body, (0.0, 0.0, 0.95))
    sky_path = tmp_path / "sky.hdr"
    with pytest.raises(MissingInput, match=r"sky\.hdr: no such file"):
        picture(clip_path, body_path, tmp_path / "out", SceneConfig(hdri_path=sky_path))
    sky_path.write_text("no picture", encoding="utf-8")
    with pytest.raises(RenderFailed, match=r"sky\.hdr: Blender (can't|finds no)"):
        picture(clip_path, body_path, tmp_path / "out", SceneConfig(hdri_path=sky_path))
