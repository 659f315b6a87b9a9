"""The index of a twin set, and the exact people, as they are read."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gmrdata.film.programmes import camera_programme
from gmrdata.film.scene import SceneConfig
from gmrdata.motion.gait import make_gait
from gmrdata.twins.twin_set import TwinSequence, TwinsRecord, read_truth
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, save_clip
from gmrdata.values.errors import BadRecord, BadSequence, MissingInput
from gmrdata.values.files import write_json
from tests.record_keys import assert_each_key_is_needed


def write_index(folder: Path, record: Any) -> None:
    (folder / "truth").mkdir(exist_ok=True)
    write_json(folder / "truth" / "twins.json", record)


def about(name: str, kind: str, people: int) -> dict[str, Any]:
    seen: dict[str, Any] = {"scene": {"kind": "park"}, "programme": {"kind": "static"}}
    return {"name": name, "class_true": kind, "people": people, "trial": "gait walk"} | seen


def test_people_come_in_order(tmp_path: Path, small_body: BodyModel) -> None:
    rows = [about("park_00", "linear", 2), about("park", "static", 1)]
    write_index(tmp_path, {"format": "gmrdata-twins/1", "sequences": rows})
    motion = make_gait("walk", 0.5, 30.0, small_body, np.random.default_rng(0))
    n = np.arange(motion.n_frames)
    for id in ("park_00.p0", "park_00.p1"):
        rest_pelvis_m = small_body.rest_pelvis_m(motion.shape)
        save_clip(
            tmp_path / "truth" / f"{id}.npz", Clip(id, motion, n >= 0, n, None), rest_pelvis_m
        )
    twins = read_truth(tmp_path)
    assert twins.classes == {"park_00": "linear", "park": "static"}
    assert twins.root == tmp_path / "3DPW"
    assert [clip.id for clip in twins.people("park_00")] == ["park_00.p0", "park_00.p1"]
    with pytest.raises(MissingInput, match=r"no park\.p0\.npz"):
        twins.people("park")
    with pytest.raises(MissingInput, match="no twin 'room_00'; there are park_00, park"):
        twins.people("room_00")


@pytest.mark.parametrize(
    ("record", "said"),
    [
        ([], "has no `format`"),
        ({"sequences": [about("a", "linear", 1)]}, "has no `format`.*make it again.*--redo"),
        ({"format": "gmrdata-twins/1"}, "has no key `sequences`"),
        ({"format": "gmrdata-twins/1", "sequences": [{"name": "a"}]}, "sequences.0.class_true`"),
        ({"format": "gmrdata-twins/1", "sequences": [1]}, "`sequences.0` is wrong"),
    ],
)
def test_a_broken_index_is_named(tmp_path: Path, record: Any, said: str) -> None:
    write_index(tmp_path, record)
    with pytest.raises(BadRecord, match=rf"twins\.json: .*{said}"):
        read_truth(tmp_path)


def test_names_lead_nowhere_else(tmp_path: Path) -> None:
    rows = [about("../../x", "linear", 1)]
    write_index(tmp_path, {"format": "gmrdata-twins/1", "sequences": rows})
    with pytest.raises(BadSequence, match="is no name of a sequence"):
        read_truth(tmp_path)


def test_a_folder_without_index_is_no_twin_set(tmp_path: Path) -> None:
    with pytest.raises(MissingInput, match="give a folder that `gmrdata threedpw twin` made"):
        read_truth(tmp_path)


def test_each_key_of_the_index_is_needed(tmp_path: Path) -> None:
    sequence = TwinSequence(
        "park_00", "static", "gait walk", 1, SceneConfig(), camera_programme("static")
    )
    record = TwinsRecord(sequences=(sequence,))
    # Scene and programme are parts of a recipe, with its defaults.
    free = ("sequences.0.scene", "sequences.0.scene.extras", "sequences.0.programme")
    assert_each_key_is_needed(record, tmp_path / "twins.json", free)
