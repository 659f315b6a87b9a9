"""VIBE-CAM from files: translations from 2D joints come back, whatever the camera does."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from gmrdata.film.programmes import static_twin
from gmrdata.film.render_outputs import project_joints
from gmrdata.gmr.config import ModelConfig
from gmrdata.gmr.infer import predict_at_source_rate
from gmrdata.gmr.model import Gmr
from gmrdata.gmr.predict import TrainedGmr, load_gmr, predict_world_motion
from gmrdata.paper.placement import clip_keypoints
from gmrdata.paper.vibe_cam import (
    SeenFiles,
    VibeCamConfig,
    VibeCamPredictions,
    infer_poses,
    predict_vibe_cam,
)
from gmrdata.score.baselines import MeanPredictions, NetworkPredictions, Predictions
from gmrdata.score.camera_as_world import CameraPredictions, as_if_still, predict_camera_as_world
from gmrdata.stage.run import Run
from gmrdata.twins.pseudo_gt_error import motion_errors
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.errors import BadKeypoints, BadMotionFile, BadRecipe, BadRecord, MissingInput
from gmrdata.values.files import read_json
from gmrdata.values.motion import Motion, deltas
from gmrdata.values.transforms import angles_rad
from gmrdata.world.compose import motion_in_camera
from tests.fixtures.command_line import fails_cleanly
from tests.paper.openpose_files import person, write_frame, write_frames
from tests.record_keys import assert_each_key_is_needed

WriteSet = Callable[..., Path]


def seen(clip: Clip) -> Motion:
    return motion_in_camera(clip.motion, camera_of(clip).world_from_cam)


def write_poses(folder: Path, clip: Clip, body: BodyModel) -> None:
    """What another network gives: local pose, orientation in the camera, shape; no translation."""
    motion = replace(seen(clip), pelvis_m=np.zeros((clip.motion.n_frames, 3)), source="network")
    posed = replace(clip, motion=motion, camera=None)
    save_clip(folder / f"{clip.id}.npz", posed, body.rest_pelvis_m(motion.shape))


@pytest.fixture
def files(filmed, small_body, write_set, body_path, tmp_path) -> Callable[..., Path]:
    """Write what VIBE-CAM needs of the first clip but keypoints, and a function that runs it."""
    manifest = write_set(tmp_path / "set", filmed[:1])
    write_poses(tmp_path / "poses", filmed[0], small_body)

    def run(config: VibeCamConfig | None = None) -> Path:
        files = SeenFiles(tmp_path / "poses", tmp_path / "keypoints", body_path)
        return predict_vibe_cam(manifest, files, tmp_path / "out", config, run=Run(redo=True))

    return run


def errors_mm(made: Path, clip: Clip) -> np.ndarray:
    """Distance of each predicted row's pelvis from the true one before the camera (T,) [mm]."""
    found = load_clip(made / "predictions" / f"{clip.id}.npz").motion
    true = as_if_still(seen(clip))
    return 1000 * np.linalg.norm(found.pelvis_m - true.pelvis_m, axis=1)


@dataclass(frozen=True)
class Take:
    """Filmed clips, their body, what writes a set of them, and a folder."""

    clips: tuple[Clip, ...]
    body: BodyModel
    write_set: WriteSet
    path: Path


@pytest.fixture
def take(filmed, small_body, write_set, tmp_path) -> Take:
    return Take(filmed, small_body, write_set, tmp_path)


@pytest.mark.parametrize("n", [25, 21])
def test_exact_keypoints_give_the_true_translation(take, files, n):
    write_frames(take.path / "keypoints" / "walk_0", take.clips[0], take.body, n=n)
    made = files()
    found = load_clip(made / "predictions" / "walk_0.npz")
    assert found.valid.all() and found.motion.frame == "world"
    assert errors_mm(made, take.clips[0]).max() < 1e-3
    true = as_if_still(seen(take.clips[0]))
    np.testing.assert_allclose(found.motion.root_rotmats, true.root_rotmats, atol=1e-9)
    record = read_json(made / "predictions.json")["clips"]["walk_0"]
    assert record["median_residual_px"] < 1e-6
    assert record["not_predicted"] == []


