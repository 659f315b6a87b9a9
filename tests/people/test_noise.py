"""Measured errors: what is measured comes back, in the place and at the time where it was."""

import numpy as np
import pytest
import torch

from gmrdata.people.landmark_body import MIRRORED_LANDMARKS
from gmrdata.people.noise import (
    NOISE_FILE,
    LandmarkNoise,
    NoiseSampler,
    SeenTruth,
    from_hips,
    measure_noise,
)
from gmrdata.people.views import views_of
from gmrdata.values.errors import BadRecord


def people(n: int, seed: int) -> np.ndarray:
    """(n, 33, 3) points about a person who goes to the right, 4 m before the camera."""
    rng = np.random.default_rng(seed)
    shape_m = rng.normal(0, 0.4, (33, 3))
    shape_m = shape_m + shape_m[list(MIRRORED_LANDMARKS)] * [-1, 1, 1]
    return shape_m + np.linspace([-1, 0, 4], [1, 0, 4], n)[:, None]


def seen_with(image: float, world_m: float) -> SeenTruth:
    """A person whom the network sees with one error everywhere: in the person's size, and [m]."""
    true_m = torch.as_tensor(people(40, 0))
    view = views_of(true_m[..., :2] / true_m[..., 2:])
    points = (
        torch.cat(
            [(view.points + image) * view.sizes[:, None, None], torch.ones(40, 33, 1)], dim=-1
        )
        @ view.cam_from_ray.mT
    )
    along = from_hips(true_m @ view.cam_from_ray)
    return SeenTruth(
        runs=np.repeat([0, 1], 20),
        true_m=true_m.numpy(),
        facing=np.tile([0.0, 0.0, -1.0], (40, 1)),
        rays=(points[..., :2] / points[..., 2:]).numpy(),
        world_m=along.numpy() + world_m,
        visibility=np.full((40, 33), 0.7),
    )


def test_errors_in_the_picture_are_measured() -> None:
    noise = measure_noise(seen_with(0.05, 0.0), 15.0)
    np.testing.assert_allclose(noise.image, 0.05, atol=1e-6)
    assert np.abs(noise.world_m).max() < 0.02  # drawn a little towards no error


def test_what_was_measured_is_added() -> None:
    """The error that all frames have is on every window, at the person's size there."""
    sampler = NoiseSampler(measure_noise(seen_with(0.05, 0.0), 15.0), 9, 24.0)
    true_m = torch.as_tensor(people(9, 0), dtype=torch.float32)[None]
    facing = torch.tensor([0.0, 0.0, -1.0]).expand(1, 9, 3)
    found = sampler.add(true_m, facing, np.random.default_rng(0))
    wanted = views_of(true_m[..., :2] / true_m[..., 2:])
    off = views_of(found.rays).sizes / wanted.sizes
    assert found.rays.shape == (1, 9, 33, 2) and off.std() < 0.05
    np.testing.assert_allclose(found.visibility.numpy(), 0.7, atol=1e-6)


def test_no_window_spans_two_runs() -> None:
    noise = measure_noise(seen_with(0.0, 0.0), 15.0)
    with pytest.raises(ValueError, match="no run of measured errors is as long"):
        NoiseSampler(noise, 40, 24.0)


def test_the_errors_that_travel_are_whole() -> None:
    noise = LandmarkNoise.read(NOISE_FILE)
    assert len(noise.runs) > 300 and np.isfinite(noise.world_m).all()
    assert 0.03 < np.abs(noise.world_m).mean() < 0.15
    NoiseSampler(noise, 27, 24.0)


def test_a_file_without_an_array_is_refused(tmp_path) -> None:
    np.savez(tmp_path / "noise.npz", format="gmrdata-landmark-noise/1", rate_hz=15.0)
    with pytest.raises(BadRecord, match=r"noise\.npz: has no array"):
        LandmarkNoise.read(tmp_path / "noise.npz")
