"""A pseudo ground truth, or a recovered sequence, against the truth, with errors put in."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.motion.gait import make_gait
from gmrdata.twins.pseudo_gt_error import (
    RecoveredSequence,
    compare_clips,
    error_series,
    sequence_errors,
    within_2sigma,
)
from gmrdata.values import transforms
from gmrdata.values.camera import CameraPath, intrinsics_from_fov
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.errors import NothingToCompare, StageFailed
from gmrdata.values.motion import Motion, deltas
from gmrdata.values.skinning import motion_vertices_m
from tests.motions import with_camera, with_motion

PSEUDO_FROM_TRUE = transforms.rigid(
    Rotation.from_euler("xyz", [100.0, -20.0, 40.0], degrees=True).as_matrix(),
    np.array([2.0, -1.0, 0.7]),
)


def filmed(id: str, motion: Motion, turn_rad: np.ndarray, centres_m: np.ndarray) -> Clip:
    """A motion seen by a camera that turns by so much (N, 3) at places (N, 3)."""
    n = np.arange(motion.n_frames)
    world_from_cam = transforms.rigid(Rotation.from_euler("xyz", turn_rad).as_matrix(), centres_m)
    camera = CameraPath(intrinsics_from_fov(60, 640, 360), 640, 360, world_from_cam, n >= 0)
    return Clip(id, motion, n >= 0, n, camera)


@pytest.fixture(scope="module")
def true_clip(small_body) -> Clip:
    """A walk seen by a camera that moves on a curve and turns."""
    motion = make_gait("walk", 4.0, 10.0, small_body, np.random.default_rng(0))
    along = np.linspace(0, 1, motion.n_frames)
    turn_rad = np.stack([0.3 * along, 1 + 0.8 * along**2, 0.1 * np.sin(9 * along)], axis=1)
    centres_m = np.stack([2 * along, np.sin(3 * along), 1.5 + 0.2 * along], axis=1)
    return filmed("walk", motion, turn_rad, centres_m)


def moved(clip: Clip, pseudo_from_true: np.ndarray, scale: float = 1.0) -> Clip:
    """The same clip in another world, everything in which is larger by a factor."""
    root = pseudo_from_true @ transforms.rigid(clip.motion.root_rotmats, clip.motion.pelvis_m)
    root[:, :3, 3] *= scale
    cameras = pseudo_from_true @ camera_of(clip).world_from_cam
    cameras[:, :3, 3] *= scale
    placed = with_motion(clip, root_rotmats=root[:, :3, :3], pelvis_m=root[:, :3, 3])
    return with_camera(placed, world_from_cam=cameras)


def test_another_world_is_no_error(true_clip):
    found = compare_clips(moved(true_clip, PSEUDO_FROM_TRUE), true_clip)
    assert found.ome_deg == pytest.approx(0, abs=1e-6)
    assert found.tme_mm == pytest.approx(0, abs=1e-9)
    assert found.camera_rotation_deg == pytest.approx(0, abs=1e-6)
    assert found.scale_error_percent == pytest.approx(0, abs=1e-9)
    assert found.trajectory_mm == pytest.approx(0, abs=1e-9)
    assert (found.frames, found.frames_with_camera) == (40, 40)
    np.testing.assert_allclose(
        found.true_from_pseudo, transforms.invert(PSEUDO_FROM_TRUE), atol=1e-10
    )


@pytest.mark.parametrize("scale", [0.9, 1.0, 1.02, 1.25])
def test_scale_error_has_its_size_and_sign(true_clip, scale):
    found = compare_clips(moved(true_clip, PSEUDO_FROM_TRUE, scale), true_clip)
    assert found.scale_error_percent == pytest.approx(100 * (scale - 1), abs=1e-8)
    steps_mm = 1000 * np.linalg.norm(np.diff(true_clip.motion.pelvis_m, axis=0), axis=1)
    assert found.tme_mm == pytest.approx(abs(scale - 1) * steps_mm.mean(), rel=1e-8, abs=1e-9)
    assert found.ome_deg == pytest.approx(0, abs=1e-6)
    # Rigidly fitted, the two paths have one middle, and each centre is off by its share of it.
    centres_m = camera_of(true_clip).centres_world_m
    away_mm = 1000 * np.linalg.norm(centres_m - centres_m.mean(axis=0), axis=1)
    assert found.camera_path_mm == pytest.approx(abs(scale - 1) * away_mm.mean(), abs=1e-9)


def test_motion_errors_are_those_put_in(true_clip):
    """A world that turns by half a degree from frame to frame."""
    yaw = Rotation.from_euler("z", 0.5 * np.arange(40)[:, None], degrees=True).as_matrix()
    pseudo = with_motion(true_clip, root_rotmats=yaw @ true_clip.motion.root_rotmats)
    found = compare_clips(pseudo, true_clip)
    assert found.ome_deg == pytest.approx(0.5, abs=1e-9)
    assert (found.n_motions, found.vme_mm) == (39, None)


def test_vertices_slip_as_far_as_the_world(true_clip, small_body):
    """A world that slips by 3 mm from frame to frame moves every vertex by 3 mm."""
    slip_m = 0.003 * np.arange(40)[:, None] * np.array([0.6, 0.0, 0.8])
    pseudo = with_motion(true_clip, pelvis_m=true_clip.motion.pelvis_m + slip_m)
    found = compare_clips(moved(pseudo, PSEUDO_FROM_TRUE), true_clip, body=small_body)
    assert found.tme_mm == pytest.approx(3, abs=1e-9)
    assert found.vme_mm == pytest.approx(3, abs=1e-4)


def test_vertices_turn_with_the_world_in_the_true_pose(true_clip, small_body):
    """VME against meshes of the body itself, and of another local pose there is no error."""
    yaw = Rotation.from_euler("z", 2.0 * np.arange(40)[:, None], degrees=True).as_matrix()
    turned = replace(true_clip.motion, root_rotmats=yaw @ true_clip.motion.root_rotmats)
    still = np.broadcast_to(np.eye(3), true_clip.motion.local_rotmats.shape)
    pseudo = replace(true_clip, motion=replace(turned, local_rotmats=still))
    meshes_m = []
    for motion in (turned, true_clip.motion):
        rotmats, metres = deltas(motion.root_rotmats, motion.pelvis_m)
        part = replace(true_clip.motion, local_rotmats=true_clip.motion.local_rotmats[:-1])
        part = replace(part, root_rotmats=rotmats, pelvis_m=metres)
        meshes_m.append(motion_vertices_m(small_body, part))
    expected_mm = 1000 * np.linalg.norm(meshes_m[0] - meshes_m[1], axis=-1).mean()
    found = compare_clips(pseudo, true_clip, body=small_body)
    assert found.vme_mm == pytest.approx(expected_mm, rel=1e-4) and expected_mm > 5


def test_camera_rotation_error_is_after_one_best_rotation(true_clip):
    """Cameras rolled by +2 and -2 deg in turn: their best common rotation is none, the error 2."""
    roll_deg = np.where(np.arange(40) % 2, 2.0, -2.0)[:, None]
    cameras = camera_of(true_clip).world_from_cam.copy()
    fixed = cameras[0, :3, :3]
    cameras[:, :3, :3] = fixed
    still = with_camera(true_clip, world_from_cam=cameras)
    rolled = cameras.copy()
    rolled[:, :3, :3] = fixed @ Rotation.from_euler("z", roll_deg, degrees=True).as_matrix()
    pseudo = moved(with_camera(still, world_from_cam=rolled), PSEUDO_FROM_TRUE)
    assert compare_clips(pseudo, still).camera_rotation_deg == pytest.approx(2.0, abs=1e-6)


def test_no_motion_is_taken_across_a_gap(true_clip):
    """The world slips by a metre in a gap; only a difference across it would show that."""
    valid = np.ones(40, bool)
    valid[20] = False
    pelvis_m = true_clip.motion.pelvis_m.copy()
    pelvis_m[20] = np.nan
    pelvis_m[21:] += [1.0, 0, 0]
    pseudo = replace(with_motion(true_clip, pelvis_m=pelvis_m), valid=valid)
    found = compare_clips(pseudo, true_clip)
    assert found.tme_mm == pytest.approx(0, abs=1e-9)
    assert found.trajectory_mm > 100
    assert found.frames == 39


def test_rows_are_paired_by_image_number(true_clip):
    """A pseudo clip of images 5, 6, 7 and 20, 21 has three motions."""
    rows = np.array([5, 6, 7, 20, 21])
    motion, camera = true_clip.motion.take(rows), camera_of(true_clip).at_rows(rows)
    motion = replace(motion, pelvis_m=motion.pelvis_m + (rows > 10)[:, None] * [1.0, 0, 0])
    camera = replace(camera, has_camera=np.array([True, True, False, True, True]))
    pseudo = Clip("part", motion, np.ones(5, bool), rows, camera)
    found = compare_clips(pseudo, true_clip)
    assert found.tme_mm == pytest.approx(0, abs=1e-9)
    assert (found.frames, found.frames_with_camera) == (5, 4)


def test_no_scale_without_camera_motion_or_positions(true_clip):
    cameras = camera_of(true_clip).world_from_cam.copy()
    cameras[:, :3, 3] = [0.3, 0.2, 0.1]
    rotation_only = with_camera(true_clip, world_from_cam=cameras)
    assert compare_clips(rotation_only, true_clip).scale_error_percent is None
    assert compare_clips(true_clip, rotation_only).scale_error_percent is None
    cameras = cameras.copy()
    cameras[:, 0, 3] += np.linspace(0, 0.049, 40)
    almost = with_camera(true_clip, world_from_cam=cameras)
    assert compare_clips(almost, almost).scale_error_percent is None


def test_no_camera_figures_without_cameras(true_clip):
    found = compare_clips(replace(true_clip, camera=None), true_clip)
    assert found.camera_rotation_deg is None and found.camera_path_mm is None
    assert found.scale_error_percent is None
    assert found.frames_with_camera == 0


def test_trajectory_error_is_evos_ape_after_the_same_alignment(true_clip):
    trajectory = pytest.importorskip("evo.core.trajectory")
    evo_metrics = pytest.importorskip("evo.core.metrics")
    noise_m = np.random.default_rng(0).normal(0, 0.02, (40, 3))
    pseudo = moved(true_clip, PSEUDO_FROM_TRUE)
    pseudo = with_motion(pseudo, pelvis_m=pseudo.motion.pelvis_m + noise_m)
    found = compare_clips(pseudo, true_clip)

    def path(clip: Clip, change: np.ndarray) -> object:
        poses = change @ transforms.rigid(clip.motion.root_rotmats, clip.motion.pelvis_m)
        return trajectory.PosePath3D(poses_se3=list(poses))

    ape = evo_metrics.APE(evo_metrics.PoseRelation.translation_part)
    ape.process_data((path(true_clip, np.eye(4)), path(pseudo, found.true_from_pseudo)))
    mean_mm = 1000 * ape.get_statistic(evo_metrics.StatisticsType.mean)
    assert found.trajectory_mm == pytest.approx(mean_mm, rel=1e-9)
    # Aligned by positions alone it is as good, but for the orientations that are fitted besides.
    positions = trajectory.PosePath3D(
        poses_se3=list(transforms.rigid(pseudo.motion.root_rotmats, pseudo.motion.pelvis_m))
    )
    positions.align(path(true_clip, np.eye(4)))
    ape.process_data((path(true_clip, np.eye(4)), positions))
    assert found.trajectory_mm == pytest.approx(
        1000 * ape.get_statistic(evo_metrics.StatisticsType.mean), rel=0.1
    )


def test_clips_that_cannot_be_compared(true_clip):
    other_rate = with_motion(true_clip, fps_hz=30.0)
    with pytest.raises(StageFailed, match="30 fps, but its truth walk has 10 fps"):
        compare_clips(other_rate, true_clip)
    in_camera = with_motion(true_clip, frame="camera")
    with pytest.raises(StageFailed, match="not in the world frame"):
        compare_clips(in_camera, true_clip)
    alternating = replace(true_clip, valid=np.arange(40) % 2 == 0)
    with pytest.raises(StageFailed, match="no two frames in a row"):
        compare_clips(alternating, true_clip)
    elsewhere = replace(true_clip, image_numbers=np.arange(100, 140))
    with pytest.raises(StageFailed, match="no two frames in a row"):
        compare_clips(elsewhere, true_clip)
    unnumbered = replace(true_clip, image_numbers=np.full(40, -1))
    assert compare_clips(unnumbered, true_clip).tme_mm == 0


@pytest.mark.parametrize("n", [1, 3])
def test_clips_too_short_for_a_motion_have_nothing_to_compare(true_clip, n):
    """Their errors over time ended in numpy's own words."""
    true, _ = thirty_hz(true_clip)
    short = replace(true, image_numbers=np.arange(40) + 40 - n)
    for compare in (compare_clips, error_series):
        with pytest.raises(NothingToCompare, match="There is nothing to compare"):
            compare(short, true, fps_hz=10.0)
    four = replace(true, image_numbers=np.arange(40) + 36)
    assert len(error_series(four, true, fps_hz=10.0).ome_deg) == 1


