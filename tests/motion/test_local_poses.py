"""Local poses from each format: the same rotations, split where frames are missing."""

import pickle  # noqa: TID251  The tests write hostile files.
import zipfile
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from gmrdata.motion.gait import embedded_motions
from gmrdata.motion.local_poses import read_local_poses
from gmrdata.values.body import BodyModel, sized
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip, save_clip
from gmrdata.values.errors import BadMotionFile, BadRecipe, BrokenPickle, MissingInput, UnsafePickle
from gmrdata.values.motion import Motion
from tests.damage import Calls, bytes_changed, read_or_refused
from tests.joblib_layout import joblib_bytes
from tests.motions import save_bare
from tests.read.system_files import (
    phalp_frame,
    phalp_poses,
    rotmats,
    some_gvhmr,
    some_poses,
    some_wham,
    vibe_person,
    write_joblib,
    write_phalp,
    write_prompthmr,
    write_slahmr,
    write_torch,
    write_tram,
)


def test_vibe(tmp_path, small_body):
    people = {1: vibe_person(5), 4: vibe_person(3, frame_ids=[7, 8, 9], seed=1)}
    first, second = read_local_poses(
        write_joblib(tmp_path / "vibe_output.pkl", people), 25.0, body=small_body
    )
    assert (first.id, second.id) == ("person_1", "person_4")
    for clip, person in ((first, people[1]), (second, people[4])):
        expected = rotmats(person["pose"])[:, 1:]
        np.testing.assert_allclose(clip.motion.local_rotmats, expected, atol=1e-12)
        assert np.array_equal(clip.image_numbers, person["frame_ids"])
        assert clip.valid.all()
        assert (clip.motion.fps_hz, clip.motion.body) == (25.0, "small")
        assert not clip.motion.shape.any()
    assert "vibe_output.pkl" in first.motion.source
    assert "frames 7-9 at 25 fps" in second.motion.source


def test_missing_frames_are_never_bridged(tmp_path, small_body):
    person = vibe_person(9, frame_ids=[3, 4, 5, 8, 9, 20, 30, 31, 32])
    path = write_joblib(tmp_path / "v.pkl", {0: person})
    runs = read_local_poses(path, 30.0, body=small_body)
    assert [run.id for run in runs] == [f"person_0_from_{n}" for n in (3, 8, 20, 30)]
    assert [run.image_numbers.tolist() for run in runs] == [[3, 4, 5], [8, 9], [20], [30, 31, 32]]
    joined = np.concatenate([run.motion.local_rotmats for run in runs])
    np.testing.assert_allclose(joined, rotmats(person["pose"])[:, 1:], atol=1e-12)


def test_short_gaps_are_filled_on_demand(tmp_path, small_body):
    person = vibe_person(5, frame_ids=[3, 4, 7, 8, 12])
    path = write_joblib(tmp_path / "v.pkl", {0: person})
    first, last = read_local_poses(path, 30.0, body=small_body, bridge_frames=2)
    assert first.image_numbers.tolist() == [3, 4, 5, 6, 7, 8]
    assert first.valid.tolist() == [True, True, False, False, True, True]
    assert last.image_numbers.tolist() == [12]
    expected = rotmats(person["pose"])[:, 1:]
    found = first.motion.local_rotmats
    np.testing.assert_allclose(found[first.valid], expected[:4], atol=1e-12)
    for row, share in ((2, 1 / 3), (3, 2 / 3)):
        for joint in (0, 11, 22):
            ends = Rotation.from_matrix(expected[1:3, joint])
            between = Slerp([0, 1], ends)(share).as_matrix()
            np.testing.assert_allclose(found[row, joint], between, atol=1e-12)


def test_no_gap_is_filled_over_the_beginning_of_a_shot(tmp_path, small_body):
    """The shot begins in a frame in which the person is not seen."""
    poses = phalp_poses(8)
    frames = [
        phalp_frame(t, {1: poses[t]}, unseen=(1,) if t in (2, 5) else (), shot=int(t == 5))
        for t in range(8)
    ]
    path = write_phalp(tmp_path / "p.pkl", frames)
    runs = read_local_poses(path, 30.0, body=small_body, bridge_frames=3)
    assert [run.image_numbers.tolist() for run in runs] == [[0, 1, 2, 3, 4], [6, 7]]
    assert runs[0].valid.tolist() == [True, True, False, True, True]