def test_two_pixels_of_noise(take, files):
    """At 3.7 m before a camera of 640x480 and 60 degrees, the median error is 17 mm, in depth."""
    rng = np.random.default_rng(0)
    folder = take.path / "keypoints" / "walk_0"
    write_frames(folder, take.clips[0], take.body, noise_px=2.0, rng=rng)
    made = files()
    found = errors_mm(made, take.clips[0])
    assert seen(take.clips[0]).pelvis_m[:, 2].mean() == pytest.approx(3.7, abs=0.1)
    assert np.median(found) == pytest.approx(17, abs=1)
    assert found.max() < 100
    record = read_json(made / "predictions.json")["clips"]["walk_0"]
    # Rayleigh's median is 1.18 sigma; three fitted numbers take a little of it.
    assert record["median_residual_px"] == pytest.approx(2 * 1.18, rel=0.1)


def test_rows_without_keypoints_are_not_predicted(take, files):
    clip, folder = take.clips[0], take.path / "keypoints" / "walk_0"
    write_frames(folder, clip, take.body)
    points_px = project_joints(clip, take.body).image_px
    (folder / "clip_000000000103_keypoints.json").unlink()
    write_frame(folder, 110, [])
    write_frame(folder, 111, [])
    write_frame(folder, 120, [person(points_px[20], 0.2)])
    made = files()
    found = load_clip(made / "predictions" / "walk_0.npz")
    np.testing.assert_array_equal(np.flatnonzero(~found.valid), [3, 10, 11, 20])
    assert np.isnan(found.motion.pelvis_m[~found.valid]).all()
    assert np.nanmax(errors_mm(made, clip)) < 1e-3
    assert read_json(made / "predictions.json")["clips"]["walk_0"]["not_predicted"] == [
        {"start": 3, "stop": 4, "reason": "no keypoint file"},
        {"start": 10, "stop": 12, "reason": "nobody detected"},
        {
            "start": 20,
            "stop": 21,
            "reason": "too few joints detected, or none of them before the camera",
        },
    ]


def test_two_people(take, files):
    """By track where one is named, wherever it stands in the list; else the more confident."""
    clip, folder = take.clips[0], take.path / "keypoints" / "walk_0"
    points_px = project_joints(clip, take.body).image_px
    for row, frame_px in enumerate(points_px):
        people = [person(frame_px, 0.7, track=6), person(frame_px + 40, 0.9, track=2)]
        write_frame(folder, 100 + row, people if row % 2 else people[::-1])
    named = errors_mm(files(VibeCamConfig(person_ids={"walk_0": 6})), clip)
    assert named.max() < 1e-3
    made = files()
    assert errors_mm(made, clip).min() > 100
    crowded = read_json(made / "predictions.json")["clips"]["walk_0"]["n_rows_with_several_people"]
    assert crowded == 40
    with pytest.raises(BadKeypoints, match="walk_0: no person 3 detected in any image of clip"):
        files(VibeCamConfig(person_ids={"walk_0": 3}))
    with pytest.raises(BadRecipe, match="person_ids: no clip run_1 in the manifest, which has"):
        files(VibeCamConfig(person_ids={"run_1": 3}))


def test_keypoints_of_smaller_images_are_scaled_when_that_is_said(take, files):
    clip, folder = take.clips[0], take.path / "keypoints" / "walk_0"
    points_px = project_joints(clip, take.body).image_px
    for row, frame_px in enumerate(points_px):
        write_frame(folder, 100 + row, [person(frame_px / 2, 0.8)])
    assert errors_mm(files(), clip).min() > 1000
    half = files(VibeCamConfig(image_size_px=(320, 240)))
    assert errors_mm(half, clip).max() < 1e-3
    with pytest.raises(BadKeypoints, match="images of 320x320 px are of another shape than the"):
        files(VibeCamConfig(image_size_px=(320, 320)))