def thirty_hz(true_clip: Clip) -> tuple[Clip, Clip]:
    """The clip, said to have 30 fps, and a pseudo ground truth whose pelvis is 3 mm off in every
    third frame."""
    true = with_motion(true_clip, fps_hz=30.0)
    pelvis_m = true.motion.pelvis_m.copy()
    pelvis_m[::3, 2] += 0.003
    return true, with_motion(true, pelvis_m=pelvis_m)


def test_at_a_third_of_the_rate_every_phase_counts(true_clip):
    true, pseudo = thirty_hz(true_clip)
    # At 30 fps two of three motions are 3 mm off; at 10 fps each phase is off as a whole or not.
    assert compare_clips(pseudo, true).tme_mm == pytest.approx(2.0, abs=0.1)
    assert compare_clips(pseudo, true, fps_hz=10.0).tme_mm == pytest.approx(0, abs=1e-9)
    assert compare_clips(true_clip, true_clip, fps_hz=10.0).ome_deg == pytest.approx(0, abs=1e-6)


def test_at_a_third_of_the_rate_no_motion_crosses_a_gap(true_clip):
    true, pseudo = thirty_hz(true_clip)
    pelvis_m = pseudo.motion.pelvis_m.copy()
    pelvis_m[13:] += 1.0
    valid = np.ones(40, bool)
    valid[13] = False
    pseudo = replace(with_motion(pseudo, pelvis_m=pelvis_m), valid=valid)
    assert compare_clips(pseudo, true, fps_hz=10.0).tme_mm == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("compare", [compare_clips, error_series])
