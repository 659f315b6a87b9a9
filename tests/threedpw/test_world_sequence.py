"""Clips in the world as 3DPW's files, a set's tables, and arithmetic of frame ranges."""

import pickle  # noqa: TID251  The oracle: what every other reader of 3DPW uses.  # noqa: TID251  The test writes a hostile pickle.
import shutil
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.cli import main
from gmrdata.manifest.current import FrameRange
from gmrdata.manifest.read import load_clips
from gmrdata.paper.table7 import merged, n_frames, n_shared
from gmrdata.read.body_file import read_body
from gmrdata.read.threedpw import read_sequence, unusable_reasons
from gmrdata.read.threedpw_files import SequenceArrays, SequenceFiles
from gmrdata.stage.progress import answers
from gmrdata.threedpw.clips import sequence_arrays, with_original, world_clip
from gmrdata.threedpw.regenerate import range_rows, sequence_rows
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.errors import BadRecipe, BadSequence
from gmrdata.values.skinning import motion_joints_m
from gmrdata.write.threedpw import write_sequence

MM, RAD = 1e-4, 1.7e-4  # 0.1 mm, 0.01 degrees


@pytest.fixture(scope="module")
def gappy(walkers) -> list[Clip]:
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
def arrays(gappy, small_body) -> SequenceArrays:
    unseen = [np.zeros((30, 18, 3))] * 2
    return sequence_arrays("walk_00", gappy, [small_body] * 2, ["female", "male"], unseen)


def test_what_is_not_known_is_nan_and_not_valid(arrays, gappy, walk_arrays):
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


def test_keypoints_and_templates_of_3dpws_own_file(arrays, walk_arrays):
    found = with_original(arrays, walk_arrays)
    for one, own, theirs in zip(found.people, arrays.people, walk_arrays.people, strict=True):
        assert one.poses2d_px is theirs.poses2d_px and one.trans_m is own.trans_m
        assert one.template_clothed_m is theirs.template_clothed_m
    with pytest.raises(BadSequence, match="30 frames of female, male, but 3DPW's own file has 30"):
        with_original(arrays, replace(walk_arrays, people=walk_arrays.people[:1]))


def test_a_regenerated_set_becomes_3dpw_again(filmed_set, made_set, tmp_path, capsys):
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


NAME = "courtyard_walk_00"


@pytest.fixture
def mixed_root(make_dataset, walk_arrays, jpeg) -> Path:
    """A good sequence, one with oddities, and five that can't be read."""
    root = make_dataset()
    odd = replace(walk_arrays, name="odd_00", people=walk_arrays.people[:1])
    files = write_sequence(root, "test", odd)
    files.image_dir.mkdir()
    for row in range(27):
        files.image_path(row).write_bytes(jpeg(90, 160))
    write_sequence(root, "test", replace(walk_arrays, name="no_images_00"))
    test_dir = root / "sequenceFiles" / "test"
    (test_dir / "empty_00.pkl").write_bytes(b"")
    (test_dir / "hostile_00.pkl").write_bytes(b"cos\nsystem\n(S'exit'\ntR.")
    (test_dir / "[red]\x1b[2J.pkl").write_bytes(pickle.dumps({}))
    (test_dir / f"{NAME}.pkl").write_bytes(b"")
    return root


def test_the_list_shows_every_sequence_and_ends_with_1(mixed_root, gmrdata, monkeypatch):
    monkeypatch.setattr(answers, "width", 240)
    answer = gmrdata("threedpw", "list", "--threedpw", mixed_root)
    assert answer.returncode == 1
    assert "Traceback" not in answer.stderr
    assert "6 of 7 sequences can't be used, see the table" in " ".join(answer.stderr.split())
    said = " ".join(answer.stdout.split())
    assert said.startswith("sequence split people frames size [px] usable problems")
    assert "1 (female) 30 90x160 80.0 %" in said
    for text in ("truncated or not a pickle", "system", "no name of a sequence",
                 "is in train and test", "unpack 3DPW's imageFiles.zip",
                 "3 of 30 images can't be used"):  # fmt: skip
        assert text in said.replace("\n", " "), text
    assert "\x1b" not in answer.stdout


