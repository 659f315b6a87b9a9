"""Other forms of a network: weights alone, several together, ONNX, and one that is symmetric."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from benchmarks.training.bundle import write_bundle
from gmrdata.cli import main
from gmrdata.gmr.augmentation import (
    mean_motion,
    mirror_local,
    mirror_points_m,
    mirror_rotmats,
    turned_back,
)
from gmrdata.gmr.config import (
    BUNDLE_FILE,
    ExtraInput,
    ModelConfig,
    MotionSource,
    Representation,
    network_dir,
    weights_dir,
)
from gmrdata.gmr.model import Gmr, MeanGmr, network_input, seen_from_feet
from gmrdata.gmr.predict import (
    OPSET,
    TrainedGmr,
    load_gmr,
    onnx_network,
    predict_deltas,
    read_bundle,
)
from gmrdata.gmr.train import GmrRecipe
from gmrdata.motion.gait import embedded_motions
from gmrdata.read.body_file import save_body
from gmrdata.stage.recipes import find_recipe, load_recipe
from gmrdata.values.body import JOINT_NAMES
from gmrdata.values.errors import BadCheckpoint
from gmrdata.values.files import read_json, write_json
from gmrdata.values.motion import deltas
from tests.fixtures.inference import keep_gmr, stepped_gmr
from tests.gmr.test_model import random_poses
from tests.read.system_files import vibe_person, write_joblib

CONFIG = ModelConfig(
    layers=1, hidden=6, extra_inputs=("standing",), rotation="standing_joint", output_scale=0.1
)


@pytest.fixture
def make_run(tmp_path) -> Callable[..., Path]:
    """A run's folder with a network of random weights."""

    def make(seed: int, config: ModelConfig = CONFIG, fps_hz: float = 10.0) -> Path:
        run_dir = tmp_path / f"run_{seed}"
        keep_gmr(run_dir, 40 + seed, *stepped_gmr(config, seed), fps_hz=fps_hz)
        return run_dir

    return make


def test_one_network_predicts_as_its_run_does(make_run, walk, tmp_path):
    run_dir, poses = make_run(2), walk(10.0).local_rotmats
    gmr = load_gmr(write_bundle([run_dir], "one", tmp_path / "bundle"))
    assert (gmr.name, gmr.step, gmr.fps_hz) == ("one", 42, 10.0)
    found, wanted = predict_deltas(gmr, poses), predict_deltas(load_gmr(run_dir), poses)
    np.testing.assert_allclose(found[0], wanted[0], atol=1e-3)
    np.testing.assert_allclose(found[1], wanted[1], atol=1e-3)
    size = (tmp_path / "bundle" / "network_0.safetensors").stat().st_size
    assert size < 2.2 * sum(p.numel() for p in gmr.model.parameters()) + 4000


def test_several_predict_the_mean_on_so3(make_run, walk, tmp_path):
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


def test_the_mean_of_far_rotations_is_the_middle_one():
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


def test_runs_of_different_networks_are_refused(make_run, tmp_path):
    runs = [make_run(1), make_run(2, fps_hz=20.0)]
    with pytest.raises(BadCheckpoint, match=r"run_2: of another network than .*run_1"):
        write_bundle(runs, "mixed", tmp_path / "bundle")
    assert not (tmp_path / "bundle").exists()


def test_broken_folders_are_named(make_run, tmp_path):
    folder = write_bundle([make_run(1), make_run(2)], "two", tmp_path / "bundle")
    with pytest.raises(BadCheckpoint, match=r"bundle: has the latest weights alone"):
        load_gmr(folder, "best")
    (folder / "network_1.safetensors").unlink()
    with pytest.raises(BadCheckpoint, match=r"network_1\.safetensors: truncated, missing"):
        read_bundle(folder)
    (folder / BUNDLE_FILE).write_text("{}")
    with pytest.raises(BadCheckpoint, match=r"bundle\.json"):
        load_gmr(folder)


def test_a_folder_of_a_former_version_is_read(make_run, walk, tmp_path):
    """Its record lacks what its networks could not choose; anything else is refused."""
    poses = walk(10.0).local_rotmats
    folder = write_bundle([make_run(1)], "one", tmp_path / "bundle")
    wanted = predict_deltas(load_gmr(folder), poses)
    record = read_json(folder / BUNDLE_FILE)
    for key in ("soles_hold", "joints_say"):
        del record["model"][key]
        write_json(folder / BUNDLE_FILE, record)
        gmr = load_gmr(folder)
        assert gmr.model.config == CONFIG
        for found, known in zip(predict_deltas(gmr, poses), wanted, strict=True):
            np.testing.assert_array_equal(found, known)
    del record["model"]["output_scale"]
    write_json(folder / BUNDLE_FILE, record)
    with pytest.raises(BadCheckpoint, match=r"bundle\.json: has no key `model\.output_scale`"):
        load_gmr(folder)