@pytest.mark.parametrize("fps_hz", [20.0, 4.0])
def test_a_rate_that_does_not_divide_the_clips_is_refused(compare, fps_hz, true_clip):
    with pytest.raises(StageFailed, match=f"10 fps is no multiple of {fps_hz:g} fps"):
        compare(true_clip, true_clip, fps_hz=fps_hz)


N = 40
ACCEPTED = RecoveredSequence("pass_00", "linear", accepted=True, seconds=1)


@pytest.fixture(scope="module")
def truth(small_body) -> list[Clip]:
    """Two people, 40 frames at 30 fps, and a camera that passes them."""
    along = np.linspace(0, 1, N)
    turn_rad = np.stack([0.1 * along, 1 + 0.5 * along, np.zeros(N)], axis=1)
    centres_m = np.stack([2 * along, np.sin(3 * along), np.full(N, 1.5)], axis=1)
    clips = []
    for person in range(2):
        rng = np.random.default_rng(person)
        motion = make_gait("walk", N / 30, 30.0, small_body, rng).take(np.arange(N))
        clips.append(filmed(f"pass_00.p{person}", motion, turn_rad, centres_m))
    return clips


def turning(clip: Clip, deg_per_frame: float) -> Clip:
    """A person whose orientation drifts about the vertical."""
    yaw = Rotation.from_euler("z", deg_per_frame * np.arange(N)[:, None], degrees=True)
    return with_motion(clip, root_rotmats=yaw.as_matrix() @ clip.motion.root_rotmats)


