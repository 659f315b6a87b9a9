"""Sequence files as they come, and as they should not."""

import pickle  # noqa: TID251  The tests write files that 3DPW's makers could have written.
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gmrdata.read import threedpw_files as parse
from gmrdata.read.threedpw_files import SequenceArrays, read_sequence_file
from gmrdata.values.errors import BadSequence

Content = dict[str, Any]


def read(tmp_path: Path, content: object, protocol: int = 2) -> SequenceArrays:
    path = tmp_path / "some.pkl"
    path.write_bytes(pickle.dumps(content, protocol))
    return read_sequence_file(path)


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_any_protocol_of_pickle_is_read(content, tmp_path, protocol):
    found = read(tmp_path, content, protocol)
    assert np.array_equal(found.people[1].poses_rad, content["poses"][1])
    assert found.people[0].campose_valid.tolist() == [bool(v) for v in content["campose_valid"][0]]


def test_cam_poses_is_world_to_camera(content, tmp_path):
    """The keypoints were made from the joints in the world, so only one direction can meet them."""
    found = read(tmp_path, content)
    person = found.people[0]
    joints_m = person.joints_world_m
    assert joints_m is not None
    for cam_from_world, hits in (
        (found.cam_from_world, True),
        (np.linalg.inv(found.cam_from_world), False),
    ):
        wrist_m = np.einsum("nij,nj->ni", cam_from_world[:, :3, :3], joints_m[:, 21])
        wrist_m += cam_from_world[:, :3, 3]
        wrist_px = (wrist_m @ found.intrinsics_px.T)[:, :2] / wrist_m[:, 2:]
        assert (np.abs(wrist_px - person.poses2d_px[:, 4, :2]).max() < 1e-6) == hits


def test_poses2d_has_its_axes_put_right_in_either_order(content, tmp_path):
    files_order = read(tmp_path, content)
    readme_order = [points.transpose(0, 2, 1) for points in content.pop("poses2d")]
    found = read(tmp_path, content | {"poses2D": readme_order})
    for one, other in zip(files_order.people, found.people, strict=True):
        assert one.poses2d_px.shape == (found.n_frames, 18, 3)
        assert np.array_equal(one.poses2d_px, other.poses2d_px)


@pytest.mark.parametrize(
    "given",
    [["f", "m"], [b"f", b"m"], [np.array("f"), np.str_("m")], ("f", "m"), ["female", "Male"]],
)
@pytest.mark.parametrize("key", ["genders", "gender"])
def test_gender_by_either_key_and_any_kind_of_string(content, tmp_path, given, key):
    del content["genders"]
    found = read(tmp_path, content | {key: given})
    assert [person.gender for person in found.people] == ["female", "male"]


@pytest.mark.parametrize("sequence", [np.array("abc"), np.array(["abc"]), b"abc", np.str_("abc")])
def test_the_name_may_be_any_kind_of_string(content, tmp_path, sequence):
    assert read(tmp_path, content | {"sequence": sequence}).name == "abc"


def test_longer_betas_are_kept_for_the_body_to_choose(content, tmp_path):
    content["betas"] = [np.arange(300.0) / 300, np.arange(10.0)]
    found = read(tmp_path, content)
    assert [len(person.betas) for person in found.people] == [300, 10]


def test_one_person(content, tmp_path):
    one = {key: value[:1] if isinstance(value, list) else value for key, value in content.items()}
    found = read(tmp_path, one)
    assert [person.gender for person in found.people] == ["female"]


def test_single_precision_and_big_endian_are_read(content, tmp_path):
    content["poses"] = [poses.astype(">f4") for poses in content["poses"]]
    content["campose_valid"] = [valid.astype(bool) for valid in content["campose_valid"]]
    poses_rad = read(tmp_path, content).people[0].poses_rad
    assert poses_rad.dtype == np.dtype("<f8")
    assert np.array_equal(poses_rad, content["poses"][0].astype(np.float64))


def test_nan_in_poses_is_kept(content, tmp_path):
    content["poses"][0][3, 5] = np.nan
    assert np.isnan(read(tmp_path, content).people[0].poses_rad).sum() == 1


@pytest.mark.parametrize(
    "key",
    ["sequence", "poses", "trans", "betas", "genders", "poses2d", "campose_valid", "cam_poses",
     "cam_intrinsics", "img_frame_ids"],
)  # fmt: skip
def test_a_missing_key_is_named(content, tmp_path, key):
    del content[key]
    with pytest.raises(BadSequence, match=rf"some\.pkl: .*lacks '{key}'"):
        read(tmp_path, content)