def test_what_decides_a_networks_motions_is_its_weights(make_run, tmp_path):
    """A run's folder may hold its measured errors and results; a bundle's is hashed as a whole."""
    run_dir = make_run(1)
    bundle = write_bundle([run_dir], "one", tmp_path / "bundle")
    assert weights_dir(run_dir) == run_dir / "checkpoints"
    assert weights_dir(bundle) == bundle
    assert weights_dir(tmp_path / "nowhere") == tmp_path / "nowhere"


def test_the_package_brings_a_network_with_its_card():
    folder = network_dir("bundled")
    gmr = load_gmr(folder)
    assert (gmr.name, gmr.fps_hz) == ("bundled", 10.0)
    assert sum(file.stat().st_size for file in folder.iterdir()) < 10_000_000
    card = (folder / "card.md").read_text(encoding="utf-8")
    assert "mocap.cs.cmu.edu" in card and "EIA-0196217" in card
    recipe = load_recipe(find_recipe("gmr_bundled"), GmrRecipe).train
    assert gmr.model.config == recipe.model, "the recipe makes such a network"


def test_who_walks_is_seen_to_walk(walk):
    """The embedded gait is nobody's, so this says little; but the way is forward, and near."""
    poses = walk(10.0, 40)
    _, moves_m = predict_deltas(load_gmr(network_dir("bundled")), poses.local_rotmats)
    _, true_m = deltas(poses.root_rotmats, poses.pelvis_m)
    assert moves_m[:, 2].sum() == pytest.approx(true_m[:, 2].sum(), rel=0.4)
    apart_m = np.linalg.norm(moves_m - true_m, axis=1)
    assert apart_m.mean() < 0.6 * np.linalg.norm(true_m, axis=1).mean()


def test_infer_without_a_run_uses_it_and_says_so(tmp_path, capsys, small_body):
    poses = write_joblib(tmp_path / "poses.pkl", {0: vibe_person(40)})
    body = tmp_path / "small.npz"
    save_body(body, small_body)
    arguments = ["--fps-hz", "30", "--body", str(body), "--no-video", "--out", str(tmp_path / "w")]
    main(["infer", str(poses), *arguments])
    assert "network: bundled" in capsys.readouterr().out
    assert read_json(tmp_path / "w" / "infer.json")["model"]["run"] == "bundled"
    with pytest.raises(SystemExit):
        main(["infer", "a", "b", "c", "--out", str(tmp_path / "x")])


SAME = 1e-5
Variant = tuple[tuple[ExtraInput, ...], MotionSource, int | None]
REGRESSED: Variant = ((), "regressed", None)
STANDING: Variant = (("velocity", "standing"), "standing_joint", 5)


def network(
    input: Representation = "quaternion",
    output: Representation = "axis-angle",
    extra: tuple[ExtraInput, ...] = (),
    source: MotionSource = "regressed",
    latent: int | None = None,
) -> TrainedGmr:
    torch.manual_seed(0)
    config = ModelConfig(
        layers=2, hidden=7, latent=latent, input=input, output=output, extra_inputs=extra,
        rotation=source, translation=source, output_scale=0.5,
    )  # fmt: skip
    return TrainedGmr(Gmr(config).eval(), 10.0, "some_run", 12)


