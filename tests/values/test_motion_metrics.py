"""OME, TME and VME on cases that were worked out by hand; vertices of whole runs, over time."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.motion.gait import embedded_motions
from gmrdata.score.predictions import still_motion
from gmrdata.values import motion_metrics as vertices
from gmrdata.values.motion import Motion, accumulate, deltas
from gmrdata.values.motion_metrics import (
    orientation_errors_deg,
    run_vertex_errors,
    translation_errors_mm,
    vertex_errors_mm,
)
from gmrdata.values.skinning import motion_vertices_m
from gmrdata.values.transforms import angles_rad, rigid
from tests.motions import moved

STILL = np.eye(3)[None]
NOWHERE_M = np.zeros((1, 3))


def ome_deg(*rotmats: np.ndarray) -> float:
    """Eq. 15."""
    return float(orientation_errors_deg(*rotmats).mean())


def tme_mm(*metres: np.ndarray) -> float:
    """Eq. 16."""
    return float(translation_errors_mm(*metres).mean())


def vme_mm(*arrays: np.ndarray) -> float:
    """Eq. 17."""
    return float(vertex_errors_mm(*arrays).mean())


def yaw(degrees: float, n: int = 1) -> np.ndarray:
    """n rotations about the body's own up axis, y."""
    return np.tile(Rotation.from_euler("y", degrees, degrees=True).as_matrix(), (n, 1, 1))


def test_one_degree_of_yaw_per_frame():
    assert ome_deg(yaw(1.0, 5), yaw(0.0, 5)) == pytest.approx(1.0, abs=1e-12)
    assert ome_deg(yaw(-1.0, 5), yaw(1.0, 5)) == pytest.approx(2.0, abs=1e-12)
    # The mean over motions, not their sum: (1 + 0 + 5) / 3.
    assert ome_deg(np.concatenate([yaw(1), yaw(0), yaw(5)]), yaw(0, 3)) == pytest.approx(2.0)


@pytest.mark.parametrize("degrees", [0.0, 1e-6, 1e-3, 90.0, 179.999, 180.0])
def test_angles_are_exact_from_0_to_180(degrees):
    assert ome_deg(yaw(degrees), yaw(0.0)) == pytest.approx(degrees, abs=1e-9)


def test_ten_millimetres():
    """The length of the difference (6, 0, 8) mm, and a mean of lengths over motions."""
    true_m = np.array([[0.1, 0.2, 0.3], [0.0, 0.0, 0.0]])
    off_m = true_m + np.array([[0.006, 0.0, 0.008], [0.0, 0.0, 0.0]])
    assert tme_mm(off_m, true_m) == pytest.approx(5.0, abs=1e-10)
    assert tme_mm(off_m[:1], true_m[:1]) == pytest.approx(10.0, abs=1e-10)


def test_a_vertex_at_a_known_radius():
    """Turned by 1 deg, a vertex 1 m off the axis moves 2 sin(0.5 deg) m, one on it nothing."""
    vertices_m = np.array([[[1.0, 0.7, 0.0], [0.0, 3.0, 0.0]]])
    chord_mm = 2000 * np.sin(np.deg2rad(0.5))
    found = vme_mm(yaw(1.0), NOWHERE_M, STILL, NOWHERE_M, vertices_m)
    assert found == pytest.approx(chord_mm / 2, abs=1e-10)
    lifted_m = np.array([[0.0, 0.01, 0.0]])
    found = vme_mm(yaw(1.0), lifted_m, STILL, NOWHERE_M, vertices_m)
    assert found == pytest.approx((np.hypot(chord_mm, 10) + 10) / 2, abs=1e-10)


def test_vertices_of_a_predicted_local_pose_count():
    """Eq. 17 compares whole meshes: with equal motions, only the local pose's error is left."""
    true_vertices_m = np.zeros((1, 4, 3))
    predicted_vertices_m = true_vertices_m + np.array([0.0, 0.03, 0.04])
    turned = yaw(30.0)
    found = vme_mm(turned, NOWHERE_M, turned, NOWHERE_M, true_vertices_m, predicted_vertices_m)
    assert found == pytest.approx(50.0, abs=1e-10)


seeds = st.integers(0, 2**31 - 1)


@given(seeds)
def test_they_are_the_papers_formulas(seed):
    """Against the equations as loops, with scipy's log map."""
    rng = np.random.default_rng(seed)
    n, v = 4, 6
    predicted = Rotation.from_rotvec(rng.normal(0, 1, (n, 3)))
    true = Rotation.from_rotvec(rng.normal(0, 1, (n, 3)))
    predicted_m, true_m = rng.normal(0, 1, (2, n, 3))
    predicted_v_m, true_v_m = rng.normal(0, 1, (2, n, v, 3))
    angle = np.mean([(true[i] * predicted[i].inv()).magnitude() for i in range(n)])
    length = np.mean([np.sqrt(((predicted_m[i] - true_m[i]) ** 2).sum()) for i in range(n)])
    vertex = np.mean(
        [
            np.linalg.norm(
                predicted[i].apply(predicted_v_m[i, j])
                + predicted_m[i]
                - true[i].apply(true_v_m[i, j])
                - true_m[i]
            )
            for i in range(n)
            for j in range(v)
        ]
    )
    rotmats, true_rotmats = predicted.as_matrix(), true.as_matrix()
    assert ome_deg(rotmats, true_rotmats) == pytest.approx(np.rad2deg(angle), rel=1e-10)
    assert tme_mm(predicted_m, true_m) == pytest.approx(1000 * length, rel=1e-12)
    found = vme_mm(rotmats, predicted_m, true_rotmats, true_m, true_v_m, predicted_v_m)
    assert found == pytest.approx(1000 * vertex, rel=1e-10)