@pytest.mark.parametrize(
    "key", ["poses_60Hz", "trans_60Hz", "betas_clothed", "v_template_clothed", "jointPositions"]
)
def test_what_the_stages_do_not_need_may_be_missing(content, tmp_path, key):
    del content[key]
    assert read(tmp_path, content).n_frames == 30


def replaced(key: str, change: Callable[[Any], Any]) -> Callable[[Content], Content]:
    """Change an array, or the second person's."""

    def apply(content: Content) -> Content:
        value = content[key]
        new = [value[0], change(value[1])] if isinstance(value, list) else change(value)
        return content | {key: new}

    return apply


PER_FRAME = ("poses", "trans", "campose_valid", "poses2d", "jointPositions", "img_frame_ids")
PER_PERSON = ("trans", "betas", "genders", "campose_valid", "poses2d", "jointPositions")
BROKEN: dict[str, tuple[str, Callable[[Content], object]]] = {
    **{f"{key} too short": (key, replaced(key, lambda a: a[:-1])) for key in PER_FRAME},
    **{f"{key} too long": (key, replaced(key, lambda a: np.concatenate([a, a])))
       for key in PER_FRAME},
    **{f"{key} for one of two": (key, lambda c, key=key: c | {key: c[key][:1]})
       for key in PER_PERSON},
    "poses of objects": ("poses", replaced("poses", lambda a: a.astype(object))),
    "poses of strings": ("poses", replaced("poses", lambda a: a.astype("S8"))),
    "poses of complex": ("poses", replaced("poses", lambda a: a.astype(complex))),
    "poses as list": ("poses", replaced("poses", lambda a: a.tolist())),
    "poses as one array": ("poses", lambda c: c | {"poses": np.stack(c["poses"])}),
    "poses with 24 joints": ("poses", replaced("poses", lambda a: a.reshape(-1, 24, 3))),
    "poses of SMPL-H": ("poses", replaced("poses", lambda a: np.zeros((len(a), 156)))),
    "no people": ("poses", lambda c: c | {"poses": []}),
    "no frames": ("cam_poses", replaced("cam_poses", lambda a: a[:0])),
    "cam_poses 3x4": ("cam_poses", replaced("cam_poses", lambda a: a[:, :3])),
    "cam_poses absurd": ("cam_poses", replaced("cam_poses", lambda a: np.zeros((0, 4, 4, 9)))),
    "cam_poses None": ("cam_poses", lambda c: c | {"cam_poses": None}),
    "6 betas": ("betas", replaced("betas", lambda a: a[:6])),
    "NaN betas": ("betas", replaced("betas", lambda a: a * np.nan)),
    "betas 10x1": ("betas", replaced("betas", lambda a: a[:, None])),
    "gender x": ("genders", lambda c: c | {"genders": ["f", "x"]}),
    "gender 1": ("genders", lambda c: c | {"genders": ["f", 1]}),
    "ids of floats": ("img_frame_ids", replaced("img_frame_ids", lambda a: a / 2)),
    "poses2d of 25": ("poses2d", replaced("poses2d", lambda a: np.zeros((len(a), 25, 3)))),
    "K of NaN": ("cam_intrinsics", replaced("cam_intrinsics", lambda k: k * np.nan)),
    "K transposed": ("cam_intrinsics", replaced("cam_intrinsics", lambda k: k.T)),
    "K of negative focal": ("cam_intrinsics", replaced("cam_intrinsics", lambda k: -k)),
    "K 3x4": ("cam_intrinsics", replaced("cam_intrinsics", lambda k: np.eye(3, 4))),
    "name as number": ("sequence", lambda c: c | {"sequence": 3}),
    "v_template as list": ("v_template_clothed", lambda c: c | {"v_template_clothed": [1, 2]}),
    "a list": ("dictionary", lambda c: [c]),
}  # fmt: skip


@pytest.mark.parametrize("broken", sorted(BROKEN))
def test_a_broken_array_is_named_with_its_file_and_a_remedy(content, tmp_path, broken):
    key, change = BROKEN[broken]
    with pytest.raises(BadSequence, match=rf"some\.pkl: .*{key}.*get the file again from 3DPW"):
        read(tmp_path, change(content))


def test_a_file_that_is_too_large_is_not_opened(content, tmp_path, monkeypatch):
    monkeypatch.setattr(parse, "LARGEST_FILE_BYTES", 1000)
    with pytest.raises(BadSequence, match="bytes, which no sequence of 3DPW has"):
        read(tmp_path, content)
