"""Clips in the world as 3DPW's files, with gaps, and a regenerated set as 3DPW again."""

import pickle  # noqa: TID251  The oracle: what every other reader of 3DPW uses.
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.cli import main
from gmrdata.manifest.read import load_clips
from gmrdata.read.body_file import read_body
from gmrdata.read.threedpw import read_sequence, unusable_reasons
from gmrdata.read.threedpw_files import SequenceArrays
from gmrdata.threedpw.clips import sequence_arrays, with_original, world_clip
from gmrdata.threedpw.regenerate import sequence_rows
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.errors import BadSequence
from gmrdata.values.skinning import motion_joints_m
from tests.fixtures.filmed_sets import Made

MM, RAD = 1e-4, 1.7e-4  # 0.1 mm, 0.01 degrees


@pytest.fixture(scope="module")
def gappy(walkers: list[Clip]) -> list[Clip]:
    """The walkers without a camera in frames 3 and 4, and the second without motion in frame 20."""
    camera = camera_of(walkers[0])
    has_camera = ~np.isin(np.arange(camera.n_frames), (3, 4))
    path = np.where(has_camera[:, None, None], camera.world_from_cam, np.nan)
    camera = replace(camera, world_from_cam=path, has_camera=has_camera)
    first, second = (replace(one, camera=camera) for one in walkers)
    pelvis_m, valid = second.motion.pelvis_m.copy(), second.valid.copy()
    pelvis_m[20], valid[20] = np.nan, False
    motion = replace(second.motion, pelvis_m=pelvis_m)
    return [first, replace(second, motion=motion, valid=valid)]


@pytest.fixture(scope="module")
def arrays(gappy: list[Clip], small_body: BodyModel) -> SequenceArrays:
    unseen = [np.zeros((30, 18, 3))] * 2
    return sequence_arrays("walk_00", gappy, [small_body] * 2, ["female", "male"], unseen)


def test_what_is_not_known_is_nan_and_not_valid(
    arrays: SequenceArrays, gappy: list[Clip], walk_arrays: SequenceArrays
) -> None:
    bare = [3, 4]
    assert np.flatnonzero(np.isnan(arrays.cam_from_world).any(axis=(1, 2))).tolist() == bare
    first, second = arrays.people
    assert np.flatnonzero(~first.campose_valid & gappy[0].valid).tolist() == bare
    assert np.flatnonzero(~second.campose_valid & gappy[1].valid).tolist() == bare
    assert np.flatnonzero(np.isnan(second.trans_m).all(axis=1)).tolist() == [20]
    assert second.trans_60hz_m is not None and second.poses_60hz_rad is not None
    assert np.flatnonzero(np.isnan(second.trans_60hz_m).any(axis=1)).tolist() == [40, 41]
    # What is known is what it was, and the last row before a gap holds.
    whole = walk_arrays.people[1]
    np.testing.assert_array_equal(second.trans_m[:20], whole.trans_m[:20])
    np.testing.assert_array_equal(second.trans_60hz_m[39], second.trans_60hz_m[38])
    assert np.isfinite(second.poses_60hz_rad[42:]).all()


def test_keypoints_and_templates_of_3dpws_own_file(
    arrays: SequenceArrays, walk_arrays: SequenceArrays
) -> None:
    found = with_original(arrays, walk_arrays)
    for one, own, theirs in zip(found.people, arrays.people, walk_arrays.people, strict=True):
        assert one.poses2d_px is theirs.poses2d_px and one.trans_m is own.trans_m
        assert one.template_clothed_m is theirs.template_clothed_m
    with pytest.raises(BadSequence, match="30 frames of female, male, but 3DPW's own file has 30"):
        with_original(arrays, replace(walk_arrays, people=walk_arrays.people[:1]))


def test_a_regenerated_set_becomes_3dpw_again(
    filmed_set: Made, made_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    flags = ["--to", "3dpw", "--threedpw", str(filmed_set.root), "--out", str(out)]
    main(["export", str(made_set), *flags])
    root = out / "3dpw"
    assert capsys.readouterr().out.splitlines()[-1].endswith("3dpw")
    shutil.copytree(filmed_set.root / "imageFiles", root / "imageFiles")
    rows, n_bad = sequence_rows(root, "campose_valid")
    assert n_bad == 0 and [row[:2] for row in rows] == [("arc_00", "train"), ("pan_00", "train")]
    clips = {clip.id: clip for clip in load_clips(made_set / "pseudo_gt.yaml")}
    body = read_body(filmed_set.body_path)
    for name, n_people in (("arc_00", 2), ("pan_00", 1)):
        path = root / "sequenceFiles" / "train" / f"{name}.pkl"
        content = pickle.loads(path.read_bytes(), encoding="latin1")
        own = pickle.loads(
            (filmed_set.root / "sequenceFiles" / "train" / path.name).read_bytes(),
            encoding="latin1",
        )
        assert content.keys() == own.keys() and len(content["poses"]) == n_people
        np.testing.assert_array_equal(content["poses2d"], own["poses2d"])
        sequence = read_sequence(root, name)
        for number in range(n_people):
            _require_same(clips[f"{name}.p{number}"], sequence, number, body, content)


def _require_same(
    wanted: Clip, sequence: object, number: int, body: BodyModel, content: dict
) -> None:
    found = world_clip(sequence, number, [body], "campose_valid")
    rows = wanted.valid & camera_of(wanted).has_camera
    reasons = np.array(unusable_reasons(sequence, number, "campose_valid"))
    assert np.array_equal(reasons == "", rows) and rows.any()
    assert found.motion.fps_hz == wanted.motion.fps_hz == 30.0
    joints_m = [motion_joints_m(body, one.motion)[rows] for one in (wanted, found)]
    assert np.abs(joints_m[0] - joints_m[1]).max() < MM
    turned = np.swapaxes(wanted.motion.rotmats[rows], -1, -2) @ found.motion.rotmats[rows]
    assert Rotation.from_matrix(turned.reshape(-1, 3, 3)).magnitude().max() < RAD
    cameras = [camera_of(one).world_from_cam[rows] for one in (wanted, found)]
    np.testing.assert_allclose(cameras[1], cameras[0], atol=1e-9)
    # The file's own joints are those of its poses, in its y-up world.
    y_up_m = joints_m[0] @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    stored_m = content["jointPositions"][number].reshape(-1, 24, 3)[rows]
    assert np.abs(stored_m - y_up_m).max() < MM
