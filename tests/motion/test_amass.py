"""AMASS: keys of all releases, hands, betas, rates, pelvis; broken arrays say what is wrong."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.motion.files import read_file, read_motion
from gmrdata.motion.local_poses import read_local_poses
from gmrdata.read.source_motion import DEFAULT_READING
from gmrdata.read.systems.result import read_system
from gmrdata.values.body import SMPL_LEG_M, SMPL_REST_PELVIS_M, leg_length_m
from gmrdata.values.errors import BadMotionFile
from tests.damage import in_one_folder, part_replaced, read_or_refused
from tests.motions import save_bare

HAND_COLUMNS = {72: (22, 23), 156: (22, 37), 165: (25, 40)}


def _arrays(n_values: int = 156, n_frames: int = 6) -> dict[str, Any]:
    rng = np.random.default_rng(5)
    return {
        "poses": rng.normal(scale=0.4, size=(n_frames, n_values)),
        "trans": rng.normal(size=(n_frames, 3)),
        "betas": rng.normal(size=16),
        "gender": "female",
        "mocap_framerate": 120.0,
        "dmpls": np.zeros((n_frames, 8)),
    }


def _save(path: Path, arrays: dict[str, Any]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **arrays)
    return path


@pytest.mark.parametrize("n_values", [72, 156, 165])
def test_rotations_are_kept_on_any_body(tmp_path, small_body, n_values):
    arrays = _arrays(n_values)
    motion = read_motion(_save(tmp_path / "a_poses.npz", arrays), small_body, ground=False)
    rotvecs = arrays["poses"].reshape(6, -1, 3)
    left, right = HAND_COLUMNS[n_values]
    expected = Rotation.from_rotvec(
        np.concatenate([rotvecs[:, :22], rotvecs[:, [left, right]]], axis=1).reshape(-1, 3)
    ).as_matrix()
    found = motion.rotmats
    np.testing.assert_allclose(found.reshape(-1, 3, 3), expected, atol=1e-12)
    np.testing.assert_array_equal(motion.shape, np.zeros(10))
    scale = leg_length_m(small_body.rest_joints_m(np.zeros(10))) / SMPL_LEG_M
    np.testing.assert_allclose(
        motion.pelvis_m, (arrays["trans"] + np.array(SMPL_REST_PELVIS_M)) * scale
    )
    whose = "" if n_values == 165 else ", which are of smpl-female"
    assert motion.source == (
        f"a_poses.npz: 120 Hz (file), betas of the file not used{whose}, path x {scale:.4f}, "
        "floor levelled by 0.0 deg"
    )


@pytest.mark.parametrize("gender", ["female", b"female", np.array("female"), np.array([b"Female"])])
@pytest.mark.parametrize("rate", [60, 60.0, np.array(60), np.array([60.0])])
@pytest.mark.parametrize("key", ["mocap_framerate", "mocap_frame_rate"])
def test_the_pelvis_of_smpls_own_body_is_trans_and_j0(tmp_path, small_body, gender, rate, key):
    arrays = _arrays() | {"gender": gender}
    del arrays["mocap_framerate"]
    path = _save(tmp_path / "a.npz", arrays | {key: rate})
    smpl = replace(small_body, name="smpl-female")
    motion = read_motion(path, smpl, ground=False)
    np.testing.assert_allclose(motion.shape, arrays["betas"][:10])
    np.testing.assert_allclose(motion.pelvis_m, arrays["trans"] + smpl.rest_pelvis_m(motion.shape))
    assert motion.fps_hz == 60.0 and motion.gender == "female"
    grounded = read_motion(path, smpl)
    steps_m = np.linalg.norm(np.diff(grounded.pelvis_m, axis=0), axis=1)
    np.testing.assert_allclose(steps_m, np.linalg.norm(np.diff(motion.pelvis_m, axis=0), axis=1))


@pytest.mark.parametrize(
    ("betas", "shape"),
    [(np.ones((1, 16)), np.ones(10)), (np.ones((1, 1, 16)), np.ones(10)),
     (np.arange(6.0)[:, None], np.r_[2.5, np.zeros(9)]), (np.ones((16, 1)), None)],
)  # fmt: skip
def test_betas_are_one_row_or_one_of_each_frame(tmp_path, small_body, betas, shape):
    """One coefficient of each of six frames was taken for six coefficients."""
    path = _save(tmp_path / "a.npz", _arrays() | {"betas": betas})
    smpl = replace(small_body, name="smpl-female")
    if shape is None:
        with pytest.raises(BadMotionFile, match=r"betas are \(16, 1\) for 6 frames"):
            read_motion(path, smpl)
        return
    np.testing.assert_array_equal(read_motion(path, smpl).shape, shape)


def test_betas_of_another_body_are_not_kept(tmp_path, small_body):
    path = _save(tmp_path / "a.npz", _arrays())
    x_path = _save(tmp_path / "x.npz", _arrays(165))
    female, male = (replace(small_body, name=f"smpl-{g}") for g in ("female", "male"))
    for other in (read_motion(path, male), read_motion(x_path, female)):
        np.testing.assert_array_equal(other.shape, np.zeros(10))
        assert "betas of the file not used" in other.source


def test_the_subjects_own_leg_length_scales_the_path(tmp_path, small_body):
    arrays = _arrays()
    path = _save(tmp_path / "a.npz", arrays)
    source_body = replace(small_body, name="smpl-female")
    motion = read_motion(path, small_body, source_body=source_body, ground=False)
    betas = arrays["betas"][:10]
    leg_m = leg_length_m(source_body.rest_joints_m(betas))
    scale = leg_length_m(small_body.rest_joints_m(np.zeros(10))) / leg_m
    expected = (arrays["trans"] + source_body.rest_pelvis_m(betas)) * scale
    np.testing.assert_allclose(motion.pelvis_m, expected)


def test_a_clip_of_the_same_body_comes_back(tmp_path, small_body):
    motion = read_motion(_save(tmp_path / "a.npz", _arrays()), small_body)
    path = save_bare(tmp_path / "clip.npz", small_body, motion)
    again = read_motion(path, small_body, ground=False)
    np.testing.assert_allclose(again.local_rotmats, motion.local_rotmats, atol=1e-12)
    np.testing.assert_allclose(again.pelvis_m, motion.pelvis_m, atol=1e-12)
    other = replace(small_body, name="other")
    with pytest.raises(BadMotionFile, match="'small'; give that body with --body"):
        read_motion(path, other)
    save_bare(path, small_body, replace(motion, frame="camera"))
    with pytest.raises(BadMotionFile, match="camera frames"):
        read_motion(path, small_body)


def test_rows_of_a_clip_that_are_not_valid_may_be_nan(tmp_path, small_body):
    """As clips of EMDB and Human3.6M have them: the motion of the other rows is read."""
    motion = read_motion(_save(tmp_path / "a.npz", _arrays(n_frames=12)), small_body)
    missing = np.isin(np.arange(12), [0, 4, 5])
    valid = ~missing & (np.arange(12) != 11)  # row 11 is not valid, and a pose all the same
    rotmats, pelvis_m = motion.rotmats, motion.pelvis_m.copy()
    rotmats[missing], pelvis_m[missing] = np.nan, np.nan
    gaps = replace(
        motion, local_rotmats=rotmats[:, 1:], root_rotmats=rotmats[:, 0], pelvis_m=pelvis_m
    )
    path = save_bare(tmp_path / "gaps.npz", small_body, gaps, valid)
    read = read_file(path, small_body, DEFAULT_READING)
    np.testing.assert_array_equal(read.valid, valid)
    np.testing.assert_allclose(read.motion.rotmats[~missing], rotmats[~missing], atol=1e-12)
    np.testing.assert_allclose(read.motion.pelvis_m[~missing], pelvis_m[~missing], atol=1e-12)
    np.testing.assert_array_equal(read.motion.rotmats[0], read.motion.rotmats[1])
    third_m = (2 * pelvis_m[3] + pelvis_m[6]) / 3
    np.testing.assert_allclose(read.motion.pelvis_m[4], third_m, atol=1e-12)
    assert read.motion.source.endswith(", 3 missing frames filled")
    # The floor is that of the rows that are there.
    known = save_bare(tmp_path / "known.npz", small_body, motion.take(~missing), valid[~missing])
    grounded, wanted = (read_motion(one, small_body, ground=True) for one in (path, known))
    np.testing.assert_array_equal(grounded.pelvis_m[~missing], wanted.pelvis_m)


def test_a_clip_without_a_motion_says_so(tmp_path, small_body):
    motion = read_motion(_save(tmp_path / "a.npz", _arrays()), small_body)
    pelvis_m = motion.pelvis_m.copy()
    pelvis_m[3] = np.nan
    lost = replace(motion, pelvis_m=pelvis_m)
    path = save_bare(tmp_path / "b.npz", small_body, lost, np.full(6, True))
    with pytest.raises(BadMotionFile, match=r"b\.npz: trans is not finite at frame 3"):
        read_motion(path, small_body)
    nobody = replace(motion, pelvis_m=np.full((6, 3), np.nan))
    path = save_bare(tmp_path / "c.npz", small_body, nobody, np.full(6, False))
    with pytest.raises(BadMotionFile, match=r"c\.npz: 0 frames are no motion"):
        read_motion(path, small_body)


def test_pythons_objects_beside_the_motion_are_left_out(tmp_path, small_body):
    """MoSh++ (moshpp/mosh_head.py) saves a dict of the markers' vertices in each SMPL-X file."""
    plain = _arrays(165) | {"mocap_frame_rate": 120.0}
    objects = {"markers_latent_vids": np.array({"C7": 5461}, dtype=object)}
    path = _save(tmp_path / "a_stageii.npz", plain | objects)
    found = read_motion(path, small_body)
    again = read_motion(_save(tmp_path / "b_stageii.npz", plain), small_body)
    np.testing.assert_array_equal(found.pelvis_m, again.pelvis_m)
    assert read_local_poses(path)[0].motion.n_frames == found.n_frames
    assert read_system(path, "world").system == "amass"