def test_keypoints_that_cannot_be_of_the_clip(take):
    clip = take.clips[0]
    points_px = project_joints(clip, take.body).image_px
    for factor, words in (
        (3.0, r"are not of the camera's images of 640x480 px. Say with image_size_px"),
        (1 / 640, "points are shares of the image, not pixels. Run OpenPose with --keypoint_scale"),
    ):
        folder = take.path / f"times_{factor:.3f}"
        for row, frame_px in enumerate(points_px):
            write_frame(folder, 100 + row, [person(frame_px * factor, 0.8)])
        with pytest.raises(BadKeypoints, match=words):
            clip_keypoints(clip, folder)
    write_frame(take.path / "others", 7, [person(points_px[0], 0.8)])
    with pytest.raises(
        BadKeypoints, match="holds frames 7 to 7, but clip walk_0 has images 100 to"
    ):
        clip_keypoints(clip, take.path / "others")
    unnumbered = replace(clip, image_numbers=np.full(40, -1))
    with pytest.raises(BadKeypoints, match="but clip walk_0 has no images"):
        clip_keypoints(unnumbered, take.path / "others")
    for number in range(100, 140):
        write_frame(take.path / "nobody", number, [])
    with pytest.raises(BadKeypoints, match="nobody: nobody detected in any image of clip walk_0"):
        clip_keypoints(clip, take.path / "nobody")
    with pytest.raises(BadMotionFile, match="clip walk_0 has no camera"):
        clip_keypoints(replace(clip, camera=None), take.path / "nobody")


def test_a_truncated_or_missing_file_leaves_nothing(take, files):
    folder = take.path / "keypoints" / "walk_0"
    with pytest.raises(MissingInput, match="keypoints/walk_0: no such"):
        files()
    write_frames(folder, take.clips[0], take.body)
    path = folder / "clip_000000000105_keypoints.json"
    path.write_text(path.read_text()[:200])
    with pytest.raises(BadRecord, match="clip_000000000105_keypoints.json: not JSON"):
        files()
    (take.path / "poses" / "walk_0.npz").unlink()
    with pytest.raises(MissingInput, match=r"poses/walk_0.npz: no such file"):
        files()
    assert not (take.path / "out").exists()


def test_poses_that_do_not_fit(take, files):
    clip, path = take.clips[0], take.path / "poses" / "walk_0.npz"
    write_frames(take.path / "keypoints" / "walk_0", clip, take.body)
    rest_pelvis_m = take.body.rest_pelvis_m(clip.motion.shape)
    posed = load_clip(path)

    def refused(other: Clip, words: str) -> None:
        save_clip(path, other, rest_pelvis_m)
        with pytest.raises(BadMotionFile, match=words):
            files()

    refused(clip, "the motion is not in the camera frame")
    motion = posed.motion
    refused(replace(posed, motion=replace(motion, body="giant")), "of body giant with 10 shape")
    refused(replace(posed, motion=replace(motion, fps_hz=30.0)), "40 frames at 30 fps, but clip")
    refused(replace(posed, image_numbers=posed.image_numbers + 1), "of other images than clip")


def test_rows_without_a_pose(take, files):
    write_frames(take.path / "keypoints" / "walk_0", take.clips[0], take.body)
    path = take.path / "poses" / "walk_0.npz"
    posed = load_clip(path)
    local_rotmats = posed.motion.local_rotmats.copy()
    local_rotmats[4, 22] = np.nan
    lost = replace(
        posed, motion=replace(posed.motion, local_rotmats=local_rotmats), valid=np.arange(40) != 9
    )
    save_clip(path, lost, take.body.rest_pelvis_m(posed.motion.shape))
    found = load_clip(files() / "predictions" / "walk_0.npz")
    np.testing.assert_array_equal(np.flatnonzero(~found.valid), [4, 9])