def test_rows_of_good_and_odd_sequences(mixed_root):
    rows, n_bad = sequence_rows(mixed_root, "campose_valid")
    assert n_bad == 6
    by_name = {row[0]: row for row in rows if row[2] != "-"}
    assert by_name == {
        "odd_00": ("odd_00", "test", "1 (female)", "30", "90x160", "80.0 %",
                   "3 of 30 images can't be used"),
    }  # fmt: skip
    (mixed_root / "sequenceFiles" / "test" / f"{NAME}.pkl").unlink()
    rows, n_bad = sequence_rows(mixed_root, "campose_valid")
    assert rows[0] == (
        NAME, "train", "2 (female, male)", "30", "90x160", "90.0 %, 100.0 %", "",
    )  # fmt: skip
    assert n_bad == 4


def test_a_good_folder_ends_with_0(make_dataset, gmrdata, monkeypatch):
    monkeypatch.setattr(answers, "width", 240)
    answer = gmrdata("threedpw", "list", "--threedpw", make_dataset())
    assert answer.returncode == 0, answer.stderr
    assert "90.0 %, 100.0 %" in answer.stdout


def test_show_gives_the_ranges_and_reasons_of_each_person(make_dataset, gmrdata):
    root = make_dataset()
    SequenceFiles(root, NAME, "train").image_path(29).unlink()
    rows, problems = range_rows(root, NAME, "campose_valid")
    assert rows == [
        ("0", "female", "0", "29", "26", "86.7 %"),
        ("0", "female", "10", "12", "3", "campose_valid is 0"),
        ("0", "female", "29", "29", "1", "image_00029.jpg is missing"),
        ("1", "male", "0", "29", "29", "96.7 %"),
        ("1", "male", "29", "29", "1", "image_00029.jpg is missing"),
    ]
    assert problems == ("1 of 30 images can't be used",)
    answer = gmrdata("threedpw", "show", NAME, "--threedpw", root)
    assert answer.returncode == 0, answer.stderr
    assert "campose_valid is 0" in answer.stdout and "1 of 30 images" in answer.stdout


def test_rules_change_the_share_and_unknown_ones_are_refused(make_dataset, walk_arrays):
    undetected = replace(
        walk_arrays.people[1],
        poses2d_px=np.where(
            np.arange(30)[:, None, None] < 15, 0.0, walk_arrays.people[1].poses2d_px
        ),
    )
    root = make_dataset(replace(walk_arrays, people=(walk_arrays.people[0], undetected)))
    shares = {rule: sequence_rows(root, rule)[0][0][5] for rule in ("glamr", "vibe")}
    assert shares["glamr"] == "90.0 %, 50.0 %"
    assert shares["vibe"] == "100.0 %, 50.0 %"
    with pytest.raises(BadRecipe, match="no rule 'best'"):
        sequence_rows(root, "best")


ranges = st.lists(
    st.builds(
        lambda start, length: FrameRange(start=start, stop=start + length),
        st.integers(0, 40),
        st.integers(1, 15),
    ),
    max_size=6,
)


def frames(parts: list[FrameRange]) -> set[int]:
    return {row for part in parts for row in range(part.start, part.stop)}


@given(a=ranges, b=ranges)
def test_counts_are_those_of_sets_of_frames(a, b):
    assert n_frames(a) == len(frames(a))
    assert n_shared(a, b) == n_shared(b, a) == len(frames(a) & frames(b))


@given(a=ranges)
def test_merged_ranges_hold_the_same_frames_and_do_not_meet(a):
    parts = merged(a)
    assert {row for start, stop in parts for row in range(start, stop)} == frames(a)
    assert all(stop < later for (_, stop), (later, _) in pairwise(parts))