def test_cmus_index_wins_over_amass(tmp_path, small_body):
    for folder, name, fps_hz in (
        ("CMU/62", "62_11_poses.npz", 60.0),
        ("cmu/62", "62_11_poses.npz", 60.0),
        ("CMU_SMPLH", "62_11_poses.npz", 60.0),
        ("CMU/02", "02_03_stageii.npz", 120.0),
        ("SFU/62", "62_11_poses.npz", 120.0),
    ):
        path = _save(tmp_path / folder / name, _arrays())
        assert read_motion(path, small_body).fps_hz == fps_hz
        assert read_motion(path, small_body, fps_hz=99).fps_hz == 99.0


def test_cmus_index_does_not_depend_on_how_the_path_is_typed(tmp_path, small_body, monkeypatch):
    folder = _save(tmp_path / "CMU" / "62" / "62_11_poses.npz", _arrays()).parent
    (tmp_path / "mine").symlink_to(folder)
    for here, typed in (
        (tmp_path, "mine/62_11_poses.npz"),
        (tmp_path / "CMU", "62/62_11_poses.npz"),
        (folder, "62_11_poses.npz"),
    ):
        monkeypatch.chdir(here)
        assert read_motion(Path(typed), small_body).fps_hz == 60.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"mocap_framerate": None}, "no frame rate .*give it with --fps-hz"),
        ({"mocap_framerate": 0.0}, "0 Hz.*fps-hz"),
        ({"mocap_framerate": -30.0}, "fps-hz"),
        ({"mocap_framerate": 10000.0}, "10000 Hz.*fps-hz"),
        ({"mocap_framerate": np.nan}, "mocap_framerate is not finite"),
        ({"mocap_framerate": [1.0, 2.0]}, "not one number"),
        ({"poses": np.array([{"a": 1}], dtype=object)}, "no array 'poses'"),
        ({"mocap_framerate": "fast"}, "mocap_framerate does not hold numbers"),
        ({"poses": None}, "no AMASS motion, it has no array 'poses'"),
        ({"floor_plane": np.zeros(4)}, "HuMoR's motion before the camera.*results_prior.npz"),
        ({"trans": None}, "no array 'trans'"),
        ({"poses": np.zeros((6, 150))}, r"poses are \(6, 150\).*SMPL"),
        ({"poses": np.zeros(156)}, r"poses are \(156,\)"),
        ({"poses": np.full((6, 156), np.nan)}, "poses is not finite at frame 0"),
        ({"poses": np.full((6, 156), np.inf)}, "poses is not finite at frame 0"),
        ({"trans": np.zeros((5, 3))}, r"trans is \(5, 3\) for 6 frames"),
        ({"poses": np.zeros((1, 156)), "trans": np.zeros((1, 3))}, "1 frames are no motion"),
        ({"poses": np.zeros((0, 156)), "trans": np.zeros((0, 3))}, "0 frames are no motion"),
    ],
)
def test_broken_arrays(tmp_path, small_body, changes, words):
    arrays = {key: v for key, v in (_arrays() | changes).items() if v is not None}
    path = _save(tmp_path / "a.npz", arrays)
    with pytest.raises(BadMotionFile, match=words) as caught:
        read_motion(path, small_body)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("name", ["shape.npz", "02_03_stagei.npz", "female_stagei.npz"])
def test_files_of_shapes_are_no_motions(tmp_path, small_body, name):
    path = _save(tmp_path / name, {"betas": np.zeros(16)})
    with pytest.raises(BadMotionFile, match="holds a subject's shape and no motion"):
        read_motion(path, small_body)


@in_one_folder(100)
@given(data=st.data())
def test_damage_never_raises_anything_else(data, tmp_path, small_body):
    path = _save(tmp_path / "a.npz", _arrays(72, 2))
    damaged = part_replaced(data, path.read_bytes())
    motion = read_or_refused(path, damaged, lambda path: read_motion(path, small_body))
    assert motion is None or np.isfinite(motion.pelvis_m).all()
