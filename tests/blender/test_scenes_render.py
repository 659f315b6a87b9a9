"""Real renders of other places, lights and skies, at a small size."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.film.render import RenderConfig
from gmrdata.film.scene import SceneConfig
from gmrdata.values.body import BodyModel
from gmrdata.values.errors import MissingInput, RenderFailed, StaleOutput
from tests.blender.jobs import Job, camera_at, facing_x, in_blender, n_features, save_job

SIZE_PX = (320, 180)


def save_view(folder: Path, body: BodyModel, target_m: tuple[float, float, float]) -> Job:
    """A clip of one frame: someone at the origin, a camera five metres off, and where it looks."""
    camera = camera_at([[5.0, 0.0, 1.5]], [target_m], SIZE_PX)
    return save_job(folder, body, facing_x(body, [[0.0, 0.0, 0.95]]), camera)


def picture(job: Job, out_dir: Path, scene: SceneConfig, *, blend: bool = False) -> np.ndarray:
    job.render(out_dir, RenderConfig(samples=4, scene=scene, jpeg_quality=98, blend=blend))
    return np.asarray(cv2.imread(str(out_dir / "frames/00000.jpg"), cv2.IMREAD_COLOR))


def loose_pictures(blend_path: Path, folder: Path) -> list[str]:
    """Pictures that a saved scene doesn't hold itself, so that it loses them elsewhere."""
    script = folder / "loose.py"
    script.write_text(
        "import sys, bpy\n"
        "bpy.ops.wm.open_mainfile(filepath=sys.argv[1])\n"
        "print('LOOSE', *(i.name for i in bpy.data.images if i.packed_file is None))\n"
    )
    _, *names = in_blender(script, blend_path).stdout.strip().splitlines()[-1].split()
    return names


@pytest.mark.parametrize("light", ["overcast", None])
def test_a_room_and_a_street_without_shadows_have_much_to_see(small_body, tmp_path, light):
    job = save_view(tmp_path, small_body, (0.0, 0.0, 0.95))
    scene = SceneConfig.model_validate({"kind": "street" if light else "room", "light": light})
    frame = picture(job, tmp_path / "out", scene)
    assert n_features(tmp_path / "out", 0) > 300
    assert (frame.max(axis=2) < 12).mean() < 0.1  # not dark
    assert (frame.min(axis=2) > 250).mean() < 0.1  # not burnt out
    assert 40 < frame.mean() < 190


def test_the_sky_is_the_file(small_body, tmp_path):
    """Looking up along -x, where a sky with a colour for each half of the compass shows both."""
    job = save_view(tmp_path, small_body, (4.9, 0.0, 1.9))
    sky_path = tmp_path / "sky.hdr"
    linear = np.zeros((16, 32, 3), np.float32)
    linear[:, :16], linear[:, 16:] = (0.0, 0.0, 0.25), (0.25, 0.0, 0.0)  # red, then blue
    assert cv2.imwrite(str(sky_path), linear)
    scene = SceneConfig(hdri_path=sky_path)
    out_dir = tmp_path / "out"
    frame = picture(job, out_dir, scene, blend=True)
    bright = round(255 * (1.055 * 0.25 ** (1 / 2.4) - 0.055))
    colours = {tuple(np.round(frame[20, x] / bright).astype(int).tolist()) for x in (40, 280)}
    assert colours == {(0, 0, 1), (1, 0, 0)}
    assert loose_pictures(out_dir / "scene/scene.blend", tmp_path) == []
    linear[:] = 0.5
    assert cv2.imwrite(str(sky_path), linear)
    with pytest.raises(StaleOutput, match=r"inputs\.hdri"):
        picture(job, out_dir, scene)


def test_skies_that_are_not_there(small_body, tmp_path):
    job = save_view(tmp_path, small_body, (0.0, 0.0, 0.95))
    sky_path = tmp_path / "sky.hdr"
    with pytest.raises(MissingInput, match=r"sky\.hdr: no such file"):
        picture(job, tmp_path / "out", SceneConfig(hdri_path=sky_path))
    sky_path.write_text("no picture", encoding="utf-8")
    with pytest.raises(RenderFailed, match=r"sky\.hdr: Blender (can't|finds no)"):
        picture(job, tmp_path / "out", SceneConfig(hdri_path=sky_path))
