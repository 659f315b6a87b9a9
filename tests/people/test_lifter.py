"""The lifter's file, how it sees and reads a track, and the fit of a body to landmarks."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from gmrdata.people.fit import FitConfig, fit
from gmrdata.people.lifter import (
    N_FEATURES,
    RATE_HZ,
    WEIGHTS_FILE,
    WINDOW,
    LiftedPose,
    Lifter,
    LifterConfig,
    lift,
    load_lifter,
    save_lifter,
    turns_to,
    views_of,
    window_features,
)
from gmrdata.values.body import BodyModel, leg_length_m
from gmrdata.values.errors import BadCheckpoint
from gmrdata.values.motion import Motion
from tests.people.exact import aligned_mm, seen_exactly, some_of

SMALL = LifterConfig(hidden=16, blocks=1)


def test_the_shipped_weights_are_small() -> None:
    assert WEIGHTS_FILE.stat().st_size <= 5_000_000


def test_exact_landmarks_give_about_the_pose(walk: Motion, anny: BodyModel) -> None:
    """It expects the network's errors, so it is no better than some centimetres without them."""
    found = lift(seen_exactly(walk, anny))
    assert aligned_mm(walk, anny, found.rotmats) < MOST_MM
    np.testing.assert_allclose(np.linalg.det(found.rotmats), 1, atol=1e-4)
    assert 0.6 < found.leg_m.mean() < 1.05


MOST_MM = 70.0


def test_left_is_left(walk: Motion, anny: BodyModel) -> None:
    """The mirrored walk, seen as somebody who walks the other way, is not the walk."""
    seen = seen_exactly(walk, anny)
    found = lift(seen)
    cosines = np.einsum("tij,tij->t", found.rotmats[:, 0], walk.root_rotmats)
    angles_deg = np.rad2deg(np.arccos(((cosines - 1) / 2).clip(-1, 1)))
    assert np.median(angles_deg) < 25


def test_a_part_of_a_track_has_the_same_poses_away_from_its_ends(
    walk: Motion, anny: BodyModel
) -> None:
    seen = seen_exactly(walk, anny)
    whole, part = lift(seen), lift(some_of(seen, slice(2, None)))
    far = int(WINDOW / RATE_HZ * walk.fps_hz / 2) + 2
    np.testing.assert_allclose(part.rotmats[far:-1], whole.rotmats[far + 2 : -1], atol=1e-5)


def test_a_single_frame_has_a_pose(walk: Motion, anny: BodyModel) -> None:
    found = lift(some_of(seen_exactly(walk, anny), slice(4, 5)))
    assert found.rotmats.shape == (1, 24, 3, 3) and np.isfinite(found.rotmats).all()


def test_what_is_before_a_long_gap_does_not_matter(walk: Motion, anny: BodyModel) -> None:
    seen = seen_exactly(walk, anny)
    late = replace(seen, times_s=seen.times_s + np.where(np.arange(walk.n_frames) >= 10, 5.0, 0))
    other = replace(
        late, rays=np.where(np.arange(walk.n_frames)[:, None, None] < 10, 0.3, late.rays)
    )
    np.testing.assert_allclose(lift(late).rotmats[12:], lift(other).rotmats[12:], atol=1e-6)


def test_weights_come_back(tmp_path: Path) -> None:
    torch.manual_seed(0)
    lifter = Lifter(SMALL).eval()
    save_lifter(tmp_path / "my.safetensors", lifter, SMALL)
    again = load_lifter(tmp_path / "my.safetensors")
    windows = torch.randn(2, WINDOW, N_FEATURES)
    for one, two in zip(lifter(windows), again(windows), strict=True):
        np.testing.assert_allclose(one.detach(), two.detach(), atol=2e-2)


