"""FORMAT.md says what is so."""

import re

import numpy as np

from gmrdata.manifest.read import json_schema, load_clips
from gmrdata.stage.recipes import schema_v1
from gmrdata.values import clip as clip_file
from gmrdata.values.camera import project

PAGE = (schema_v1().parents[1] / "FORMAT.md").read_text()


def test_every_field_is_on_the_page():
    words = set(re.findall(r"\w+", PAGE))
    fields = {name for model in json_schema()["$defs"].values() for name in model["properties"]}
    assert fields - words == set()


def test_every_array_is_on_the_page(finished_data_set):
    words = set(re.findall(r"`(\w+)`", PAGE))
    assert set(clip_file.read_npz(finished_data_set / "clips" / "walk.npz")) - words == set()


def test_the_pages_own_loader(finished_data_set, monkeypatch):
    code = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    monkeypatch.chdir(finished_data_set)
    found: dict[str, np.ndarray] = {}
    exec(code[0], found)
    clip = load_clips(finished_data_set / "set.yaml")[1]
    camera = clip.camera
    assert camera is not None
    np.testing.assert_allclose(found["pelvis_m"], clip.motion.pelvis_m[clip.valid], atol=1e-12)
    pelvis_px = project(
        camera.world_from_cam[clip.valid],
        clip.motion.pelvis_m[clip.valid][:, None],
        camera.intrinsics_px,
    )[:, 0]
    in_front = np.isfinite(pelvis_px).all(axis=1)
    assert in_front.any()
    np.testing.assert_allclose(found["pelvis_px"][in_front, :2], pelvis_px[in_front], rtol=1e-9)
