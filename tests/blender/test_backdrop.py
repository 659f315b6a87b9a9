"""A .blend file as the place: seen as it was saved, placed where the recipe says, and never run."""

import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from matplotlib.font_manager import findfont
from pydantic import ValidationError

from gmrdata.film.render import RenderConfig
from gmrdata.film.render_outputs import read_flow
from gmrdata.film.scene import BackdropConfig, SceneConfig
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import project
from gmrdata.values.clip import camera_of, load_clip
from gmrdata.values.errors import RenderFailed
from gmrdata.values.files import read_json, sha256_of_file
from tests.blender.jobs import (
    Job,
    ask_blender,
    camera_at,
    facing_x,
    grown,
    mask_of,
    save_job,
    unprojected,
)

N_FRAMES, SIZE_PX = 2, (160, 90)
ORIGIN_M, YAW_DEG = (10.0, 20.0, 1.0), 90.0
"""Our x axis is the file's y: the north wall (y = 23.9) is at x = 3.9, the east wall (x = 15.9) at
y = -5.9, and the cube's near side (y = 21.5) at x = 1.5."""


@pytest.fixture(scope="module")
def blend(box_place) -> Path:
    return box_place.backdrop.path


def save_clip_at(folder: Path, body: BodyModel, person_m: tuple[float, float]) -> Job:
    """Two frames of someone who stands there, filmed from 4 m before the origin towards +x."""
    centres_m = [[-4.0, 0.0, 1.5], [-4.0, 0.1, 1.5]]
    camera = camera_at(centres_m, [[1.0, 0.0, 1.0]] * N_FRAMES, SIZE_PX)
    return save_job(folder, body, facing_x(body, [[*person_m, 0.97]] * N_FRAMES), camera)


def config(path: Path, **more: Any) -> RenderConfig:
    backdrop = BackdropConfig(path=path, origin_m=ORIGIN_M, yaw_deg=YAW_DEG, **more)
    scene = SceneConfig(kind="blend", backdrop=backdrop)
    return RenderConfig(scene=scene, samples=2, image_format="png", depth=True, flow=True)


