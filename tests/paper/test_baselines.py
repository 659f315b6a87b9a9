"""Baselines without training: camera-frame poses as world poses, zero and mean motion."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.cameras.files import Geometry, SfmCameras, save_cameras
from gmrdata.gmr.runs import runs_at
from gmrdata.manifest.current import Quality
from gmrdata.score.baselines import (
    MeanConfig,
    Subject,
    mean_motion,
    moving_as,
    predict_mean,
    predict_zero,
)
from gmrdata.score.camera_as_world import (
    CameraAsWorldConfig,
    as_if_still,
    predict_camera_as_world,
    seen_motion,
)
from gmrdata.values.clip import Clip, camera_of, load_clip
from gmrdata.values.errors import (
    BadManifest,
    BadMotionFile,
    BadRecord,
    MissingInput,
    StageFailed,
    StaleOutput,
)
from gmrdata.values.files import read_json
from gmrdata.values.motion import Motion, accumulate, deltas
from gmrdata.world.compose import metric_cameras, motion_in_camera
from tests.clips_in_memory import counted_clips
from tests.motions import with_camera
from tests.reconstructions import good_quality, pseudo_gt_quality

RECOVERED = CameraAsWorldConfig(camera="recovered")


def delta_error(motion: Motion, true: Motion) -> float:
    """Largest difference of the two motions' dR and dT entries."""
    found, expected = (deltas(one.root_rotmats, one.pelvis_m) for one in (motion, true))
    return max(float(np.abs(a - b).max()) for a, b in zip(found, expected, strict=True))


def recovered(clip: Clip, scale: float, geometry: Geometry = "full") -> SfmCameras:
    """The clip's cameras in another world and unit, without rows 0 and 7, one row later."""
    camera = camera_of(clip)
    other = np.array([[0.0, 1, 0, 3], [0, 0, 1, -2], [1, 0, 0, 5], [0, 0, 0, 1]])
    world_from_cam = metric_cameras(other @ camera.world_from_cam, 1 / scale)
    has_camera = np.ones(clip.motion.n_frames, bool)
    has_camera[7] = False
    world_from_cam[7] = np.nan
    path = replace(camera, world_from_cam=world_from_cam[1:], has_camera=has_camera[1:])
    return SfmCameras(path, geometry, clip.image_numbers[1:], np.zeros(len(path.has_camera), bool))


def write_scale(folder: Path, scale: float | None) -> None:
    quality = pseudo_gt_quality(good_quality(40), scale)
    quality.write(folder / "pseudo_gt" / "quality.json")


def test_a_camera_at_rest_sees_the_world_motion(filmed):
    clip = filmed[0]
    still = np.tile(camera_of(clip).world_from_cam[0], (40, 1, 1))
    seen = motion_in_camera(clip.motion, still)
    assert delta_error(as_if_still(seen), clip.motion) < 1e-12
    assert delta_error(as_if_still(seen_motion(clip)[0]), clip.motion) > 0.01


def test_its_world_is_upright_as_the_camera_is():
    """What is up in the image is up in the world, and what is far is along +y."""
    seen = Motion(
        np.tile(np.eye(3), (1, 23, 1, 1)), np.eye(3)[None], np.array([[0.1, -0.2, 5.0]]),
        np.zeros(10), 10.0, "small", "neutral", "camera", "seen",
    )  # fmt: skip
    np.testing.assert_allclose(as_if_still(seen).pelvis_m, [[0.1, 5.0, 0.2]])


def test_ignored_true_and_recovered(filmed, write_set, tmp_path, works):
    """Only the camera that is known gives the true motion back, the recovered one where it is."""
    manifest = write_set(tmp_path / "set", filmed[:1])
    true = filmed[0].motion
    folder = tmp_path / "cameras" / "walk_0"
    save_cameras(folder / "sfm" / "cameras.npz", recovered(filmed[0], 2.5))
    write_scale(folder, 2.5)
    found = {}
    for camera in ("ignored", "true", "recovered"):
        out = tmp_path / camera
        given = ("--cameras", tmp_path / "cameras") if camera == "recovered" else ()
        asked = ("baseline", "camera_as_world", manifest, "--camera", camera, *given)
        works(*asked, "--out", out)
        found[camera] = load_clip(out / "predictions" / "walk_0.npz")
        assert read_json(out / "predictions.json")["figures"] == {"camera": camera}
    assert delta_error(found["ignored"].motion, true) > 0.01
    np.testing.assert_allclose(found["true"].motion.pelvis_m, true.pelvis_m, atol=1e-9)
    np.testing.assert_allclose(found["true"].motion.root_rotmats, true.root_rotmats, atol=1e-9)
    rows = np.arange(8, 40)
    np.testing.assert_array_equal(np.flatnonzero(~found["recovered"].valid), [0, 7])
    part, true_part = (
        replace(one, root_rotmats=one.root_rotmats[rows], pelvis_m=one.pelvis_m[rows])
        for one in (found["recovered"].motion, true)
    )
    assert delta_error(part, true_part) < 1e-9


