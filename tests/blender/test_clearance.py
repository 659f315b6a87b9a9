"""How near the camera and the person come to what stands about, by Blender's own surfaces."""

import json
from typing import Any

import pytest

from gmrdata.film.render_outputs import Clearance, clearance_figures
from gmrdata.values.errors import BadRecord
from gmrdata.values.files import read_json, write_json
from tests.blender.jobs import ask_blender

# A box fills x 4 to 6, y -1 to 1, z 0 to 2; a wall 2 cm thick stands at y = 3, x -1 to 1, z 0 to 2.
PERSON = [[0.0, 0.0, 1.0], [0.5, 0.0, 1.0]]
CASES = {
    "clear": {"camera_m": [[0.0, -4.0, 1.5], [1.0, -4.0, 1.5]], "pelvis_m": PERSON},
    "behind the wall for a frame": {
        "camera_m": [[0.0, 4.0, 1.5], [3.0, 4.0, 1.5]],
        "pelvis_m": [[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]],
    },
    "through the wall from one frame to the next": {
        "camera_m": [[0.5, 2.0, 1.5], [0.5, 4.0, 1.5]],
        "pelvis_m": PERSON,
    },
    "touches": {"camera_m": [[3.0, 0.0, 1.5], [3.97, 0.0, 1.5]], "pelvis_m": PERSON},
    "inside": {"camera_m": [[5.0, 0.0, 1.0], [5.1, 0.0, 1.0]], "pelvis_m": PERSON},
    "walks into the box": {
        "camera_m": [[0.0, -4.0, 1.5]] * 3,
        "pelvis_m": [[3.0, 0.0, 1.0], [3.5, 0.0, 1.0], [4.5, 0.0, 1.0]],
    },
}


@pytest.fixture(scope="module")
def answers(tmp_path_factory) -> dict[str, Any]:
    path = tmp_path_factory.mktemp("clearance") / "cases.json"
    path.write_text(json.dumps(CASES))
    return dict(ask_blender("clearance_by_blender.py", path))


def test_distances_are_those_to_the_nearest_surface(answers):
    assert answers["nothing"] is None  # the ground doesn't count
    clear = answers["clear"]
    # From (1, -4, 1.5) to the box's edge x = 4, y = -1; from (0, 0, 1) to the wall's face.
    assert clear["camera_m"] == pytest.approx(18**0.5, abs=1e-4)
    assert clear["person_m"] == pytest.approx(2.99, abs=1e-4)
    assert clear["sight_share"] == 1.0


def test_what_hides_the_person_is_counted(answers):
    hidden = answers["behind the wall for a frame"]
    assert hidden["sight_share"] == 0.5
    assert hidden["camera_m"] == pytest.approx(0.99, abs=1e-4)


@pytest.mark.parametrize(
    ("case", "message"),
    [
        ("through the wall from one frame to the next", "frame 1: the camera's path leads through"),
        ("touches", "frame 1: the camera's path leads through"),
        ("inside", "hides the person from the camera in every frame"),
        ("walks into the box", "frame 2: the person's path leads through"),
    ],
)
def test_a_path_through_a_thing_is_an_error(answers, case, message):
    assert message in answers[case] and "scene.seed" in answers[case]


def test_a_backdrop_that_hides_the_person_or_stands_in_someones_way_is_an_error(answers):
    """A clip without the person in any picture was rendered, and passers-by went through walls."""
    told = answers["backdrop"]
    assert told["clear"] == told["hidden in one frame"] == ""
    assert told["hidden"].startswith("a.blend: 'thing1' hides the person from the camera in every")
    assert told["through"].startswith("a.blend: in frame 0 passer_by_1 goes through 'thing1'; ")
    assert "another scene.seed for extras" in told["through"]


def test_the_figures_come_back_from_the_file_and_each_key_is_needed(tmp_path):
    assert clearance_figures(tmp_path) == {}
    path = tmp_path / "clearance.json"
    Clearance(camera_m=1.25, person_m=0.8, sight_share=0.75).write(path)
    whole = read_json(path)
    assert clearance_figures(tmp_path) == {
        "camera_clearance_m": 1.25,
        "person_clearance_m": 0.8,
        "clear_sight_share": 0.75,
    }
    write_json(path, whole | {"camera_m": -1})
    with pytest.raises(BadRecord, match=r"json: `camera_m` .*greater than 0; make it again"):
        clearance_figures(tmp_path)
    for key in ("format", "camera_m", "person_m", "sight_share"):
        write_json(path, {k: value for k, value in whole.items() if k != key})
        with pytest.raises(BadRecord, match=rf"clearance\.json: has no (key )?`{key}`.*--redo"):
            clearance_figures(tmp_path)
