"""Checkpoints: whole or refused."""

import errno
import json
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file

from gmrdata.gmr.checkpoint import (
    BestScore,
    best_of,
    checkpoint_dir,
    latest_checkpoint,
    load_optimizer,
    load_weights,
    read_best,
    read_model,
    read_state,
)
from gmrdata.gmr.config import ModelConfig
from gmrdata.gmr.model import Gmr
from gmrdata.gmr.predict import load_gmr
from gmrdata.values.errors import BadCheckpoint, MissingInput
from gmrdata.values.files import write_json
from tests.fixtures.inference import keep_gmr, stepped_gmr
from tests.record_keys import assert_each_key_is_needed
from tests.write.test_full_disk import small_files

CONFIG = ModelConfig(layers=2, hidden=6, dropout=0.1)


def stepped(config: ModelConfig = CONFIG) -> tuple[Gmr, torch.optim.Adam]:
    return stepped_gmr(config)


@pytest.fixture
def run_dir(tmp_path) -> Path:
    keep_gmr(tmp_path, 40, *stepped())
    return tmp_path


def test_everything_comes_back(run_dir):
    folder = latest_checkpoint(run_dir)
    assert folder == checkpoint_dir(run_dir, 40)
    model, optimizer = stepped()
    again = read_model(folder)
    assert again.config == CONFIG
    for name, tensor in model.state_dict().items():
        assert torch.equal(again.state_dict()[name], tensor)
    fresh = torch.optim.Adam(again.parameters())
    load_optimizer(folder, again, fresh)
    for i, state in optimizer.state_dict()["state"].items():
        for key, value in state.items():
            assert torch.equal(fresh.state_dict()["state"][i][key], value)
    assert read_state(folder).step == 40
    assert load_gmr(run_dir).step == 40


def test_a_full_disk_is_said_as_one_and_leaves_the_step_before(run_dir):
    """It was a traceback of an error that only safetensors has."""
    with small_files(), pytest.raises(OSError) as caught:
        keep_gmr(run_dir, 80, *stepped(ModelConfig(layers=1, hidden=64)))
    assert caught.value.errno == errno.EFBIG
    assert read_state(latest_checkpoint(run_dir)).step == 40


def test_a_run_has_its_folders_name_wherever_it_is_called_from(run_dir, monkeypatch):
    monkeypatch.chdir(run_dir)
    assert load_gmr(".").name == run_dir.name


def test_only_the_latest_stays_and_its_bytes_repeat(run_dir, tmp_path):
    keep_gmr(run_dir, 80, *stepped())
    assert sorted(p.name for p in (run_dir / "checkpoints").iterdir()) == [
        "latest",
        "step_00000080",
    ]
    other = tmp_path / "other"
    keep_gmr(other, 80, *stepped())
    for file in checkpoint_dir(run_dir, 80).iterdir():
        assert file.read_bytes() == (checkpoint_dir(other, 80) / file.name).read_bytes()


def test_a_kill_while_writing_leaves_the_former(run_dir, monkeypatch):
    """Whatever call the process dies in, the pointer names a whole checkpoint."""

    class Killed(BaseException):
        pass

    def die(*_: object) -> None:
        raise Killed

    for place in (
        "gmrdata.gmr.checkpoint.save",
        "gmrdata.gmr.checkpoint.write_json",
        "gmrdata.gmr.checkpoint.write_text",
    ):
        with monkeypatch.context() as patch:
            patch.setattr(place, die)
            with pytest.raises(Killed):
                keep_gmr(run_dir, 80, *stepped())
        assert load_gmr(run_dir).step == 40
    keep_gmr(run_dir, 80, *stepped())
    assert load_gmr(run_dir).step == 80
    assert len(list((run_dir / "checkpoints").iterdir())) == 2


