"""Camera-frame poses taken as world poses, and the references that know the camera."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gmrdata.cameras.files import Geometry, SfmCameras, save_cameras
from gmrdata.cli import main
from gmrdata.score.camera_as_world import (
    CameraAsWorldConfig,
    as_if_still,
    predict_camera_as_world,
    seen_motion,
)
from gmrdata.values.clip import Clip, camera_of, load_clip
from gmrdata.values.errors import BadMotionFile, BadRecord, MissingInput
from gmrdata.values.files import read_json
from gmrdata.values.motion import Motion, deltas
from gmrdata.world.compose import metric_cameras, motion_in_camera
from tests.reconstructions import good_quality, pseudo_gt_quality

WriteSet = Callable[..., Path]
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


def test_a_camera_at_rest_sees_the_world_motion(filmed: tuple[Clip, ...]) -> None:
    clip = filmed[0]
    still = np.tile(camera_of(clip).world_from_cam[0], (40, 1, 1))
    seen = motion_in_camera(clip.motion, still)
    assert delta_error(as_if_still(seen), clip.motion) < 1e-12
    assert delta_error(as_if_still(seen_motion(clip)[0]), clip.motion) > 0.01


def test_its_world_is_upright_as_the_camera_is() -> None:
    """What is up in the image is up in the world, and what is far is along +y."""
    seen = Motion(
        np.tile(np.eye(3), (1, 23, 1, 1)), np.eye(3)[None], np.array([[0.1, -0.2, 5.0]]),
        np.zeros(10), 10.0, "small", "neutral", "camera", "seen",
    )  # fmt: skip
    np.testing.assert_allclose(as_if_still(seen).pelvis_m, [[0.1, 5.0, 0.2]])


def test_ignored_true_and_recovered(
    filmed: tuple[Clip, ...], write_set: WriteSet, tmp_path: Path
) -> None:
    """Only the camera that is known gives the true motion back, the recovered one where it is."""
    manifest = write_set(tmp_path / "set", filmed[:1])
    true = filmed[0].motion
    folder = tmp_path / "cameras" / "walk_0"
    save_cameras(folder / "sfm" / "cameras.npz", recovered(filmed[0], 2.5))
    write_scale(folder, 2.5)
    found = {}
    for camera in ("ignored", "true", "recovered"):
        out = tmp_path / camera
        asked = ["baseline", "camera_as_world", str(manifest), "--camera", camera]
        main([*asked, "--cameras", str(tmp_path / "cameras"), "--out", str(out)])
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


def test_rows_without_a_true_camera_are_not_predicted(
    filmed: tuple[Clip, ...], write_set: WriteSet, tmp_path: Path
) -> None:
    camera = camera_of(filmed[0])
    has_camera = np.arange(40) != 5
    cameras = np.where(has_camera[:, None, None], camera.world_from_cam, np.nan)
    lost = replace(filmed[0], camera=replace(camera, world_from_cam=cameras, has_camera=has_camera))
    unseen = replace(filmed[1], camera=None)
    made = predict_camera_as_world(write_set(tmp_path / "set", [lost, unseen]), tmp_path / "out")
    found = load_clip(made / "predictions" / "walk_0.npz")
    np.testing.assert_array_equal(found.valid, has_camera)
    assert read_json(made / "predictions.json")["left_out"] == {"walk_1": "no camera sees it"}


def test_a_clip_in_the_camera_frame_is_taken_as_it_is(
    filmed: tuple[Clip, ...], write_set: WriteSet, tmp_path: Path
) -> None:
    motion = motion_in_camera(filmed[0].motion, camera_of(filmed[0]).world_from_cam)
    manifest = write_set(tmp_path / "set", [replace(filmed[0], motion=motion, camera=None)])
    made = predict_camera_as_world(manifest, tmp_path / "out")
    found = load_clip(made / "predictions" / "walk_0.npz").motion
    assert found.frame == "world"
    assert delta_error(found, as_if_still(motion)) < 1e-9


def test_recovered_cameras_that_do_not_fit(
    filmed: tuple[Clip, ...], write_set: WriteSet, tmp_path: Path
) -> None:
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


def test_cameras_that_do_not_travel_need_no_scale(
    filmed: tuple[Clip, ...], write_set: WriteSet, tmp_path: Path
) -> None:
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
