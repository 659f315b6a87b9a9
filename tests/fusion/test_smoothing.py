"""The pose graph: exact small cases, error bars, loops, feet, another world."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.fusion import smoothing
from gmrdata.fusion.smoothing import (
    ErrorProcess,
    FusedPoses,
    PlantedFeet,
    SamePlace,
    SeenMotions,
    SeenPoses,
    mean_variance,
    smooth,
)
from gmrdata.values.motion import deltas

FPS_HZ = 10.0
SHIFT_TIME_S = 0.5


def path(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A smooth walk with turns: world_from_root (n, 3, 3) and pelvis (n, 3) [m]."""
    rng = np.random.default_rng(seed)
    turns = np.cumsum(rng.normal(scale=0.05, size=(n, 3)), axis=0)
    steps_m = np.cumsum(rng.normal(scale=0.01, size=(n, 3)), axis=0) + np.array([0.1, 0.0, 0.0])
    return Rotation.from_rotvec(turns).as_matrix(), np.cumsum(steps_m, axis=0)


def process(n: int, turn: float, place: float, time_s: float) -> ErrorProcess:
    sigma = np.tile([turn] * 3 + [place] * 3, (n - 1, 1))
    return ErrorProcess(sigma, np.full(6, time_s))


def motions_of(
    rotmats: np.ndarray, pelvis_m: np.ndarray, fast: float = 1e-4, slow: float = 1e-4
) -> SeenMotions:
    n = len(pelvis_m)
    processes = process(n, fast, fast, 0.05), process(n, slow, slow, 5.0)
    return SeenMotions(*deltas(rotmats, pelvis_m), *processes)


def seen_of(
    rotmats: np.ndarray,
    pelvis_m: np.ndarray,
    known: np.ndarray,
    sigma_m: float = 1e-3,
    slow_m: float = 0.0,
) -> SeenPoses:
    n = len(known)
    hidden = np.where(known[:, None], pelvis_m, np.nan)
    turns = np.where(known[:, None, None], rotmats, np.nan)
    covariances = np.tile(sigma_m**2 * np.eye(3), (n, 1, 1))
    shift_m = np.tile(slow_m * np.eye(3), (n, 1, 1))
    return SeenPoses(turns, hidden, known, np.full(n, 1e-3), covariances, shift_m, SHIFT_TIME_S)


def begun(rotmats: np.ndarray, pelvis_m: np.ndarray) -> SeenPoses:
    """Poses of which no camera knows one, and only the first counts."""
    nowhere = seen_of(rotmats, pelvis_m, np.zeros(len(rotmats), dtype=bool))
    return replace(nowhere, rotmats=rotmats, pelvis_m=pelvis_m)


def gap(n: int, start: int, stop: int) -> np.ndarray:
    known = np.ones(n, dtype=bool)
    known[start:stop] = False
    return known


def assert_is(fused: FusedPoses, rotmats: np.ndarray, pelvis_m: np.ndarray, atol: float) -> None:
    np.testing.assert_allclose(fused.pelvis_m, pelvis_m, rtol=0, atol=atol)
    np.testing.assert_allclose(fused.rotmats, rotmats, rtol=0, atol=atol)


@pytest.mark.parametrize(("start", "stop"), [(0, 0), (10, 30), (0, 15), (25, 40)])
def test_exact_motions_bridge_any_gap(start, stop):
    truth = path(40)
    fused = smooth(FPS_HZ, seen_of(*truth, gap(40, start, stop)), motions_of(*truth))
    assert_is(fused, *truth, atol=1e-9)


def test_without_a_camera_the_networks_path_is_kept():
    truth = path(30)
    fused = smooth(FPS_HZ, begun(*truth), motions_of(*truth))
    assert_is(fused, *truth, atol=1e-9)
    assert fused.place_covariance_m2[0].max() < 1e-11


def test_a_network_that_turns_wrongly_is_led_by_the_cameras():
    rotmats, pelvis_m = path(60)
    rng = np.random.default_rng(1)
    wrong = Rotation.from_rotvec(rng.normal(scale=0.05, size=(59, 3))).as_matrix()
    motions = motions_of(rotmats, pelvis_m, fast=0.7, slow=0.2)
    turns, steps_m = motions.delta_rotmats @ wrong, 1.3 * motions.delta_m
    off = replace(motions, delta_rotmats=turns, delta_m=steps_m)
    fused = smooth(FPS_HZ, seen_of(rotmats, pelvis_m, gap(60, 20, 30)), off)
    known = gap(60, 20, 30)
    assert np.abs(fused.pelvis_m - pelvis_m)[known].max() < 0.005
    assert np.linalg.norm(fused.pelvis_m - pelvis_m, axis=1).max() < 0.1