def test_betas_are_kept_on_the_body_that_they_are_of(tmp_path, small_body):
    person = vibe_person(4)
    path = write_joblib(tmp_path / "v.pkl", {0: person})
    (run,) = read_local_poses(path, 30.0, body=replace(small_body, name="smpl-neutral"))
    np.testing.assert_allclose(run.motion.shape, person["betas"].mean(axis=0), atol=1e-6)
    (other,) = read_local_poses(path, 30.0, body=replace(small_body, name="smpl-male"))
    assert not other.motion.shape.any()


@pytest.mark.parametrize("of_body", ["smpl-female", "smpl-neutral"])
def test_the_shape_of_a_clip_is_kept_by_size_and_its_gender_is_the_bodys(
    of_body, tmp_path, small_body
):
    """A woman's clip on the neutral body was called female, and 10 betas were lost on 16."""
    woman = replace(small_body, name="smpl-female")
    motion = embedded_motions(woman, np.random.default_rng(0), count=1, duration_s=1)[0]
    assert (motion.body, motion.gender) == ("smpl-female", "female")
    path = save_bare(tmp_path / "walk.npz", woman, motion)
    (run,) = read_local_poses(path, body=sized(replace(woman, name=of_body), 16))
    kept = of_body == "smpl-female"
    assert (run.motion.body, run.motion.gender) == (of_body, of_body.removeprefix("smpl-"))
    np.testing.assert_array_equal(run.motion.shape, np.append(motion.shape * kept, np.zeros(6)))


def test_wham(tmp_path, small_body):
    runs = read_local_poses(
        write_joblib(tmp_path / "wham_output.pkl", some_wham({0: 4, 12: 6})), 30.0, body=small_body
    )
    assert [run.id for run in runs] == ["person_0", "person_12"]
    assert [run.motion.n_frames for run in runs] == [4, 6]
    expected = rotmats(some_poses(6, seed=12))[:, 1:]
    np.testing.assert_allclose(runs[1].motion.local_rotmats, expected, atol=1e-12)


def test_phalp_leaves_out_what_was_not_seen_and_splits_at_shots(tmp_path, small_body):
    a, b = phalp_poses(8), phalp_poses(8, seed=5)
    frames = [
        phalp_frame(
            t,
            {2: a[t]} if t < 2 else {2: a[t], 7: b[t]},
            unseen=(2,) if t == 3 else (),
            shot=int(t == 6),
        )
        for t in range(8)
    ]
    runs = read_local_poses(write_phalp(tmp_path / "demo_x.pkl", frames), 30.0, body=small_body)
    assert {run.id: run.image_numbers.tolist() for run in runs} == {
        "person_2_from_0": [0, 1, 2],
        "person_2_from_4": [4, 5],
        "person_2_from_6": [6, 7],
        "person_7_from_2": [2, 3, 4, 5],
        "person_7_from_6": [6, 7],
    }
    by_id = {run.id: run.motion.local_rotmats for run in runs}
    np.testing.assert_allclose(by_id["person_2_from_4"], a[4:6], atol=1e-6)
    np.testing.assert_allclose(by_id["person_7_from_2"], b[2:6], atol=1e-6)
    product = by_id["person_7_from_2"] @ np.swapaxes(by_id["person_7_from_2"], -1, -2)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(3), product.shape), atol=1e-12)


def test_phalp_frames_may_stand_in_any_order(tmp_path, small_body):
    poses = phalp_poses(4)
    frames = [phalp_frame(t, {1: poses[t]}) for t in (2, 0, 3, 1)]
    (run,) = read_local_poses(write_phalp(tmp_path / "p.pkl", frames), 30.0, body=small_body)
    np.testing.assert_allclose(run.motion.local_rotmats, poses, atol=1e-6)


def test_phalp_of_images_that_its_sorting_put_out_of_order_is_refused(tmp_path, small_body):
    """It takes a folder's 0.jpg to 11.jpg as 0, 1, 10, 11, 2, ...: times would be of others."""
    poses, names = phalp_poses(12), sorted(f"rgbd/{n}.jpg" for n in range(12))
    frames = [phalp_frame(t, {1: poses[t]}) | {"frame_path": name} for t, name in enumerate(names)]
    path = write_phalp(tmp_path / "p.pkl", frames)
    with pytest.raises(BadMotionFile, match=r"p\.pkl: image 2 follows on image 11.*00012\.jpg"):
        read_local_poses(path, 30.0, body=small_body)
    # Times in seconds have their own numbers of digits, and their parts begin again.
    times_s = [f"1305031102.{t}" for t in (175, 2, 304, 45, 6, 72, 854, 95)]
    times_s += [f"1305031103.{t}" for t in ("004", "04", 1, 14)]
    for right in ([f"{t:02d}" for t in range(12)], times_s, list("abcdefghijkl")):
        named = [{**one, "frame_path": f"{t}.jpg"} for one, t in zip(frames, right, strict=True)]
        (run,) = read_local_poses(write_phalp(path, named), 30.0, body=small_body)
        assert run.image_numbers.tolist() == list(range(12))


