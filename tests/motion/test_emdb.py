"""EMDB's pickles, on files of that layout that the tests write."""

import os
import pickle  # noqa: TID251  The tests write files that EMDB's makers could have written.
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.manifest.check import check_manifest
from gmrdata.manifest.read import load_clips
from gmrdata.motion.emdb import make_emdb
from gmrdata.read.emdb import read_emdb
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import project
from gmrdata.values.clip import camera_of
from gmrdata.values.errors import BadBodyFile, BadSequence, MissingInput, UnsafePickle
from gmrdata.values.transforms import rigid
from tests.clip_manifests import clips_of
from tests.damage import Calls, bytes_changed, in_one_folder, read_or_refused
from tests.smpl_models import save_smpl

N_FRAMES = 12
Content = dict[str, Any]


def content(name: str = "P0_09_outdoor_walk", gender: str = "male", **flags: bool) -> Content:
    """A person who stands upright in the y-up world and goes along x, in front of a camera."""
    rng = np.random.default_rng(len(name))
    turned = Rotation.from_euler("y", np.linspace(0, 40, N_FRAMES)[:, None], degrees=True)
    trans_m = np.linspace([0, 1.0, 0], [1.1, 1.0, 0.2], N_FRAMES)
    # The camera looks along the world's -z, with y down: x right, y down, z forward.
    cam_from_world = rigid(np.diag([1.0, -1.0, -1.0]), np.zeros(3)) @ rigid(
        Rotation.from_euler("y", np.linspace(0, 10, N_FRAMES)[:, None], degrees=True).as_matrix(),
        np.linspace([0, -1, -4], [-1, -1, -4], N_FRAMES),
    )
    return {
        "gender": gender,
        "name": name,
        "emdb1": flags.get("emdb1", False),
        "emdb2": flags.get("emdb2", True),
        "n_frames": N_FRAMES,
        "good_frames_mask": np.arange(N_FRAMES) != 4,
        "camera": {
            "intrinsics": np.array([[1450.0, 0, 720], [0, 1450.0, 960], [0, 0, 1]]),
            "extrinsics": cam_from_world,
            "width": 1440,
            "height": 1920,
        },
        "smpl": {
            "poses_root": turned.as_rotvec(),
            "poses_body": 0.2 * rng.normal(size=(N_FRAMES, 69)),
            "trans": trans_m,
            "betas": rng.normal(size=10),
        },
        "kp2d": np.zeros((N_FRAMES, 24, 2)),
        "bboxes": {"bboxes": np.zeros((N_FRAMES, 4)), "invalid_idxs": np.array([4])},
    }


def write_sequence(root: Path, values: Any, name: str = "P0_09_outdoor_walk") -> Path:
    subject, _, sequence = name.partition("_")
    path = root / subject / sequence / f"{name}_data.pkl"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(pickle.dumps(values))
    return path


@pytest.fixture
def bodies(tmp_path, small_body) -> dict[str, BodyModel]:
    folder = tmp_path / "smpl"
    return {
        gender: save_smpl(folder / f"{gender}.npz", small_body, gender)
        for gender in ("female", "male")
    }


def test_manifests_of_all_of_emdb1_and_of_emdb2(tmp_path, bodies):
    root = tmp_path / "EMDB"
    write_sequence(root, content())
    second = "P7_57_outdoor_rock_chair"
    write_sequence(root, content(second, "female", emdb1=True, emdb2=False), second)
    made = make_emdb(root, str(tmp_path / "smpl"), tmp_path / "out")
    assert [path.name for path in made] == ["emdb.yaml", "emdb1.yaml", "emdb2.yaml"]
    ids = []
    for path in made:
        check_manifest(path)
        entries = clips_of(path)
        ids.append([clip.id for clip in entries])
    assert ids == [["P0_09_outdoor_walk", second], [second], ["P0_09_outdoor_walk"]]
    (entry,) = entries
    assert (entry.body, entry.fps_hz) == ("smpl-male", 30.0)
    assert entry.source.sequence == "P0/09_outdoor_walk"
    assert entry.camera_motion == "linear_panning"
    assert [(part.start, part.stop, part.reason) for part in entry.dropped] == [
        (4, 5, "good_frames_mask is False")
    ]
    assert entry.quality is not None and entry.quality.figures["mean_tilt_deg"] < 1e-6