def test_a_slow_error_that_cameras_show_is_taken_off_within_the_gap():
    """A network that thinks every step a fifth too long is right once cameras have shown it."""
    rotmats = np.tile(np.eye(3), (80, 1, 1))
    pelvis_m = np.arange(80)[:, None] * [0.12, 0.0, 0.0]
    known = gap(80, 50, 80)
    motions = motions_of(rotmats, pelvis_m, fast=0.05, slow=0.2)
    long = replace(motions, delta_m=1.2 * motions.delta_m)
    fused = smooth(FPS_HZ, seen_of(rotmats, pelvis_m, known), long)
    alone_m = 0.2 * 0.12 * 30
    # It fades back to none with the slow error's memory, 5 s.
    assert np.linalg.norm(fused.pelvis_m[-1] - pelvis_m[-1]) < 0.35 * alone_m


def test_error_bars_of_a_bridge_are_those_of_a_random_walk():
    """Independent steps of s, ends known: variance s^2 k (n - k) / n after k of n steps."""
    n, step_m = 22, 0.02
    rotmats, pelvis_m = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))
    motions = motions_of(rotmats, pelvis_m)
    rate = step_m * FPS_HZ / np.sqrt(mean_variance(np.array(1 / (FPS_HZ * 1e-3))))
    fast = process(n, 1e-6, float(rate), 1e-3)
    walk = SeenMotions(motions.delta_rotmats, motions.delta_m, fast, process(n, 1e-9, 1e-9, 5.0))
    fused = smooth(FPS_HZ, seen_of(rotmats, pelvis_m, gap(n, 1, n - 1), sigma_m=1e-5), walk)
    k = np.arange(n)
    expected = step_m**2 * k * (n - 1 - k) / (n - 1)
    for axis in range(3):
        found = fused.place_covariance_m2[:, axis, axis]
        np.testing.assert_allclose(found, expected, rtol=1e-3, atol=2e-10)


def test_error_bars_are_those_of_many_trials():
    """Errors drawn as the graph takes them: errors over error bars have a variance of one."""
    n, trials = 50, 60
    rotmats, pelvis_m = path(n)
    rng = np.random.default_rng(2)
    fast, slow = process(n, 0.15, 0.2, 0.3), process(n, 0.03, 0.15, 4.0)
    true_turns, true_m = deltas(rotmats, pelvis_m)
    known = gap(n, 12, 42)
    over, turned = [], []
    for _ in range(trials):
        errors = sum(sampled(one, rng) for one in (fast, slow))
        turns = true_turns @ Rotation.from_rotvec(errors[:, :3]).as_matrix()
        motions = SeenMotions(turns, true_m + errors[:, 3:], fast, slow)
        noisy_m = pelvis_m + rng.normal(scale=0.01, size=pelvis_m.shape)
        noisy_m += 0.03 * wandering(n, 3, SHIFT_TIME_S, rng)
        noise = Rotation.from_rotvec(rng.normal(scale=1e-3, size=(n, 3))).as_matrix()
        seen = seen_of(rotmats @ noise, noisy_m, known, sigma_m=0.01, slow_m=0.03)
        fused = smooth(FPS_HZ, seen, motions)
        variances = np.diagonal(fused.place_covariance_m2, axis1=1, axis2=2)
        over.append((fused.pelvis_m - pelvis_m) ** 2 / variances)
        off = Rotation.from_matrix(fused.rotmats.swapaxes(1, 2) @ rotmats).as_rotvec()
        turned.append(off**2 / np.diagonal(fused.turn_covariance_rad2, axis1=1, axis2=2))
    for ratios in (np.array(over), np.array(turned)):
        assert ratios[:, ~known].mean() == pytest.approx(1.0, abs=0.2)
        assert ratios[:, known].mean() == pytest.approx(1.0, abs=0.3)
        assert (ratios[:, ~known] < 4).mean() > 0.9


def test_a_depth_that_wanders_is_held_by_the_network():
    """The person stands, and the camera's depth wanders by 5 cm within half a second each time."""
    n = 120
    rotmats, pelvis_m = np.tile(np.eye(3), (n, 1, 1)), np.tile([0.0, 0.0, 0.9], (n, 1))
    wrong_m = 0.05 * wandering(n, 1, SHIFT_TIME_S, np.random.default_rng(4)) * [0.0, 1.0, 0.0]
    motions = motions_of(rotmats, pelvis_m, fast=0.02, slow=0.02)
    known = np.ones(n, dtype=bool)
    off_m = []
    for slow_m in (0.0, 0.05):
        seen = seen_of(rotmats, pelvis_m + wrong_m, known, sigma_m=0.01, slow_m=slow_m)
        fused = smooth(FPS_HZ, seen, motions)
        off_m.append(np.ptp(fused.pelvis_m[:, 1]))
    assert off_m[1] < 0.4 * off_m[0]
    error_m = np.abs(fused.pelvis_m - pelvis_m)[:, 1]
    assert (error_m < 2 * np.sqrt(fused.place_covariance_m2[:, 1, 1])).all()


