"""OpenPose's JSON: which joints it gives, and files that are none."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.read.openpose import PAIRS, keypoint_files, read_people
from gmrdata.values.body import JOINT, JOINT_NAMES, MIRRORED
from gmrdata.values.errors import BadKeypoints, BadRecord, GmrdataError, MissingInput

BODY_25 = (
    "Nose", "Neck", "RShoulder", "RElbow", "RWrist", "LShoulder", "LElbow", "LWrist", "MidHip",
    "RHip", "RKnee", "RAnkle", "LHip", "LKnee", "LAnkle", "REye", "LEye", "REar", "LEar",
    "LBigToe", "LSmallToe", "LHeel", "RBigToe", "RSmallToe", "RHeel",
)  # fmt: skip
"""OpenPose's own names in its own order."""


def test_pairs_have_the_same_names() -> None:
    sides = {"R": "right_", "L": "left_"}
    for keypoint, joint in PAIRS.items():
        name = BODY_25[keypoint]
        expected = name.lower() if name == "Neck" else sides[name[0]] + name[1:].lower()
        assert JOINT_NAMES[joint] == expected
    assert sorted(MIRRORED[joint] for joint in PAIRS.values()) == sorted(PAIRS.values())


@pytest.mark.parametrize("n", [25, 21])
def test_each_keypoint_arrives_at_its_joint(tmp_path: Path, n: int) -> None:
    """In OpenPose's layout and STAF's; joints without a keypoint have no confidence."""
    path = tmp_path / "00000.json"
    flat = [value for i in range(n) for value in (10.0 * i, 10.0 * i + 1, i / 100)]
    person = {"person_id": [4], "pose_keypoints_2d": flat, "face_keypoints_2d": []}
    path.write_text(json.dumps({"version": 1.3, "people": [person]}))
    (found,) = read_people(path)
    assert found.id == 4
    np.testing.assert_array_equal(found.keypoints[JOINT["left_wrist"]], [70, 71, 0.07])
    np.testing.assert_array_equal(found.keypoints[JOINT["right_ankle"]], [110, 111, 0.11])
    assert found.confidence == pytest.approx(sum(keypoint / 100 for keypoint in PAIRS))
    unpaired = sorted(set(range(24)) - set(PAIRS.values()))
    assert not found.keypoints[unpaired].any()


def test_nobody_and_no_track(tmp_path: Path) -> None:
    path = tmp_path / "00000.json"
    path.write_text('{"people": []}')
    assert read_people(path) == []
    for track in ('"person_id": [-1], ', ""):
        path.write_text(f'{{"people": [{{{track}"pose_keypoints_2d": {[0.5] * 75}}}]}}')
        assert read_people(path)[0].id is None


FLAT = [1.0, 2.0, 0.5] * 25


@pytest.mark.parametrize(
    ("record", "words"),
    [
        ([], "no list of people"),
        ({"persons": []}, "no list of people"),
        ({"people": ["me"]}, "pose_keypoints_2d has none, expected 75 .BODY_25 of OpenPose. or 63"),
        ({"people": [{"pose_keypoints_2d": FLAT[:54]}]}, "has 54 numbers"),
        ({"people": [{"pose_keypoints_2d": [None, *FLAT[1:]]}]}, "something that is no number"),
        ({"people": [{"pose_keypoints_2d": [True, *FLAT[1:]]}]}, "something that is no number"),
        ({"people": [{"pose_keypoints_2d": [float("nan"), *FLAT[1:]]}]}, "is no number"),
        ({"people": [{"pose_keypoints_2d": [10**400, *FLAT[1:]]}]}, "is no number"),
        ({"people": [{"pose_keypoints_2d": [*FLAT[:-1], -0.5]}]}, "a confidence below zero"),
        ({"people": [{"pose_keypoints_2d": FLAT, "person_id": ["3"]}]}, "person_id is"),
    ],
)
def test_json_of_another_kind(tmp_path: Path, record: Any, words: str) -> None:
    path = tmp_path / "00007_keypoints.json"
    path.write_text(json.dumps(record))
    with pytest.raises(BadKeypoints, match=rf"00007_keypoints.json: .*{words}"):
        read_people(path)


@given(st.integers(0, 400))
def test_a_truncated_file_is_named(tmp_path_factory: pytest.TempPathFactory, kept: int) -> None:
    path = tmp_path_factory.mktemp("cut") / "00007_keypoints.json"
    text = json.dumps({"people": [{"person_id": [0], "pose_keypoints_2d": FLAT}]})
    path.write_text(text[: min(kept, len(text) - 1)])
    with pytest.raises(BadRecord, match=r"00007_keypoints.json: not JSON"):
        read_people(path)


@given(st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4)
    | st.dictionaries(st.sampled_from(["people", "person_id", "pose_keypoints_2d"]), inner),
))  # fmt: skip
def test_whatever_json_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, record: Any
) -> None:
    path = tmp_path_factory.mktemp("any") / "1.json"
    path.write_text(json.dumps(record))
    try:
        assert read_people(path) == []
    except GmrdataError as error:
        assert "1.json" in str(error)


def test_frames_are_found_by_number(tmp_path: Path) -> None:
    for name in ("take2_000000000010_keypoints.json", "00009_keypoints.json", "notes.txt"):
        (tmp_path / name).write_text("{}")
    assert list(keypoint_files(tmp_path)) == [9, 10]
    (tmp_path / "9.json").write_text("{}")
    with pytest.raises(BadKeypoints, match=r"are both of frame 9"):
        keypoint_files(tmp_path)
    (tmp_path / "9.json").rename(tmp_path / "all.json")
    with pytest.raises(BadKeypoints, match=r"all.json: no number in the name"):
        keypoint_files(tmp_path)
    with pytest.raises(MissingInput, match="gone: no such folder"):
        keypoint_files(tmp_path / "gone")
    (tmp_path / "empty").mkdir()
    with pytest.raises(MissingInput, match="empty: no JSON files"):
        keypoint_files(tmp_path / "empty")