def test_person_and_camera_in_the_z_up_world(tmp_path, bodies):
    values = content()
    write_sequence(tmp_path / "EMDB", values)
    made = make_emdb(tmp_path / "EMDB", str(tmp_path / "smpl" / "male.npz"), tmp_path / "out")
    (clip,) = load_clips(made[0])
    smpl = values["smpl"]
    pelvis_y_up_m = smpl["trans"] + bodies["male"].rest_pelvis_m(smpl["betas"])
    x, y, z = pelvis_y_up_m.T
    np.testing.assert_allclose(clip.motion.pelvis_m, np.stack([x, -z, y], axis=1), atol=1e-6)
    assert clip.motion.gender == "male"
    np.testing.assert_allclose(clip.motion.shape, smpl["betas"])
    body_rotmats = Rotation.from_rotvec(smpl["poses_body"].reshape(-1, 3)).as_matrix()
    np.testing.assert_allclose(
        clip.motion.local_rotmats, body_rotmats.reshape(N_FRAMES, 23, 3, 3), atol=1e-12
    )
    # The file's own projection of the pelvis: K E [p, 1].
    camera = values["camera"]
    homogeneous = np.c_[pelvis_y_up_m, np.ones(N_FRAMES)]
    cam_m = np.einsum("nij,nj->ni", camera["extrinsics"], homogeneous)[:, :3]
    image = cam_m @ camera["intrinsics"].T
    path = camera_of(clip)
    found_px = project(path.world_from_cam, clip.motion.pelvis_m[:, None], path.intrinsics_px)
    assert (cam_m[:, 2] > 3).all()
    np.testing.assert_allclose(found_px[:, 0], image[:, :2] / image[:, 2:], atol=1e-3)
    assert (path.width_px, path.height_px) == (1440, 1920)
    np.testing.assert_array_equal(clip.image_numbers, np.arange(N_FRAMES))


def test_frames_that_are_not_finite_are_dropped(tmp_path, bodies):
    values = content()
    values["smpl"]["poses_body"][2, 5] = np.nan
    values["camera"]["extrinsics"][6] = 2 * np.eye(4)
    write_sequence(tmp_path / "EMDB", values)
    made = make_emdb(tmp_path / "EMDB", str(tmp_path / "smpl"), tmp_path / "out")
    (clip,) = load_clips(made[0])
    assert np.flatnonzero(~clip.valid).tolist() == [2, 4, 6]
    assert np.isnan(clip.motion.local_rotmats[2]).all()
    assert np.isnan(camera_of(clip).world_from_cam[6]).all()
    assert [part.reason for part in clips_of(made[0])[0].dropped] == [
        "poses or trans is not finite",
        "good_frames_mask is False",
        "extrinsics is no rigid transform",
    ]
    check_manifest(made[0])


def test_bodies_are_those_of_the_genders(tmp_path, small_body):
    write_sequence(tmp_path / "EMDB", content(gender="neutral"))
    save_smpl(tmp_path / "smpl" / "a.npz", small_body, "male")
    with pytest.raises(BadBodyFile, match="needs the body smpl-neutral, given: smpl-male"):
        make_emdb(tmp_path / "EMDB", str(tmp_path / "smpl"), tmp_path / "out")
    save_smpl(tmp_path / "smpl" / "b.npz", small_body, "male")
    with pytest.raises(BadBodyFile, match="two files of the body smpl-male"):
        make_emdb(tmp_path / "EMDB", str(tmp_path / "smpl"), tmp_path / "out")
    (tmp_path / "empty").mkdir()
    with pytest.raises(MissingInput, match="holds no SMPL models"):
        make_emdb(tmp_path / "EMDB", str(tmp_path / "empty"), tmp_path / "out")
    with pytest.raises(MissingInput, match="Name the folder that holds EMDB's P0 to P9"):
        make_emdb(tmp_path / "smpl", str(tmp_path / "smpl"), tmp_path / "out")


def _nested(depth: int) -> list[Any]:
    """Deeper than numpy's arrays go."""
    return [_nested(depth - 1)] if depth else []