def test_gvhmr_has_21_joints_and_straight_hands(tmp_path, small_body):
    path = write_torch(tmp_path / "hmr4d_results.pt", some_gvhmr(6))
    (run,) = read_local_poses(path, 30.0, body=small_body)
    found = run.motion.local_rotmats
    np.testing.assert_allclose(found[:, :21], rotmats(some_poses(6, 21)), atol=1e-12)
    assert np.array_equal(found[:, 21:], np.broadcast_to(np.eye(3), (6, 2, 3, 3)))
    assert run.image_numbers.tolist() == list(range(6))


def test_results_that_were_saved_in_another_way(tmp_path, small_body):
    """zju3dv/GVHMR#10: the result as a numpy pickle, for Blender; and a dict with an order."""
    content = some_gvhmr(6)
    arrays = {
        key: {name: None if one is None else one.numpy() for name, one in content[key].items()}
        for key in ("smpl_params_global", "smpl_params_incam")
    }
    (tmp_path / "hmr4d_results.pt.pkl").write_bytes(pickle.dumps(arrays))
    whole = write_torch(tmp_path / "hmr4d_results.pt", content)
    (tmp_path / "w.pkl").write_bytes(pickle.dumps(OrderedDict(some_wham({0: 6}))))
    wham = write_joblib(tmp_path / "wham_output.pkl", some_wham({0: 6}))
    for other, usual in ((tmp_path / "hmr4d_results.pt.pkl", whole), (tmp_path / "w.pkl", wham)):
        (found,), (true,) = (read_local_poses(p, 30.0, body=small_body) for p in (other, usual))
        assert np.array_equal(found.motion.local_rotmats, true.motion.local_rotmats)
    torch.save(content, tmp_path / "old.pt", _use_new_zipfile_serialization=False)
    with pytest.raises(BadMotionFile, match=r"old\.pt: .*before version 1\.6.*save it again"):
        read_local_poses(tmp_path / "old.pt", 30.0, body=small_body)


def filmed_motion(body: BodyModel) -> tuple[Motion, CameraPath]:
    """A second at 20 Hz, before a camera that stands at the origin."""
    motion = embedded_motions(body, np.random.default_rng(0), count=1, fps_hz=20, duration_s=1)[0]
    n, matrix_px = motion.n_frames, np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    still = np.tile(np.eye(4), (n, 1, 1))
    return motion, CameraPath(matrix_px, 640, 480, still, np.ones(n, bool))


def test_systems_in_folders_and_npz_are_read_too(tmp_path, small_body):
    motion, camera = filmed_motion(small_body)
    n, rest_m = motion.n_frames, small_body.rest_pelvis_m(motion.shape)
    tram = write_tram(tmp_path / "tram", motion, camera, np.arange(n) + 2, rest_m)
    run = write_slahmr(tmp_path / "run", {7: motion}, camera, rest_m)
    slahmr = run / "motion_chunks" / "x_000040_world_results.npz"
    for path, name, n_same, first in ((tram, "person_0", 23, 2), (slahmr, "person_7", 21, 0)):
        (found,) = read_local_poses(path, 20.0, body=small_body)
        assert (found.id, found.image_numbers[0], found.motion.n_frames) == (name, first, n)
        wanted = motion.local_rotmats[:, :n_same]
        np.testing.assert_allclose(found.motion.local_rotmats[:, :n_same], wanted, atol=1e-9)


