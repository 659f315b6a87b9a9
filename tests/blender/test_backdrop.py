"""A .blend file as the place: seen as it was saved, placed where the recipe says, and never run."""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from gmrdata.film.camera_moves import look_at
from gmrdata.film.render import RenderConfig, render_clip
from gmrdata.film.render_outputs import read_depth, read_flow
from gmrdata.film.scene import BackdropConfig, SceneConfig
from gmrdata.read.body_file import save_body
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath, intrinsics_from_fov, project
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.errors import RenderFailed
from gmrdata.values.files import read_json, sha256_of_file
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import apply, rigid

N_FRAMES, WIDTH_PX, HEIGHT_PX = 2, 160, 90
ORIGIN_M, YAW_DEG = (10.0, 20.0, 1.0), 90.0
"""Our x axis is the file's y: the north wall (y = 23.9) is at x = 3.9, the east wall (x = 15.9) at
y = -5.9, and the cube's near side (y = 21.5) at x = 1.5."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("backdrop")


@pytest.fixture(scope="module")
def blend(folder: Path) -> Path:
    path = folder / "place.blend"
    maker = Path(__file__).parent / "make_backdrop.py"
    subprocess.run([sys.executable, str(maker), str(path), str(folder / "victim")], check=True)
    (folder / "victim").unlink(missing_ok=True)  # who makes such a file runs it
    return path


def save_clip_at(folder: Path, body: BodyModel, person_m: tuple[float, float]) -> Path:
    """Two frames of someone who stands there, filmed from 4 m before the origin towards +x."""
    motion = Motion(
        np.tile(np.eye(3), (N_FRAMES, 23, 1, 1)),
        np.tile([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], (N_FRAMES, 1, 1)),
        np.tile([*person_m, 0.97], (N_FRAMES, 1)),
        np.zeros(body.n_shape),
        10.0,
        body.name,
        "neutral",
        "world",
        "stands",
    )
    centres_m = np.array([[-4.0, 0.0, 1.5], [-4.0, 0.1, 1.5]])
    pose = rigid(look_at(centres_m, np.tile([1.0, 0.0, 1.0], (N_FRAMES, 1))), centres_m)
    intrinsics_px = intrinsics_from_fov(60.0, WIDTH_PX, HEIGHT_PX)
    camera = CameraPath(intrinsics_px, WIDTH_PX, HEIGHT_PX, pose, np.ones(N_FRAMES, bool))
    clip = Clip("stands", motion, np.ones(N_FRAMES, bool), np.full(N_FRAMES, -1), camera)
    save_clip(folder / "clip.npz", clip, body.rest_pelvis_m(motion.shape))
    save_body(folder / "body.npz", body)
    return folder / "clip.npz"


def config(path: Path, **more: Any) -> RenderConfig:
    backdrop = BackdropConfig(path=path, origin_m=ORIGIN_M, yaw_deg=YAW_DEG, **more)
    scene = SceneConfig(kind="blend", backdrop=backdrop)
    return RenderConfig(scene=scene, samples=2, image_format="png", depth=True, flow=True)


@pytest.fixture(scope="module")
def rendered(folder: Path, blend: Path, small_body: BodyModel) -> Path:
    clip = save_clip_at(folder, small_body, (0.0, 1.5))
    out_dir = folder / "out"
    return render_clip(clip, folder / "body.npz", out_dir, config(blend), on_frame=lambda _: None)


def points_m(rendered: Path, row: int) -> np.ndarray:
    """(H, W, 3) world points [m] of a frame's depth; NaN where nothing is seen."""
    camera = camera_of(load_clip(rendered / "clip.npz"))
    depth_m = read_depth(rendered / f"depth/{row:05d}.png")[..., None]
    x, y = np.meshgrid(np.arange(WIDTH_PX) + 0.5, np.arange(HEIGHT_PX) + 0.5)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(camera.intrinsics_px).T
    cam_m = np.where(np.isfinite(depth_m), depth_m, np.nan) * rays
    return apply(camera.world_from_cam[row], cam_m.reshape(-1, 3)).reshape(rays.shape)


def test_the_file_lies_where_the_recipe_puts_it_and_stays_there(rendered: Path) -> None:
    for row in range(N_FRAMES):
        mask = cv2.imread(str(rendered / f"masks/{row:05d}.png"), cv2.IMREAD_GRAYSCALE)
        assert 100 < (mask > 0).sum() < 2000
        seen_m = points_m(rendered, row)[cv2.dilate(mask, np.ones((3, 3), np.uint8)) == 0]
        x, y, z = seen_m.T
        on_floor, on_wall = np.abs(z) < 0.02, np.abs(x - 3.9) < 0.02
        cube = (np.abs(x - 1.5) < 0.02) & (np.abs(y) < 0.51) & (z < 1.01)
        assert on_floor.sum() > 3000 and on_wall.sum() > 1000
        # The cube neither went where its keys lead nor was scaled by its driver.
        assert cube.sum() > 200
        np.testing.assert_allclose([y[cube].min(), y[cube].max()], [-0.5, 0.5], atol=0.04)
        assert np.nanmin(z) > -0.02


