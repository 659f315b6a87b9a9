"""Making a lifter: examples that are right, a step that helps, and who is left out."""

from pathlib import Path

import numpy as np
import pytest
import torch

from gmrdata.cli import main
from gmrdata.motion.gait import make_gait
from gmrdata.people.examples import ExampleSampler, SpoilConfig, bank_of
from gmrdata.people.landmark_body import tree_joints
from gmrdata.people.lifter import WINDOW, LifterConfig, load_lifter
from gmrdata.people.noise import NOISE_FILE, LandmarkNoise
from gmrdata.people.training import (
    LIFTER_FILE,
    LifterRecord,
    TrainingConfig,
    train,
    train_lifter,
)
from gmrdata.people.views import N_FEATURES, SEEN
from gmrdata.read.bodies import anny_file
from gmrdata.values.body import BodyModel, leg_length_m
from gmrdata.values.clip import Clip
from gmrdata.values.errors import MissingInput
from gmrdata.values.motion import Motion
from tests.clip_manifests import write_clips

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
    assert np.corrcoef(*(d.numpy() for d in drop))[0, 1] > 0.3
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


def test_a_recipe_makes_one(anny: BodyModel, tmp_path: Path) -> None:
    clip = Clip("a", gait(anny, 0), np.ones(90, bool), np.full(90, -1), None)
    manifest = write_clips(tmp_path, anny, [clip])
    recipe = tmp_path / "tiny.yaml"
    network = "network: {hidden: 16, blocks: 1}"
    recipe.write_text(f"recipe: lifter\n{network}\nsteps: 2\nbatch_size: 4\n")
    out = tmp_path / "out"
    main(["run", str(recipe), "--manifest", str(manifest), "--out", str(out)])
    assert load_lifter(out / LIFTER_FILE)(torch.zeros(1, WINDOW, N_FEATURES))[1].shape == (1,)


def test_held_out_subjects_and_trials_are_left_out(anny: BodyModel, tmp_path: Path) -> None:
    clips = [
        Clip(name, gait(anny, n), np.ones(90, bool), np.full(90, -1), None)
        for n, name in enumerate(("02_01", "03_01", "05_12"))
    ]
    manifest = write_clips(tmp_path, anny, clips, dataset="CMU")
    config = TINY.model_copy(update={"held_out_trials": ("05_12",)})
    made = train_lifter(manifest, anny_file(), tmp_path / "lifter", config)
    record = LifterRecord.read(made.with_name("lifter.json"))
    assert record.motions == 1 and record.held_out == ("02_01", "05_12")
    nobody = config.model_copy(update={"held_out_subjects": (2, 3, 5)})
    with pytest.raises(MissingInput, match="no motion is left to train on"):
        train_lifter(manifest, anny_file(), tmp_path / "other", nobody)
