"""The loss against direct readings of eqs. 5 and 9-14 in float64, and by finite differences."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
import torch
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from gmrdata.gmr import losses
from gmrdata.gmr.config import LossConfig, ModelConfig
from gmrdata.gmr.losses import Bodies, Motions, counts_of, gmr_loss, make_loss_bodies, vertex_l1_m
from gmrdata.gmr.model import Gmr
from gmrdata.gmr.rotations import to_rotmats
from gmrdata.values.body import BodyModel, vertex_rows, with_vertices
from gmrdata.values.skinning_torch import posed_vertices
from tests.gmr.direct_reading import direct_mesh_m

B, N = 3, 6
Kind = Literal["chordal", "angular", "axis-angle"]
Reduction = Literal["mean", "sum"]
KINDS: tuple[Kind, ...] = ("chordal", "angular", "axis-angle")
REDUCTIONS: tuple[Reduction, ...] = ("mean", "sum")


def random_motions(seed: int, angle_rad: float = 0.3) -> Motions:
    """Rotations by about that angle, round any axis."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(B * N, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angles_rad = angle_rad * rng.uniform(0.98, 1.0, (B * N, 1))
    rotmats = Rotation.from_rotvec(axes * angles_rad).as_matrix()
    return Motions(
        torch.as_tensor(rotmats.reshape(B, N, 3, 3)), torch.as_tensor(rng.normal(0, 0.1, (B, N, 3)))
    )


def random_bodies(
    body: BodyModel, seed: int, n_vertices: int | None = None, dtype: torch.dtype = torch.float64
) -> Bodies:
    rng = np.random.default_rng(seed)
    local = Rotation.from_rotvec(rng.normal(0, 0.4, (B * N * 23, 3))).as_matrix()
    return Bodies(
        make_loss_bodies([body], n_vertices, "cpu", dtype),
        torch.as_tensor(rng.normal(0, 1, (B, body.n_shape)), dtype=dtype),
        torch.as_tensor(local, dtype=dtype).reshape(B, N, 23, 3, 3),
    )


def bent_body(body: BodyModel) -> BodyModel:
    """The body with pose blend shapes, as SMPL has them."""
    pose_dirs_m = np.random.default_rng(9).normal(0, 0.01, (len(body.template_m), 3, 207))
    return replace(body, pose_dirs_m=pose_dirs_m)


def direct_terms(
    predicted: Motions, true: Motions, vertices_m: np.ndarray, lengths: list[int], kind: str
) -> dict[str, tuple[float, int]]:
    """Each equation as a plain loop: its sum and the number of its addends."""
    sums = dict.fromkeys(("orientation", "translation", "vertex", "smoothness"), 0.0)
    pairs = 0
    for b, n in enumerate(lengths):
        delta_rotmats = predicted.delta_rotmats[b].numpy()
        true_rotmats = true.delta_rotmats[b].numpy()
        delta_m, true_m = predicted.delta_m[b].numpy(), true.delta_m[b].numpy()
        for i in range(n):
            if kind == "chordal":
                sums["orientation"] += (
                    np.linalg.norm(delta_rotmats[i] - true_rotmats[i], "fro") ** 2
                )
            elif kind == "angular":
                relative = Rotation.from_matrix(delta_rotmats[i] @ true_rotmats[i].T)
                sums["orientation"] += relative.magnitude() ** 2
            else:
                vectors = Rotation.from_matrix([delta_rotmats[i], true_rotmats[i]]).as_rotvec()
                sums["orientation"] += np.linalg.norm(vectors[0] - vectors[1]) ** 2
            sums["translation"] += np.linalg.norm(delta_m[i] - true_m[i]) ** 2
            for v in vertices_m[b, i]:
                moved_m = delta_rotmats[i] @ v + delta_m[i] - true_rotmats[i] @ v - true_m[i]
                sums["vertex"] += np.abs(moved_m).sum()
        for i in range(n - 1):
            sums["smoothness"] += (
                np.linalg.norm(delta_rotmats[i] - delta_rotmats[i + 1], "fro") ** 2
            )
            pairs += 1
    counts = {"orientation": sum(lengths), "translation": sum(lengths), "smoothness": pairs}
    counts["vertex"] = sum(lengths) * vertices_m.shape[2]
    return {name: (sums[name], counts[name]) for name in sums}


