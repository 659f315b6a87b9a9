"""Human3.6M's JSON files, on files of that layout that the tests write."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.gmr.runs import runs_at
from gmrdata.manifest.check import check_manifest
from gmrdata.manifest.read import load_clips
from gmrdata.motion.human36m import make_human36m
from gmrdata.read.body_file import read_body
from gmrdata.read.human36m import find_subjects, read_cameras, read_takes
from gmrdata.values.camera import project
from gmrdata.values.clip import camera_of, load_clip
from gmrdata.values.errors import BadBodyFile, BadSequence, MissingInput
from gmrdata.values.motion_metrics import orientation_errors_deg
from tests.clip_manifests import clips_of
from tests.damage import bytes_changed, in_one_folder, read_or_refused
from tests.smpl_models import save_smpl

Content = dict[str, Any]


def camera(seed: int) -> Content:
    rng = np.random.default_rng(seed)
    rotmat = Rotation.random(random_state=seed).as_matrix()
    return {
        "R": rotmat.tolist(),
        "t": (1000 * rng.normal(size=3) + [0, 0, 5000]).tolist(),
        "f": [1145.05, 1143.78],
        "c": [512.54, 515.45],
    }


def row(rng: np.random.Generator) -> Content:
    """One frame as the published files have it: `trans` is a list of one list."""
    return {
        "pose": (0.3 * rng.normal(size=72)).tolist(),
        "shape": (0.5 * rng.normal(size=10)).tolist(),
        "trans": [rng.normal(size=3).tolist()],
        "fitted_3d_pose": (1000 * rng.normal(size=(17, 3))).tolist(),
    }


def parameters(frames: tuple[int, ...] = (0, 5, 10, 20, 25, 30), seed: int = 0) -> Content:
    rng = np.random.default_rng(seed)
    return {
        action: {sub: {str(frame): row(rng) for frame in frames} for sub in ("1", "2")}
        for action in ("2", "14")
    }


def write_subject(root: Path, subject: int, content: Any = None) -> Path:
    root.mkdir(parents=True, exist_ok=True)
    path = root / f"Human36M_subject{subject}_smpl_param.json"
    path.write_text(json.dumps(parameters(seed=subject) if content is None else content))
    cameras = {str(number): camera(10 * subject + number) for number in (1, 2, 3, 4)}
    path.with_name(f"Human36M_subject{subject}_camera.json").write_text(json.dumps(cameras))
    return path


@pytest.fixture
def body_path(tmp_path, small_body) -> Path:
    save_smpl(tmp_path / "smpl.npz", small_body, "neutral")
    return tmp_path / "smpl.npz"


def test_two_manifests_by_subject(tmp_path, body_path):
    root = tmp_path / "h36m"
    for subject in (1, 5, 9):
        write_subject(root / "annotations", subject)
    made = make_human36m(root, str(body_path), tmp_path / "out")
    assert [path.name for path in made] == ["train.yaml", "test.yaml"]
    for path in made:
        check_manifest(path)
    train, test = map(clips_of, made)
    assert [clip.id for clip in test] == [
        "S9.Directions.1",
        "S9.Directions.2",
        "S9.Walking.1",
        "S9.Walking.2",
    ]
    assert {clip.source.sequence.split("/")[0] for clip in train} == {"S1", "S5"}
    entry = test[0]
    assert (entry.fps_hz, entry.n_frames, entry.camera_motion) == (10.0, 7, "static")
    assert [(part.start, part.stop) for part in entry.dropped] == [(3, 4)]
    # Again: nothing is made.
    written = made[0].stat().st_mtime_ns
    clip_file = tmp_path / "out" / "clips" / "S9" / "S9.Walking.1.npz"
    clip_written = clip_file.stat().st_mtime_ns
    make_human36m(root, str(body_path), tmp_path / "out")
    assert clip_file.stat().st_mtime_ns == clip_written and written


def test_poses_pelvis_and_camera(tmp_path, body_path):
    content = parameters()
    write_subject(tmp_path / "h36m", 11, content)
    (made,) = make_human36m(tmp_path / "h36m", str(body_path), tmp_path / "out")
    clip = load_clips(made)[2]
    assert clip.id == "S11.Walking.1"
    body = read_body(body_path)
    frames = (0, 5, 10, 20, 25, 30)
    rows = [content["14"]["1"][str(frame)] for frame in frames]
    at = np.array([0, 1, 2, 4, 5, 6])
    np.testing.assert_array_equal(np.flatnonzero(clip.valid), at)
    np.testing.assert_array_equal(clip.image_numbers, [1, 6, 11, 16, 21, 26, 31])
    rotmats = Rotation.from_rotvec(np.reshape([r["pose"] for r in rows], (-1, 3))).as_matrix()
    rotmats = rotmats.reshape(6, 24, 3, 3)
    np.testing.assert_allclose(clip.motion.root_rotmats[at], rotmats[:, 0], atol=1e-12)
    np.testing.assert_allclose(clip.motion.local_rotmats[at], rotmats[:, 1:], atol=1e-12)
    pelvis_m = [np.array(r["trans"][0]) + body.rest_pelvis_m(np.array(r["shape"])) for r in rows]
    np.testing.assert_allclose(clip.motion.pelvis_m[at], pelvis_m, atol=1e-9)
    assert np.isnan(clip.motion.pelvis_m[3]).all()
    np.testing.assert_allclose(clip.motion.shape, np.mean([r["shape"] for r in rows], axis=0))
    # By the published formula, in millimetres: X_cam = R X + t, x = f X / Z + c.
    said = camera(114)
    point_mm = np.array([300.0, -200.0, 900.0])
    cam_mm = np.array(said["R"]) @ point_mm + said["t"]
    expected_px = np.array(said["f"]) * cam_mm[:2] / cam_mm[2] + said["c"]
    path = camera_of(clip)
    found_px = project(path.world_from_cam[0], point_mm[None] / 1000, path.intrinsics_px)[0]
    if cam_mm[2] > 0:
        np.testing.assert_allclose(found_px, expected_px, rtol=1e-9)
    else:
        assert np.isnan(found_px).all()
    np.testing.assert_allclose(
        path.world_from_cam[0, :3, 3] * 1000, -np.array(said["R"]).T @ said["t"], atol=1e-6
    )
    assert (path.width_px, path.height_px) == (1000, 1002)


def test_no_run_crosses_a_frame_without_parameters(tmp_path, body_path):
    write_subject(tmp_path / "h36m", 1)
    make_human36m(tmp_path / "h36m", str(body_path), tmp_path / "out")
    clip = load_clip(tmp_path / "out" / "clips" / "S1" / "S1.Directions.1.npz")
    runs = runs_at(clip, 10.0, all_phases=True)
    assert [run.n_frames for run in runs] == [3, 3]
    same = orientation_errors_deg(runs[0].root_rotmats, clip.motion.root_rotmats[:3])
    assert same.max() < 1e-6


def test_other_steps_between_frames(tmp_path, body_path):
    """Each frame, as NeuralAnnot has them; a frame off the grid; a single frame."""
    root = tmp_path / "h36m"
    content = {
        "2": {"1": parameters((3, 4, 5, 6))["2"]["1"], "2": parameters((0,))["2"]["1"]},
        "3": {"1": parameters((0, 5, 10, 12, 15))["2"]["1"]},
    }
    path = write_subject(root, 6, content)
    path.rename(root / "Human36M_subject6_SMPL_NeuralAnnot.json")
    (made,) = make_human36m(root, str(body_path), tmp_path / "out")
    each, single, fifth = load_clips(made)
    assert (each.motion.fps_hz, each.motion.n_frames) == (50.0, 4)
    assert each.image_numbers.tolist() == [4, 5, 6, 7] and each.valid.all()
    assert single.motion.n_frames == 1
    assert (fifth.motion.fps_hz, fifth.image_numbers.tolist()) == (10.0, [1, 6, 11, 16])
    assert fifth.valid.all() and "1 between them left out" in fifth.motion.source


def test_nan_makes_a_frame_invalid(tmp_path, body_path):
    content = parameters((0, 5, 10, 15))
    content["2"]["1"]["5"]["pose"][7] = float("nan")
    content["2"]["1"]["10"]["trans"] = [[1e30, 0, 0]]
    write_subject(tmp_path / "h36m", 7, content)
    (made,) = make_human36m(tmp_path / "h36m", str(body_path), tmp_path / "out")
    assert load_clips(made)[0].valid.tolist() == [True, False, False, True]
    check_manifest(made)


def _without(content: Content, key: str) -> Content:
    del content["2"]["1"]["5"][key]
    return content


def _with(content: Content, key: str, value: Any) -> Content:
    content["2"]["1"]["5"][key] = value
    return content


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ([], "the file is a list of 0"),
        ({}, "holds no takes"),
        ({"17": {}}, "action 17 is none of"),
        ({"2": []}, r"\[2\] is a list of 0"),
        ({"2": {"1": {}}}, r"\[2\]\[1\] has no frames"),
        ({"2": {"one": {}}}, "no whole numbers"),
        ({"2": {"1": {"05": {}}}}, "no whole numbers"),
        ({"2": {"1": {"5": 3}}}, r"\[2\]\[1\]\[5\] is a int"),
        ({"2": {"1": {"999999": row(np.random.default_rng(0))}}}, "which no video has"),
        (_without(parameters(), "shape"), r"\[2\]\[1\]\[5\].shape is a NoneType"),
        (_with(parameters(), "pose", [0.0] * 71), r"pose has shape \(71,\), expected \(72\)"),
        (_with(parameters(), "pose", ["a"] * 72), "pose is a list of 72, expected an array"),
        (_with(parameters(), "trans", [[1, 2], [3]]), "trans is a list of 2"),
        (_with(parameters(), "trans", [10**400, 0, 0]), "trans is a list of 3"),
    ],
)
def test_other_layouts_are_refused_by_place(tmp_path, content, said):
    path = write_subject(tmp_path, 1, content)
    with pytest.raises(BadSequence, match=said):
        read_takes(path)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("R", np.diag([1.0, 1.0, -1.0]).tolist(), "R is no rotation"),
        ("R", [[1, 0], [0, 1]], r"R has shape \(2, 2\)"),
        ("t", [0, float("nan"), 0], "no finite t, f and c"),
        ("f", [0, 1000], "with f > 0"),
        ("c", None, "c is a NoneType"),
    ],
)
def test_broken_cameras_are_refused(tmp_path, key, value, said):
    path = tmp_path / "camera.json"
    path.write_text(json.dumps({"4": camera(1) | {key: value}}))
    with pytest.raises(BadSequence, match=said):
        read_cameras(path)


def test_what_is_missing_is_said(tmp_path, body_path, small_body):
    with pytest.raises(MissingInput, match=r"no Human36M_subjectN_smpl_param\.json"):
        find_subjects(tmp_path)
    path = write_subject(tmp_path / "h36m", 1)
    save_smpl(tmp_path / "f.npz", small_body, "female")
    with pytest.raises(BadBodyFile, match=r"SMPL's neutral body, given: smpl-female"):
        make_human36m(tmp_path / "h36m", str(tmp_path / "f.npz"), tmp_path / "out_f")
    path.with_name("Human36M_subject1_camera.json").unlink()
    with pytest.raises(MissingInput, match=r"Human36M_subject1_camera\.json: no such file"):
        make_human36m(tmp_path / "h36m", str(body_path), tmp_path / "out")


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["1", "2", "5", "pose", "x"]), inner, max_size=3)
    ),
    max_leaves=12,
)


@in_one_folder(150)
@given(content=JSON)
def test_any_json_is_read_or_refused(tmp_path, content):
    for read in (read_takes, read_cameras):
        read_or_refused(tmp_path / "any.json", json.dumps(content).encode(), read)


@in_one_folder(40)
@given(data=st.data(), share=st.floats(0, 0.999))
def test_truncated_and_changed_files_are_refused_or_read(data, tmp_path, share):
    path = write_subject(tmp_path, 5, {"2": parameters((0, 5))["2"]})
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(BadSequence, match="not JSON"):
        read_takes(path)
    read_or_refused(path, bytes_changed(data, whole, 1), read_takes)
