"""The loss against direct readings of eqs. 5 and 9-14 in float64, and by finite differences."""

from typing import Literal

import numpy as np
import pytest
import torch
from scipy.linalg import expm, logm
from scipy.spatial.transform import Rotation

from gmrdata.body.forward import place, posed_vertices
from gmrdata.body.model import BodyModel
from gmrdata.body.subset import vertex_rows, with_vertices
from gmrdata.gmr.config import LossConfig
from gmrdata.gmr.losses import Motions, gmr_loss, vertex_l1_m
from gmrdata.gmr.rotations import to_rotmats

B, N, V = 3, 6, 20
KINDS: tuple[Literal["chordal", "angular", "axis-angle"], ...] = (
    "chordal",
    "angular",
    "axis-angle",
)


def random_motions(seed: int, angle_rad: float = 0.3) -> Motions:
    rng = np.random.default_rng(seed)
    rotmats = Rotation.from_rotvec(rng.normal(0, angle_rad, (B * N, 3))).as_matrix()
    return Motions(
        torch.as_tensor(rotmats.reshape(B, N, 3, 3)),
        torch.as_tensor(rng.normal(0, 0.1, (B, N, 3))),
    )


def random_vertices_m(seed: int) -> torch.Tensor:
    return torch.as_tensor(np.random.default_rng(seed).normal(0, 0.5, (B, N, V, 3)))


def direct_terms(
    predicted: Motions, true: Motions, vertices_m: torch.Tensor, lengths: list[int], kind: str
) -> dict[str, tuple[float, int]]:
    """Each equation as a plain loop: its sum and the number of its addends (vertices apart)."""
    sums = dict.fromkeys(("orientation", "translation", "vertex", "smoothness"), 0.0)
    pairs = 0
    for b, n in enumerate(lengths):
        rotmats, true_rotmats = predicted.rotmats[b].numpy(), true.rotmats[b].numpy()
        metres, true_m = predicted.metres[b].numpy(), true.metres[b].numpy()
        for i in range(n):
            if kind == "chordal":
                sums["orientation"] += np.linalg.norm(rotmats[i] - true_rotmats[i], "fro") ** 2
            elif kind == "angular":
                log = logm(rotmats[i] @ true_rotmats[i].T).real
                sums["orientation"] += log[2, 1] ** 2 + log[0, 2] ** 2 + log[1, 0] ** 2
            else:
                log = (logm(rotmats[i]) - logm(true_rotmats[i])).real
                sums["orientation"] += log[2, 1] ** 2 + log[0, 2] ** 2 + log[1, 0] ** 2
            sums["translation"] += np.linalg.norm(metres[i] - true_m[i]) ** 2
            for v in vertices_m[b, i].numpy():
                moved_m = rotmats[i] @ v + metres[i] - true_rotmats[i] @ v - true_m[i]
                sums["vertex"] += np.abs(moved_m).sum()
        for i in range(n - 1):
            sums["smoothness"] += np.linalg.norm(rotmats[i] - rotmats[i + 1], "fro") ** 2
            pairs += 1
    counts = {"orientation": sum(lengths), "translation": sum(lengths), "smoothness": pairs}
    counts["vertex"] = sum(lengths) * V
    return {name: (sums[name], counts[name]) for name in sums}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("reduction", ["mean", "sum"])
@pytest.mark.parametrize("lengths", [[N, N, N], [N, 2, 1]])
def test_terms_are_the_equations(
    kind: Literal["chordal", "angular", "axis-angle"],
    reduction: Literal["mean", "sum"],
    lengths: list[int],
) -> None:
    predicted, true, vertices_m = random_motions(1), random_motions(2), random_vertices_m(3)
    mask = torch.arange(N) < torch.tensor(lengths)[:, None]
    config = LossConfig(orientation_loss=kind, reduction=reduction)
    found = gmr_loss(predicted, true, mask, vertices_m, V, config)
    total = 0.0
    for name, (value, count) in direct_terms(predicted, true, vertices_m, lengths, kind).items():
        expected = value / count if reduction == "mean" else value / B
        assert getattr(found, name).item() == pytest.approx(expected, rel=1e-9), name
        total += {"smoothness": 1e-2}.get(name, 1.0) * expected
    assert found.total.item() == pytest.approx(total, rel=1e-9)