def test_lamp_and_picture_are_the_files(rendered: Path) -> None:
    frame = cv2.imread(str(rendered / "frames/00000.png"), cv2.IMREAD_GRAYSCALE)
    x, y, z = np.moveaxis(points_m(rendered, 0), -1, 0)
    front = (np.abs(x - 1.5) < 0.02) & (np.abs(y) < 0.45) & (z > 0.05) & (z < 0.95)
    floor = (np.abs(z) < 0.02) & (x < 1)
    assert frame[floor].mean() > 60
    assert frame[front].max() > frame[floor].max() / 2  # lit by the lamp


def test_the_background_flows_as_the_camera_moves(rendered: Path) -> None:
    flow_px = read_flow(rendered / "flow/00000.png")
    camera, seen_m = camera_of(load_clip(rendered / "clip.npz")), points_m(rendered, 0)
    y, x = np.nonzero(np.abs(seen_m[..., 0] - 3.9) < 0.02)
    next_px = project(camera.world_from_cam[1], seen_m[y, x], camera.intrinsics_px)
    expected_px = next_px - np.c_[x + 0.5, y + 0.5]
    assert len(x) > 1000 and np.abs(expected_px).max() > 1
    assert np.abs(flow_px[y, x] - expected_px).max() < 0.1


def test_nothing_of_the_file_is_run(rendered: Path) -> None:
    assert (rendered / "frames/00001.png").is_file()
    assert not (rendered.parent / "victim").exists()


def test_the_file_is_an_input_of_the_stage(rendered: Path, blend: Path) -> None:
    assert read_json(rendered / "stage.json")["inputs"]["backdrop"] == sha256_of_file(blend)


def test_nobody_walks_through_a_wall_unless_asked(
    blend: Path, small_body: BodyModel, tmp_path: Path
) -> None:
    clip, body = save_clip_at(tmp_path, small_body, (4.0, 0.0)), tmp_path / "body.npz"
    with pytest.raises(RenderFailed, match=r"frame 0 the person goes through 'WallNorth'"):
        render_clip(clip, body, tmp_path / "out", config(blend), on_frame=lambda _: None)
    allowed = config(blend, allow_collisions=True)
    render_clip(clip, body, tmp_path / "out", allowed, on_frame=lambda _: None)
    assert (tmp_path / "out/frames/00001.png").is_file()


def test_files_that_cannot_be_a_place(blend: Path, small_body: BodyModel, tmp_path: Path) -> None:
    clip, body = save_clip_at(tmp_path, small_body, (0.0, 1.5)), tmp_path / "body.npz"
    whole = blend.read_bytes()
    bad = {
        "hello": (b"hello", "can't read it"),
        "cut": (whole[: len(whole) // 2], "can't read it"),
        "newer": (
            re.sub(rb"v05\d\d", b"v0900", whole, count=1),
            "saved by Blender 9.0, newer than",
        ),
    }
    for name, (content, message) in bad.items():
        path = tmp_path / f"{name}.blend"
        path.write_bytes(content)
        with pytest.raises(RenderFailed, match=message) as caught:
            render_clip(clip, body, tmp_path / name, config(path), on_frame=lambda _: None)
        assert path.name in str(caught.value)
    with pytest.raises(RenderFailed, match=r"has the scenes Scene and not 'Attic'"):
        render_clip(
            clip, body, tmp_path / "s", config(blend, scene_name="Attic"), on_frame=lambda _: None
        )


@pytest.mark.parametrize(
    "said",
    [
        {"kind": "blend"},
        {"kind": "street", "backdrop": {"path": "a.blend"}},
        {"kind": "blend", "backdrop": {"path": "a.blend"}, "light": "sun"},
        {"kind": "blend", "backdrop": {"path": "a.blend"}, "hdri_path": "a.hdr"},
    ],
)
def test_recipes_that_do_not_fit_together(said: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match="backdrop: "):
        SceneConfig.model_validate(said)


def test_what_a_file_would_take_from_elsewhere_is_refused_by_name(tmp_path: Path) -> None:
    root = Path(__file__).parents[2]
    said = subprocess.run(
        [sys.executable, Path(__file__).with_name("odd_backdrops_by_blender.py"), tmp_path],
        capture_output=True,
        text=True,
        check=True,
        cwd=root,
        env={"PYTHONPATH": str(root)},
    )
    found = json.loads(said.stdout.split("\nANSWER ")[1])
    assert found.pop("plain") == found.pop("small_generated_picture") == ""
    endless = found.pop("generated_picture")
    assert "its picture 'endless' has 3600000000 pixels" in endless
    parts = {
        "picture_beside": "beside",
        "device_as_picture": "zeros",
        "font": "DejaVu Sans Book",
        "volume": "fog",
        "linked_library": "library.blend",
        "light_profile": "profile",
    }
    assert found.keys() == parts.keys()
    for name, part in parts.items():
        assert f"{name}.blend: needs other files ({part})." in found[name]