def test_a_rate_that_is_not_that_of_slahmrs_frames_is_refused(tmp_path, small_body):
    """It takes images at 30 Hz of a video of 60, whose rate made the motion twice as fast."""
    motion, camera = filmed_motion(small_body)
    run = write_slahmr(tmp_path, {7: motion}, camera, small_body.rest_pelvis_m(motion.shape))
    path = run / "motion_chunks" / "x_000040_world_results.npz"
    (run / ".hydra").mkdir()
    config = "data:\n  type: video\n  frame_opts:\n    fps: 30\n"
    (run / ".hydra" / "config.yaml").write_text(config)
    for said_hz, fps_hz in ((None, 30.0), (29.97, 29.97)):
        (found,) = read_local_poses(path, said_hz, body=small_body)
        assert found.motion.fps_hz == fps_hz
    with pytest.raises(BadRecipe, match="--fps-hz 60: .*frames are at 30 fps.*Leave it out"):
        read_local_poses(path, 60.0, body=small_body)
    mosh = {"fullpose": some_poses(5, 52), "trans": np.zeros((5, 3)), "mocap_framerate": 60.0}
    (own,) = read_local_poses(write_joblib(tmp_path / "mosh.pkl", mosh), 30.0, body=small_body)
    assert own.motion.fps_hz == 30.0


@pytest.mark.parametrize(("video_hz", "fps_hz"), [(89.0, 89.0), (120.0, 60.0), (240.0, 60.0)])
def test_prompthmr_has_no_rate_of_a_faster_video(video_hz, fps_hz, tmp_path, small_body):
    """It leaves out frames by itself then."""
    motion, camera = filmed_motion(small_body)
    path = tmp_path / "results.pkl"
    write_prompthmr(path, motion, camera, np.arange(motion.n_frames))
    if video_hz != fps_hz:
        with pytest.raises(BadRecipe, match=f"takes one of each .* frames. Say {fps_hz:g}"):
            read_local_poses(path, video_hz, body=small_body)
    (found,) = read_local_poses(path, fps_hz, body=small_body)
    assert found.motion.fps_hz == fps_hz


def test_amass_keeps_its_own_rate_or_takes_the_given_one(tmp_path, small_body):
    poses = some_poses(5, 52).astype(np.float64)
    np.savez(
        tmp_path / "walk_poses.npz",
        poses=poses,
        trans=np.zeros((5, 3)),
        betas=np.zeros(16),
        gender="neutral",
        mocap_framerate=60.0,
    )
    (run,) = read_local_poses(tmp_path / "walk_poses.npz", body=small_body)
    assert (run.id, run.motion.fps_hz) == ("walk_poses", 60.0)
    expected = rotmats(poses)[:, [*range(1, 23), 37]]
    np.testing.assert_allclose(run.motion.local_rotmats, expected, atol=1e-12)
    (slower,) = read_local_poses(tmp_path / "walk_poses.npz", 30.0, body=small_body)
    assert slower.motion.fps_hz == 30.0


def test_a_clip_is_split_at_frames_that_are_not_valid(tmp_path, small_body):
    motion = embedded_motions(
        small_body, np.random.default_rng(0), count=1, fps_hz=20.0, duration_s=1.0
    )[0]
    valid = np.ones(20, bool)
    valid[8:11] = False
    rotations = motion.local_rotmats.copy()
    rotations[8:11] = np.nan
    clip = Clip("walk", replace(motion, local_rotmats=rotations), valid, np.arange(20), None)
    save_clip(tmp_path / "c.npz", clip, small_body.rest_pelvis_m(motion.shape))
    runs = read_local_poses(tmp_path / "c.npz", body=small_body)
    assert [run.id for run in runs] == ["walk_from_0", "walk_from_11"]
    np.testing.assert_allclose(runs[1].motion.local_rotmats, rotations[11:], atol=1e-12)
    assert runs[0].motion.fps_hz == 20.0
    np.testing.assert_allclose(runs[0].motion.shape, motion.shape, atol=0)


def _with_nan(n_frames: int) -> np.ndarray:
    poses = some_poses(n_frames)
    poses[2, 5] = np.nan
    return poses


