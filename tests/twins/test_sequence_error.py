"""A recovered sequence's row, with errors that were put in."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.motion.gait import make_gait
from gmrdata.twins.pseudo_gt_error import RecoveredSequence, sequence_errors, within_2sigma
from gmrdata.values import transforms
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath, intrinsics_from_fov
from gmrdata.values.clip import Clip
from gmrdata.values.errors import StageFailed

N = 40
ACCEPTED = RecoveredSequence("pass_00", "linear", accepted=True, seconds=1)


@pytest.fixture(scope="module")
def truth(small_body: BodyModel) -> list[Clip]:
    """Two people, 40 frames at 30 fps, and a camera that passes them."""
    along = np.linspace(0, 1, N)
    turn_rad = np.stack([0.1 * along, 1 + 0.5 * along, np.zeros(N)], axis=1)
    centres_m = np.stack([2 * along, np.sin(3 * along), np.full(N, 1.5)], axis=1)
    world_from_cam = transforms.rigid(Rotation.from_euler("xyz", turn_rad).as_matrix(), centres_m)
    intrinsics_px = intrinsics_from_fov(60, 640, 360)
    camera = CameraPath(intrinsics_px, 640, 360, world_from_cam, np.ones(N, bool))
    clips = []
    for person in range(2):
        motion = make_gait("walk", N / 30, 30.0, small_body, np.random.default_rng(person))
        rows = np.arange(N)
        motion = replace(
            motion,
            local_rotmats=motion.local_rotmats[rows],
            root_rotmats=motion.root_rotmats[rows],
            pelvis_m=motion.pelvis_m[rows],
        )
        clips.append(Clip(f"pass_00.p{person}", motion, np.ones(N, bool), rows, camera))
    return clips


def turning(clip: Clip, deg_per_frame: float) -> Clip:
    """A person whose orientation drifts about the vertical."""
    yaw = Rotation.from_euler("z", deg_per_frame * np.arange(N)[:, None], degrees=True)
    root_rotmats = yaw.as_matrix() @ clip.motion.root_rotmats
    return replace(clip, motion=replace(clip.motion, root_rotmats=root_rotmats))


def scaled(clip: Clip, factor: float) -> Clip:
    """Everything in the world larger by a factor."""
    assert clip.camera is not None
    cameras = clip.camera.world_from_cam.copy()
    cameras[:, :3, 3] *= factor
    return replace(
        clip,
        motion=replace(clip.motion, pelvis_m=factor * clip.motion.pelvis_m),
        camera=replace(clip.camera, world_from_cam=cameras),
    )


def test_a_sequence_shows_the_person_who_fares_worst(
    truth: list[Clip], small_body: BodyModel
) -> None:
    """0.1 and 0.2 deg per frame are 0.3 and 0.6 deg per motion at 10 fps."""
    found = [turning(truth[0], 0.1), turning(truth[1], 0.2)]
    recovered = RecoveredSequence(
        "pass_00", "linear_panning", accepted=True, seconds=12.345, class_measured="linear"
    )
    row = sequence_errors(recovered, found, truth, small_body)
    assert [p.ome_deg for p in row.people] == pytest.approx([0.3, 0.6], abs=1e-6)
    assert row.ome_deg == pytest.approx(0.6, abs=1e-6)
    assert row.vme_mm == max(person.vme_mm for person in row.people) > 0
    assert [person.n_motions for person in row.people] == [37, 37]
    assert (row.class_true, row.class_measured) == ("linear_panning", "linear")
    assert (row.frames, row.kept_share, row.seconds) == (N, 1.0, 12.35)
    assert row.scale_error_percent == pytest.approx(0, abs=1e-9)
    assert set(row.model_dump()) == {
        "id", "class_true", "class_measured", "accepted", "frames", "kept_share",
        "ome_deg", "tme_mm", "vme_mm", "camera_rotation_deg", "camera_path_mm",
        "scale_error_percent", "scale_within_2sigma", "seconds", "people", "reasons",
    }  # fmt: skip


@pytest.mark.parametrize(("sigma_share", "inside"), [(0.011, True), (0.009, False)])
def test_two_percent_too_large(truth: list[Clip], sigma_share: float, inside: bool) -> None:
    found = [scaled(clip, 1.02) for clip in truth]
    # The true factor is 5: 5.1 was found.
    measured = replace(ACCEPTED, scale=5.1, scale_sigma=5 * sigma_share)
    row = sequence_errors(measured, found, truth)
    assert row.scale_error_percent == pytest.approx(2, abs=1e-5)
    assert row.scale_within_2sigma is inside
    assert row.camera_rotation_deg == pytest.approx(0, abs=1e-5)
    assert row.vme_mm is None


def test_motions_are_between_kept_frames_alone(truth: list[Clip]) -> None:
    """Frame 20 is not kept, and the world slips by a metre there: 4 of 37 motions would tell."""
    valid = np.arange(N) != 20
    pelvis_m = truth[0].motion.pelvis_m + (np.arange(N) > 20)[:, None] * [1.0, 0, 0]
    gapped = replace(truth[0], valid=valid, motion=replace(truth[0].motion, pelvis_m=pelvis_m))
    row = sequence_errors(ACCEPTED, [gapped], truth[:1])
    assert row.tme_mm == pytest.approx(0, abs=1e-9)
    assert row.people[0].n_motions == 33
    assert row.kept_share == 39 / 40


def test_what_was_not_recovered_has_no_errors(truth: list[Clip]) -> None:
    rejected = replace(truth[0], valid=np.zeros(N, bool))
    in_camera = replace(truth[1], motion=replace(truth[1].motion, frame="camera"))
    flicker = replace(truth[1], valid=np.arange(N) % 4 < 2)
    for found in ([rejected, in_camera], [], [rejected, flicker]):
        row = sequence_errors(replace(ACCEPTED, accepted=False), found, truth)
        assert row.ome_deg is row.camera_path_mm is row.scale_error_percent is None
        assert row.scale_within_2sigma is None
        assert [person.id for person in row.people] == ["pass_00.p0", "pass_00.p1"]
    assert row.kept_share == 0.25


def test_clips_of_another_video_are_an_error_not_a_gap(truth: list[Clip]) -> None:
    other = replace(truth[0], motion=replace(truth[0].motion, fps_hz=25.0))
    with pytest.raises(StageFailed, match="25 fps"):
        sequence_errors(ACCEPTED, [other], truth[:1])


def test_without_an_error_bar_there_is_no_answer() -> None:
    assert within_2sigma(None, 1.0, 0.1) is None
    assert within_2sigma(1.0, None, 0.1) is None
    assert within_2sigma(1.0, 1.0, None) is None
    assert within_2sigma(-10.0, 0.9, 0.051) is True
    assert within_2sigma(-10.0, 0.9, 0.049) is False