def test_rows_without_a_true_camera_are_not_predicted(filmed, write_set, tmp_path):
    camera = camera_of(filmed[0])
    has_camera = np.arange(40) != 5
    cameras = np.where(has_camera[:, None, None], camera.world_from_cam, np.nan)
    lost = replace(filmed[0], camera=replace(camera, world_from_cam=cameras, has_camera=has_camera))
    unseen = replace(filmed[1], camera=None)
    # Where its person is, its camera is not, and it is where the person can't be used.
    elsewhere = with_camera(filmed[2], has_camera=np.arange(40) < 20)
    elsewhere = replace(elsewhere, valid=np.arange(40) >= 20)
    manifest = write_set(tmp_path / "set", [lost, unseen, elsewhere])
    made = predict_camera_as_world(manifest, tmp_path / "out")
    found = load_clip(made / "predictions" / "walk_0.npz")
    np.testing.assert_array_equal(found.valid, has_camera)
    assert read_json(made / "predictions.json")["left_out"] == dict.fromkeys(
        ("walk_1", "walk_2"), "no camera sees it"
    )


def test_a_clip_in_the_camera_frame_is_taken_as_it_is(filmed, write_set, tmp_path):
    motion = motion_in_camera(filmed[0].motion, camera_of(filmed[0]).world_from_cam)
    manifest = write_set(tmp_path / "set", [replace(filmed[0], motion=motion, camera=None)])
    made = predict_camera_as_world(manifest, tmp_path / "out")
    found = load_clip(made / "predictions" / "walk_0.npz").motion
    assert found.frame == "world"
    assert delta_error(found, as_if_still(motion)) < 1e-9


def test_recovered_cameras_that_do_not_fit(filmed, write_set, tmp_path):
    manifest = write_set(tmp_path / "set", filmed[:1])
    cameras, out = tmp_path / "cameras", tmp_path / "out"
    with pytest.raises(MissingInput, match="no recovered cameras given. Name --cameras"):
        predict_camera_as_world(manifest, out, RECOVERED)
    with pytest.raises(MissingInput, match=r"cameras/walk_0: no sfm/cameras.npz and no cameras"):
        predict_camera_as_world(manifest, out, RECOVERED, cameras_dir=cameras)
    path = cameras / "walk_0" / "cameras.npz"
    save_cameras(path, recovered(filmed[0], 2.5))
    with pytest.raises(BadMotionFile, match=r"up to scale, and no pseudo_gt/quality.json states"):
        predict_camera_as_world(manifest, out, RECOVERED, cameras_dir=cameras)
    write_scale(cameras / "walk_0", None)
    with pytest.raises(BadRecord, match=r"quality.json: states no scale above zero"):
        predict_camera_as_world(manifest, out, RECOVERED, cameras_dir=cameras)
    others = replace(recovered(filmed[0], 2.5), image_numbers=np.arange(39))
    save_cameras(path, others)
    with pytest.raises(BadMotionFile, match="a camera for none of the images of clip walk_0"):
        predict_camera_as_world(manifest, out, RECOVERED, cameras_dir=cameras)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(BadMotionFile, match=r"cameras.npz: not a readable .npz"):
        predict_camera_as_world(manifest, out, RECOVERED, cameras_dir=cameras)
    assert not out.exists()