@pytest.mark.parametrize("name", ["model.safetensors", "optimizer.safetensors", "state.json"])
@pytest.mark.parametrize("share", [None, 0.0, 0.5, 0.99])
def test_missing_and_truncated_files_are_refused(run_dir, name, share):
    path = checkpoint_dir(run_dir, 40) / name
    whole = path.read_bytes()
    path.unlink()
    if share is not None:
        path.write_bytes(whole[: int(share * len(whole))])
    model, optimizer = stepped()
    with pytest.raises(BadCheckpoint, match=name):
        read_state(path.parent)
        load_weights(path.parent, model)
        load_optimizer(path.parent, model, optimizer)


def test_the_best_weights_come_back_or_are_refused(run_dir):
    model, optimizer = stepped()
    folder = checkpoint_dir(run_dir, 40)
    assert read_best(folder) is None
    with pytest.raises(BadCheckpoint, match="no best weights"):
        read_model(folder, "best")
    best = best_of(None, 30, "score", 2.0, model)
    assert best is not None
    with torch.no_grad():
        model.regression.bias += 1
    for worse in (2.0, 3.0, float("nan"), float("inf")):
        assert best_of(best, 40, "score", worse, model) is best
    keep_gmr(run_dir, 40, model, optimizer, best=best)
    again = read_best(folder)
    assert again is not None
    assert again.score == BestScore(step=30, score="score", value=2.0)
    difference = read_model(folder).regression.bias - read_model(folder, "best").regression.bias
    torch.testing.assert_close(difference, torch.ones(6))
    with pytest.raises(BadCheckpoint, match="no 'Best' weights; take latest or best"):
        load_gmr(run_dir, "Best")
    drawn = torch.random.get_rng_state()
    load_gmr(run_dir, "best")
    assert torch.equal(torch.random.get_rng_state(), drawn)
    path = folder / "best.safetensors"
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(BadCheckpoint, match=r"best\.safetensors: truncated"):
        read_model(folder, "best")
    state = json.loads((folder / "state.json").read_text())
    write_json(folder / "state.json", state | {"best": {"step": 3}})
    with pytest.raises(BadCheckpoint, match=r"state\.json: has no key `best\.score`"):
        read_best(folder)


def test_another_models_weights_are_refused(run_dir):
    folder = checkpoint_dir(run_dir, 40)
    other, optimizer = stepped(ModelConfig(layers=2, hidden=7))
    with pytest.raises(BadCheckpoint, match="of another model; differing tensors: encoder"):
        load_weights(folder, other)
    with pytest.raises(BadCheckpoint, match="of another model"):
        load_optimizer(folder, other, optimizer)


@pytest.mark.parametrize(
    "change", [{"format": "else"}, {"model": {"layers": 0}}, {"model": None}, {"fps_hz": None}]
)
def test_a_state_that_makes_no_sense_is_refused(run_dir, change):
    path = checkpoint_dir(run_dir, 40) / "state.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(BadCheckpoint, match=r"state\.json"):
        load_gmr(run_dir)


def test_each_key_of_a_state_is_needed(run_dir):
    """A setting that is not stated is not taken for today's default."""
    model, optimizer = stepped()
    keep_gmr(run_dir, 40, model, optimizer, best=best_of(None, 3, "a", 2.0, model))
    folder = checkpoint_dir(run_dir, 40)
    state = read_state(folder)
    assert state.best is not None
    assert_each_key_is_needed(state, folder / "state.json")


def test_a_state_of_the_first_version_is_read(run_dir):
    """It left out `processes`, `averaged` and `best` where they did not apply."""
    path = checkpoint_dir(run_dir, 40) / "state.json"
    state = json.loads(path.read_text()) | {"format": "gmrdata-gmr/1"}
    for key in ("processes", "averaged", "best"):
        del state[key]
    write_json(path, state)
    found = read_state(path.parent)
    assert (found.processes, found.averaged, found.best) == (1, False, None)
    assert load_gmr(run_dir).step == 40
    write_json(path, {key: value for key, value in state.items() if key != "fps_hz"})
    with pytest.raises(BadCheckpoint, match=r"state\.json: (.|\n)*fps_hz"):
        load_gmr(run_dir)


LATEST = ("joints_say", "soles_hold")