BAD_PEOPLE: dict[str, tuple[Callable[[], Any], str]] = {
    "22 joints": (
        lambda: {1: vibe_person(4) | {"pose": some_poses(4, 22)}},
        r"pose of person_1 is \(4, 66\), not \(T, 72\)",
    ),
    "NaN": (
        lambda: {1: vibe_person(4) | {"pose": _with_nan(4)}},
        "pose of person_1 is not finite at frame 2; cut such frames",
    ),
    "one frame": (lambda: {1: vibe_person(1)}, "no person has two frames in a row"),
    "no frames": (lambda: {1: vibe_person(0)}, r"pose of person_1 is \(0, 72\)"),
    "alone": (lambda: {1: vibe_person(3, [1, 5, 9])}, "no person has two frames in a row"),
    "fewer frame numbers": (
        lambda: {1: vibe_person(4) | {"frame_ids": np.arange(3)}},
        r"frame_ids of person_1 is \(3,\) for 4 poses",
    ),
    "falling frame numbers": (
        lambda: {1: vibe_person(3, [5, 4, 6])},
        "frame_ids of person_1 are not rising frame numbers",
    ),
    "frame numbers before the video": (
        lambda: {1: vibe_person(3, [-1, 0, 1])},
        "frame_ids of person_1 are not rising frame numbers",
    ),
    "broken frame numbers": (
        lambda: {1: vibe_person(3) | {"frame_ids": np.array([0.0, 0.5, 2.0])}},
        "are not rising frame numbers",
    ),
    "no pose": (lambda: {1: {"frame_ids": np.arange(3)}}, "person_1 has no 'pose'"),
    "words": (
        lambda: {1: vibe_person(2) | {"pose": np.array([["a"] * 72] * 2)}},
        "pose of person_1 does not hold numbers",
    ),
    "a path as a name": (lambda: {"../../x": vibe_person(3)}, r"a person is called '\.\./\.\./x'"),
    "a huge number as a name": (lambda: {1 << 20000: vibe_person(3)}, "a person is called a int"),
    "other keys": (lambda: {1: {"joints": np.ones(3)}}, "first entry has: joints"),
    "an array alone": (lambda: np.ones((3, 72)), "no poses in a known form"),
    "no people": (dict, "has no person in it"),
    "not a person": (lambda: {1: vibe_person(3), 2: np.ones(3)}, "person_2 has no 'pose'"),
}


BAD_FRAMES: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "wrong joints": (
        lambda frame: frame["smpl"][0].update(body_pose=np.zeros((21, 3, 3))),
        r"body_pose of person_1 in frame 1 is \(21, 3, 3\)",
    ),
    "no rotations": (
        lambda frame: frame["smpl"][0].update(body_pose=np.ones((23, 3, 3))),
        "body_pose of person_1 holds matrices that are no rotations",
    ),
    "mirrored": (
        lambda frame: frame["smpl"][0].update(body_pose=-np.tile(np.eye(3), (23, 1, 1))),
        "holds matrices that are no rotations",
    ),
    "NaN": (
        lambda frame: frame["smpl"][0].update(body_pose=np.full((23, 3, 3), np.nan)),
        "body_pose of person_1 in frame 1 is not finite",
    ),
    "fewer poses than tracks": (lambda frame: frame["smpl"].clear(), "of different lengths"),
    "no tracks": (lambda frame: frame.update(tid=None), "of different lengths"),
    "no lists": (lambda frame: frame.update(tid=None, smpl=None), "of different lengths"),
    "tracks of None": (lambda frame: frame.update(tid=[None]), "a person is called a NoneType"),
    "poses of None": (
        lambda frame: frame.update(smpl=[None]),
        "person_1 in frame 1 has no 'body_pose'",
    ),
    "no time": (lambda frame: frame.pop("time"), "has no 'time'"),
    "a time that is no number": (lambda frame: frame.update(time="x"), "is no number"),
    "the same time twice": (lambda frame: frame.update(time=0), "are not rising frame numbers"),
    "ragged betas": (
        lambda frame: frame["smpl"][0].update(betas=np.ones(3)),
        "betas of person_1 are of other lengths by frame",
    ),
}


def _tracks(change: Callable[[dict[str, Any]], Any]) -> dict[Any, Any]:
    poses = phalp_poses(3)
    frames = [phalp_frame(t, {1: poses[t]}) for t in range(3)]
    change(frames[1])
    return {frame["frame_path"]: frame for frame in frames}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        *BAD_PEOPLE.values(),
        *((partial(_tracks, change), said) for change, said in BAD_FRAMES.values()),
    ],
    ids=[*BAD_PEOPLE, *(f"track: {fault}" for fault in BAD_FRAMES)],
)
def test_bad_people_and_tracks_are_refused_by_name(content, message, tmp_path, small_body):
    path = tmp_path / "bad.pkl"
    path.write_bytes(joblib_bytes(content()))
    with pytest.raises(BadMotionFile, match=message) as caught:
        read_local_poses(path, 30.0, body=small_body)
    assert str(path) in str(caught.value)


