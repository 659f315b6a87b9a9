"""What the lifter sees does not hang on where in the picture, how far, and through which lens."""

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from gmrdata.people.lifter import turns_to, views_of, window_features


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