def test_the_verb(take, body_path, gmrdata, works):
    manifest = take.write_set(take.path / "set", take.clips[:1])
    write_poses(take.path / "poses", take.clips[0], take.body)
    write_frames(take.path / "keypoints" / "walk_0", take.clips[0], take.body)
    asked = ("baseline", "vibe_cam", manifest, "--poses", take.path / "poses",
             "--keypoints", take.path / "keypoints", "--body", body_path)  # fmt: skip
    said = works(*asked, "--image-size", "640", "480", "--out", take.path / "out")
    assert said.stdout.split() == [str(take.path / "out")]
    assert errors_mm(take.path / "out", take.clips[0]).max() < 1e-3
    for wrong, why in (
        (["--person", "walk_0"], "--person walk_0: expected the clip's id, =, and a number"),
        (["--person", "walk_0=1", "walk_0=2"], "--person walk_0=2: expected the clip's id"),
        (["--person", "=2"], "--person =2: expected the clip's id, =, and a number"),
        (["--person", f"walk_0={'9' * 5000}"], "and a number"),
        (["--image-size", "0", "480"], "--image-size 0: Input should be greater than 0"),
    ):
        fails_cleanly(gmrdata(*asked, *wrong, "--out", take.path / "no"), why)


def test_gmr_sees_poses_of_a_rate_that_is_no_multiple_of_its_own(
    take, run_dir, body_path, monkeypatch
):
    """25 fps were refused, though the network's row on true poses resamples them.

    The first three frames are less than two of the network's.
    """
    filmed = take.clips[0]
    clip = replace(filmed, motion=replace(filmed.motion, fps_hz=25.0))
    manifest = take.write_set(take.path / "set", [clip])
    poses_dir, seen_rows = take.path / "poses", np.arange(40) != 3
    write_poses(poses_dir, replace(clip, valid=seen_rows), take.body)
    made = infer_poses(run_dir, manifest, poses_dir, take.path / "out", body_path=body_path)
    found = load_clip(made / "predictions" / "walk_0.npz")
    np.testing.assert_array_equal(found.valid, np.arange(40) > 3)
    assert found.motion.fps_hz == 25.0
    np.testing.assert_allclose(found.motion.pelvis_m[4], clip.motion.pelvis_m[0], atol=1e-9)
    world = predict_at_source_rate(load_gmr(run_dir), clip.motion.take(slice(4, 40)))
    part = found.motion.take(slice(4, 40))
    for ours, expected in zip(
        deltas(part.root_rotmats, part.pelvis_m),
        deltas(world.root_rotmats, world.pelvis_m),
        strict=True,
    ):
        np.testing.assert_allclose(ours, expected, atol=1e-6)
    (run_dir / "delta_errors.json").touch()  # as the weights are the same, nothing is stale
    assert infer_poses(run_dir, manifest, poses_dir, made, body_path=body_path) == made
    # The run has its name where it is called from within, too.
    monkeypatch.chdir(run_dir)
    within = infer_poses(Path(), manifest, poses_dir, take.path / "within", body_path=body_path)
    assert read_json(within / "predictions.json")["figures"]["run"] == run_dir.name
    slow = replace(clip, motion=replace(clip.motion, fps_hz=5.0))
    manifest = take.write_set(take.path / "slow", [slow])
    write_poses(poses_dir, slow, take.body)
    with pytest.raises(BadMotionFile, match="5 fps is lower than 10 fps"):
        infer_poses(run_dir, manifest, poses_dir, take.path / "no", body_path=body_path)


@pytest.fixture(scope="module")
def takes(filmed) -> tuple[Clip, Clip]:
    """One motion: camera on, camera off."""
    on = filmed[0]
    off = static_twin(camera_of(on), on.motion.pelvis_m)
    return replace(on, id="walk_on"), replace(on, id="walk_off", camera=off)


def scores(predicted: Clip, true: Clip, body: BodyModel) -> tuple[float, float, float]:
    """OME [deg], TME [mm] and VME [mm] at 10 fps, all phases."""
    rows = np.arange(true.motion.n_frames)
    errors = motion_errors(predicted, true, rows, rows, 2, body)
    return tuple(float(values.mean()) for values in errors)  # type: ignore[return-value]


