"""What a clip with cameras says: noise, known frames, error bars, and feet that stand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.fusion.camera_evidence import (
    OWN_FUSION,
    FusionConfig,
    Noise,
    WorldErrors,
    error_bars,
    fusion_config_of,
    hidden_frames,
    known_frames,
    measured_noise,
    planted_feet,
    seen_poses,
    unseen_frames,
)
from gmrdata.fusion.network_evidence import free_where_hidden, widened, with_pace_errors
from gmrdata.fusion.smoothing import ErrorProcess, FusedPoses, SeenMotions
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip
from gmrdata.values.motion import Motion, deltas
from gmrdata.values.people import System
from gmrdata.values.transforms import rigid
from gmrdata.world.bodies import BodiesRecord

CONFIG = FusionConfig()


def clip_of(motion: Motion, camera_m: tuple[float, float, float] = (0.0, -5.0, 1.5)) -> Clip:
    n = motion.n_frames
    cameras = rigid(np.tile(np.eye(3), (n, 1, 1)), np.tile(camera_m, (n, 1)))
    camera = CameraPath(np.eye(3), 640, 480, cameras, np.ones(n, dtype=bool))
    return Clip("walk", motion, np.ones(n, dtype=bool), np.arange(n), camera)


def motions_of(motion: Motion, sigma: float = 0.05) -> SeenMotions:
    n = motion.n_frames
    parts = [ErrorProcess(np.full((n - 1, 6), sigma), np.full(6, time_s)) for time_s in (0.2, 5.0)]
    return SeenMotions(*deltas(motion.root_rotmats, motion.pelvis_m), *parts)


@pytest.fixture
def motion(walk) -> Motion:
    return walk(30.0, 240)


def noisy_of(motion: Motion) -> Motion:
    """Poses as a system has them that errs from frame to frame."""
    rng = np.random.default_rng(0)
    rays = motion.pelvis_m - [0.0, -5.0, 1.5]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    noise = 0.005 * rng.normal(size=rays.shape)
    along = 0.02 * rng.normal(size=(len(rays), 1))
    noise += (along - (noise * rays).sum(axis=1, keepdims=True)) * rays
    turns = Rotation.from_rotvec(0.01 * rng.normal(size=rays.shape)).as_matrix()
    root_rotmats = motion.root_rotmats @ turns
    return replace(motion, pelvis_m=motion.pelvis_m + noise, root_rotmats=root_rotmats)


@pytest.mark.parametrize("every", [1, 2, 5])
def test_noise_along_and_across_the_ray_is_found(walk, every):
    """Also of poses of every second or fifth frame, of which no three are in a row."""
    motion = walk(30.0, 240 * every)
    clip = clip_of(noisy_of(motion))
    clip = replace(clip, valid=np.arange(motion.n_frames) % every == 0)
    found = measured_noise(clip, motions_of(motion), CONFIG)
    assert found.along_m == pytest.approx(0.02, rel=0.25)
    assert found.across_m == pytest.approx(0.005, rel=0.35)
    assert found.turn_rad == pytest.approx(0.01, rel=0.25)


@pytest.mark.parametrize("known", [[10, 11, 12, 13], [*range(0, 240, 30)], [0, 239], []])
def test_a_noise_that_nothing_measures_is_not_the_least(motion, known):
    clip = clip_of(noisy_of(motion))
    clip = replace(clip, valid=np.isin(np.arange(motion.n_frames), known))
    found = measured_noise(clip, motions_of(motion), CONFIG)
    assert (found.along_m, found.across_m) == (0.01, 0.01)
    assert np.rad2deg(found.turn_rad) == pytest.approx(2.0)


def test_without_noise_there_is_the_floor(motion):
    found = measured_noise(clip_of(motion), motions_of(motion), CONFIG)
    assert (found.along_m, found.across_m) == (CONFIG.place_floor_m, CONFIG.place_floor_m)
    assert np.rad2deg(found.turn_rad) == pytest.approx(CONFIG.turn_floor_deg)


def test_a_noise_that_is_given_is_taken(motion):
    config = FusionConfig(place_sigma_m=0.03, turn_sigma_deg=2.0)
    found = measured_noise(clip_of(motion), motions_of(motion), config)
    assert (found.along_m, found.across_m) == (0.03, 0.03)
    assert np.rad2deg(found.turn_rad) == pytest.approx(2.0)


def test_a_pace_that_may_be_wrong_is_mostly_so_forward(motion):
    motions = motions_of(motion, sigma=0.0)
    found = with_pace_errors(motions, 30.0, 0.3)
    walked_m = np.linalg.norm(np.diff(motion.pelvis_m, axis=0).sum(axis=0))
    pace = walked_m * 30.0 / (motion.n_frames - 1)
    sigma = found.slow.sigma
    assert not sigma[:, :3].any() and found.fast is motions.fast
    np.testing.assert_allclose(np.median(sigma[:, 5]), 0.3 * pace, rtol=0.15)
    np.testing.assert_allclose(sigma[:, 3] / sigma[:, 5], 0.5)


def test_people_of_the_built_in_estimator_have_their_own_noise(tmp_path, monkeypatch):
    """Known by who saw them, in a video's folder, beside its world, and of one clip of that."""
    folder, world = tmp_path / "bodies", tmp_path / "pseudo_gt"
    for made in (folder, world):
        made.mkdir()
    (world / "person_0.npz").touch()
    monkeypatch.chdir(world)
    assert fusion_config_of(tmp_path) == FusionConfig()
    systems: dict[System, FusionConfig] = {"wham": FusionConfig(), "gmrdata": OWN_FUSION}
    for estimator, config in systems.items():
        BodiesRecord(
            estimator=estimator, file="poses", body="anny", people=(), left_out=(), notes=()
        ).write(folder / "bodies.json")
        for source in (tmp_path, world, world / "person_0.npz", Path(), Path("person_0.npz")):
            assert fusion_config_of(source) == config


