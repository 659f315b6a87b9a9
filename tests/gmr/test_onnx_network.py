"""GMR's ONNX model in onnxruntime, compared with torch."""

import numpy as np
import onnxruntime
import pytest
import torch
from scipy.spatial.transform import Rotation

from gmrdata.gmr.config import ExtraInput, ModelConfig, MotionSource, Representation
from gmrdata.gmr.model import Gmr
from gmrdata.gmr.predict import OPSET, TrainedGmr, onnx_network, predict_deltas
from gmrdata.motion.gait import embedded_motions
from gmrdata.values.body import JOINT_NAMES, BodyModel

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


def run_onnx(model: bytes, local_rotmats: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """dR and dT of a batch (B, T, 23, 3, 3) by onnxruntime."""
    session = onnxruntime.InferenceSession(model)
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
def test_every_kind_of_network_is_the_same_as_in_torch(
    kinds: tuple[Representation, Representation], variant: Variant
) -> None:
    gmr = network(*kinds, *variant)
    poses = np.stack([wild_poses(9, seed) for seed in range(3)])
    turns, steps_m = run_onnx(onnx_network(gmr), poses)
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
def test_any_length_of_a_motion(
    usual: tuple[TrainedGmr, bytes], small_body: BodyModel, n_frames: int
) -> None:
    rng = np.random.default_rng(1)
    seconds = n_frames / 10 + 1
    motion = embedded_motions(small_body, rng, count=1, fps_hz=10.0, duration_s=seconds)[0]
    local_rotmats = motion.local_rotmats[:n_frames]
    gmr, model = usual
    turns, steps_m = run_onnx(model, local_rotmats[None])
    wanted = predict_deltas(gmr, local_rotmats)
    assert np.abs(turns[0] - wanted[0]).max() < SAME
    assert np.abs(steps_m[0] - wanted[1]).max() < SAME


def test_the_model_says_what_it_needs(usual: tuple[TrainedGmr, bytes]) -> None:
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


def test_the_network_stays_as_it_was() -> None:
    """It was left in training mode, in which dropout is random."""
    gmr = network()
    onnx_network(gmr)
    assert not any(module.training for module in gmr.model.modules())