def run_onnx(
    session: onnxruntime.InferenceSession, local_rotmats: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """dR and dT of a batch (B, T, 23, 3, 3) by onnxruntime."""
    turns, steps_m = session.run(None, {"local_rotmats": local_rotmats.astype(np.float32)})
    return turns, steps_m


def wild_poses(n_frames: int, seed: int) -> np.ndarray:
    """Joints that go through whole turns, where quaternions change their signs."""
    rng = np.random.default_rng(seed)
    rotvecs = np.cumsum(rng.normal(0, 0.4, (n_frames, 23, 3)), axis=0)
    rotvecs += rng.normal(size=(23, 3))
    return Rotation.from_rotvec(rotvecs.reshape(-1, 3)).as_matrix().reshape(-1, 23, 3, 3)


@pytest.mark.parametrize(
    ("kinds", "variant"),
    [
        (("quaternion", "axis-angle"), REGRESSED),
        (("axis-angle", "quaternion"), REGRESSED),
        (("6d", "6d"), REGRESSED),
        (("quaternion", "6d"), STANDING),
    ],
)
def test_every_kind_of_network_is_the_same_as_in_torch(kinds, variant):
    gmr = network(*kinds, *variant)
    poses = np.stack([wild_poses(9, seed) for seed in range(3)])
    turns, steps_m = run_onnx(onnxruntime.InferenceSession(onnx_network(gmr)), poses)
    assert (turns.shape, steps_m.shape) == ((3, 8, 3, 3), (3, 8, 3))
    for at, one in enumerate(poses):
        wanted = predict_deltas(gmr, one)
        assert np.abs(turns[at] - wanted[0]).max() < SAME
        assert np.abs(steps_m[at] - wanted[1]).max() < SAME


@pytest.fixture(scope="module")
def usual() -> tuple[TrainedGmr, bytes]:
    """A network of the paper's kind, and its model file."""
    gmr = network(latent=5)
    return gmr, onnx_network(gmr)


@pytest.mark.parametrize("n_frames", [2, 3, 64, 301])
def test_any_length_of_a_motion(usual, small_body, n_frames):
    rng = np.random.default_rng(1)
    seconds = n_frames / 10 + 1
    motion = embedded_motions(small_body, rng, count=1, fps_hz=10.0, duration_s=seconds)[0]
    local_rotmats = motion.local_rotmats[:n_frames]
    gmr, model = usual
    turns, steps_m = run_onnx(onnxruntime.InferenceSession(model), local_rotmats[None])
    wanted = predict_deltas(gmr, local_rotmats)
    assert np.abs(turns[0] - wanted[0]).max() < SAME
    assert np.abs(steps_m[0] - wanted[1]).max() < SAME


def test_the_model_says_what_it_needs(usual):
    gmr, model = usual
    session = onnxruntime.InferenceSession(model)
    about = session.get_modelmeta().custom_metadata_map
    assert float(about["fps_hz"]) == 10.0
    assert about["joints"].split(",") == list(JOINT_NAMES[1:])
    assert (about["run"], about["step"]) == ("some_run", "12")
    assert ModelConfig.model_validate_json(about["network"]) == gmr.model.config
    (given,), made = session.get_inputs(), session.get_outputs()
    assert (given.name, given.type, given.shape) == (
        "local_rotmats", "tensor(float)", ["batch", "frames", 23, 3, 3],
    )  # fmt: skip
    assert [(one.name, one.shape) for one in made] == [
        ("delta_rotmats", ["batch", "motions", 3, 3]),
        ("delta_m", ["batch", "motions", 3]),
    ]
    assert all(one.name in about for one in (given, *made))
    assert OPSET == 17


def test_the_network_stays_as_it_was():
    """It was left in training mode, in which dropout is random."""
    gmr = network()
    onnx_network(gmr)
    assert not any(module.training for module in gmr.model.modules())


SYMMETRIC_CONFIG = ModelConfig(
    layers=1, hidden=5, extra_inputs=("standing", "velocity", "feet"), looks_at="legs_and_trunk",
    rotation="standing_joint", translation="standing_joint", output_scale=0.5, symmetric=True,
    joints_say=True, soles_hold=True,
)  # fmt: skip


def symmetric_network() -> Gmr:
    torch.manual_seed(1)
    model = Gmr(SYMMETRIC_CONFIG).double().eval()
    assert model.looks is not None
    for look in model.looks:  # which say nothing before they are trained
        # Answers that are half a turn apart have no mean.
        torch.nn.init.normal_(look.scores.weight, std=0.3)
    return model


def answer(model: Gmr, poses: Tensor, lengths: Tensor | None = None) -> tuple[Tensor, Tensor]:
    config = model.config
    with torch.no_grad():
        return model(network_input(poses, config.input, config.extra_inputs), lengths)


def test_a_mirror_image_moves_as_the_mirrored_person():
    poses, model = random_poses(1, 7), symmetric_network()
    turns, moves_m = answer(model, poses)
    seen = answer(model, torch.from_numpy(mirror_local(poses.numpy())))
    np.testing.assert_allclose(seen[0][:, :-1], mirror_rotmats(turns.numpy())[:, :-1], atol=1e-6)
    np.testing.assert_allclose(seen[1][:, :-1], mirror_points_m(moves_m.numpy())[:, :-1], atol=1e-6)


def test_backwards_the_person_goes_back():
    poses, model = random_poses(1, 7), symmetric_network()
    turns, back = answer(model, poses)[0], answer(model, poses.flip(1))[0]
    np.testing.assert_allclose(back[0, :-1].flip(0), turns[0, :-1].mT, atol=1e-6)


def test_four_right_answers_are_one(walk):
    """True motions of a walk, its mirror image, its reverse and both; and of a shorter piece."""
    motion = walk(10.0)
    roots, pelvis_m = motion.root_rotmats[:12], motion.pelvis_m[:12]
    turns, moves_m = np.zeros((4, 2, 12, 3, 3)), np.zeros((4, 2, 12, 3))
    for piece, n in enumerate((12, 7)):
        for way in range(4):
            step = -1 if way >= 2 else 1
            found = deltas(roots[:n][::step], pelvis_m[:n][::step])
            if way % 2:
                found = mirror_rotmats(found[0]), mirror_points_m(found[1])
            turns[way, piece, : n - 1], moves_m[way, piece, : n - 1] = found
            turns[way, piece, n - 1 :] = np.eye(3)
    lengths = torch.tensor([12, 7])
    ways = zip(torch.from_numpy(turns), torch.from_numpy(moves_m), strict=True)
    mean = mean_motion(turned_back(list(ways), lengths))
    wanted = deltas(roots, pelvis_m)
    for piece, n in enumerate((12, 7)):
        np.testing.assert_allclose(mean[0][piece, : n - 1], wanted[0][: n - 1], atol=1e-6)
        np.testing.assert_allclose(mean[1][piece, : n - 1], wanted[1][: n - 1], atol=1e-6)


def test_the_answer_lies_between_the_plain_networks_answers():
    poses, model = random_poses(1, 9), symmetric_network()
    plain = Gmr(SYMMETRIC_CONFIG.model_copy(update={"symmetric": False})).double().eval()
    plain.load_state_dict(model.state_dict())
    _, as_given = answer(plain, poses)
    mirrored = mirror_points_m(
        answer(plain, torch.from_numpy(mirror_local(poses.numpy())))[1].numpy()
    )
    _, mean_m = answer(model, poses)
    assert np.abs(as_given.numpy() - mirrored)[:, :-1].max() > 1e-3
    assert not torch.allclose(mean_m, as_given)
    model.train()
    torch.testing.assert_close(answer(model, poses)[1], as_given)


def test_four_ways_have_their_supports_one_after_the_other():
    """Those of all at once took four times the memory, which is gigabytes for hours of poses."""
    model, sizes = symmetric_network(), list[int]()
    assert model.looks is not None
    model.looks[0].register_forward_hook(lambda _, given, scores: sizes.append(len(scores)))
    answer(model, random_poses(1, 9))
    assert sizes == [1] * 4


def test_a_padded_batch_is_its_sequences():
    poses, model = random_poses(2, 8), symmetric_network()
    alone = answer(model, poses[1:, :5])
    together = answer(model, poses, torch.tensor([8, 5]))
    torch.testing.assert_close(together[0][1, :4], alone[0][0, :4])
    torch.testing.assert_close(together[1][1, :4], alone[1][0, :4])


@pytest.mark.slow
def test_as_an_onnx_model():
    """One model takes any number of frames."""
    gmr = TrainedGmr(symmetric_network().float(), 10.0, "some_run", 3)
    model = onnx_network(gmr)
    assert len(onnx.load_from_string(model).graph.node) < 12_500  # 19,000 took as long again
    network = onnxruntime.InferenceSession(model)
    for poses in (random_poses(2, 2).numpy(), random_poses(2, 9).numpy()):
        turns, steps_m = run_onnx(network, poses)
        for at, one in enumerate(poses):
            wanted = predict_deltas(gmr, one)
            np.testing.assert_allclose(turns[at], wanted[0], atol=1e-5)
            np.testing.assert_allclose(steps_m[at], wanted[1], atol=1e-5)


def test_feet_see_the_body_in_their_own_frames():
    """Where the left foot stands as in the T-pose, its frame is the root's."""
    still = torch.eye(3, dtype=torch.float64).expand(3, 23, 3, 3).clone()
    left, right = seen_from_feet(still)[0].unbind(0)
    np.testing.assert_allclose(left[6:9], (-0.198, 0, 0), atol=1e-12)  # the other ankle
    np.testing.assert_allclose(right[6:9], (0.198, 0, 0), atol=1e-12)
    np.testing.assert_allclose(left[12:15], (-0.099, 0.838, -0.011), atol=1e-12)  # the pelvis
    np.testing.assert_allclose(left[24:], (0, 1, 0, 0, 1, 0), atol=1e-12)
    assert -0.12 < left[0] < -0.08 and 0.8 < left[1] < 1.2, "the centre of mass, about the pelvis"
    poses = random_poses(6)
    seen = seen_from_feet(poses)
    np.testing.assert_allclose(
        seen[:-1, 0, 12:15] + seen[:-1, 0, 15:18] / 10, seen[1:, 0, 12:15], atol=1e-12
    )
    assert seen[-1, :, 3:6].abs().max() == 0
    mirrored = seen_from_feet(torch.from_numpy(mirror_local(poses.numpy())))
    swapped = seen.flip(1).unflatten(-1, (10, 3)) * torch.tensor([-1.0, 1.0, 1.0])
    np.testing.assert_allclose(mirrored, swapped.flatten(-2), atol=1e-12)