def test_weights_and_a_missing_vertex_term() -> None:
    predicted, true = random_motions(1), random_motions(2)
    config = LossConfig(orientation=2.0, translation=3.0, vertex=0.0, smoothness=5.0)
    found = gmr_loss(predicted, true, torch.ones(B, N, dtype=torch.bool), None, V, config)
    expected = 2 * found.orientation + 3 * found.translation + 5 * found.smoothness
    assert found.total.item() == pytest.approx(expected.item(), rel=1e-12)
    assert found.vertex.item() == 0


def test_padding_has_no_value_and_no_gradient() -> None:
    predicted, true, vertices_m = random_motions(1), random_motions(2), random_vertices_m(3)
    mask = torch.arange(N) < torch.tensor([4, 1, N])[:, None]
    leaves = [predicted.rotmats.requires_grad_(), predicted.metres.requires_grad_()]
    gmr_loss(predicted, true, mask, vertices_m, V, LossConfig()).total.backward()
    for leaf in leaves:
        assert leaf.grad is not None
        assert leaf.grad[~mask].abs().max() == 0
        assert (leaf.grad[mask].abs().flatten(1).sum(-1) > 0).all()


def test_vertex_term_is_eq_13_with_the_body_posed_twice(small_body: BodyModel) -> None:
    """Value and gradient as if prediction and truth each went through the body under autograd."""
    rng = np.random.default_rng(0)
    local_rotmats = torch.as_tensor(
        Rotation.from_rotvec(rng.normal(0, 0.4, (B * N * 23, 3))).as_matrix()
    ).reshape(B, N, 23, 3, 3)
    shape = torch.as_tensor(rng.normal(0, 1, (B, 1, small_body.n_shape)))
    true = random_motions(2)

    def values() -> Motions:
        made = random_motions(1)
        return Motions(made.rotmats.requires_grad_(), made.metres.requires_grad_())

    ours, direct = values(), values()
    with torch.no_grad():
        vertices_m = posed_vertices(small_body, shape, local_rotmats)
    short = vertex_l1_m(ours, true, vertices_m).sum()
    short.backward()
    meshes_m = [
        place(m.rotmats, m.metres, posed_vertices(small_body, shape, local_rotmats))
        for m in (direct, true)
    ]
    long = (meshes_m[0] - meshes_m[1]).abs().sum(-1).mean(-1).sum()
    long.backward()
    assert short.item() == pytest.approx(long.item(), rel=1e-10)
    assert ours.rotmats.grad is not None
    assert ours.metres.grad is not None
    torch.testing.assert_close(ours.rotmats.grad, direct.rotmats.grad, rtol=1e-8, atol=1e-10)
    torch.testing.assert_close(ours.metres.grad, direct.metres.grad, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("reduction", ["mean", "sum"])
def test_a_vertex_subset_estimates_the_whole(reduction: Literal["mean", "sum"]) -> None:
    predicted, true = random_motions(1), random_motions(2)
    cloud_m = torch.as_tensor(np.random.default_rng(0).normal(0, 0.3, (B, N, 2000, 3)))
    mask = torch.ones(B, N, dtype=torch.bool)
    config = LossConfig(reduction=reduction)
    whole = gmr_loss(predicted, true, mask, cloud_m, 2000, config).vertex
    part = gmr_loss(predicted, true, mask, cloud_m[:, :, vertex_rows(2000, 500)], 2000, config)
    assert part.vertex.item() == pytest.approx(whole.item(), rel=0.03)


def test_vertex_rows_are_spread_and_ascending(small_body: BodyModel) -> None:
    assert vertex_rows(10, None).tolist() == list(range(10))
    assert vertex_rows(10, 50).tolist() == list(range(10))
    assert vertex_rows(10, 4).tolist() == [0, 2, 5, 7]
    rows = vertex_rows(len(small_body.template_m), 50)
    assert len(np.unique(rows)) == 50
    part = with_vertices(small_body, rows)
    pose = torch.as_tensor(
        Rotation.from_rotvec(np.random.default_rng(1).normal(0, 0.5, (23, 3))).as_matrix()
    )
    shape = torch.linspace(-1, 1, small_body.n_shape, dtype=torch.float64)
    torch.testing.assert_close(
        posed_vertices(part, shape, pose),
        posed_vertices(small_body, shape, pose)[torch.as_tensor(rows)],
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("angle_rad", [0.0, 1e-8, 1e-4, 0.1, 1.0, 3.0, np.pi - 1e-3])
def test_gradients_by_finite_differences(
    kind: Literal["chordal", "angular", "axis-angle"], angle_rad: float
) -> None:
    """The gradient through the network's output, at predictions of angle 0 to nearly pi."""
    axis = np.array([0.6, -0.48, 0.64])
    start = np.concatenate([angle_rad * axis, [0.03, -0.02, 0.05]])
    # The truth lies aside, and by less than pi from each prediction: at pi the angle has a kink.
    true = Motions(
        torch.as_tensor(expm(0.02 * np.cross(np.eye(3), [1.0, 0.5, -0.3])))[None, None],
        torch.tensor([[[0.01, 0.02, 0.03]]], dtype=torch.float64),
    )
    vertices_m = torch.as_tensor(np.random.default_rng(4).normal(0, 0.5, (1, 1, 30, 3)))
    config = LossConfig(orientation_loss=kind)
    mask = torch.ones(1, 1, dtype=torch.bool)

    def loss(values: torch.Tensor) -> torch.Tensor:
        rotmats = to_rotmats(values[None, None, :3], "axis-angle")
        return gmr_loss(
            Motions(rotmats, values[None, None, 3:]), true, mask, vertices_m, 30, config
        ).total

    values = torch.tensor(start, requires_grad=True)
    (gradient,) = torch.autograd.grad(loss(values), values)
    step = 1e-5
    differences = [
        (loss(torch.tensor(start + d)) - loss(torch.tensor(start - d))).item() / (2 * step)
        for d in np.eye(6) * step
    ]
    np.testing.assert_allclose(gradient.numpy(), differences, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("angle_rad", [0.0, 1e-12, 1e-7, np.pi - 1e-7, np.pi, np.pi + 1e-7])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_gradients_are_finite_at_0_and_pi(
    kind: Literal["chordal", "angular", "axis-angle"], angle_rad: float, dtype: torch.dtype
) -> None:
    """Prediction and truth equal, opposite, or both at half a turn."""
    axis = torch.tensor([0.6, -0.48, 0.64], dtype=dtype)
    for true_angle_rad in (0.0, np.pi):
        values = (angle_rad * axis).requires_grad_()
        true_rotmats = to_rotmats(true_angle_rad * axis, "axis-angle")[None, None]
        found = gmr_loss(
            Motions(
                to_rotmats(values[None, None], "axis-angle"), torch.zeros(1, 1, 3, dtype=dtype)
            ),
            Motions(true_rotmats, torch.zeros(1, 1, 3, dtype=dtype)),
            torch.ones(1, 1, dtype=torch.bool),
            torch.ones(1, 1, 2, 3, dtype=dtype),
            2,
            LossConfig(orientation_loss=kind),
        )
        found.total.backward()
        assert torch.isfinite(found.total)
        assert values.grad is not None
        assert torch.isfinite(values.grad).all()
