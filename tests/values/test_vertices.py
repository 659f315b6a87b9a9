"""Vertex errors of whole runs: per motion, and over time."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.motion.gait import embedded_motions
from gmrdata.score.predictions import still_motion
from gmrdata.values import motion_metrics as vertices
from gmrdata.values.motion import Motion, accumulate, deltas
from gmrdata.values.motion_metrics import run_vertex_errors
from gmrdata.values.skinning import motion_vertices_m
from gmrdata.values.transforms import rigid
from tests.motions import moved


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
