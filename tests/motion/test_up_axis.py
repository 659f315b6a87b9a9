"""Which way is up: files in other worlds than their convention's, and people who truly lie."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.motion.files import read_file, read_motion
from gmrdata.motion.gait import make_gait
from gmrdata.motion.library import READING_FILE, ReadingRecord, make_library
from gmrdata.motion.up_axis import person_of, remarks_on, standing_along, tilt_over_feet_deg
from gmrdata.read.source_motion import ReadConfig, UpAxis, axis_of
from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.clip import load_clip
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import smallest_rotation
from gmrdata.write.amass import write_amass
from gmrdata.write.bvh import write_bvh

AXES: tuple[UpAxis, ...] = ("x", "y", "-x", "-y", "-z")
SUPINE = Rotation.from_euler("x", -90, degrees=True).as_matrix()
HEADSTAND = Rotation.from_euler("x", 180, degrees=True).as_matrix()


def _moved(motion: Motion, rotmats: np.ndarray, pelvis_m: np.ndarray) -> Motion:
    """The same limbs, with roots turned by (3, 3) or (T, 3, 3) and another path."""
    return replace(motion, root_rotmats=rotmats @ motion.root_rotmats, pelvis_m=pelvis_m)


def _in_world(motion: Motion, up: UpAxis) -> Motion:
    turn = smallest_rotation(np.eye(3)[2], axis_of(up))
    return _moved(motion, turn, motion.pelvis_m @ turn.T)


def _save(path: Path, motion: Motion, body: BodyModel) -> Path:
    """As BVH of the body's own skeleton, or as AMASS."""
    if path.suffix == ".bvh":
        write_bvh(path, motion, body)
        return path
    write_amass(path, motion, body)
    return path


def _pointed(motion: Motion) -> Motion:
    """The same with toes pointed, as they are of feet that carry nobody."""
    local = motion.local_rotmats.copy()
    ankles = [JOINT["left_ankle"] - 1, JOINT["right_ankle"] - 1]
    local[:, ankles] = local[:, ankles] @ Rotation.from_euler("x", 45, degrees=True).as_matrix()
    return replace(motion, local_rotmats=local)


@pytest.mark.parametrize("suffix", [".bvh", ".npz"])
@pytest.mark.parametrize("up", AXES)
@pytest.mark.parametrize("kind", ["walk", "run"])
def test_a_person_who_goes_is_set_upright(tmp_path, small_body, suffix, up, kind):
    gait = make_gait(kind, 3.0, 30.0, small_body, np.random.default_rng(0))
    path = _save(tmp_path / f"a{suffix}", _in_world(gait, up), small_body)
    read = read_file(path, small_body, ReadConfig())
    assert read.upright and "is up (the feet show it)" in read.motion.source
    # What is up, as the body sees it, and how high the pelvis is.
    np.testing.assert_allclose(read.motion.root_rotmats[:, 2], gait.root_rotmats[:, 2], atol=1e-3)
    rises_m = np.diff(read.motion.pelvis_m[:, 2])
    scale = rises_m.max() / np.diff(gait.pelvis_m[:, 2]).max()
    np.testing.assert_allclose(rises_m, scale * np.diff(gait.pelvis_m[:, 2]), atol=1e-3)
    said = read_motion(path, small_body, up="y" if suffix == ".bvh" else "z")
    assert not np.allclose(said.root_rotmats[:, 2], gait.root_rotmats[:, 2], atol=0.1)


@pytest.mark.parametrize("suffix", [".bvh", ".npz"])
def test_one_who_stands_still_is_refused_until_it_is_said(tmp_path, small_body, suffix):
    walk = make_gait("walk", 2.0, 30.0, small_body, np.random.default_rng(0))
    still = replace(walk.take(np.zeros(60, dtype=int)), pelvis_m=np.tile([0.1, 0.2, 0.0], (60, 1)))
    still = replace(still, local_rotmats=np.broadcast_to(np.eye(3), (60, 23, 3, 3)))
    fallen = _in_world(still, "y")
    path = _save(tmp_path / f"a{suffix}", fallen, small_body)
    here, other = ("-z", "y") if suffix == ".bvh" else ("y", "z")
    with pytest.raises(BadMotionFile, match=f"up: --up {here} or --up {other}$"):
        read_motion(path, small_body)
    assert read_file(path, small_body, ReadConfig(up=here)).upright
    assert not read_file(path, small_body, ReadConfig(up=other)).upright