def test_cameras_that_do_not_travel_need_no_scale(filmed, write_set, tmp_path):
    camera = camera_of(filmed[0])
    turning = camera.world_from_cam.copy()
    turning[:, :3, 3] = [1.0, -6.0, 1.5]
    clip = replace(filmed[0], camera=replace(camera, world_from_cam=turning))
    rotation_only = turning.copy()
    rotation_only[:, :3, 3] = 0
    path = replace(camera, world_from_cam=rotation_only)
    found = SfmCameras(path, "rotation_only", clip.image_numbers, np.zeros(40, bool))
    save_cameras(tmp_path / "cameras" / "walk_0" / "cameras.npz", found)
    made = predict_camera_as_world(
        write_set(tmp_path / "set", [clip]),
        tmp_path / "out",
        RECOVERED,
        cameras_dir=tmp_path / "cameras",
    )
    world = load_clip(made / "predictions" / "walk_0.npz").motion
    assert delta_error(world, clip.motion) < 1e-9


def steady(clip: Clip, rotvec_rad: list[float], delta_m: list[float]) -> Clip:
    """The same person with one motion from each frame to the next."""
    n = clip.motion.n_frames
    root_rotmats, pelvis_m = accumulate(
        np.tile(Rotation.from_rotvec(rotvec_rad).as_matrix(), (n - 1, 1, 1)),
        np.tile(delta_m, (n - 1, 1)),
        clip.motion.root_rotmats[0],
        clip.motion.pelvis_m[0],
    )
    motion = replace(clip.motion, root_rotmats=root_rotmats, pelvis_m=pelvis_m)
    return replace(clip, motion=motion)


def test_zero_motion_stays_in_the_first_valid_pose(filmed, write_set, tmp_path):
    valid = np.arange(40) >= 3
    valid[20] = False
    clips = [replace(filmed[0], valid=valid), filmed[1]]
    made = predict_zero(write_set(tmp_path / "set", clips), tmp_path / "out")
    found = load_clip(made / "predictions" / "walk_0.npz")
    np.testing.assert_array_equal(found.valid, valid)
    np.testing.assert_array_equal(found.image_numbers, clips[0].image_numbers)
    true = clips[0].motion
    assert (found.id, found.motion.frame, found.camera) == ("walk_0", "world", None)
    assert (found.motion.fps_hz, found.motion.n_frames) == (20.0, 40)
    np.testing.assert_allclose(found.motion.pelvis_m[valid] - true.pelvis_m[3], 0, atol=1e-12)
    np.testing.assert_allclose(
        found.motion.root_rotmats[valid] - true.root_rotmats[3], 0, atol=1e-12
    )
    np.testing.assert_allclose(found.motion.local_rotmats, true.local_rotmats, atol=1e-12)
    assert np.isnan(found.motion.pelvis_m[20]).all()
    record = read_json(made / "predictions.json")
    assert record["method"] == "zero"
    assert record["clips"]["walk_0"] == {"fps_hz": 20.0, "n_frames": 40, "n_valid": 36}


def test_clips_that_cannot_be_used_are_named(filmed, write_set, tmp_path):
    rejected = {"walk_0": Quality(verdict="rejected", reasons=("too few points",))}
    nothing = replace(filmed[1], valid=np.zeros(40, bool))
    manifest = write_set(tmp_path / "set", [filmed[0], nothing, filmed[2]], rejected)
    made = predict_zero(manifest, tmp_path / "out")
    assert [path.name for path in (made / "predictions").iterdir()] == ["walk_2.npz"]
    assert read_json(made / "predictions.json")["left_out"] == {
        "walk_0": "rejected: too few points",
        "walk_1": "no frame is valid",
    }
    manifest = write_set(tmp_path / "none", [nothing])
    with pytest.raises(StageFailed, match="zero: nothing to predict in any clip. walk_1: no frame"):
        predict_zero(manifest, tmp_path / "no")


def test_the_mean_of_one_motion_is_that_motion(filmed):
    clip = steady(filmed[0], [0.1, -0.3, 0.2], [0.01, -0.02, 0.05])
    mean = mean_motion([clip], 20.0)
    np.testing.assert_allclose(
        Rotation.from_matrix(mean.delta_rotmat).as_rotvec(), [0.1, -0.3, 0.2], atol=1e-9
    )
    np.testing.assert_allclose(mean.mean_m, [0.01, -0.02, 0.05], atol=1e-9)
    found = moving_as(mean, Subject(clip, np.zeros(3)))
    np.testing.assert_allclose(found.clip.motion.pelvis_m, clip.motion.pelvis_m, atol=1e-9)
    np.testing.assert_allclose(found.clip.motion.root_rotmats, clip.motion.root_rotmats, atol=1e-9)