@pytest.mark.parametrize("angle_rad", [1e-5, 0.3, np.pi - 1e-6])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("reduction", REDUCTIONS)
@pytest.mark.parametrize("lengths", [[N, N, N], [N, 2, 1]])
def test_terms_are_the_equations(small_body, kind, reduction, lengths, angle_rad):
    predicted, true = random_motions(1, angle_rad), random_motions(2, angle_rad)
    bodies = random_bodies(small_body, 3, n_vertices=20)
    part = with_vertices(small_body, vertex_rows(len(small_body.template_m), 20))
    vertices_m = posed_vertices(part, bodies.shape[:, None], bodies.local_rotmats).numpy()
    mask = torch.arange(N) < torch.tensor(lengths)[:, None]
    config = LossConfig(orientation_loss=kind, reduction=reduction)
    found = gmr_loss(predicted, true, mask, bodies, config)
    total = 0.0
    for name, (value, count) in direct_terms(predicted, true, vertices_m, lengths, kind).items():
        expected = value / count if reduction == "mean" else value / B
        if name == "vertex" and reduction == "sum":
            expected *= len(small_body.template_m) / 20
        assert found[name].item() == pytest.approx(expected, rel=1e-8), name
        total += {"smoothness": 1e-2}.get(name, 1.0) * expected
    assert found["loss"].item() == pytest.approx(total, rel=1e-8)


def test_weights_and_a_missing_vertex_term():
    predicted, true = random_motions(1), random_motions(2)
    config = LossConfig(orientation=2.0, translation=3.0, vertex=0.0, smoothness=5.0)
    found = gmr_loss(predicted, true, torch.ones(B, N, dtype=torch.bool), None, config)
    expected = 2 * found["orientation"] + 3 * found["translation"] + 5 * found["smoothness"]
    assert found["loss"].item() == pytest.approx(expected.item(), rel=1e-12)
    assert found["vertex"].item() == 0


def test_padding_has_no_value_and_no_gradient(small_body):
    predicted, true, bodies = random_motions(1), random_motions(2), random_bodies(small_body, 3)
    mask = torch.arange(N) < torch.tensor([4, 1, N])[:, None]
    leaves = [predicted.delta_rotmats.requires_grad_(), predicted.delta_m.requires_grad_()]
    gmr_loss(predicted, true, mask, bodies, LossConfig())["loss"].backward()
    for leaf in leaves:
        assert leaf.grad is not None
        assert leaf.grad[~mask].abs().max() == 0
        assert (leaf.grad[mask].abs().flatten(1).sum(-1) > 0).all()


@pytest.mark.parametrize("reduction", REDUCTIONS)
def test_parts_of_a_step_add_up(small_body, reduction):
    """Three processes with a window each, of different lengths: their mean is the whole's loss."""
    predicted, true, bodies = random_motions(1), random_motions(2), random_bodies(small_body, 3)
    mask = torch.arange(N) < torch.tensor([4, 1, N])[:, None]
    config = LossConfig(reduction=reduction)
    whole = gmr_loss(predicted, true, mask, bodies, config)
    parts = []
    for b in range(B):
        rows = slice(b, b + 1)
        parts.append(
            gmr_loss(
                Motions(predicted.delta_rotmats[rows], predicted.delta_m[rows]),
                Motions(true.delta_rotmats[rows], true.delta_m[rows]),
                mask[rows],
                Bodies(bodies.bodies, bodies.shape[rows], bodies.local_rotmats[rows]),
                config,
                counts_of(mask, processes=B),
            )
        )
    for name in ("loss", "orientation", "translation", "vertex", "smoothness"):
        mean = sum(part[name].item() for part in parts) / B
        assert mean == pytest.approx(whole[name].item(), rel=1e-12), name


