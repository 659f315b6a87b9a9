"""Making a lifter: examples that are right, a step that helps, and who is left out.

A try of `training/` and no measurement: what ships is not made anew.
"""

from pathlib import Path

import numpy as np
import pytest
import torch
from training.examples import ExampleSampler, SpoilConfig, bank_of
from training.learning import (
    RECIPE_FILE,
    LifterRecipe,
    LifterRecord,
    TrainingConfig,
    train,
    train_lifter,
)
from training.noise import NOISE_FILE, LandmarkNoise, NoiseSampler, SeenTruth, measure_noise

from gmrdata.motion.gait import make_gait
from gmrdata.people.landmark_network import MIRRORED_LANDMARKS, from_hips, tree_joints
from gmrdata.people.lifter import N_FEATURES, SEEN, WINDOW, LifterConfig, load_lifter, views_of
from gmrdata.read.bodies import ANNY_FILE
from gmrdata.stage.recipes import load_recipe
from gmrdata.values.body import BodyModel, leg_length_m
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadRecord, MissingInput
from gmrdata.values.motion import Motion
from tests.clip_manifests import write_clips

pytestmark = pytest.mark.bench
TINY = TrainingConfig(network=LifterConfig(hidden=16, blocks=1), steps=2, batch_size=4)


def gait(body: BodyModel, seed: int) -> Motion:
    return make_gait("walk", 3.0, 30.0, body, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def sampler(anny: BodyModel) -> ExampleSampler:
    noise = LandmarkNoise.read(NOISE_FILE)
    return ExampleSampler(bank_of([gait(anny, 0), gait(anny, 1)]), anny, noise, SpoilConfig())


def test_an_example_is_what_its_pose_looks_like(sampler: ExampleSampler) -> None:
    """Knees in the picture lie about where the pose has them: the noise is some centimetres."""
    example = sampler.sample(64, np.random.default_rng(0))
    assert example.features.shape == (64, WINDOW, N_FEATURES)
    assert torch.isfinite(example.features).all()
    joints_m, _ = tree_joints(example.rest_joints_m, example.rotmats)
    middle = example.features[:, WINDOW // 2, : 6 * len(SEEN)].unflatten(-1, (len(SEEN), 6))
    knees = [SEEN.index(25), SEEN.index(26)]
    drop = (
        middle[:, knees, 1].mean(1),
        joints_m[:, [4, 5], 1].mean(1) - joints_m[:, [1, 2], 1].mean(1),
    )
    assert np.corrcoef(drop[0].numpy(), drop[1].numpy())[0, 1] > 0.3
    # Who faces the camera has the left at the right of the picture.
    left = middle[:, SEEN.index(23), 0] - middle[:, SEEN.index(24), 0]
    true = joints_m[:, 1, 0] - joints_m[:, 2, 0]
    assert (torch.sign(left) == torch.sign(true))[true.abs() > 0.05].float().mean() > 0.8
    mean_m = example.leg_m.mean()
    lengths_m = [leg_length_m(one.numpy()) for one in example.rest_joints_m[:4]]
    np.testing.assert_allclose(example.leg_m[:4], lengths_m, rtol=1e-4)
    assert 0.7 < mean_m < 0.95


def test_training_learns_and_is_the_same_again(sampler: ExampleSampler) -> None:
    config = TINY.model_copy(update={"steps": 20, "batch_size": 4, "warmup_steps": 1})
    said: list[float] = []
    first, _ = train(sampler, config, lambda step, losses: said.append(losses["loss"]))
    again, _ = train(sampler, config, lambda step, losses: None)
    for one, two in zip(first.parameters(), again.parameters(), strict=True):
        assert torch.equal(one, two)
    assert said and np.isfinite(said).all()


def test_the_recipe_that_made_the_weights_loads() -> None:
    config = load_recipe(RECIPE_FILE, LifterRecipe).config()
    assert config.steps == 1500 and config.held_out_subjects == (2, 8)


def test_held_out_subjects_and_trials_are_left_out(anny: BodyModel, tmp_path: Path) -> None:
    clips = [
        Clip(name, gait(anny, n), np.ones(90, bool), np.full(90, -1), None)
        for n, name in enumerate(("02_01", "03_01", "05_12"))
    ]
    manifest = write_clips(tmp_path, anny, clips, dataset="CMU")
    config = TINY.model_copy(update={"held_out_trials": ("05_12",)})
    made = train_lifter(manifest, ANNY_FILE, tmp_path / "lifter", config)
    record = LifterRecord.read(made.with_name("lifter.json"))
    assert record.motions == 1 and record.held_out == ("02_01", "05_12")
    assert load_lifter(made)(torch.zeros(1, WINDOW, N_FEATURES))[1].shape == (1,)
    nobody = config.model_copy(update={"held_out_subjects": (2, 3, 5)})
    with pytest.raises(MissingInput, match="no motion is left to train on"):
        train_lifter(manifest, ANNY_FILE, tmp_path / "other", nobody)


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


def test_a_file_without_an_array_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "noise.npz", format="gmrdata-landmark-noise/1", rate_hz=15.0)
    with pytest.raises(BadRecord, match=r"noise\.npz: has no array"):
        LandmarkNoise.read(tmp_path / "noise.npz")