@pytest.mark.parametrize("content", [b"", b"<html>404</html>" * 9])
def test_a_broken_file_is_told(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "my.safetensors"
    path.write_bytes(content)
    with pytest.raises(BadCheckpoint, match=r"my\.safetensors: not a lifter"):
        load_lifter(path)


def test_other_weights_are_told(tmp_path: Path) -> None:
    from safetensors.torch import save_file

    save_file({"layer": torch.zeros(2)}, tmp_path / "my.safetensors")
    with pytest.raises(BadCheckpoint, match=r"my\.safetensors: not a lifter"):
        load_lifter(tmp_path / "my.safetensors")


def cloud(seed: int) -> torch.Tensor:
    """(27, 33, 3) points about a person, 4 m before the camera."""
    rng = np.random.default_rng(seed)
    return torch.as_tensor(rng.normal(0, 0.4, (27, 33, 3)) + np.array([0.0, 0.0, 4.0]))


def rays_of(points_m: torch.Tensor) -> torch.Tensor:
    return points_m[..., :2] / points_m[..., 2:]


def test_turns_take_the_axis_to_the_ray() -> None:
    rays = torch.tensor([[0.0, 0.0], [0.4, -0.2], [-1.0, 2.0]], dtype=torch.float64)
    turns = turns_to(rays)
    np.testing.assert_allclose(rays_of(turns[..., 2]).numpy(), rays.numpy(), atol=1e-12)
    np.testing.assert_allclose(
        (turns @ turns.mT).numpy(), np.tile(np.eye(3), (3, 1, 1)), atol=1e-12
    )


def test_a_camera_that_looks_up_or_down_sees_the_same() -> None:
    points_m = cloud(0)
    points_m[:, [23, 24]] = torch.tensor([[0.1, 0.05, 4.0], [-0.1, 0.05, 4.0]]).double()
    turned_m = points_m @ torch.as_tensor(Rotation.from_euler("x", 0.3).as_matrix()).T
    one, other = views_of(rays_of(points_m)), views_of(rays_of(turned_m))
    np.testing.assert_allclose(other.points.numpy(), one.points.numpy(), atol=1e-3)
    np.testing.assert_allclose(other.sizes.numpy(), one.sizes.numpy(), rtol=1e-3)


def test_a_person_twice_as_large_and_far_looks_the_same() -> None:
    points_m = cloud(1)
    one, two = views_of(rays_of(points_m)), views_of(rays_of(2 * points_m))
    np.testing.assert_allclose(two.points.numpy(), one.points.numpy(), atol=1e-12)


def test_frames_that_are_not_known_are_empty() -> None:
    rays = rays_of(cloud(2)).float()[None]
    known = torch.ones(1, 27)
    known[0, :5] = 0
    features, cam_from_ray = window_features(
        rays, torch.zeros(1, 27, 33, 3), torch.ones(1, 27, 33), known
    )
    assert not features[0, :5].any() and features[0, 5:, -1].all()
    assert cam_from_ray.shape == (1, 3, 3)


STEPS = FitConfig(steps=60)
N = 8


def some(motion: Motion) -> Motion:
    return motion.take(slice(0, N))


def test_exact_landmarks_give_the_pose_and_the_place(walk: Motion, anny: BodyModel) -> None:
    rest_joints_m = anny.rest_joints_m(walk.shape)
    found = fit(some_of(seen_exactly(walk, anny), slice(0, N)), rest_joints_m, STEPS)
    assert aligned_mm(some(walk), anny, found.rotmats) < 45
    depth = found.pelvis_m[:, 2] / walk.pelvis_m[:N, 2]
    # A person of unknown size: what is not as large stands nearer.
    size = found.leg_m / leg_length_m(rest_joints_m)
    np.testing.assert_allclose(depth / size, 1, atol=0.03)
    np.testing.assert_allclose(np.linalg.det(found.rotmats), 1, atol=1e-5)


def test_from_the_true_poses_it_stays_there(walk: Motion, anny: BodyModel) -> None:
    rest_joints_m = anny.rest_joints_m(walk.shape)
    start = LiftedPose(walk.rotmats[:N], np.full(N, leg_length_m(rest_joints_m)))
    seen = some_of(seen_exactly(walk, anny), slice(0, N))
    found = fit(seen, rest_joints_m, FitConfig(steps_from_start=20), start)
    assert aligned_mm(some(walk), anny, found.rotmats) < 12


def test_a_frame_of_wild_landmarks_is_bridged(walk: Motion, anny: BodyModel) -> None:
    rest_joints_m = anny.rest_joints_m(walk.shape)
    seen = some_of(seen_exactly(walk, anny), slice(0, N))
    world_m, rays = seen.world_m.copy(), seen.rays.copy()
    rng = np.random.default_rng(0)
    world_m[5, :23] += rng.normal(0, 0.5, (23, 3))
    rays[5, :23] += rng.normal(0, 0.1, (23, 2))
    start = LiftedPose(walk.rotmats[:N], np.full(N, leg_length_m(rest_joints_m)))
    wild = fit(
        replace(seen, world_m=world_m, rays=rays),
        rest_joints_m,
        FitConfig(steps_from_start=20),
        start,
    )
    assert aligned_mm(some(walk), anny, wild.rotmats) < 20


def test_two_frames_are_enough(walk: Motion, anny: BodyModel) -> None:
    seen = some_of(seen_exactly(walk, anny), slice(0, 2))
    found = fit(seen, anny.rest_joints_m(walk.shape), FitConfig(steps=5))
    assert np.isfinite(found.pelvis_m).all() and found.rotmats.shape == (2, 24, 3, 3)