def _lying(walk: Motion, t_s: np.ndarray) -> Motion:
    return _moved(_pointed(walk), SUPINE, np.tile([0.0, 0.0, 0.12], (len(t_s), 1)))


def _swimming(walk: Motion, t_s: np.ndarray) -> Motion:
    return _moved(_pointed(walk), SUPINE, np.c_[0 * t_s, 1.2 * t_s, 0 * t_s])


def _rolling(walk: Motion, t_s: np.ndarray) -> Motion:
    rolls = Rotation.from_euler("z", 3.0 * t_s[:, None]).as_matrix()
    return _moved(_pointed(walk), SUPINE @ rolls, np.c_[0.6 * t_s, 0 * t_s, 0 * t_s + 0.12])


def _cartwheeling(walk: Motion, t_s: np.ndarray) -> Motion:
    turns = Rotation.from_euler("y", 4.0 * t_s[:, None]).as_matrix()
    return _moved(walk, turns, np.c_[1.2 * t_s, 0 * t_s, 0 * t_s + 0.8])


def _hanging_by_the_feet(walk: Motion, t_s: np.ndarray) -> Motion:
    return _moved(_pointed(walk), HEADSTAND, np.tile([0.0, 0.0, 1.2], (len(t_s), 1)))


@pytest.mark.parametrize("suffix", [".bvh", ".npz"])
@pytest.mark.parametrize("made", [_lying, _swimming, _rolling, _cartwheeling, _hanging_by_the_feet])
def test_who_does_not_stand_is_left_as_he_is(tmp_path, small_body, suffix, made):
    walk = make_gait("walk", 3.0, 30.0, small_body, np.random.default_rng(1))
    walk = replace(walk, root_rotmats=walk.root_rotmats[0].T @ walk.root_rotmats)
    walk = _moved(walk, Rotation.from_euler("x", 90, degrees=True).as_matrix(), walk.pelvis_m)
    motion = made(walk, np.arange(walk.n_frames) / walk.fps_hz)
    read = read_file(_save(tmp_path / f"a{suffix}", motion, small_body), small_body, ReadConfig())
    assert not read.upright and "is up" not in read.motion.source
    np.testing.assert_allclose(read.motion.root_rotmats, motion.root_rotmats, atol=1e-5)


def test_one_who_lies_with_feet_at_right_angles_is_not_turned(tmp_path, small_body):
    """On a couch: the feet seem to stand, but it is they that move, not the pelvis over them."""
    walk = make_gait("walk", 3.0, 30.0, small_body, np.random.default_rng(1))
    t_s = np.arange(walk.n_frames) / walk.fps_hz
    turns = np.zeros((len(t_s), 23, 3))
    for joint, about in ((1, 0), (2, 0), (3, 2), (6, 2)):  # hips bend slowly, the trunk to the side
        turns[:, joint - 1, about] = 0.15 * np.sin(2.0 * t_s)
    turns[:, [6, 7], 0] = -turns[:, [0, 1], 0]  # feet stay as they are
    local = Rotation.from_rotvec(turns.reshape(-1, 3)).as_matrix().reshape(-1, 23, 3, 3)
    lying = replace(walk, local_rotmats=local, root_rotmats=np.tile(np.eye(3), (len(t_s), 1, 1)))
    lying = replace(lying, pelvis_m=np.tile([0.0, 0.0, 0.45], (len(t_s), 1)))
    said = standing_along(person_of(small_body, lying), axis_of("y"))
    assert said.sway_m > 0.1 and said.planted > 0.2 and said.carried_m < 0.0
    with pytest.raises(BadMotionFile, match="stands still along y, or lies"):
        read_motion(_save(tmp_path / "a.npz", lying, small_body), small_body)