def test_a_place_is_less_sure_along_the_ray(motion):
    clip = clip_of(motion)
    config = FusionConfig(slow_along_share=0.03, slow_place_m=0.02)
    seen = seen_poses(clip, Noise(0.1, 0.01, 0.02), config)
    ray = motion.pelvis_m[7] - [0.0, -5.0, 1.5]
    away_m = np.linalg.norm(ray)
    ray /= away_m
    across = np.linalg.svd(ray[None])[2][1:]
    slow_m2 = seen.shift_m[7] @ seen.shift_m[7].T
    for covariance_m2, along_m, across_m in (
        (seen.place_covariance_m2[7], 0.1, 0.01),
        (slow_m2, 0.03 * away_m, 0.02),
    ):
        assert ray @ covariance_m2 @ ray == pytest.approx(along_m**2)
        expected = across_m**2 * np.eye(2)
        np.testing.assert_allclose(across @ covariance_m2 @ across.T, expected, atol=1e-12)


def test_known_and_unseen_frames(motion):
    clip = clip_of(motion)
    valid, has_camera = clip.valid.copy(), clip.valid.copy()
    valid[10:20] = False  # the person was not found
    valid[30:40] = has_camera[30:40] = False  # the camera was lost
    assert clip.camera is not None
    cut = replace(clip, valid=valid, camera=replace(clip.camera, has_camera=has_camera))
    np.testing.assert_array_equal(known_frames(cut), valid)
    assert np.flatnonzero(unseen_frames(cut)).tolist() == list(range(10, 20))
    wide = widened(motions_of(motion), unseen_frames(cut), 3.0).fast.sigma[:, 0] / 0.05
    assert np.flatnonzero(wide > 1).tolist() == list(range(9, 20))
    assert not known_frames(replace(clip, camera=None)).any()


def test_who_is_hidden_for_longer_than_a_step_may_go_anywhere(motion):
    seen = np.ones(240, dtype=bool)
    seen[10:20] = seen[40:80] = False
    hidden = hidden_frames(seen, motion.fps_hz)
    assert np.flatnonzero(hidden).tolist() == [*range(40, 80)]
    motions = motions_of(motion)
    free = free_where_hidden(motions, hidden)
    assert free.slow is motions.slow
    touched = np.isin(np.arange(239), np.arange(39, 80))
    expected = np.hypot(0.05, [1.0, 1.0, 1.0, 2.0, 0.5, 2.0])
    np.testing.assert_allclose(free.fast.sigma[touched], np.tile(expected, (41, 1)))
    np.testing.assert_array_equal(free.fast.sigma[~touched], 0.05)


