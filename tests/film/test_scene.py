"""What a recipe may say of the place that it films in."""

import json
from pathlib import Path

import pytest
from pydantic import ValidationError

from gmrdata.film.render import full_json
from gmrdata.film.scene import SceneConfig


@pytest.mark.parametrize(
    ("said", "lit_by"),
    [
        ({}, "sun"),
        ({"kind": "street"}, "sun"),
        ({"kind": "room"}, "indoor"),
        ({"kind": "park", "light": "overcast"}, "overcast"),
        ({"kind": "room", "light": "indoor"}, "indoor"),
    ],
)
def test_light_suits_the_place(said: dict[str, str], lit_by: str) -> None:
    assert SceneConfig.model_validate(said).lit_by == lit_by


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({"kind": "room", "light": "sun"}, "a room has no other"),
        ({"kind": "street", "light": "indoor"}, "`indoor` is for a room"),
        ({"kind": "room", "hdri_path": "sky.hdr"}, "no sky is seen from a room"),
        ({"kind": "room", "extras": {"cars": 1}}, "a car doesn't fit a room"),
        ({"extras": {"dogs": 1}}, "Extra inputs are not permitted"),
        ({"extras": {"passers_by": -1}}, "greater than or equal to 0"),
        ({"kind": "moon"}, "Input should be 'courtyard', 'street', 'park', 'room' or 'blend'"),
    ],
)
def test_what_cannot_be(said: dict[str, str], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        SceneConfig.model_validate(said)


def test_a_sky_is_an_input_with_a_full_path_for_the_renderer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    scene = SceneConfig(hdri_path=Path("sky.hdr"))
    assert scene.inputs == {"hdri": Path("sky.hdr")}
    assert json.loads(full_json(scene))["hdri_path"] == str(tmp_path / "sky.hdr")
    (tmp_path / "a.bvh").touch()
    scene = SceneConfig.model_validate({"extras": {"passers_by": 1, "motions": ["a.bvh"]}})
    assert scene.inputs == {"extras_motion0": Path("a.bvh")}
    assert json.loads(full_json(scene))["extras"]["motions"] == [str(tmp_path / "a.bvh")]
    assert SceneConfig().inputs == {}
    assert SceneConfig.model_validate_json(full_json(SceneConfig())) == SceneConfig()