def _changed(key: str, value: Any) -> Content:
    values = content()
    *above, last = key.split(".")
    inner = values
    for part in above:
        inner = inner[part]
    if value is None:
        del inner[last]
    else:
        inner[last] = value
    return values


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ([1, 2], "holds a list of 2 where a dictionary with 'smpl' belongs"),
        (_changed("smpl", None), "it lacks 'smpl'"),
        (_changed("smpl", np.zeros(3)), "smpl is an array of dtype float64"),
        (_changed("smpl.trans", None), "it lacks 'trans'"),
        (_changed("smpl.trans", np.zeros((5, 3))), r"trans has shape \(5, 3\), expected \(12, 3\)"),
        (_changed("smpl.poses_body", np.zeros((N_FRAMES, 63))), r"expected \(12, 69\)"),
        (_changed("smpl.betas", np.full(10, np.nan)), "betas are not finite"),
        (_changed("smpl.betas", np.array(["a"] * 10)), "betas is an array of dtype <U1"),
        (_changed("n_frames", 0), "n_frames is 0, expected a whole number"),
        (_changed("n_frames", True), "n_frames is True"),
        (_changed("n_frames", "12"), "n_frames is '12'"),
        (_changed("camera.width", -3), "width is -3"),
        (_changed("camera.intrinsics", np.eye(3) * 2), "no calibration matrix"),
        (_changed("camera.extrinsics", np.zeros((N_FRAMES, 3, 4))), r"expected \(12, 4, 4\)"),
        (_changed("gender", "x"), "gender is 'x', expected female, male, neutral"),
        (_changed("emdb2", 1), "emdb2 is a int, expected True or False"),
        (_changed("good_frames_mask", np.ones(3, bool)), "expected 12 of True, False"),
        (_changed("good_frames_mask", _nested(70)), "good_frames_mask is a list of 1, expected"),
        (_changed("name", 7), "name is a int, expected a string"),
    ],
)
def test_other_layouts_are_refused(tmp_path, values, said):
    path = write_sequence(tmp_path, values)
    with pytest.raises(BadSequence, match=said) as refused:
        read_emdb(path)
    assert str(path) in str(refused.value)


@pytest.mark.parametrize("key", ["name", "smpl.trans", "kp2d"])
def test_a_hostile_pickle_is_named_and_not_run(tmp_path, monkeypatch, key):
    monkeypatch.chdir(tmp_path)
    path = write_sequence(tmp_path, _changed(key, Calls(os.system, "touch touched")))
    with pytest.raises(UnsafePickle, match="system"):
        read_emdb(path)
    assert not (tmp_path / "touched").exists()


def test_links_out_of_the_folder_are_left_out(tmp_path, bodies):
    outside = write_sequence(tmp_path / "elsewhere", content())
    link = tmp_path / "EMDB" / "P0" / "09_outdoor_walk" / "P0_09_outdoor_walk_data.pkl"
    link.parent.mkdir(parents=True)
    link.symlink_to(outside)
    with pytest.raises(MissingInput, match="no P"):
        make_emdb(tmp_path / "EMDB", str(tmp_path / "smpl"), tmp_path / "out")


@in_one_folder(60)
@given(data=st.data(), share=st.floats(0, 0.999))
def test_truncated_and_changed_files_are_refused_or_read(data, tmp_path, share):
    path = write_sequence(tmp_path, content())
    whole = path.read_bytes()
    assert read_or_refused(path, whole[: int(share * len(whole))], read_emdb) is None
    read_or_refused(path, bytes_changed(data, whole, 1), read_emdb)


@in_one_folder(30)
@given(seed=st.integers(0, 2**16), protocol=st.sampled_from([2, 3, 4, 5]))
def test_what_was_written_is_read(tmp_path, seed, protocol):
    rng = np.random.default_rng(seed)
    values = content(emdb1=bool(seed % 2))
    values["smpl"]["trans"] = rng.normal(size=(N_FRAMES, 3)).astype(np.float32)
    values["good_frames_mask"] = rng.random(N_FRAMES) < 0.5
    values["emdb2"] = np.bool_(seed % 3 == 0)
    path = write_sequence(tmp_path, values)
    path.write_bytes(pickle.dumps(values, protocol))
    sequence = read_emdb(path)
    np.testing.assert_array_equal(sequence.trans_m, values["smpl"]["trans"])
    np.testing.assert_array_equal(sequence.good, values["good_frames_mask"])
    np.testing.assert_array_equal(sequence.poses_rad[:, 3:], values["smpl"]["poses_body"])
    np.testing.assert_array_equal(sequence.cam_from_world, values["camera"]["extrinsics"])
    assert (sequence.emdb1, sequence.emdb2) == (bool(seed % 2), seed % 3 == 0)
