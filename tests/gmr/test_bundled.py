"""Networks in a folder of weights alone, and several that predict together."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from benchmarks.training.bundle import write_bundle
from gmrdata.cli import main
from gmrdata.gmr.config import BUNDLE_FILE, ModelConfig, network_dir
from gmrdata.gmr.model import Gmr, MeanGmr
from gmrdata.gmr.predict import (
    load_gmr,
    predict_deltas,
    read_bundle,
)
from gmrdata.gmr.train import GmrRecipe
from gmrdata.read.body_file import save_body
from gmrdata.stage.recipes import find_recipe, load_recipe
from gmrdata.values.body import BodyModel
from gmrdata.values.errors import BadCheckpoint
from gmrdata.values.files import read_json
from gmrdata.values.motion import Motion, deltas
from tests.fixtures.inference import keep_gmr, stepped_gmr
from tests.read.system_files import vibe_person, write_joblib

CONFIG = ModelConfig(
    layers=1, hidden=6, extra_inputs=("standing",), rotation="standing_joint", output_scale=0.1
)


@pytest.fixture
def make_run(tmp_path: Path) -> Callable[..., Path]:
    """A run's folder with a network of random weights."""

    def make(seed: int, config: ModelConfig = CONFIG, fps_hz: float = 10.0) -> Path:
        run_dir = tmp_path / f"run_{seed}"
        keep_gmr(run_dir, 40 + seed, *stepped_gmr(config, seed), fps_hz=fps_hz)
        return run_dir

    return make


def test_one_network_predicts_as_its_run_does(
    make_run: Callable[..., Path], walk: Callable[..., Motion], tmp_path: Path
) -> None:
    run_dir, poses = make_run(2), walk(10.0).local_rotmats
    gmr = load_gmr(write_bundle([run_dir], "one", tmp_path / "bundle"))
    assert (gmr.name, gmr.step, gmr.fps_hz) == ("one", 42, 10.0)
    found, wanted = predict_deltas(gmr, poses), predict_deltas(load_gmr(run_dir), poses)
    np.testing.assert_allclose(found[0], wanted[0], atol=1e-3)
    np.testing.assert_allclose(found[1], wanted[1], atol=1e-3)
    size = (tmp_path / "bundle" / "network_0.safetensors").stat().st_size
    assert size < 2.2 * sum(p.numel() for p in gmr.model.parameters()) + 4000


def test_several_predict_the_mean_on_so3(
    make_run: Callable[..., Path], walk: Callable[..., Motion], tmp_path: Path
) -> None:
    runs, poses = [make_run(seed) for seed in (1, 2, 3)], walk(10.0).local_rotmats
    gmr = load_gmr(write_bundle(runs, "three", tmp_path / "bundle"))
    assert isinstance(gmr.model, MeanGmr)
    rotmats, moves_m = predict_deltas(gmr, poses)
    each = [predict_deltas(load_gmr(run_dir), poses) for run_dir in runs]
    mean = [
        Rotation.from_matrix(np.stack(m)).mean() for m in zip(*(r for r, _ in each), strict=True)
    ]
    apart = Rotation.from_matrix(each[0][0]).inv() * Rotation.from_matrix(each[1][0])
    wrong = Rotation.from_matrix(rotmats).inv() * Rotation.concatenate(mean)
    assert wrong.magnitude().max() < 0.02 * apart.magnitude().max()
    np.testing.assert_allclose(moves_m, np.mean([m for _, m in each], axis=0), atol=1e-3)


def test_the_mean_of_far_rotations_is_the_middle_one() -> None:
    """Three constant networks that turn by 10, 40 and 70 degrees about one axis."""
    models = []
    for degrees in (10, 40, 70):
        model = Gmr(ModelConfig(layers=1, hidden=2))
        with torch.no_grad():
            model.regression.weight.zero_()
            model.regression.bias.copy_(torch.tensor([0, np.deg2rad(degrees), 0, degrees, 0, 0]))
        models.append(model)
    rotmats, moves_m = MeanGmr(models)(torch.zeros(1, 3, 92))
    found = Rotation.from_matrix(rotmats[0].detach().double().numpy()).as_rotvec(degrees=True)
    np.testing.assert_allclose(found, np.tile([0, 40, 0], (3, 1)), atol=1e-4)
    assert moves_m[0, :, 0].tolist() == [40, 40, 40]


def test_runs_of_different_networks_are_refused(
    make_run: Callable[..., Path], tmp_path: Path
) -> None:
    runs = [make_run(1), make_run(2, fps_hz=20.0)]
    with pytest.raises(BadCheckpoint, match=r"run_2: of another network than .*run_1"):
        write_bundle(runs, "mixed", tmp_path / "bundle")
    assert not (tmp_path / "bundle").exists()


def test_broken_folders_are_named(make_run: Callable[..., Path], tmp_path: Path) -> None:
    folder = write_bundle([make_run(1), make_run(2)], "two", tmp_path / "bundle")
    with pytest.raises(BadCheckpoint, match=r"bundle: has the latest weights alone"):
        load_gmr(folder, "best")
    (folder / "network_1.safetensors").unlink()
    with pytest.raises(BadCheckpoint, match=r"network_1\.safetensors: truncated, missing"):
        read_bundle(folder)
    (folder / BUNDLE_FILE).write_text("{}")
    with pytest.raises(BadCheckpoint, match=r"bundle\.json"):
        load_gmr(folder)


def test_the_package_brings_a_network_with_its_card() -> None:
    folder = network_dir("bundled")
    gmr = load_gmr(folder)
    assert (gmr.name, gmr.fps_hz) == ("bundled", 10.0)
    assert sum(file.stat().st_size for file in folder.iterdir()) < 10_000_000
    card = (folder / "card.md").read_text(encoding="utf-8")
    assert "mocap.cs.cmu.edu" in card and "EIA-0196217" in card
    recipe = load_recipe(find_recipe("gmr_bundled"), GmrRecipe).train
    assert gmr.model.config == recipe.model, "the recipe makes such a network"


def test_who_walks_is_seen_to_walk(walk: Callable[..., Motion]) -> None:
    """The embedded gait is nobody's, so this says little; but the way is forward, and near."""
    poses = walk(10.0, 40)
    _, moves_m = predict_deltas(load_gmr(network_dir("bundled")), poses.local_rotmats)
    _, true_m = deltas(poses.root_rotmats, poses.pelvis_m)
    assert moves_m[:, 2].sum() == pytest.approx(true_m[:, 2].sum(), rel=0.4)
    apart_m = np.linalg.norm(moves_m - true_m, axis=1)
    assert apart_m.mean() < 0.6 * np.linalg.norm(true_m, axis=1).mean()


def test_infer_without_a_run_uses_it_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], small_body: BodyModel
) -> None:
    poses = write_joblib(tmp_path / "poses.pkl", {0: vibe_person(40)})
    body = tmp_path / "small.npz"
    save_body(body, small_body)
    arguments = ["--fps-hz", "30", "--body", str(body), "--no-video", "--out", str(tmp_path / "w")]
    main(["infer", str(poses), *arguments])
    assert "network: bundled" in capsys.readouterr().out
    assert read_json(tmp_path / "w" / "infer.json")["model"]["run"] == "bundled"
    with pytest.raises(SystemExit):
        main(["infer", "a", "b", "c", "--out", str(tmp_path / "x")])
