"""The network of Fig. 4."""

from itertools import product

import pytest
import torch

from gmrdata.gmr.config import ExtraInput, ModelConfig, MotionSource, Representation
from gmrdata.gmr.model import Gmr, input_size, network_input
from tests.gmr.direct_reading import parameter_count

REPRESENTATIONS: tuple[Representation, ...] = ("quaternion", "axis-angle", "6d")
INPUTS = {"quaternion": 92, "axis-angle": 69, "6d": 138}


@pytest.mark.parametrize(("input_", "output"), list(product(REPRESENTATIONS, REPRESENTATIONS)))
def test_all_nine_of_table_1(input_: Representation, output: Representation) -> None:
    config = ModelConfig(layers=2, hidden=8, input=input_, output=output)
    model = Gmr(config)
    poses = torch.randn(3, 10, INPUTS[input_], generator=torch.Generator().manual_seed(0))
    delta_rotmats, delta_m = model(poses)
    assert delta_rotmats.shape == (3, 10, 3, 3)
    assert delta_m.shape == (3, 10, 3)
    eye = torch.eye(3).expand(3, 10, 3, 3)
    torch.testing.assert_close(
        delta_rotmats @ delta_rotmats.transpose(-1, -2), eye, atol=1e-5, rtol=0
    )
    assert sum(p.numel() for p in model.parameters()) == parameter_count(config)


@pytest.mark.parametrize(("layers", "hidden"), [(1, 1), (1, 7), (3, 5), (4, 16)])
def test_parameter_count(layers: int, hidden: int) -> None:
    config = ModelConfig(layers=layers, hidden=hidden)
    assert sum(p.numel() for p in Gmr(config).parameters()) == parameter_count(config)


@pytest.mark.parametrize(
    ("extra", "inputs"),
    [(("velocity",), 92 + 69), (("standing",), 92 + 138), (("velocity", "standing"), 92 + 207)],
)
def test_parameter_count_with_extra_inputs(extra: tuple[ExtraInput, ...], inputs: int) -> None:
    """Only the first layer is larger: three gates of both directions look at each number."""
    config = ModelConfig(layers=3, hidden=5, extra_inputs=extra)
    assert sum(p.numel() for p in Gmr(config).parameters()) == parameter_count(config)
    assert input_size(config) == inputs
    plain = parameter_count(ModelConfig(layers=3, hidden=5))
    assert parameter_count(config) - plain == 2 * 3 * 5 * (inputs - 92)


def test_the_papers_network() -> None:
    """4 x 2048: 26.3 M for the first layer, 75.5 M for each other, 8.4 M behind the GRUs."""
    first = 2 * 3 * (2048 * (92 + 2048) + 2 * 2048)
    other = 2 * 3 * (2048 * (4096 + 2048) + 2 * 2048)
    behind = 4096 * 2048 + 2048 + 2048 * 6 + 6
    assert parameter_count(ModelConfig()) == first + 3 * other + behind == 261_289_990


@pytest.mark.parametrize(("latent", "count"), [(None, 7_114_246), (2048, 8_697_862)])
def test_table_9_with_a_latent_size_of_its_own(latent: int | None, count: int) -> None:
    """2 / 512, with as many latent numbers as hidden units, and with the 2048 of Fig. 4."""
    config = ModelConfig(layers=2, hidden=512, latent=latent)
    model = Gmr(config)
    assert sum(p.numel() for p in model.parameters()) == parameter_count(config) == count
    assert model.projection.out_features == model.regression.in_features == (latent or 512)
    assert model(torch.zeros(1, 3, 92))[1].shape == (1, 3, 3)


@pytest.mark.parametrize("output", REPRESENTATIONS)
def test_a_network_of_zeros_stands_still(output: Representation) -> None:
    model = Gmr(ModelConfig(layers=1, hidden=4, output=output))
    for parameter in model.parameters():
        torch.nn.init.zeros_(parameter)
    delta_rotmats, delta_m = model(torch.ones(1, 5, 92))
    assert torch.equal(delta_rotmats, torch.eye(3).expand(1, 5, 3, 3))
    assert torch.equal(delta_m, torch.zeros(1, 5, 3))


@pytest.mark.parametrize("source", ["regressed", "standing_joint"])
def test_padding_changes_nothing(source: MotionSource) -> None:
    config = ModelConfig(layers=2, hidden=6, rotation=source, translation=source)
    model = Gmr(config).eval()
    generator = torch.Generator().manual_seed(3)
    poses = torch.randn(3, 12, 92, generator=generator)
    lengths = torch.tensor([5, 12, 2])
    together = model(poses, lengths)
    for row, n in enumerate(lengths.tolist()):
        alone = model(poses[row : row + 1, :n])
        # The last motion leads to a frame that isn't there, and is dropped by callers.
        kept = n if source == "regressed" else n - 1
        for part in range(2):
            expected = alone[part][0, :kept]
            torch.testing.assert_close(together[part][row, :kept], expected, atol=1e-6, rtol=0)


def test_it_looks_both_ways() -> None:
    """Each output depends on the first and on the last frame."""
    model = Gmr(ModelConfig(layers=1, hidden=6)).eval()
    poses = torch.randn(1, 9, 92, generator=torch.Generator().manual_seed(5), requires_grad=True)
    model(poses)[1][0, 4].sum().backward()
    assert poses.grad is not None
    assert (poses.grad[0].abs().sum(-1) > 0).all()


def test_network_input_is_w_first_by_joint() -> None:
    still = torch.eye(3).expand(4, 23, 3, 3)
    assert torch.equal(network_input(still, "quaternion")[0, :8], torch.tensor([1.0, 0, 0, 0] * 2))
    assert network_input(still, "axis-angle").shape == (4, 69)
    assert network_input(still, "6d").shape == (4, 138)