@pytest.mark.parametrize(
    ("version", "added_later", "there_already"),
    [
        (2, ("latent", "looks_at", "regressed", "symmetric", *LATEST), "output_scale"),
        (3, ("looks_at", "regressed", "symmetric", *LATEST), "latent"),
        (4, ("symmetric", *LATEST), "looks_at"),
        (5, LATEST, "symmetric"),
        (6, LATEST[1:], "joints_say"),
    ],
)
def test_a_state_of_a_later_version_is_read(version, added_later, there_already, run_dir):
    """The second's network had as many latent numbers as hidden units; the third's saw all joints,
    regressed freely and had a latent size; the fourth's answered to a sequence as it is; the
    fifth's joints had no say, and the sixth's soles.  Whatever else is lacking is refused."""
    path = checkpoint_dir(run_dir, 40) / "state.json"
    state = json.loads(path.read_text()) | {"format": f"gmrdata-gmr/{version}"}
    for key in added_later:
        del state["model"][key]
    write_json(path, state)
    assert load_gmr(run_dir).model.config == CONFIG
    for key in ("averaged", "model"):
        write_json(path, {name: value for name, value in state.items() if name != key})
        with pytest.raises(BadCheckpoint, match=rf"state\.json: .*`{key}`"):
            load_gmr(run_dir)
    del state["model"][there_already]
    write_json(path, state)
    with pytest.raises(BadCheckpoint, match=rf"has no key `model\.{there_already}`"):
        load_gmr(run_dir)


def test_no_checkpoint_and_a_pointer_to_nowhere(tmp_path):
    with pytest.raises(MissingInput, match="no trained model"):
        load_gmr(tmp_path)
    (tmp_path / "checkpoints").mkdir()
    for text in ("step_00000001\n", "\n", ""):
        (tmp_path / "checkpoints" / "latest").write_text(text)
        with pytest.raises(BadCheckpoint, match="which is not there"):
            load_gmr(tmp_path)


@pytest.mark.parametrize(
    "pointed", [b"\xff\xfe\x00\x80" * 40, b"../../etc", b"step_00000040\0", b""]
)
def test_a_pointer_that_is_no_name_is_told(pointed, run_dir):
    (run_dir / "checkpoints" / "latest").write_bytes(pointed)
    with pytest.raises(BadCheckpoint, match=r"latest: names .* which is not there"):
        latest_checkpoint(run_dir)


def test_weights_that_are_no_numbers_are_told(run_dir):
    path = checkpoint_dir(run_dir, 40) / "model.safetensors"
    tensors = load_file(path)
    tensors["projection.bias"][2] = torch.nan
    save_file(tensors, path)
    with pytest.raises(BadCheckpoint, match=r"model\.safetensors: projection\.bias holds NaN"):
        load_gmr(run_dir)
    tensors["projection.bias"] = torch.full((6,), 1e300, dtype=torch.float64)
    save_file(tensors, path)
    with pytest.raises(BadCheckpoint, match=r"projection\.bias holds NaN or infinite"):
        load_gmr(run_dir)
    for dtype in (torch.int8, torch.bool, torch.complex64):
        save_file(tensors | {"projection.bias": torch.ones(6, dtype=dtype)}, path)
        with pytest.raises(BadCheckpoint, match=rf"projection\.bias is of {dtype}, no weights"):
            load_gmr(run_dir)


def test_a_record_that_asks_for_a_huge_network_is_told_before_it_is_made(run_dir):
    path = checkpoint_dir(run_dir, 40) / "state.json"
    state = json.loads(path.read_text())
    state["model"] |= {"hidden": 10_000, "layers": 1}  # 2.4 GB of weights
    path.write_text(json.dumps(state))
    with pytest.raises(BadCheckpoint, match="of another model"):
        load_gmr(run_dir)
    state["model"]["layers"] = 10**7
    path.write_text(json.dumps(state))
    with pytest.raises(BadCheckpoint, match="`model.layers` is wrong: .* 64"):
        load_gmr(run_dir)
