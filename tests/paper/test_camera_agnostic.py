"""Camera-motion agnostic, shown: one take filmed by a moving camera and by one at rest (Table 6).

GMR is given what the camera sees of the local pose, and its motion is the same for both cameras, to
the bit.  Camera-frame poses taken as world poses are right for the camera at rest alone.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from gmrdata.film.programmes import static_twin
from gmrdata.gmr.config import ModelConfig
from gmrdata.gmr.model import Gmr
from gmrdata.gmr.predict import TrainedGmr, predict_world_motion
from gmrdata.paper.vibe_cam import SeenFiles, predict_vibe_cam
from gmrdata.score.camera_as_world import predict_camera_as_world
from gmrdata.twins.pseudo_gt_error import motion_errors
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.motion_metrics import angles_rad
from gmrdata.world.compose import motion_in_camera
from tests.paper.openpose_files import write_frames

WriteSet = Callable[..., Path]


@pytest.fixture(scope="module")
def takes(filmed: tuple[Clip, ...]) -> tuple[Clip, Clip]:
    """One motion: camera on, camera off."""
    on = filmed[0]
    off = static_twin(camera_of(on), on.motion.pelvis_m)
    return replace(on, id="walk_on"), replace(on, id="walk_off", camera=off)


def seen_by_its_camera(clip: Clip) -> Clip:
    """What a perfect pose estimator gives: poses in the camera's frame."""
    motion = motion_in_camera(clip.motion, camera_of(clip).world_from_cam)
    return replace(clip, motion=motion)


def scores(predicted: Clip, true: Clip, body: BodyModel) -> tuple[float, float, float]:
    """OME [deg], TME [mm] and VME [mm] at 10 fps, all phases."""
    rows = np.arange(true.motion.n_frames)
    errors = motion_errors(predicted, true, rows, rows, 2, body)
    return tuple(float(values.mean()) for values in errors)  # type: ignore[return-value]


def turn_deg(clip: Clip) -> float:
    """Mean angle by which the camera turns between frames at 10 fps: what OME must be."""
    rotmats = camera_of(clip).world_from_cam[:, :3, :3]
    return float(np.rad2deg(angles_rad(rotmats[2:] @ rotmats[:-2].swapaxes(1, 2))).mean())


def test_gmr_sees_the_same_motion_with_the_camera_on_and_off(takes: tuple[Clip, Clip]) -> None:
    torch.manual_seed(0)
    gmr = TrainedGmr(Gmr(ModelConfig(layers=2, hidden=16)).eval(), 20.0, "untrained", 0)
    on, off = (seen_by_its_camera(clip) for clip in takes)
    assert not np.allclose(on.motion.root_rotmats, off.motion.root_rotmats, atol=0.1)
    np.testing.assert_array_equal(on.motion.local_rotmats, off.motion.local_rotmats)
    found = [predict_world_motion(gmr, clip.motion) for clip in (on, off)]
    np.testing.assert_array_equal(found[0].root_rotmats, found[1].root_rotmats)
    np.testing.assert_array_equal(found[0].pelvis_m, found[1].pelvis_m)
    # Not because it predicts nothing: another local pose gives another motion.
    other = replace(on.motion, local_rotmats=on.motion.local_rotmats[::-1])
    assert not np.allclose(predict_world_motion(gmr, other).pelvis_m, found[0].pelvis_m, atol=1e-3)


def test_camera_frame_poses_are_right_for_the_camera_at_rest_alone(
    takes: tuple[Clip, Clip], small_body: BodyModel, write_set: WriteSet, tmp_path: Path
) -> None:
    made = predict_camera_as_world(write_set(tmp_path / "set", takes), tmp_path / "out")
    on, off = (
        scores(load_clip(made / "predictions" / f"{clip.id}.npz"), clip, small_body)
        for clip in takes
    )
    assert max(off) < 1e-5
    assert on[0] == pytest.approx(turn_deg(takes[0]), rel=1e-6)
    assert on[1] > 50 and on[2] > 50


def test_so_is_vibe_cam(
    takes: tuple[Clip, Clip],
    small_body: BodyModel,
    write_set: WriteSet,
    body_path: Path,
    tmp_path: Path,
) -> None:
    """With exact poses and keypoints all that is left of its error is the camera's motion."""
    for clip in takes:
        posed = seen_by_its_camera(clip)
        motion = replace(posed.motion, pelvis_m=np.zeros((clip.motion.n_frames, 3)))
        save_clip(
            tmp_path / "poses" / f"{clip.id}.npz",
            replace(posed, motion=motion),
            small_body.rest_pelvis_m(motion.shape),
        )
        write_frames(tmp_path / "keypoints" / clip.id, clip, small_body)
    files = SeenFiles(tmp_path / "poses", tmp_path / "keypoints", body_path)
    made = predict_vibe_cam(write_set(tmp_path / "set", takes), files, tmp_path / "out")
    on, off = (
        scores(load_clip(made / "predictions" / f"{clip.id}.npz"), clip, small_body)
        for clip in takes
    )
    assert max(off) < 1e-3
    assert on[0] == pytest.approx(turn_deg(takes[0]), rel=1e-6)
    assert on[1] > 50 and on[2] > 50