def test_a_sequence_shows_the_person_who_fares_worst(truth, small_body):
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
def test_two_percent_too_large(truth, sigma_share, inside):
    found = [moved(clip, np.eye(4), 1.02) for clip in truth]
    # The true factor is 5: 5.1 was found.
    measured = replace(ACCEPTED, scale=5.1, scale_sigma=5 * sigma_share)
    row = sequence_errors(measured, found, truth)
    assert row.scale_error_percent == pytest.approx(2, abs=1e-5)
    assert row.scale_within_2sigma is inside
    assert row.camera_rotation_deg == pytest.approx(0, abs=1e-5)
    assert row.vme_mm is None
    # Of the person who fares worst, as all else: it was of the first.
    found[1] = moved(truth[1], np.eye(4), 0.97)
    row = sequence_errors(measured, found, truth)
    assert row.scale_error_percent == pytest.approx(-3, abs=1e-5)
    assert row.scale_within_2sigma is False


def test_motions_are_between_kept_frames_alone(truth):
    """Frame 20 is not kept, and the world slips by a metre there: 4 of 37 motions would tell."""
    valid = np.arange(N) != 20
    pelvis_m = truth[0].motion.pelvis_m + (np.arange(N) > 20)[:, None] * [1.0, 0, 0]
    gapped = replace(with_motion(truth[0], pelvis_m=pelvis_m), valid=valid)
    row = sequence_errors(ACCEPTED, [gapped], truth[:1])
    assert row.tme_mm == pytest.approx(0, abs=1e-9)
    assert row.people[0].n_motions == 33
    assert row.kept_share == 39 / 40