@pytest.mark.parametrize("n", [2, 3, 8, 15])
@pytest.mark.parametrize("loops", [(), (SamePlace(0, 1, 0.01), SamePlace(1, -1, 0.02))])
def test_error_bars_are_blocks_of_the_whole_inverse(n, loops):
    rotmats, pelvis_m = path(n)
    loops = tuple(loop._replace(other_row=loop.other_row % n) for loop in loops)
    seen = seen_of(rotmats, pelvis_m, np.arange(n) < 2, sigma_m=0.1, slow_m=0.1)
    motions = motions_of(rotmats, pelvis_m, fast=0.2, slow=0.1)
    graph = smoothing._Graph(FPS_HZ, seen, motions, None, loops)
    state = smoothing._State(rotmats, pelvis_m, np.zeros((n, 6)), np.zeros((n, 3)))
    inverse = np.linalg.inv(smoothing._normal_equations(graph, state)[0].toarray())
    fused = smoothing._with_covariances(graph, state, 1)
    for k in range(n):
        first = smoothing.WIDTH * k
        block = inverse[first : first + 6, first : first + 6]
        for found, wanted in (
            (fused.turn_covariance_rad2[k], block[:3, :3]),
            (fused.place_covariance_m2[k], block[3:, 3:]),
        ):
            np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=1e-5 * wanted[0, 0])


def sampled(one: ErrorProcess, rng: np.random.Generator) -> np.ndarray:
    """Errors of motions (T-1, 6) [rad, m], drawn from a process."""
    spread = np.sqrt(mean_variance(1 / (FPS_HZ * one.time_s)))
    return wandering(len(one.sigma), 6, one.time_s, rng) * one.sigma * spread / FPS_HZ


def wandering(
    n: int, d: int, time_s: float | np.ndarray, rng: np.random.Generator, fps_hz: float = FPS_HZ
) -> np.ndarray:
    """A Gauss-Markov process (n, d) of variance 1."""
    kept = np.exp(-1 / (fps_hz * time_s))
    states = [rng.normal(size=d)]
    for _ in range(n - 1):
        states.append(kept * states[-1] + np.sqrt(1 - kept**2) * rng.normal(size=d))
    return np.array(states)