def test_the_mean_minimises_the_chordal_distance(filmed):
    """No rotation near it has less, and the mean dT is numpy's."""
    mean = mean_motion(filmed, 10.0)
    parts = [
        deltas(run.root_rotmats, run.pelvis_m)
        for clip in filmed
        for run in runs_at(clip, 10.0, all_phases=True)
    ]
    rotmats = np.concatenate([part[0] for part in parts])
    assert mean.n_motions == len(rotmats) == 3 * 2 * 19
    np.testing.assert_allclose(
        mean.mean_m, np.concatenate([part[1] for part in parts]).mean(axis=0), atol=1e-12
    )

    def cost(rotmat: np.ndarray) -> float:
        return float(np.square(rotmats - rotmat).sum())

    for axis in np.concatenate([np.eye(3), -np.eye(3)]):
        assert cost(mean.delta_rotmat) < cost(
            mean.delta_rotmat @ Rotation.from_rotvec(0.01 * axis).as_matrix()
        )


def test_at_a_higher_rate_the_mean_is_reached_after_as_many_frames(filmed):
    """In every phase: the step is a screw's share, not that of rotation and translation alone."""
    mean = mean_motion([steady(filmed[0], [0.0, 0.8, 0.1], [0.3, 0.0, 0.1])], 20.0)
    fast = replace(filmed[1], motion=replace(filmed[1].motion, fps_hz=60.0))
    motion = moving_as(mean, Subject(fast, np.zeros(3))).clip.motion
    for phase in range(3):
        delta_rotmats, delta_m = deltas(motion.root_rotmats[phase::3], motion.pelvis_m[phase::3])
        np.testing.assert_allclose(delta_rotmats - mean.delta_rotmat, 0, atol=1e-9)
        np.testing.assert_allclose(delta_m - mean.mean_m, 0, atol=1e-9)


def test_the_verbs(filmed, small_body, write_set, tmp_path, works):
    manifest = write_set(tmp_path / "set", filmed[:2])
    training = write_set(tmp_path / "training", filmed[2:])
    for asked in (("zero", manifest), ("mean", manifest, "--training", training)):
        out = tmp_path / asked[0]
        assert works("baseline", *asked, "--out", out).stdout.split() == [str(out)]
    figures = read_json(tmp_path / "mean" / "predictions.json")["figures"]
    assert (figures["fps_hz"], figures["n_motions"]) == (10.0, 38)
    assert figures["mean_m"] == pytest.approx(mean_motion(filmed[2:], 10.0).mean_m)
    again = predict_mean(manifest, [training], tmp_path / "again")
    names = sorted(path.name for path in (again / "predictions").iterdir())
    assert names == ["walk_0.npz", "walk_1.npz"]
    for name in names:
        one, other = (tmp_path / run / "predictions" / name for run in ("mean", "again"))
        assert one.read_bytes() == other.read_bytes()
    # The rest pelvis travels with the clip, so AMASS's `trans` is right as well.
    with np.load(again / "predictions" / "walk_0.npz") as arrays:
        expected_m = small_body.rest_pelvis_m(filmed[0].motion.shape)
        np.testing.assert_allclose(arrays["rest_pelvis_m"], expected_m)
    with pytest.raises(StaleOutput, match="fps_hz"):
        predict_mean(manifest, [training], tmp_path / "again", MeanConfig(fps_hz=20.0))


def test_the_clips_of_a_mean_are_read_one_by_one(filmed, write_set, tmp_path, monkeypatch):
    """All of CMU at once were 7 GB."""
    clips = [replace(filmed[0], id=f"walk_{n}", camera=None) for n in range(4)]
    manifest = write_set(tmp_path / "set", clips[:1])
    training = write_set(tmp_path / "training", clips)
    in_memory, _ = counted_clips(monkeypatch)
    predict_mean(manifest, [training], tmp_path / "mean")
    assert len(in_memory) == 1 + 4 and max(in_memory) <= 2


def test_there_is_no_mean_of_nothing(filmed):
    flicker = replace(filmed[0], valid=np.arange(40) % 2 == 0)
    with pytest.raises(BadManifest, match="none of the 1 training clips has two valid frames"):
        mean_motion([flicker], 20.0)
    seen = replace(filmed[0], motion=replace(filmed[0].motion, frame="camera"))
    with pytest.raises(BadManifest, match="clip walk_0: its motion is in the camera's frame"):
        mean_motion([seen], 20.0)