def test_one_who_lies_in_a_rig_that_shows_no_up(tmp_path, small_body, write_person):
    """Bones along one axis in the zero pose: the trunk alone would say that this person stands."""
    shoulders = np.zeros((30, 24, 3))
    shoulders[:, [JOINT["left_shoulder"], JOINT["right_shoulder"]]] = [[60, 0, 0], [-60, 0, 0]]
    shoulders[:, 0] = [0, -90, 0]
    path = write_person(tmp_path / "a.bvh", small_body, shoulders, np.zeros((30, 3)))
    turned = read_file(path, small_body, ReadConfig(rest_pose="first_frame"))
    assert [what for what in turned.remarks if "no up" in what]
    said = read_file(path, small_body, ReadConfig(rest_pose="first_frame", up="z"))
    assert not [what for what in said.remarks if "no up" in what]


@pytest.mark.parametrize("far_m", [0.0, 13.0, 100.0])
def test_a_jump_does_not_hide_that_the_world_is_tilted(small_body, far_m):
    """One frame 13 m away: both feet carried 0 there, the tilt was NaN, and nothing was said."""
    walk = make_gait("walk", 6.0, 30.0, small_body, np.random.default_rng(0))
    turn = Rotation.from_euler("x", 30, degrees=True).as_matrix()
    tilted = _moved(walk, turn, walk.pelvis_m @ turn.T)
    upright_deg, own_deg = (tilt_over_feet_deg(person_of(small_body, m)) for m in (walk, tilted))
    assert own_deg == pytest.approx(30.0, abs=upright_deg + 0.1)
    tilted.pelvis_m[90, 0] += far_m
    person = person_of(small_body, tilted)
    assert tilt_over_feet_deg(person) == pytest.approx(own_deg, abs=0.1)
    (remark,) = remarks_on(person, 30.0)
    assert remark.startswith(f"leans by {own_deg:.0f} degrees over the feet on average")


def test_a_pelvis_that_jumps_is_said(tmp_path, small_body):
    """A file with places of one trial and then of another had no remark, and was trained on."""
    walk = make_gait("walk", 2.0, 30.0, small_body, np.random.default_rng(0))
    assert (
        read_file(_save(tmp_path / "a.npz", walk, small_body), small_body, ReadConfig()).remarks
        == ()
    )
    walk.pelvis_m[40:, 1] += 0.5
    path = _save(tmp_path / "b.npz", walk, small_body)
    (said,) = read_file(path, small_body, ReadConfig()).remarks
    assert said.startswith("jumps by 0.5") and "from frame 39 to 40: nobody" in said
    walk.pelvis_m[50:] -= 0.6
    (said,) = read_file(
        _save(tmp_path / "c.npz", walk, small_body), small_body, ReadConfig()
    ).remarks
    assert "from frame 39 to 40, the first of 2 such steps: nobody" in said


def test_up_stands_in_the_record(tmp_path, small_body, body_path):
    walk = make_gait("walk", 2.0, 30.0, small_body, np.random.default_rng(0))
    path = _save(tmp_path / "walk.npz", _in_world(walk, "y"), small_body)
    for up, upright in ((None, True), ("z", False)):
        out = tmp_path / f"out_{up}"
        make_library((path,), str(body_path), out, up=up)
        record = ReadingRecord.read(out / "clips" / "walk" / READING_FILE)
        assert (record.upright, record.residual_deg) == (upright, {})


def _odd(shared_path: Callable[[str], Path], name: str, out: Path) -> dict[str, Motion]:
    make_library((shared_path(f"odd/{name}"),), "anny", out)
    return {path.parent.name: load_clip(path).motion for path in out.rglob("clip.npz")}


def test_a_zero_pose_with_y_up_in_a_world_with_z_up(shared_path, tmp_path):
    read = _odd(shared_path, "bvh_rest_y_up_motion_z_up", tmp_path)
    for name in ("b01_rest_yup_motion_zup", "c06_reference_turned"):
        np.testing.assert_allclose(read[name].rotmats, read["plain"].rotmats, atol=1e-5)
        np.testing.assert_allclose(read[name].pelvis_m, read["plain"].pelvis_m, atol=1e-5)


def test_amass_with_y_up(shared_path, tmp_path):
    read = _odd(shared_path, "amass_y_up", tmp_path)
    turned, plain = read["n01_yup_poses"], read["m00_plain_poses"]
    np.testing.assert_allclose(turned.rotmats, plain.rotmats, atol=1e-6)
    np.testing.assert_allclose(turned.pelvis_m, plain.pelvis_m, atol=1e-5)