def test_gvhmr_of_another_layout(tmp_path, small_body):
    write_torch(tmp_path / "a.pt", some_gvhmr(4, n_joints=23))
    torch.save({"weights": torch.ones(3)}, tmp_path / "b.pt")
    torch.save(torch.ones(3), tmp_path / "c.pt")
    with zipfile.ZipFile(tmp_path / "d.pt", "w") as archive:
        archive.writestr("hello.txt", "hello")
    for name, said in (
        ("a", r"body_pose of person_0 is \(4, 69\), not \(T, 63\)"),
        ("b", "holds no poses in a known form .it has: weights"),
        ("c", "holds no dict"),
        ("d", r"truncated or not a file of torch\.save"),
    ):
        with pytest.raises(BadMotionFile, match=rf"{name}\.pt: {said}"):
            read_local_poses(tmp_path / f"{name}.pt", 30.0, body=small_body)


def test_hostile_files_are_not_run(tmp_path, small_body):
    touched = tmp_path / "touched"
    call = Calls(exec, f"open({str(touched)!r}, 'w')")
    person = vibe_person(3) | {"joints2d": call}
    (tmp_path / "vibe.pkl").write_bytes(joblib_bytes({1: person}))
    content = {"smpl_params_global": call}
    torch.save(content, tmp_path / "new.pt")
    torch.save(content, tmp_path / "old.pt", _use_new_zipfile_serialization=False)
    (tmp_path / "plain.pkl").write_bytes(pickle.dumps(call))
    for name in ("vibe.pkl", "new.pt", "plain.pkl"):
        with pytest.raises(UnsafePickle, match=name.replace(".", r"\.")):
            read_local_poses(tmp_path / name, 30.0, body=small_body)
    with pytest.raises(
        BadMotionFile, match=r"old\.pt: is in torch's form from before version 1\.6"
    ):
        read_local_poses(tmp_path / "old.pt", 30.0, body=small_body)
    assert not touched.exists()


def _whole(kind: str, folder: Path) -> bytes:
    """A file of one person in three frames from a system."""
    path = folder / "whole.bin"
    if kind == "vibe":
        write_joblib(path, {1: vibe_person(3)})
    elif kind == "phalp":
        poses = phalp_poses(3)
        write_phalp(path, [phalp_frame(t, {1: poses[t]}) for t in range(3)])
    else:
        write_torch(path, some_gvhmr(3))
    return path.read_bytes()


@given(data=st.data())
def test_changed_bytes_are_read_or_refused(data, small_body, tmp_path_factory):
    """Whatever a few changed bytes make of a file: poses that are finite, or one of our errors."""
    folder = tmp_path_factory.getbasetemp()
    whole = _whole(data.draw(st.sampled_from(["vibe", "phalp", "gvhmr"])), folder)
    runs = read_or_refused(
        folder / "changed.bin",
        bytes_changed(data, whole),
        lambda path: read_local_poses(path, 30.0, body=small_body),
    )
    assert all(np.isfinite(run.motion.local_rotmats).all() for run in runs or ())


@pytest.mark.parametrize("kind", ["vibe", "phalp", "gvhmr"])
def test_truncated_files_are_an_error(kind, tmp_path, small_body):
    data, cut = _whole(kind, tmp_path), tmp_path / "cut.bin"
    for length in np.linspace(0, len(data) - 1, 40).astype(int):
        cut.write_bytes(data[:length])
        with pytest.raises((BrokenPickle, UnsafePickle, BadMotionFile), match=r"cut\.bin"):
            read_local_poses(cut, 30.0, body=small_body)


def test_a_rate_is_needed_and_checked(tmp_path, small_body):
    path = write_joblib(tmp_path / "v.pkl", {1: vibe_person(3)})
    with pytest.raises(BadMotionFile, match=r"v\.pkl: does not say its frame rate.*--fps-hz"):
        read_local_poses(path, body=small_body)
    with pytest.raises(BadMotionFile, match="5000 Hz is not from 1 to 1000 Hz"):
        read_local_poses(path, 5000.0, body=small_body)
    with pytest.raises(MissingInput, match=r"none\.pkl: no such file"):
        read_local_poses(tmp_path / "none.pkl", 30.0, body=small_body)


def test_a_pickle_that_says_its_rate_is_believed(tmp_path, small_body):
    poses = {"poses": some_poses(6), "trans": np.zeros((6, 3)), "mocap_framerate": 60.0}
    path = tmp_path / "m.pkl"
    path.write_bytes(pickle.dumps(poses))
    rates = [read_local_poses(path, said, body=small_body)[0] for said in (None, 30.0)]
    assert [clip.motion.fps_hz for clip in rates] == [60.0, 30.0]
