"""Similarity fits and mean rotations, with evo as an oracle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.values.transforms import fit_similarity, mean_rotation

seeds = st.integers(0, 2**31 - 1)


@given(seeds, st.floats(0.05, 20))
def test_a_similarity_is_found_exactly(seed, scale):
    rng = np.random.default_rng(seed)
    points_b_m = rng.normal(0, 1, (10, 3))
    rotmat = Rotation.random(random_state=seed).as_matrix()
    translation_m = rng.normal(0, 5, 3)
    found = fit_similarity(scale * points_b_m @ rotmat.T + translation_m, points_b_m, scale=True)
    assert found.scale == pytest.approx(scale, rel=1e-9)
    np.testing.assert_allclose(found.rotmat, rotmat, atol=1e-9)
    np.testing.assert_allclose(found.translation_m, translation_m, atol=1e-8)
    np.testing.assert_allclose(
        found.apply(points_b_m), scale * points_b_m @ rotmat.T + translation_m, atol=1e-9
    )


@given(seeds, st.booleans())
def test_noisy_fits_are_evos(seed, scale):
    geometry = pytest.importorskip("evo.core.geometry")
    rng = np.random.default_rng(seed)
    points_a_m, points_b_m = rng.normal(0, 1, (2, 12, 3))
    found = fit_similarity(points_a_m, points_b_m, scale=scale)
    rotmat, translation_m, factor = geometry.umeyama_alignment(points_b_m.T, points_a_m.T, scale)
    assert found.scale == pytest.approx(factor, rel=1e-9)
    np.testing.assert_allclose(found.rotmat, rotmat, atol=1e-8)
    np.testing.assert_allclose(found.translation_m, translation_m, atol=1e-8)


def test_reflected_points_still_get_a_rotation():
    points_m = np.random.default_rng(3).normal(0, 1, (20, 3))
    found = fit_similarity(points_m * [1, 1, -1], points_m, scale=False)
    assert np.linalg.det(found.rotmat) == pytest.approx(1.0)


def test_points_in_a_plane_are_enough():
    points_m = np.random.default_rng(3).normal(0, 1, (20, 3)) * [1, 1, 0]
    turn = Rotation.from_euler("xyz", [0.3, -1.0, 2.0]).as_matrix()
    found = fit_similarity(2.5 * points_m @ turn.T, points_m, scale=True)
    np.testing.assert_allclose(found.rotmat, turn, atol=1e-10)
    assert found.scale == pytest.approx(2.5)


@given(seeds)
def test_the_chordal_mean_is_scipys(seed):
    """Scipy's mean of rotations minimises the same distance."""
    centre = Rotation.random(random_state=seed)
    noise = Rotation.from_rotvec(np.random.default_rng(seed).normal(0, 0.3, (9, 3)))
    rotations = centre * noise
    np.testing.assert_allclose(
        mean_rotation(rotations.as_matrix()), rotations.mean().as_matrix(), atol=1e-9
    )