def test_what_was_not_recovered_has_no_errors(truth):
    rejected = replace(truth[0], valid=np.zeros(N, bool))
    in_camera = with_motion(truth[1], frame="camera")
    flicker = replace(truth[1], valid=np.arange(N) % 4 < 2)
    for found in ([rejected, in_camera], [], [rejected, flicker]):
        row = sequence_errors(replace(ACCEPTED, accepted=False), found, truth)
        assert row.ome_deg is row.camera_path_mm is row.scale_error_percent is None
        assert row.scale_within_2sigma is None
        assert [person.id for person in row.people] == ["pass_00.p0", "pass_00.p1"]
    assert row.kept_share == 0.25


def test_clips_of_another_video_are_an_error_not_a_gap(truth):
    other = with_motion(truth[0], fps_hz=25.0)
    with pytest.raises(StageFailed, match="25 fps"):
        sequence_errors(ACCEPTED, [other], truth[:1])


def test_without_an_error_bar_there_is_no_answer():
    assert within_2sigma(None, 1.0, 0.1) is None
    assert within_2sigma(1.0, None, 0.1) is None
    assert within_2sigma(1.0, 1.0, None) is None
    assert within_2sigma(-10.0, 0.9, 0.051) is True
    assert within_2sigma(-10.0, 0.9, 0.049) is False