def test_what_is_wrong_with_a_world_is_part_of_the_error_bar(motion):
    clip, n = clip_of(motion), motion.n_frames
    assert clip.camera is not None
    cameras = clip.camera.world_from_cam.copy()
    cameras[:, 0, 3] = np.linspace(-10, 10, n)
    moving = replace(clip, camera=replace(clip.camera, world_from_cam=cameras))
    zero = np.zeros((n, 3, 3))
    poses = FusedPoses(motion.root_rotmats, motion.pelvis_m, zero, zero, 1)
    bars = error_bars(poses, moving, CONFIG, WorldErrors(0.02, 0.07, 2.0))
    apart_m = motion.pelvis_m - np.append(motion.pelvis_m[:, :2].mean(axis=0), 0.0)
    lean_m = np.deg2rad(2.0) / np.sqrt(2) * np.linalg.norm(apart_m[:, :2], axis=1)
    expected_m2 = (0.02 * apart_m) ** 2
    expected_m2[:, 2] += lean_m**2
    np.testing.assert_allclose(bars["place_sigma_m"] ** 2, expected_m2)
    away_m = np.linalg.norm(motion.pelvis_m - cameras[:, :3, 3], axis=1)
    seen_m = np.linalg.norm(bars["camera_sigma_m"], axis=1)
    np.testing.assert_allclose(seen_m, 0.07 * away_m)
    np.testing.assert_allclose(bars["turn_sigma_deg"], np.hypot(CONFIG.slow_turn_deg, np.sqrt(2)))
    lasting = CONFIG.model_copy(update={"lasting_place_m": 0.03})
    wider = error_bars(poses, moving, lasting, WorldErrors(0.02, 0.07, 2.0))
    for key in ("place_sigma_m", "camera_sigma_m"):
        np.testing.assert_allclose(wider[key] ** 2, bars[key] ** 2 + 0.03**2)
    none = error_bars(poses, replace(moving, camera=None), CONFIG, WorldErrors(0.02, 0.07, 2.0))
    assert none["place_sigma_m"].max() == 0 and np.isnan(none["camera_sigma_m"]).all()


def test_on_steps_the_height_is_no_surer_where_no_camera_is_known(motion):
    """What a person's distance is wrong by was left out of the height there."""
    clip, zero = clip_of(motion), np.zeros((motion.n_frames, 3, 3))
    assert clip.camera is not None
    cameras, has_camera = clip.camera.world_from_cam.copy(), clip.camera.has_camera.copy()
    cameras[:, 2, 3] = np.linspace(1.5, 3.5, motion.n_frames)
    gone = replace(clip.camera, world_from_cam=cameras.copy(), has_camera=has_camera)
    has_camera[100:140] = has_camera[-20:] = False
    gone.world_from_cam[~has_camera] = np.nan
    poses = FusedPoses(motion.root_rotmats, motion.pelvis_m, zero, zero, 1)
    errors = WorldErrors(distance_share=0.07, floor_at_m=(0.0, 0.0))
    found_m = error_bars(poses, replace(clip, camera=gone), CONFIG, errors)["place_sigma_m"]
    cameras[-20:, 2, 3] = cameras[-21, 2, 3]
    np.testing.assert_allclose(
        found_m[:, 2], 0.07 * np.abs(cameras[:, 2, 3] - motion.pelvis_m[:, 2])
    )


def test_a_walking_persons_feet_stand_in_turn(motion, small_body):
    seen = deltas(motion.root_rotmats, motion.pelvis_m)
    feet = planted_feet(small_body, motion, seen, CONFIG)
    assert feet.points_root_m.shape == (240, 6, 3)
    by_foot = feet.still.reshape(239, 2, 3).any(axis=2)
    assert 0.3 < by_foot.mean() < 0.8
    assert by_foot.any(axis=1).mean() > 0.7
    world_m = (
        motion.pelvis_m[:, None]
        + (motion.root_rotmats[:, None] @ feet.points_root_m[..., None])[..., 0]
    )
    moved_m = np.linalg.norm(np.diff(world_m, axis=0), axis=-1)
    assert moved_m[feet.still].max() * 30 < CONFIG.planted_m_per_s