def test_error_bars_grow_into_a_gap_and_with_its_length():
    truth = path(60)
    motions = motions_of(*truth, fast=0.2, slow=0.05)
    largest = []
    for stop in (20, 30, 50):
        fused = smooth(FPS_HZ, seen_of(*truth, gap(60, 10, stop)), motions)
        spread = np.trace(fused.place_covariance_m2, axis1=1, axis2=2)
        assert abs(int(spread.argmax()) - (9 + stop) // 2) <= 2
        largest.append(spread.max())
    assert largest[0] < largest[1] < largest[2]


def test_a_loop_pulls_the_end_and_narrows_its_error_bar():
    n = 120
    angles = np.linspace(0, 2 * np.pi, n)
    pelvis_m = np.stack([np.cos(angles), np.sin(angles), np.ones(n)], axis=1)
    rotmats = Rotation.from_rotvec(angles[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    motions = motions_of(rotmats, pelvis_m, fast=0.1, slow=0.05)
    drift = Rotation.from_rotvec([0.0, 0.0, 0.008]).as_matrix()
    turns, steps_m = motions.delta_rotmats @ drift, 1.05 * motions.delta_m
    off, start = replace(motions, delta_rotmats=turns, delta_m=steps_m), begun(rotmats, pelvis_m)
    alone = smooth(FPS_HZ, start, off)
    closed = smooth(FPS_HZ, start, off, loops=[SamePlace(0, n - 1, 0.01)])
    errors_m = [np.linalg.norm((one.pelvis_m - pelvis_m)[-1, :2]) for one in (alone, closed)]
    assert errors_m[1] < 0.05 * errors_m[0]
    middle_m = [np.linalg.norm((one.pelvis_m - pelvis_m)[60, :2]) for one in (alone, closed)]
    assert middle_m[1] < middle_m[0]
    assert closed.place_covariance_m2[-1, 0, 0] == pytest.approx(1e-4, rel=0.05)


def test_one_camera_that_is_far_off_is_not_believed():
    rotmats, pelvis_m = path(40)
    seen = seen_of(rotmats, pelvis_m, gap(40, 0, 0), sigma_m=0.005)
    seen.pelvis_m[20] += [1.0, 0.0, 0.0]
    fused = smooth(FPS_HZ, seen, motions_of(rotmats, pelvis_m, fast=0.1, slow=0.02))
    assert np.linalg.norm(fused.pelvis_m[20] - pelvis_m[20]) < 0.01


def test_planted_feet_hold_the_person_and_the_ground_the_height():
    """A person who stands: the network lets them slide and rise, their feet do not."""
    n = 40
    rotmats, pelvis_m = np.tile(np.eye(3), (n, 1, 1)), np.tile([0.0, 0.0, 0.9], (n, 1))
    motions = motions_of(rotmats, pelvis_m, fast=0.1, slow=0.1)
    sliding = replace(motions, delta_m=motions.delta_m + np.array([0.01, 0.0, 0.01]))
    feet = PlantedFeet(
        np.tile([[[0.1, 0.0, -0.9]], [[-0.1, 0.0, -0.9]]], (n, 1, 1, 1)).reshape(n, 2, 3),
        np.ones((n - 1, 2), dtype=bool),
        slip_m=0.001,
        height_sigma_m=None,
    )
    seen = seen_of(rotmats, pelvis_m, gap(n, 1, n))
    alone_m, held_m = (
        np.linalg.norm(smooth(FPS_HZ, seen, sliding, feet=one).pelvis_m - pelvis_m, axis=1)
        for one in (None, feet)
    )
    assert alone_m[-1] > 0.3
    assert held_m[-1] < 0.02
    grounded = PlantedFeet(feet.points_root_m, feet.still, slip_m=1.0, height_sigma_m=0.01)
    on_ground_m = smooth(FPS_HZ, seen, sliding, feet=grounded).pelvis_m
    assert np.abs(on_ground_m[:, 2] - 0.9).max() < 0.01
    assert np.abs(on_ground_m[-1, 0]) > 0.2


@settings(max_examples=10)
@given(
    turn=st.tuples(*[st.floats(-3.0, 3.0)] * 3), move_m=st.tuples(*[st.floats(-100.0, 100.0)] * 3)
)
def test_another_world_gives_the_same_motion_and_error_bars(turn, move_m):
    rotmats, pelvis_m = path(25)
    world = Rotation.from_rotvec(turn).as_matrix()
    moved = world @ rotmats, pelvis_m @ world.T + move_m
    rng = np.random.default_rng(3)
    motions = motions_of(rotmats, pelvis_m, fast=0.2, slow=0.1)
    noise_m = rng.normal(scale=0.01, size=motions.delta_m.shape)
    motions = replace(motions, delta_m=motions.delta_m + noise_m)
    known = gap(25, 8, 18)
    here, there = (
        smooth(FPS_HZ, seen_of(*poses, known), motions) for poses in ((rotmats, pelvis_m), moved)
    )
    np.testing.assert_allclose(there.pelvis_m, here.pelvis_m @ world.T + move_m, atol=2e-4)
    np.testing.assert_allclose(there.rotmats, world @ here.rotmats, atol=2e-4)
    turned = world @ here.place_covariance_m2 @ world.T
    np.testing.assert_allclose(there.place_covariance_m2, turned, atol=1e-6)
    np.testing.assert_allclose(there.turn_covariance_rad2, here.turn_covariance_rad2, atol=1e-6)


def test_a_loop_that_bends_a_long_path_far_settles():
    """A straight way of 12 m that is told to end where it began: full steps overshoot there."""
    n, rng = 300, np.random.default_rng(0)
    turns = Rotation.from_rotvec(rng.normal(scale=0.01, size=(n - 1, 3))).as_matrix()
    fast = ErrorProcess(np.tile([0.15, 0.15, 0.3, 0.1, 0.08, 0.15], (n - 1, 1)), np.full(6, 0.05))
    slow = ErrorProcess(np.tile([0, 0, 0, 0, 0, 0.02], (n - 1, 1)), np.full(6, 3.0))
    motions = SeenMotions(turns, np.tile([0.04, 0.0, 0.0], (n - 1, 1)), fast, slow)
    start = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))
    fused = smooth(30.0, begun(*start), motions, loops=[SamePlace(0, n - 1, 0.1)])
    assert np.linalg.norm(fused.pelvis_m[-1, :2] - fused.pelvis_m[0, :2]) < 0.3