def assert_errs_by_the_cameras_motion(
    made: Path, takes: tuple[Clip, Clip], body: BodyModel, atol: float
) -> None:
    """Predictions are right for the camera at rest; else OME is by how much the camera turns."""
    on, off = (
        scores(load_clip(made / "predictions" / f"{clip.id}.npz"), clip, body) for clip in takes
    )
    assert max(off) < atol
    rotmats = camera_of(takes[0]).world_from_cam[:, :3, :3]
    turns_deg = np.rad2deg(angles_rad(rotmats[2:] @ rotmats[:-2].swapaxes(1, 2)))
    assert on[0] == pytest.approx(turns_deg.mean(), rel=1e-6)
    assert on[1] > 50 and on[2] > 50


def test_gmr_sees_the_same_motion_with_the_camera_on_and_off(takes):
    torch.manual_seed(0)
    gmr = TrainedGmr(Gmr(ModelConfig(layers=2, hidden=16)).eval(), 20.0, "untrained", 0)
    on, off = map(seen, takes)
    assert not np.allclose(on.root_rotmats, off.root_rotmats, atol=0.1)
    np.testing.assert_array_equal(on.local_rotmats, off.local_rotmats)
    found = [predict_world_motion(gmr, motion) for motion in (on, off)]
    np.testing.assert_array_equal(found[0].root_rotmats, found[1].root_rotmats)
    np.testing.assert_array_equal(found[0].pelvis_m, found[1].pelvis_m)
    # Not because it predicts nothing: another local pose gives another motion.
    other = replace(on, local_rotmats=on.local_rotmats[::-1])
    assert not np.allclose(predict_world_motion(gmr, other).pelvis_m, found[0].pelvis_m, atol=1e-3)


def test_camera_frame_poses_are_right_for_the_camera_at_rest_alone(take, takes):
    made = predict_camera_as_world(take.write_set(take.path / "set", takes), take.path / "out")
    assert_errs_by_the_cameras_motion(made, takes, take.body, atol=1e-5)


def test_so_is_vibe_cam(take, takes, body_path):
    """With exact poses and keypoints all that is left of its error is the camera's motion."""
    for clip in takes:
        write_poses(take.path / "poses", clip, take.body)
        write_frames(take.path / "keypoints" / clip.id, clip, take.body)
    files = SeenFiles(take.path / "poses", take.path / "keypoints", body_path)
    made = predict_vibe_cam(take.write_set(take.path / "set", takes), files, take.path / "out")
    assert_errs_by_the_cameras_motion(made, takes, take.body, atol=1e-3)


CLIP = {"fps_hz": 20.0, "n_frames": 40, "n_valid": 36}
PLACED = {
    "median_residual_px": 1.5,
    "n_rows_with_several_people": 2,
    "not_predicted": [{"start": 3, "stop": 7, "reason": "no image"}],
}
MEAN = {
    "mean_rotvec_rad": (0.0, 0.1, 0.0),
    "mean_m": (0.0, 0.0, 0.1),
    "fps_hz": 10.0,
    "n_motions": 9,
}


@pytest.mark.parametrize(
    ("record", "figures", "of_clip"),
    [
        (Predictions, {}, {}),
        (MeanPredictions, MEAN, {}),
        (CameraPredictions, {"camera": "ignored"}, {}),
        (NetworkPredictions, {"run": "gmr"}, {}),
        (VibeCamPredictions, {}, PLACED),
    ],
)
def test_each_key_of_predictions_is_needed(record, figures, of_clip, tmp_path):
    found = record.model_validate(
        {
            "method": "a baseline",
            "figures": figures,
            "clips": {"walk": CLIP | of_clip},
            "left_out": {"run": "no frame is valid"},
        }
    )
    assert_each_key_is_needed(found, tmp_path / "predictions.json", free=("left_out", "clips"))
