"""The prior on acceleration: what it leaves alone, and that it helps, where the truth is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from gmrdata.cameras.files import NOT_SMOOTHED, Smoothing, load_cameras, load_quality
from gmrdata.cameras.frames import Timeline
from gmrdata.cameras.map.rotation_only import refine_turning, solve_rotation_only
from gmrdata.cameras.map.smoothing import (
    camera_information,
    noise_px,
    second_differences,
    smooth_cameras,
)
from gmrdata.cameras.match.matches import Matches, PairMatches
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values import transforms
from gmrdata.values.camera import project
from gmrdata.values.frame_set import FrameSet, VideoRecord
from gmrdata.values.transforms import fit_similarity
from tests.filming import motion_errors, solve_keyframes_once
from tests.frame_sets import frame_set

INTRINSICS_PX = np.array([[300.0, 0, 160], [0, 310.0, 90], [0, 0, 1]])
CONFIG = SfmConfig()
UNIT = 5.0


def timeline(n: int, *cuts: int) -> Timeline:
    return Timeline(np.arange(n), np.array(cuts, dtype=np.int64))


def path(turns_deg: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Cameras (T, 4, 4) that turn by rotation vectors (T, 3)."""
    return transforms.rigid(Rotation.from_rotvec(np.deg2rad(turns_deg)).as_matrix(), places)


def steady(n: int) -> np.ndarray:
    t = np.arange(n)[:, None]
    return path(t * [0.0, 0.4, 0.3], t * [0.02, -0.01, 0.03])


def shaken(true: np.ndarray, rng: np.random.Generator, deg: float, share: float) -> np.ndarray:
    """The cameras with independent errors of these sizes per axis."""
    n = len(true)
    result = true.copy()
    turns = Rotation.from_rotvec(np.deg2rad(deg) * rng.normal(size=(n, 3))).as_matrix()
    result[:, :3, :3] = turns @ true[:, :3, :3]
    result[:, :3, 3] += share * UNIT * rng.normal(size=(n, 3))
    return result


def held(n: int, deg: float, share: float) -> csr_array:
    """Information of n cameras with such errors."""
    sigmas = np.tile(np.repeat([np.deg2rad(deg), share * UNIT], 3), n)
    return csr_array(np.diag(sigmas**-2))


