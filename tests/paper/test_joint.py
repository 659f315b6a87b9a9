"""The non-sequential model: it learns from features that tell, and refuses what does not fit."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from gmrdata.gmr.checkpoint import latest_checkpoint
from gmrdata.gmr.config import LossConfig, NetworkConfig
from gmrdata.gmr.flat_runs import in_memory
from gmrdata.gmr.losses import make_loss_bodies
from gmrdata.gmr.windows import Batch, TrainingSet
from gmrdata.paper.joint import (
    JointModel,
    fit_joint,
    joint_loss,
    joint_runs,
    load_features,
    load_joint,
    make_joint_batch,
    predict_joint,
    split_rows,
    training_runs,
)
from gmrdata.paper.plan import JointConfig
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, load_clip
from gmrdata.values.errors import (
    BadCheckpoint,
    BadFeatures,
    BadManifest,
    BadMotionFile,
    MissingInput,
    TrainingDiverged,
)
from gmrdata.values.files import read_json, read_npz, write_npz
from gmrdata.values.motion import deltas
from gmrdata.values.transforms import angles_rad
from tests.folders import bytes_of
from tests.motions import walking_clips

N_FEATURES = 48
SMALL = JointConfig(
    model=NetworkConfig(layers=1, hidden=48, output_scale=0.1),
    loss=LossConfig(n_vertices=16),
    frames=16,
    learning_rate=3e-3,
    batch_size=8,
    steps=150,
)


@pytest.fixture(scope="module")
def walks(small_body) -> list[Clip]:
    """Six generated people at 20 fps, 4 s each."""
    return walking_clips(small_body, [f"walk_{i}" for i in range(6)], duration_s=4.0)


def told(clip: Clip) -> np.ndarray:
    """Image features that tell everything: one fixed random map of local pose and root motion."""
    motion = clip.motion
    delta_rotmats, delta_m = deltas(motion.root_rotmats, motion.pelvis_m)
    motions = np.concatenate([delta_rotmats.reshape(-1, 9) * 10, delta_m * 10], axis=1)
    motions = np.concatenate([motions, motions[-1:]])
    numbers = np.concatenate([motion.local_rotmats.reshape(len(motions), -1), motions], axis=1)
    mapping = np.random.default_rng(99).normal(0, 1, (numbers.shape[1], N_FEATURES))
    return (numbers @ mapping).astype(np.float32)


def write_features(folder: Path, clips: list[Clip]) -> None:
    for clip in clips:
        write_npz(folder / f"{clip.id}.npz", {"features": told(clip)})


def pose_error_deg(local_rotmats: np.ndarray, true_rotmats: np.ndarray) -> float:
    """Mean angle of the local rotations."""
    return float(np.rad2deg(angles_rad(true_rotmats @ local_rotmats.swapaxes(-1, -2))).mean())


def test_it_learns(walks, small_body, write_set, body_path, tmp_path, works):
    """On people that it has not seen it beats the mean pose and zero motion by far."""
    training, held_out = walks[:5], walks[5]
    write_features(tmp_path / "features", walks)
    recipe = tmp_path / "joint.yaml"
    recipe.write_text(json.dumps(SMALL.model_dump(mode="json")))
    given = ("--features", tmp_path / "features", "--body", body_path)
    asked = ("baseline", "joint_train", write_set(tmp_path / "training", training), *given)
    said = works(*asked, "--recipe", recipe, "--out", tmp_path / "run")
    assert said.stdout.split() == [str(tmp_path / "run")]
    lines = (tmp_path / "run" / "metrics.jsonl").read_text().splitlines()
    first, last = json.loads(lines[0]), json.loads(lines[-1])
    assert (first["step"], last["step"]) == (10, 150)
    assert last["loss"] < 0.3 * first["loss"]
    assert all(last[term] < first[term] for term in ("local_pose", "translation", "vertex"))

    scored = write_set(tmp_path / "scored", [held_out])
    asked = ("baseline", "joint", tmp_path / "run", scored, *given, "--out", tmp_path / "out")
    assert works(*asked).stdout.split() == [str(tmp_path / "out")]
    (tmp_path / "run" / "notes.txt").touch()
    works(*asked)  # nothing is stale: the weights are the same
    found = load_clip(tmp_path / "out" / "predictions" / "walk_5.npz")
    assert (found.motion.fps_hz, found.motion.n_frames) == (10.0, 40)
    assert found.valid.all()
    true = held_out.motion
    # Features hold no shape; it was the truth's.
    assert true.shape.any() and not found.motion.shape.any()
    arrays = read_npz(tmp_path / "out" / "predictions" / "walk_5.npz")
    rest_m = small_body.rest_pelvis_m(np.zeros(small_body.n_shape))
    np.testing.assert_allclose(arrays["rest_pelvis_m"], rest_m)
    true_local = true.local_rotmats[::2]
    mean_pose = load_joint(tmp_path / "run").mean_pose.reshape(23, 2, 3).numpy()
    x = mean_pose[:, 0] / np.linalg.norm(mean_pose[:, 0], axis=1, keepdims=True)
    y = mean_pose[:, 1] - (x * mean_pose[:, 1]).sum(1, keepdims=True) * x
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    mean_rotmats = np.stack([x, y, np.cross(x, y)], axis=-1)
    of_mean_deg = pose_error_deg(np.broadcast_to(mean_rotmats, true_local.shape), true_local)
    assert pose_error_deg(found.motion.local_rotmats, true_local) < 0.6 * of_mean_deg
    _, true_m = deltas(true.root_rotmats[::2], true.pelvis_m[::2])
    _, delta_m = deltas(found.motion.root_rotmats, found.motion.pelvis_m)
    still_mm = 1000 * np.linalg.norm(true_m, axis=1).mean()
    assert 1000 * np.linalg.norm(delta_m - true_m, axis=1).mean() < 0.6 * still_mm


def told_runs(*clips: Clip) -> TrainingSet:
    """Runs at 10 fps of clips and of features that tell everything."""
    return training_runs([(clip, told(clip)) for clip in clips], 10.0)


def fitted(runs: TrainingSet, body: BodyModel, run_dir: Path, **changes: Any) -> JointModel:
    """A network trained in a folder by the small recipe with changes."""
    run_dir.mkdir(exist_ok=True)
    return fit_joint(runs, [body], run_dir, SMALL.model_copy(update=changes))


def test_the_same_recipe_gives_the_same_network(walks, small_body, tmp_path):
    runs = told_runs(*walks[:2])
    for name in ("one", "other"):
        fitted(runs, small_body, tmp_path / name, steps=3)
    assert bytes_of(tmp_path / "one") == bytes_of(tmp_path / "other")


def test_a_run_that_was_stopped_goes_on_bit_for_bit(walks, small_body, tmp_path, monkeypatch):
    """Stopped in step 6, it goes on from step 4, with the dropout that it would have had."""
    runs = told_runs(*walks[:2])
    model = SMALL.model.model_copy(update={"layers": 2, "dropout": 0.3})
    changes = {"model": model, "steps": 9, "log_every": 1, "checkpoint_every": 4}
    fitted(runs, small_body, tmp_path / "whole", **changes)

    def stop_in_step_6(runs: TrainingSet, config: JointConfig, step: int) -> Batch:
        if step == 6:
            raise KeyboardInterrupt
        return make_joint_batch(runs, config, step)

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr("gmrdata.paper.joint.make_joint_batch", stop_in_step_6)
        fitted(runs, small_body, tmp_path / "stopped", **changes)
    pointer = tmp_path / "stopped" / "checkpoints" / "latest"
    assert pointer.read_text() == "step_00000004\n"
    fitted(runs, small_body, tmp_path / "stopped", **changes)
    assert bytes_of(tmp_path / "stopped") == bytes_of(tmp_path / "whole")
    steps = [json.loads(line)["step"] for line in (tmp_path / "whole/metrics.jsonl").open()]
    assert steps == list(range(1, 10))


def test_what_is_read_is_what_was_written(walks, small_body, tmp_path):
    runs = told_runs(walks[0])
    model = fitted(runs, small_body, tmp_path, steps=2).eval()
    features = torch.from_numpy(split_rows(runs.frames.poses)[0][:40])[None]
    drawn = torch.random.get_rng_state()
    with torch.no_grad():
        one, other = model(features), load_joint(tmp_path)(features)
    assert torch.equal(torch.random.get_rng_state(), drawn)  # as reading a GMR leaves it
    assert torch.equal(one.local_rotmats, other.local_rotmats)
    assert torch.equal(one.motions.delta_m, other.motions.delta_m)
    folder = latest_checkpoint(tmp_path)
    assert folder is not None
    weights = folder / "model.safetensors"
    weights.write_bytes(weights.read_bytes()[:-8])
    with pytest.raises(BadCheckpoint, match=r"model.safetensors: truncated"):
        load_joint(tmp_path)
    state = json.loads((folder / "state.json").read_text())
    for broken in ({}, state | {"config": {"model": 1}}, state | {"n_features": None}):
        (folder / "state.json").write_text(json.dumps(broken))
        with pytest.raises(BadCheckpoint, match=r"state.json: .*Give a run"):
            load_joint(tmp_path)
    for key in state:
        rest = {other: value for other, value in state.items() if other != key}
        (folder / "state.json").write_text(json.dumps(rest))
        with pytest.raises(BadCheckpoint, match=rf"state.json: has no .*`{key}`"):
            load_joint(tmp_path)
    del state["config"]["model"]["output_scale"]
    (folder / "state.json").write_text(json.dumps(state))
    with pytest.raises(BadCheckpoint, match=r"has no key `config\.model\.output_scale`"):
        load_joint(tmp_path)
    with pytest.raises(MissingInput, match="no trained model there"):
        load_joint(tmp_path / "nowhere")


def test_padding_and_windows(walks, small_body):
    """A run that is shorter than a window is padded, and the padding does not count."""
    short = replace(walks[0], valid=np.arange(80) < 12)
    runs = joint_runs(short, told(short), 10.0)
    assert [len(run.poses) for run in runs] == [6, 6]
    config = SMALL.model_copy(update={"reverse_probability": 0.0})
    batch = make_joint_batch(TrainingSet(in_memory(runs), "6d"), config, step=1)
    assert batch.lengths.tolist() == [6] * 8
    assert batch.mask.sum().item() == 40
    torch.manual_seed(0)
    model = JointModel(config, N_FEATURES).eval()
    output = model(batch.poses, batch.lengths)
    cut = replace(
        batch,
        poses=batch.poses[:, :6],
        mask=batch.mask[:, :5],
        motions=type(batch.motions)(
            batch.motions.delta_rotmats[:, :5], batch.motions.delta_m[:, :5]
        ),
        local_rotmats=batch.local_rotmats[:, :6],
    )
    loss_bodies = make_loss_bodies([small_body], None, "cpu")
    for reduction in ("mean", "sum"):
        both = config.model_copy(update={"loss": LossConfig(reduction=reduction)})
        padded = joint_loss(output, batch, loss_bodies, both)
        whole = joint_loss(model(cut.poses), cut, loss_bodies, both)
        for one, other in zip(padded.items(), whole.items(), strict=True):
            assert one[0] == other[0]
            assert one[1].item() == pytest.approx(other[1].item(), rel=1e-4, abs=1e-9)


def test_a_window_played_backwards(walks):
    runs = joint_runs(replace(walks[0], valid=np.arange(80) < 12), told(walks[0]), 20.0)
    batches = [
        make_joint_batch(
            TrainingSet(in_memory(runs), "6d"),
            SMALL.model_copy(update={"reverse_probability": share}),
            1,
        )
        for share in (0.0, 1.0)
    ]
    assert torch.equal(batches[0].poses[:, :12].flip(1), batches[1].poses[:, :12])
    ahead, back = (batch.motions.delta_rotmats[:, :11] for batch in batches)
    torch.testing.assert_close(back, ahead.flip(1).transpose(-1, -2))


def test_every_run_is_a_sequence_of_its_own(
    walks, small_body, write_set, body_path, tmp_path, monkeypatch
):
    """And one frame alone is a pose; rows beside a gap are not valid at the lower rate.  A clip
    without features is left out."""
    valid = np.ones(80, bool)
    valid[[21, 25]] = False
    clip = replace(walks[0], valid=valid)
    model = fitted(told_runs(walks[1]), small_body, tmp_path / "run", steps=1)
    write_features(tmp_path / "features", [clip])
    manifest = write_set(tmp_path / "set", [clip, walks[1]])
    features, body = tmp_path / "features", {"body_path": body_path}
    predict_joint(tmp_path / "run", manifest, features, tmp_path / "out", **body)
    left_out = read_json(tmp_path / "out" / "predictions.json")["left_out"]
    assert left_out == {"walk_1": "no features/walk_1.npz"}
    with pytest.raises(BadMotionFile, match=r"clip walk_0: of body .* Give the clips' own body"):
        predict_joint(tmp_path / "run", manifest, features, tmp_path / "anny")
    found = load_clip(tmp_path / "out" / "predictions" / "walk_0.npz")
    # Row 11 at 10 fps is row 22, and row 21 between it and row 20 is not valid.
    np.testing.assert_array_equal(np.flatnonzero(~found.valid), [11, 13])
    np.testing.assert_allclose(found.motion.pelvis_m[12], found.motion.pelvis_m[10], atol=1e-9)
    np.testing.assert_allclose(found.motion.pelvis_m[14], found.motion.pelvis_m[12], atol=1e-9)
    with torch.no_grad():
        alone = model.eval()(torch.from_numpy(told(clip)[24:25])[None]).local_rotmats[0, 0]
    np.testing.assert_allclose(found.motion.local_rotmats[12], alone.numpy(), atol=1e-5)
    # The run has its name where it is called from within, too.
    monkeypatch.chdir(tmp_path / "run")
    predict_joint(Path(), manifest, features, tmp_path / "within", **body)
    assert read_json(tmp_path / "within" / "predictions.json")["figures"]["run"] == "run"


def test_features_that_do_not_fit(walks, small_body, write_set, tmp_path):
    clip, path = walks[0], tmp_path / "walk_0.npz"
    with pytest.raises(MissingInput, match=r"walk_0.npz: no image features of clip walk_0"):
        load_features(tmp_path, clip)
    good = told(clip)
    holed = good.copy()
    holed[[7, 9]] = np.nan
    for arrays, words in (
        ({"feature": good}, r"features is none, expected numbers of shape \(80, D\)"),
        ({"features": good[:-1]}, r"float32 of shape \(79, 48\), expected"),
        ({"features": good[:, :0]}, "has no columns"),
        ({"features": good.astype(int)}, "int64 of shape"),
        ({"features": good + np.float64(1e300)}, r"infinite numbers \(80 rows in all\)"),
        ({"features": holed}, r"row 7 holds NaN or infinite numbers \(2 rows in all\)"),
    ):
        write_npz(path, arrays)
        with pytest.raises(BadFeatures, match=rf"walk_0.npz: .*{words}"):
            load_features(tmp_path, clip)
    valid = np.ones(80, bool)
    valid[[7, 9]] = False
    assert load_features(tmp_path, replace(clip, valid=valid)).shape == (80, N_FEATURES)
    path.write_bytes(b"PK")
    with pytest.raises(BadMotionFile, match=r"walk_0.npz: not a readable .npz"):
        load_features(tmp_path, clip)
    with pytest.raises(BadFeatures, match="features have 48 or 7 numbers|features have 7 or 48"):
        training_runs([(clip, good), (walks[1], good[:, :7])], 10.0)
    fitted(told_runs(clip), small_body, tmp_path / "run", steps=1)
    write_npz(path, {"features": good[:, :7]})
    manifest = write_set(tmp_path / "set", [clip])
    with pytest.raises(BadFeatures, match="7 numbers per frame, but the model takes 48"):
        predict_joint(tmp_path / "run", manifest, tmp_path, tmp_path / "out")


def test_clips_that_do_not_fit(walks):
    clip = walks[0]
    odd = replace(clip, motion=replace(clip.motion, fps_hz=25.0))
    with pytest.raises(BadMotionFile, match="25 fps is no whole multiple of 10 fps"):
        joint_runs(odd, told(clip), 10.0)
    flicker = replace(clip, valid=np.arange(80) % 2 == 0)
    with pytest.raises(BadManifest, match="none of the 1 training clips has two valid frames"):
        training_runs([(flicker, told(clip))], 20.0)


def test_a_step_size_that_is_far_too_large(walks, small_body, tmp_path):
    with pytest.raises(TrainingDiverged, match="Lower learning_rate, or set gradient_norm"):
        fitted(told_runs(walks[0]), small_body, tmp_path, learning_rate=1e30)
    assert latest_checkpoint(tmp_path) is None