@pytest.fixture(scope="module")
def rendered(blend, small_body, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("backdrop")
    return save_clip_at(folder, small_body, (0.0, 1.5)).render(folder / "out", config(blend))


def test_the_file_lies_where_the_recipe_puts_it_and_stays_there(rendered):
    for row in range(N_FRAMES):
        mask = mask_of(rendered, row)
        assert 100 < mask.sum() < 2000
        seen_m = unprojected(rendered, row)[~grown(mask, 3)]
        x, y, z = seen_m.T
        on_floor, on_wall = np.abs(z) < 0.02, np.abs(x - 3.9) < 0.02
        cube = (np.abs(x - 1.5) < 0.02) & (np.abs(y) < 0.51) & (z < 1.01)
        assert on_floor.sum() > 3000 and on_wall.sum() > 1000
        # The cube neither went where its keys lead nor was scaled by its driver.
        assert cube.sum() > 200
        np.testing.assert_allclose([y[cube].min(), y[cube].max()], [-0.5, 0.5], atol=0.04)
        assert np.nanmin(z) > -0.02


def test_lamp_and_picture_are_the_files(rendered):
    frame = cv2.imread(str(rendered / "frames/00000.png"), cv2.IMREAD_GRAYSCALE)
    x, y, z = np.moveaxis(unprojected(rendered, 0), -1, 0)
    front = (np.abs(x - 1.5) < 0.02) & (np.abs(y) < 0.45) & (z > 0.05) & (z < 0.95)
    floor = (np.abs(z) < 0.02) & (x < 1)
    assert frame[floor].mean() > 60
    assert frame[front].max() > frame[floor].max() / 2  # lit by the lamp


def test_the_background_flows_as_the_camera_moves(rendered):
    flow_px = read_flow(rendered / "flow/00000.png")
    camera, seen_m = camera_of(load_clip(rendered / "clip.npz")), unprojected(rendered, 0)
    y, x = np.nonzero(np.abs(seen_m[..., 0] - 3.9) < 0.02)
    next_px = project(camera.world_from_cam[1], seen_m[y, x], camera.intrinsics_px)
    expected_px = next_px - np.c_[x + 0.5, y + 0.5]
    assert len(x) > 1000 and np.abs(expected_px).max() > 1
    assert np.abs(flow_px[y, x] - expected_px).max() < 0.1


def test_nothing_of_the_file_is_run_and_it_is_an_input(rendered, blend):
    assert (rendered / "frames/00001.png").is_file()
    assert not blend.with_name("victim").exists()
    assert read_json(rendered / "stage.json")["inputs"]["backdrop"] == sha256_of_file(blend)


def test_nobody_walks_through_a_wall_unless_asked(blend, small_body, tmp_path):
    job = save_clip_at(tmp_path, small_body, (4.0, 0.0))
    with pytest.raises(RenderFailed, match=r"frame 0 the person goes through 'WallNorth'"):
        job.render(tmp_path / "out", config(blend))
    job.render(tmp_path / "out", config(blend, allow_collisions=True))
    assert (tmp_path / "out/frames/00001.png").is_file()


def test_files_that_cannot_be_a_place(blend, small_body, tmp_path):
    job = save_clip_at(tmp_path, small_body, (0.0, 1.5))
    whole = blend.read_bytes()
    bad = {
        "hello": (b"hello", "can't read it"),
        "cut": (whole[: len(whole) // 2], "can't read it"),
        "newer": (re.sub(rb"v05\d\d", b"v0900", whole, count=1), "by Blender 9.0, newer than"),
    }
    for name, (content, message) in bad.items():
        path = tmp_path / f"{name}.blend"
        path.write_bytes(content)
        with pytest.raises(RenderFailed, match=message) as caught:
            job.render(tmp_path / name, config(path))
        assert path.name in str(caught.value)
    with pytest.raises(RenderFailed, match=r"has the scenes Scene and not 'Attic'"):
        job.render(tmp_path / "s", config(blend, scene_name="Attic"))


@pytest.mark.parametrize(
    "said",
    [
        {"kind": "blend"},
        {"kind": "street", "backdrop": {"path": "a.blend"}},
        {"kind": "blend", "backdrop": {"path": "a.blend"}, "light": "sun"},
        {"kind": "blend", "backdrop": {"path": "a.blend"}, "hdri_path": "a.hdr"},
    ],
)
def test_recipes_that_do_not_fit_together(said):
    with pytest.raises(ValidationError, match="backdrop: "):
        SceneConfig.model_validate(said)


def test_what_a_file_would_take_from_elsewhere_is_refused_by_name(tmp_path):
    found = ask_blender("odd_backdrops_by_blender.py", tmp_path, findfont("DejaVu Sans"))
    assert found.pop("plain") == found.pop("small_generated_picture") == ""
    endless = found.pop("generated_picture")
    assert "its picture 'endless' has 3600000000 pixels" in endless
    assert "its Unit Scale is 0.01, so its lengths are no metres" in found.pop("centimetres")
    parts = {
        "picture_beside": "beside",
        "device_as_picture": "zeros",
        "font": "DejaVu Sans Book",
        "volume": "fog",
        "linked_library": "library.blend",
        # It was taken for the file itself, and its changes were in no hash.
        "library_of_the_same_name": "library_of_the_same_name.blend.001",
        "light_profile": "profile",
    }
    assert found.keys() == parts.keys()
    for name, part in parts.items():
        assert f"{name}.blend: needs other files ({part})." in found[name]


@pytest.fixture(scope="module")
def placed(tmp_path_factory) -> dict[str, Any]:
    return dict(ask_blender("placed_by_blender.py", tmp_path_factory.mktemp("placed")))


def test_things_stand_where_the_file_has_them(placed):
    """What hangs on a camera, a constraint or an instance was left behind, or moved twice."""
    should, found = placed["should"], placed["found"]
    assert found.keys() == should.keys()
    for name, world in should.items():
        np.testing.assert_allclose(found[name], world, atol=1e-5, err_msg=name)
    np.testing.assert_allclose(placed["axes"], placed["should_axes"], atol=1e-5)


def test_rays_meet_what_is_rendered(placed):
    assert placed["hidden in the viewport"] == "Shown" and placed["not rendered"] is None