def a_camera(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A camera (1, 4, 4), points (60, 3) and where it sees them (60, 2)."""
    points = rng.uniform([-2, -1, 4], [2, 1, 7], (60, 3))
    camera = path(np.array([[5.0, -20.0, 3.0]]), np.array([[0.3, -0.2, 0.1]]))
    return camera, points, project(camera[0], points, INTRINSICS_PX)


def smoothed(cameras: np.ndarray, held_by: csr_array, *cuts: int) -> tuple[np.ndarray, Smoothing]:
    """All frames refined together, at the optimum of their images."""
    n = len(cameras)
    return smooth_cameras(cameras, held_by, np.zeros(6 * n), timeline(n, *cuts), UNIT, CONFIG)


def test_information_is_the_inverse_covariance_of_least_squares():
    # The camera is found again from noisy image points many times: its scatter is what was said.
    rng = np.random.default_rng(0)
    camera, points, exact_px = a_camera(rng)
    noise = 0.2
    found = []
    for _ in range(400):
        image_px = exact_px + noise * rng.normal(size=exact_px.shape)
        held_by, slope = camera_information(camera, [(0, image_px, points)], INTRINSICS_PX, 1.0)
        found.append(-np.linalg.solve(held_by.toarray(), slope))
    scatter = np.cov(np.array(found).T)
    ratio = np.linalg.eigvals(scatter @ held_by.toarray()).real
    assert ratio.min() > 0.6 and ratio.max() < 1.6
    assert noise_px(noise * rng.normal(size=(100_000, 2))) == pytest.approx(noise, rel=0.01)


def test_a_step_along_the_slope_leads_to_the_camera():
    true, points, image_px = a_camera(np.random.default_rng(1))
    turn_rad, step = np.array([3e-5, -2e-5, 1e-5]), np.array([1e-4, 2e-4, -1e-4])
    off = true.copy()
    off[0, :3, :3] = Rotation.from_rotvec(-turn_rad).as_matrix() @ true[0, :3, :3]
    off[0, :3, 3] -= step
    held_by, slope = camera_information(off, [(0, image_px, points)], INTRINSICS_PX, 1.0)
    back = -np.linalg.solve(held_by.toarray(), slope)
    assert back == pytest.approx(np.concatenate([turn_rad, step]), rel=2e-3, abs=1e-8)


def test_a_steady_path_is_left_as_it_is():
    true = steady(40)
    result, figures = smoothed(true, held(40, 0.01, 1e-4))
    assert result == pytest.approx(true, abs=1e-12)
    assert figures.turn is not None
    assert figures.turn.acceleration_deg_per_frame2 == CONFIG.acceleration_deg
    assert figures.turn.noise_deg == pytest.approx(0.01, rel=1e-3)
    # Half of what is at the cut-off passes: (noise / sigma)^2 (2 sin(pi f))^4 = 1.
    f = figures.turn.cutoff_cycles_per_frame
    assert (0.01 / 0.002) ** 2 * (2 * np.sin(np.pi * f)) ** 4 == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize("shake_hz", [0.5, 1.0, 2.0])
def test_the_shake_of_a_hand_survives(shake_hz):
    n, fps_hz = 150, 30.0
    wave = np.sin(2 * np.pi * shake_hz * np.arange(n) / fps_hz)[:, None]
    true = path(0.3 * wave * [1.0, -0.5, 0.2], 0.01 * wave * [1.0, 0.3, -0.6])
    # With the noise of a hundredth of a degree, a shake of a third of a degree.
    result, _ = smoothed(true, held(n, 0.01, 2e-4))
    inner = slice(5, -5)
    kept = Rotation.from_matrix(result[inner, :3, :3]).as_rotvec(degrees=True)
    left = Rotation.from_matrix(true[inner, :3, :3]).as_rotvec(degrees=True)
    assert np.abs(kept - left).max() < 0.01 * 0.3
    assert np.abs(result - true)[inner, :3, 3].max() < 0.02 * 0.01


def test_noise_goes_down_at_every_step_of_time():
    rng, n = np.random.default_rng(2), 150
    wave = np.sin(2 * np.pi * np.arange(n) / 30)[:, None]
    sway = path(0.3 * wave * [1.0, -0.5, 0.2], 0.01 * wave * [1.0, 0.3, -0.6])
    for true, gain in ((steady(n), 0.3), (steady(n) @ sway, 0.75)):
        noisy = shaken(true, rng, 0.02, 4e-4)
        result, _ = smoothed(noisy, held(n, 0.02, 4e-4))
        before, after = motion_errors(noisy, true, 1), motion_errors(result, true, 1)
        assert after[0] < gain * before[0] and after[1] < gain * before[1]
        before, after = motion_errors(noisy, true, 3), motion_errors(result, true, 3)
        assert after[0] < before[0] and after[1] < before[1]


def test_a_badly_held_camera_follows_the_others_and_they_do_not_follow_it():
    true, n = steady(30), 30
    noisy = true.copy()
    noisy[12, :3, 3] += 0.3 * UNIT
    sigmas = np.tile(np.repeat([1e-4, 1e-4 * UNIT], 3), n)
    sigmas[6 * 12 : 6 * 13] *= 1e5
    result, _ = smoothed(noisy, csr_array(np.diag(sigmas**-2)))
    assert np.abs(result[:, :3, 3] - true[:, :3, 3]).max() < 1e-3 * UNIT


def test_a_jump_at_a_cut_stays():
    true = steady(40)
    true[20:, :3, 3] += 1.0
    weak = held(40, 0.1, 1e-2)
    cut, _ = smoothed(true, weak, 19)
    assert cut == pytest.approx(true, abs=1e-9)
    uncut, _ = smoothed(true, weak)
    assert np.abs(uncut - true).max() > 0.01


def test_uneven_steps_and_missing_cameras():
    numbers = np.array([0, 1, 2, 4, 5, 6, 9, 10, 11, 12, 13, 14])
    even = steady(15)
    true = even[numbers]
    true[4] = np.nan
    times = Timeline(numbers, np.zeros(0, dtype=np.int64))
    differences = second_differences(np.isfinite(true[:, 0, 0]), times, 5)
    assert differences.rows[2].tolist() == [2, 3, 5]
    assert differences.spans[2].tolist() == [2.0, 2.0]
    assert differences.of(true) == pytest.approx(0.0, abs=1e-12)
    place = differences.matrix(12) @ np.nan_to_num(true[:, :3, 3])
    assert place == pytest.approx(differences.of(true)[:, 3:], abs=1e-12)
    result, _ = smooth_cameras(true, held(12, 0.1, 1e-2), np.zeros(72), times, UNIT, CONFIG)
    assert np.isnan(result[4]).all()
    assert np.nan_to_num(result) == pytest.approx(np.nan_to_num(true), abs=1e-9)
    few = second_differences(np.isfinite(true[:, 0, 0]), times, 1)
    assert [2, 3, 5] in few.rows.tolist() and not any(5 in row[:2] for row in few.rows.tolist())


def dropped(fps_hz: float, every: int) -> FrameSet:
    """Every so-manieth of 120 frames, of which a camera at that rate dropped five in the middle."""
    shown = np.delete(np.arange(120), np.arange(61, 66))[::every]
    video = VideoRecord.model_construct(every=every)
    even = frame_set(np.arange(len(shown)) * every, (320, 180), fps_hz / every)
    return replace(even, times_s=(shown / fps_hz).round(6), video=video)


@pytest.mark.parametrize("fps_hz", [10.0, 29.97, 240.0])
@pytest.mark.parametrize("every", [1, 2])
def test_a_pan_over_frames_that_were_dropped_is_left_as_it_is(fps_hz, every):
    frames = dropped(fps_hz, every)
    numbers = frames.numbers_in_time
    # The five take two and a half steps of every second frame.
    assert np.diff(numbers).tolist() == [
        1 + 5 / every * (at == 60 // every) for at in frames.numbers[:-1]
    ]
    true = steady(120)[(every * numbers).astype(int)]
    time = Timeline(numbers, np.zeros(0, dtype=np.int64))
    n = len(true)
    result, _ = smooth_cameras(true, held(n, 0.01, 1e-4), np.zeros(6 * n), time, UNIT, CONFIG)
    assert result == pytest.approx(true, abs=1e-9)


def test_images_in_even_steps_and_those_without_times_keep_their_numbers():
    even = frame_set(np.arange(9), (320, 180), 30.0)
    jittery = replace(even, times_s=even.times_s + 0.01 * (np.arange(9) % 2))
    unknown = replace(even, times_s=np.full(9, np.nan), rate_hz=np.nan)
    for frames in (even, jittery, unknown):
        assert frames.numbers_in_time is frames.numbers


def test_too_few_frames_are_left_alone():
    true = steady(5)
    result, figures = smoothed(true, held(5, 1, 1))
    assert result is true and figures == NOT_SMOOTHED


def test_a_turning_camera_is_smoothed_by_its_matches():
    rng, n = np.random.default_rng(3), 40
    true = path(np.arange(n)[:, None] * [0.0, 0.5, 0.1], np.zeros((n, 3)))
    points = rng.uniform([-20, -6, 20], [20, 6, 40], (400, 3))
    keypoints = [
        project(camera, points, INTRINSICS_PX) + 0.3 * rng.normal(size=(400, 2)) for camera in true
    ]
    some = [np.sort(rng.choice(400, 30, replace=False)) for _ in range(3 * n)]
    pairs = [
        PairMatches(i, i + step, np.stack([some[i + step]] * 2, axis=1), "PANORAMIC")
        for i in range(n)
        for step in (1, 4)
        if i + step < n
    ]
    turning = solve_rotation_only(
        Matches(keypoints, pairs), INTRINSICS_PX, 2.0, np.random.default_rng(0)
    )
    refined, figures = refine_turning(turning, timeline(n), CONFIG)
    before, after = (
        motion_errors(transforms.rigid(found.world_from_cam_rotmats, np.zeros(3)), true, 1)[0]
        for found in (turning, refined)
    )
    assert after < 0.7 * before
    assert figures.turn is not None
    assert figures.turn.noise_deg > 0.001 and figures.place is None
    # The first frame is the world, before and after.
    first = turning.world_from_cam_rotmats[0]
    assert refined.world_from_cam_rotmats[0] == pytest.approx(first, abs=1e-9)
    without = replace(turning, has_camera=np.arange(n) != 7)
    assert np.array_equal(
        refine_turning(without, timeline(n), CONFIG)[0].has_camera, without.has_camera
    )


@pytest.mark.slow
def test_filmed_motions_get_better(film, tmp_path, monkeypatch):
    filmed = film("arc", 40)
    solve_keyframes_once(monkeypatch)
    errors = []
    for name, config in {
        "rough": SfmConfig(acceleration_deg=10.0, acceleration_share=1.0),
        "smooth": CONFIG,
    }.items():
        out_dir = filmed.solved(tmp_path / name, config)
        found, true = load_cameras(out_dir).path, filmed.world_from_cam
        assert found.has_camera.all()
        true_from_found = fit_similarity(true[:, :3, 3], found.centres_world_m, scale=True)
        metric = found.world_from_cam.copy()
        metric[:, :3, 3] *= true_from_found.scale
        errors.append([motion_errors(metric, true, step) for step in (1, 3)])
    rough, smooth = np.array(errors)
    assert (smooth[0] < 0.9 * rough[0]).all()  # from frame to frame
    assert (smooth[1] < rough[1]).all()  # over three frames: 10 of 30 per second
    rough, smooth = load_quality(tmp_path / "rough").smoothing, load_quality(out_dir).smoothing
    assert rough.turn is not None and rough.turn.cutoff_cycles_per_frame == 0.5
    assert smooth.turn is not None and smooth.turn.cutoff_cycles_per_frame > 0.1
