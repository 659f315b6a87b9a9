"""Rigid transforms against scipy's; similarities and mean rotations, with evo as an oracle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.values import transforms
from gmrdata.values.transforms import fit_similarity, mean_rotation

seeds = st.integers(0, 2**32 - 1)


def random_rigid(seed: int, n: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return transforms.rigid(
        Rotation.random(n, random_state=rng).as_matrix(), rng.normal(0, 10, (n, 3))
    )


@given(seeds)
def test_inverse(seed):
    a_from_b = random_rigid(seed, 5)
    identity = np.broadcast_to(np.eye(4), (5, 4, 4))
    np.testing.assert_allclose(transforms.invert(a_from_b) @ a_from_b, identity, atol=1e-12)
    np.testing.assert_allclose(a_from_b @ transforms.invert(a_from_b), identity, atol=1e-12)
    np.testing.assert_allclose(transforms.invert(a_from_b), np.linalg.inv(a_from_b), atol=1e-12)


@given(seeds)
def test_apply_of_a_product_is_apply_twice(seed):
    a_from_b, b_from_c = random_rigid(seed, 4), random_rigid(seed // 2 + 1, 4)
    points_c = np.random.default_rng(seed).normal(0, 5, (4, 7, 3))
    np.testing.assert_allclose(
        transforms.apply(a_from_b @ b_from_c, points_c),
        transforms.apply(a_from_b, transforms.apply(b_from_c, points_c)),
        atol=1e-11,
    )


@given(seeds)
def test_agrees_with_scipy(seed):
    scipy_transform = pytest.importorskip("scipy.spatial.transform")
    if not hasattr(scipy_transform, "RigidTransform"):
        pytest.skip("RigidTransform came with scipy 1.16")
    a_from_b, b_from_c = random_rigid(seed, 3), random_rigid(seed // 3 + 7, 3)
    points_b = np.random.default_rng(seed).normal(0, 5, (3, 3))
    oracle = scipy_transform.RigidTransform.from_matrix(a_from_b)
    other = scipy_transform.RigidTransform.from_matrix(b_from_c)
    np.testing.assert_allclose(
        transforms.apply(a_from_b, points_b[:, None])[:, 0], oracle.apply(points_b), atol=1e-11
    )
    np.testing.assert_allclose(transforms.invert(a_from_b), oracle.inv().as_matrix(), atol=1e-11)
    np.testing.assert_allclose(a_from_b @ b_from_c, (oracle * other).as_matrix(), atol=1e-11)


def test_rigid_broadcasts_one_rotation_over_many_translations():
    translations = np.arange(6.0).reshape(2, 3)
    a_from_b = transforms.rigid(np.eye(3), translations)
    assert a_from_b.shape == (2, 4, 4)
    np.testing.assert_array_equal(a_from_b[:, :3, 3], translations)
    np.testing.assert_array_equal(a_from_b[:, 3], [[0, 0, 0, 1]] * 2)


@pytest.mark.parametrize("axes", ["XYZ", "ZXY", "YX", "X", "xyz", "zyx", "yz", "z"])
def test_angles_about_axes_are_scipys(axes):
    angles_deg = np.random.default_rng(0).uniform(-400, 400, (5, 40, len(axes)))
    angles_deg[0, :9] = np.arange(-360, 450, 90)[:, None]
    expected = Rotation.from_euler(axes, angles_deg.reshape(-1, len(axes)), degrees=True)
    found = transforms.euler_rotmats(axes, angles_deg)
    assert found.shape == (5, 40, 3, 3)
    np.testing.assert_allclose(found.reshape(-1, 3, 3), expected.as_matrix(), rtol=0, atol=2e-15)


def test_between_is_two_products():
    rng = np.random.default_rng(0)
    left, right, rotmats = (
        rng.normal(size=(3, 3)),
        rng.normal(size=(3, 3)),
        rng.normal(size=(4, 5, 3, 3)),
    )
    np.testing.assert_allclose(
        transforms.between(left, rotmats[:, 2], right), left @ rotmats[:, 2] @ right, atol=1e-14
    )
    np.testing.assert_allclose(
        transforms.between(left, rotmats, right), left @ rotmats @ right, atol=1e-14
    )


def test_angles_of_any_length_are_exact_at_0_and_180_degrees():
    x, y = np.eye(3)[:2]
    others = np.stack([2.0 * x, 3.0 * y, -x, x + y, 1e-9 * y + x])
    found = transforms.angles_deg(5.0 * x, others)
    assert np.allclose(found, [0.0, 90.0, 180.0, 45.0, np.rad2deg(1e-9)], rtol=1e-12, atol=0.0)


@pytest.mark.parametrize(
    ("a", "b"), [((1, 0, 0), (0, 2, 0)), ((1, 2, 3), (-1, -2, -3)), ((0, 1, 0), (0, 5, 0))]
)
def test_smallest_rotation(a, b):
    a, b = np.array(a, dtype=float), np.array(b, dtype=float)
    rotation = transforms.smallest_rotation(a, b)
    np.testing.assert_allclose(rotation @ a / np.linalg.norm(a), b / np.linalg.norm(b), atol=1e-12)
    angle = np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)
    assert Rotation.from_matrix(rotation).magnitude() == pytest.approx(angle)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


@pytest.mark.parametrize("angle_rad", [0.0, 1e-9, 1e-4, 1e-3, 0.7, 3.0, np.pi, 9.0])
def test_rotations_are_scipys_to_the_last_bit(angle_rad):
    rng = np.random.default_rng(0)
    axes = np.concatenate([np.eye(3), -np.eye(3), rng.normal(size=(994, 3))])
    rotvecs = angle_rad * axes / np.linalg.norm(axes, axis=1, keepdims=True)
    expected = Rotation.from_rotvec(rotvecs)
    found = transforms.rotmats_from_rotvecs(rotvecs.reshape(2, 500, 3)).reshape(-1, 3, 3)
    np.testing.assert_array_equal(found, expected.as_matrix())
    # Read from single precision, they are rotations no more.
    for rotmats in (found, found[::-1] @ found, found.astype(np.float32)):
        expected = Rotation.from_matrix(rotmats)
        quaternions = transforms.quaternions_from_rotmats(rotmats)
        np.testing.assert_array_equal(quaternions, expected.as_quat(scalar_first=True))
        rotvecs = transforms.rotvecs_from_rotmats(rotmats)
        np.testing.assert_array_equal(rotvecs, expected.as_rotvec())
        again = transforms.rotmats_from_quaternions(quaternions)
        np.testing.assert_array_equal(again, expected.as_matrix())


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