@given(seeds)
def test_vme_of_a_pure_translation_is_tme(seed):
    rng = np.random.default_rng(seed)
    rotmats = Rotation.random(3, random_state=seed).as_matrix()
    predicted_m, true_m = rng.normal(0, 1, (2, 3, 3))
    vertices_m = rng.normal(0, 1, (3, 5, 3))
    found = vertex_errors_mm(rotmats, predicted_m, rotmats, true_m, vertices_m)
    np.testing.assert_allclose(found, 1000 * np.linalg.norm(predicted_m - true_m, axis=1))


def test_angles_keep_the_batch_shape():
    rotation = Rotation.random(6, random_state=0)
    found = angles_rad(rotation.as_matrix().reshape(2, 3, 3, 3))
    np.testing.assert_allclose(found, rotation.magnitude().reshape(2, 3), rtol=1e-12)


@pytest.fixture(scope="module")
def walk(small_body) -> Motion:
    (motion,) = embedded_motions(
        small_body, np.random.default_rng(0), count=1, fps_hz=10.0, duration_s=2.0
    )
    return motion


def test_an_error_per_step_adds_up(walk, small_body, monkeypatch):
    """10 mm too far up in each of 19 steps: VME 10 mm, and 10 mm per frame over time."""
    monkeypatch.setattr(vertices, "CHUNK_BYTES", len(small_body.template_m) * 24 * 8 * 7)
    n = walk.n_frames
    lifted = replace(walk, pelvis_m=walk.pelvis_m + 0.01 * np.arange(n)[:, None] * [0, 0, 1.0])
    found = run_vertex_errors(small_body, walk, {"predicted": lifted})["predicted"]
    np.testing.assert_allclose(found.vme_mm, 10.0, atol=1e-8)
    np.testing.assert_allclose(found.over_time_mm, 10.0 * np.arange(n), atol=1e-8)


def test_the_predictions_world_does_not_matter(walk, small_body):
    turn = Rotation.from_euler("xyz", [20, 30, 200], degrees=True).as_matrix()
    elsewhere = moved(walk, rigid(turn, np.full(3, 5.0)))
    found = run_vertex_errors(small_body, walk, {"predicted": elsewhere})["predicted"]
    np.testing.assert_allclose(found.vme_mm, 0, atol=1e-8)
    np.testing.assert_allclose(found.over_time_mm, 0, atol=1e-8)


def test_over_time_is_the_distance_of_the_accumulated_meshes(walk, small_body):
    """Against meshes of the body model, of motions accumulated by eqs. 3-4, own pose included."""
    rng = np.random.default_rng(1)
    delta_rotmats, delta_m = deltas(walk.root_rotmats, walk.pelvis_m)
    noise = Rotation.from_rotvec(rng.normal(0, 0.02, (len(delta_m), 3))).as_matrix()
    delta_rotmats, delta_m = delta_rotmats @ noise, delta_m + rng.normal(0, 0.01, delta_m.shape)
    bent = walk.local_rotmats @ Rotation.from_rotvec(
        rng.normal(0, 0.05, (walk.n_frames * 23, 3))
    ).as_matrix().reshape(walk.local_rotmats.shape)
    elsewhere = accumulate(delta_rotmats, delta_m, np.eye(3), np.zeros(3))
    predicted = replace(
        walk,
        local_rotmats=bent,
        shape=walk.shape + 0.3,
        root_rotmats=elsewhere[0],
        pelvis_m=elsewhere[1],
    )
    found = run_vertex_errors(small_body, walk, {"predicted": predicted})["predicted"]
    roots, places_m = accumulate(delta_rotmats, delta_m, walk.root_rotmats[0], walk.pelvis_m[0])
    there = replace(predicted, root_rotmats=roots, pelvis_m=places_m)
    offsets_m = motion_vertices_m(small_body, there) - motion_vertices_m(small_body, walk)
    expected_mm = 1000 * np.linalg.norm(offsets_m, axis=-1).mean(-1)
    np.testing.assert_allclose(found.over_time_mm, expected_mm, rtol=1e-3)
    assert found.over_time_mm[0] > 1  # of the local pose alone


def test_zero_motion_stays_at_the_first_pose(walk):
    still = still_motion(walk, walk)
    np.testing.assert_array_equal(still.root_rotmats, np.tile(walk.root_rotmats[0], (20, 1, 1)))
    np.testing.assert_array_equal(still.pelvis_m, np.tile(walk.pelvis_m[0], (20, 1)))
    assert still.local_rotmats is walk.local_rotmats