@pytest.mark.parametrize("has_pose_dirs", [False, True])
@pytest.mark.parametrize("block_vertices", [1024, 37])
def test_vertex_term_is_eq_13_with_the_body_posed_twice(
    small_body, has_pose_dirs, block_vertices, monkeypatch
):
    """Value and gradient as if prediction and truth each went through the body under autograd."""
    monkeypatch.setattr(losses, "BLOCK_VERTICES", block_vertices)
    monkeypatch.setattr(losses, "CHUNK_BYTES", {"cpu": 12 * 8 * N * block_vertices * 2})
    body = bent_body(small_body) if has_pose_dirs else small_body
    bodies, true = random_bodies(body, 0), random_motions(2)

    def leaves() -> Motions:
        made = random_motions(1)
        return Motions(made.delta_rotmats.requires_grad_(), made.delta_m.requires_grad_())

    ours, direct = leaves(), leaves()
    weights = torch.rand(B, N, dtype=torch.float64, generator=torch.manual_seed(0))
    short = vertex_l1_m(
        ours.delta_rotmats - true.delta_rotmats, ours.delta_m - true.delta_m, bodies
    )
    (short * weights).sum().backward()
    meshes_m = [
        direct_mesh_m(body, bodies.shape[:, None], m.delta_rotmats, m.delta_m, bodies.local_rotmats)
        for m in (direct, true)
    ]
    long = (meshes_m[0] - meshes_m[1]).abs().sum(-1).mean(-1)
    (long * weights).sum().backward()
    torch.testing.assert_close(short, long, rtol=1e-10, atol=0)
    assert ours.delta_rotmats.grad is not None
    assert ours.delta_m.grad is not None
    torch.testing.assert_close(
        ours.delta_rotmats.grad, direct.delta_rotmats.grad, rtol=1e-8, atol=1e-10
    )
    torch.testing.assert_close(ours.delta_m.grad, direct.delta_m.grad, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("has_pose_dirs", [False, True])
def test_weights_get_the_direct_readings_gradient_in_single_precision(small_body, has_pose_dirs):
    """To 1e-5 of its length, through the network, in the numbers that a training has."""
    body = bent_body(small_body) if has_pose_dirs else small_body
    bodies, true = random_bodies(body, 0, dtype=torch.float32), random_motions(2)
    true = Motions(true.delta_rotmats.float(), true.delta_m.float())
    torch.manual_seed(0)
    model = Gmr(ModelConfig(layers=1, hidden=16))
    poses = torch.randn(B, N, 92)

    def gradient_of(direct: bool) -> tuple[float, torch.Tensor]:
        model.zero_grad()
        delta_rotmats, delta_m = model(poses)
        if direct:
            shape, local = bodies.shape[:, None], bodies.local_rotmats
            predicted_m = direct_mesh_m(body, shape, delta_rotmats, delta_m, local)
            true_m = direct_mesh_m(body, shape, true.delta_rotmats, true.delta_m, local)
            loss = (predicted_m - true_m).abs().sum(-1).mean()
        else:
            loss = vertex_l1_m(
                delta_rotmats - true.delta_rotmats, delta_m - true.delta_m, bodies
            ).mean()
        loss.backward()
        return loss.item(), torch.nn.utils.parameters_to_vector(
            p.grad for p in model.parameters() if p.grad is not None
        )

    (value, gradient), (direct_value, direct_gradient) = gradient_of(False), gradient_of(True)
    assert value == pytest.approx(direct_value, rel=1e-5)
    assert (gradient - direct_gradient).norm() < 1e-5 * direct_gradient.norm()


@pytest.mark.parametrize("reduction", REDUCTIONS)
def test_a_vertex_subset_estimates_the_whole(small_body, reduction):
    predicted, true = random_motions(1), random_motions(2)
    mask = torch.ones(B, N, dtype=torch.bool)
    config = LossConfig(reduction=reduction)
    whole, part = (
        gmr_loss(predicted, true, mask, random_bodies(small_body, 3, n), config)["vertex"].item()
        for n in (None, 112)
    )
    assert part == pytest.approx(whole, rel=0.03)
    assert part != whole


def test_vertex_rows_are_spread_and_ascending(small_body):
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


@pytest.mark.parametrize("angle_rad", [0.0, 1e-8, 1e-4, 0.1, 1.0, 3.0, np.pi - 1e-3])
@pytest.mark.parametrize("reduction", REDUCTIONS)
@pytest.mark.parametrize("term", [*KINDS, "translation", "vertex", "smoothness"])
def test_gradients_by_finite_differences(small_body, term, reduction, angle_rad):
    """Each term's gradient through the network's output, at predictions of 0 to nearly pi."""
    axes = np.array([[0.6, -0.48, 0.64], [0.8, 0.6, 0.0], [-0.28, 0.96, 0.0]])
    delta_m = np.array([[0.03, -0.02, 0.05], [0.1, 0.0, -0.04], [-0.07, 0.02, 0.01]])
    values = torch.tensor(np.concatenate([angle_rad * axes, delta_m], axis=1)[None])
    # The truth lies aside, and by less than pi from each prediction: at pi the angle has a kink.
    aside = expm(0.02 * np.cross(np.eye(3), [1.0, 0.5, -0.3]))
    true = Motions(
        torch.as_tensor(aside).expand(1, 3, 3, 3),
        torch.tensor([0.01, 0.02, 0.03], dtype=torch.float64).expand(1, 3, 3),
    )
    some = random_bodies(small_body, 4, n_vertices=40)
    bodies = Bodies(some.bodies, some.shape[:1], some.local_rotmats[:1, :3])
    kind = term if term in KINDS else "chordal"
    config = LossConfig.model_validate({"orientation_loss": kind, "reduction": reduction})
    seen = bodies if term == "vertex" else None  # the costly term, which no other depends on
    mask = torch.tensor([[True, True, True]])

    def loss(values: torch.Tensor) -> torch.Tensor:
        rotmats = to_rotmats(values[..., :3], "axis-angle")
        terms = gmr_loss(Motions(rotmats, values[..., 3:]), true, mask, seen, config)
        return terms["orientation" if term in KINDS else term]

    # A step so short that no vertex of eq. 13 passes the kink of its L1 norm.
    leaf = values.requires_grad_()
    assert torch.autograd.gradcheck(loss, (leaf,), eps=1e-7, atol=1e-6, rtol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("angle_rad", [0.0, 1e-12, 1e-7, np.pi - 1e-7, np.pi, np.pi + 1e-7])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_gradients_are_finite_at_0_and_pi(small_body, kind, angle_rad, dtype):
    """Prediction and truth equal, opposite, or both at half a turn."""
    axis = torch.tensor([0.6, -0.48, 0.64], dtype=dtype)
    some = random_bodies(small_body, 4, n_vertices=2, dtype=dtype)
    bodies = Bodies(some.bodies, some.shape[:1], some.local_rotmats[:1, :1])
    for true_angle_rad in (0.0, np.pi):
        values = (angle_rad * axis).requires_grad_()
        true_rotmats = to_rotmats(true_angle_rad * axis, "axis-angle")[None, None]
        found = gmr_loss(
            Motions(
                to_rotmats(values[None, None], "axis-angle"), torch.zeros(1, 1, 3, dtype=dtype)
            ),
            Motions(true_rotmats, torch.zeros(1, 1, 3, dtype=dtype)),
            torch.ones(1, 1, dtype=torch.bool),
            bodies,
            LossConfig(orientation_loss=kind),
        )
        found["loss"].backward()
        assert torch.isfinite(found["loss"])
        assert values.grad is not None
        assert torch.isfinite(values.grad).all()


def test_each_window_is_posed_on_its_own_body(small_body):
    """Value and gradient of a batch with two bodies are those of each body alone."""
    other = replace(
        small_body,
        template_m=1.2 * small_body.template_m,
        joints_template_m=1.2 * small_body.joints_template_m,
    )
    one, two = random_bodies(small_body, 5), random_bodies(other, 5)
    numbers = torch.tensor([1, 0, 1])
    mixed = Bodies((*one.bodies, *two.bodies), one.shape, one.local_rotmats, numbers)
    predicted, true = random_motions(1, 0.3), random_motions(2, 0.3)
    found = []
    for people in (one, two, mixed):
        turns = (predicted.delta_rotmats - true.delta_rotmats).detach().requires_grad_()
        moves = (predicted.delta_m - true.delta_m).detach().requires_grad_()
        means_m = vertex_l1_m(turns, moves, people)
        (means_m * torch.arange(1.0, 1.0 + means_m.numel()).reshape(means_m.shape)).sum().backward()
        found.append((means_m.detach(), turns.grad, moves.grad))
    for of_one, of_two, of_both in zip(*found, strict=True):
        assert of_one is not None and of_two is not None and of_both is not None
        expected = torch.stack([of_two[0], of_one[1], of_two[2]])
        torch.testing.assert_close(of_both, expected)


@pytest.mark.parametrize("kind", KINDS)
def test_lengths_of_errors_are_their_means_and_have_a_slope_everywhere(kind):
    """A chordal distance of small angles is the angle times the root of 2."""
    true, mask = random_motions(1), torch.ones(B, N, dtype=torch.bool)
    mask[1, 4:] = False
    turn = torch.as_tensor(Rotation.from_rotvec([0, 0.02, 0]).as_matrix())
    still = Motions(turn.expand(B, N, 3, 3), torch.zeros(B, N, 3, dtype=torch.float64))
    config = LossConfig(error="length", vertex=0.0, smoothness=0.0, orientation_loss=kind)
    at_rest = Motions(torch.eye(3).double().expand(B, N, 3, 3), true.delta_m)
    terms = gmr_loss(still, at_rest, mask, None, config)
    root = np.sqrt(2) if kind == "chordal" else 1.0
    assert terms["orientation"].item() == pytest.approx(0.02 * root, rel=2e-3)
    lengths_m = true.delta_m.norm(dim=-1)[mask]
    assert terms["translation"].item() == pytest.approx(lengths_m.mean().item(), rel=1e-3)
    assert terms["loss"] == terms["orientation"] + terms["translation"]
    delta_m = true.delta_m.clone().requires_grad_()
    exact = gmr_loss(Motions(true.delta_rotmats, delta_m), true, mask, None, config)
    exact["loss"].backward()
    assert delta_m.grad is not None and delta_m.grad.abs().max() == 0
