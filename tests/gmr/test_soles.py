"""Soles that hold a predicted motion, against a body that stands, and scipy's least squares."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from gmrdata.gmr.augmentation import mirror_local, mirror_points_m, mirror_rotmats
from gmrdata.gmr.config import ModelConfig
from gmrdata.gmr.infer import predict_at_source_rate
from gmrdata.gmr.model import Gmr
from gmrdata.gmr.predict import TrainedGmr, predict_deltas, predict_world_motion
from gmrdata.gmr.soles import (
    SLIP_SIGMA_M_PER_S,
    STEP_SIGMA_M_PER_S,
    STILL_M_PER_S,
    TURN_SIGMA_RAD_PER_S,
    held_by_soles,
    sole_points_m,
)
from gmrdata.motion.gait import embedded_motions
from gmrdata.motion.resample import resample
from gmrdata.read.bodies import load_body
from gmrdata.values.body import WORLD_FROM_REST
from gmrdata.values.motion import Motion, deltas, without_root
from gmrdata.world.planted_feet import SOLE_POINTS, foot_points_m
from tests.gmr.test_model import random_poses

FPS_HZ = 10.0


@pytest.fixture(scope="module")
def walker() -> Motion:
    """A generated walk, made as large as the mean skeleton walks it."""
    rng, body = np.random.default_rng(3), load_body("anny")
    motion = embedded_motions(body, rng, count=1, fps_hz=FPS_HZ, duration_s=4.0)[0]
    own, mean = (sole_heights_m(body, shape) for shape in (motion.shape, 0 * motion.shape))
    return replace(motion, shape=0 * motion.shape, pelvis_m=motion.pelvis_m * mean / own)


def sole_heights_m(body, shape):
    """How far the soles are below the pelvis in the rest pose."""
    return body.rest_pelvis_m(shape)[1] - body.rest_vertices_m(shape)[:, 1].min()


def held_motions(local_rotmats, rotmats, delta_m, fps_hz=FPS_HZ):
    """`held_by_soles` of arrays."""
    between = torch.as_tensor(rotmats), torch.as_tensor(delta_m)
    found = held_by_soles(torch.as_tensor(local_rotmats), between, fps_hz)
    return tuple(values.numpy() for values in found)


def moved_m(local_rotmats, rotmats, delta_m):
    """What each point of the soles moves by in each motion (T-1, 6, 3)."""
    points_m = sole_points_m(torch.as_tensor(local_rotmats)).numpy()
    ends_m = points_m[1:] @ rotmats.swapaxes(-1, -2)
    return ends_m + delta_m[:, None] - points_m[:-1]


def angles_deg(rotmats, true_rotmats):
    wrong = rotmats.swapaxes(-1, -2) @ true_rotmats
    return np.rad2deg(np.linalg.norm(Rotation.from_matrix(wrong).as_rotvec(), axis=1))


def test_the_points_are_those_of_the_default_body(walker):
    """Skinning bends a sole's front a little, the mean skeleton's is stiff."""
    points_m = foot_points_m(load_body("anny"), without_root(walker))[:, :, SOLE_POINTS]
    pelvis_m = without_root(walker).pelvis_m
    wanted_m = points_m.reshape(walker.n_frames, 6, 3) - pelvis_m[:, None]
    found_m = sole_points_m(torch.as_tensor(walker.local_rotmats)).numpy()
    assert np.abs(found_m - wanted_m).max() < 0.025
    t_pose = np.broadcast_to(np.eye(3), (1, 23, 3, 3))
    still = replace(walker.take(slice(1)), local_rotmats=t_pose.copy(), shape=walker.shape * 0)
    wanted_m = foot_points_m(load_body("anny"), without_root(still))[0, :, SOLE_POINTS]
    found_m = sole_points_m(torch.as_tensor(t_pose.copy())).numpy()[0]
    np.testing.assert_allclose(found_m, wanted_m.reshape(6, 3), atol=0.0015)


def test_who_stands_on_both_feet_keeps_them_there():
    """A network that turns by 6 degrees a second, and glides at 3 cm/s."""
    poses = np.tile(np.eye(3), (3, 23, 1, 1))
    rotmats = np.tile(Rotation.from_rotvec([0.0, np.deg2rad(0.6), 0.0]).as_matrix(), (2, 1, 1))
    delta_m = np.tile([0.0, 0.0, 0.003], (2, 1))
    found, found_m = held_motions(poses, rotmats, delta_m)
    assert angles_deg(found, np.eye(3)).max() < 0.4
    slid_m = np.abs(moved_m(poses, rotmats, delta_m)).max()
    assert np.abs(moved_m(poses, found, found_m)).max() < 0.5 * slid_m


def test_feet_of_a_walk_slide_by_less(walker):
    true_rotmats, true_m = deltas(walker.root_rotmats, walker.pelvis_m)
    wrong = true_rotmats @ Rotation.from_rotvec([0.0, np.deg2rad(0.6), 0.0]).as_matrix()
    rotmats, delta_m = held_motions(walker.local_rotmats, wrong, true_m)
    assert angles_deg(rotmats, true_rotmats).mean() < 0.5
    true_moves_m, before_m, after_m = (
        np.linalg.norm(moved_m(walker.local_rotmats, *motions), axis=-1)
        for motions in ((true_rotmats, true_m), (wrong, true_m), (rotmats, delta_m))
    )
    still = true_moves_m < 0.003
    assert still.any(axis=1).mean() > 0.5
    assert np.median(after_m[still]) < 0.85 * np.median(before_m[still])


def test_who_flies_stays_as_the_network_has_it():
    """No point moves by less than 2 m/s."""
    poses = np.broadcast_to(np.eye(3), (5, 23, 3, 3)).copy()
    rotmats = np.tile(np.eye(3), (4, 1, 1))
    delta_m = np.tile([0.0, 0.05, 0.3], (4, 1))
    found, found_m = held_motions(poses, rotmats, delta_m)
    assert angles_deg(found, rotmats).max() < 0.05
    np.testing.assert_allclose(found_m, delta_m, atol=1e-3)


def test_it_is_the_least_of_its_sum():
    """Beside scipy's minimum, for legs that bend by a fraction of a degree."""
    rng = np.random.default_rng(2)
    small = Rotation.from_rotvec(rng.normal(scale=0.004, size=(2 * 23, 3))).as_matrix()
    poses = small.reshape(2, 23, 3, 3)
    rotmats = Rotation.from_rotvec([[0.01, 0.03, -0.01]]).as_matrix()
    delta_m = np.array([[0.004, -0.002, 0.006]])
    found, found_m = held_motions(poses, rotmats, delta_m)

    def total(numbers):
        turn, step = numbers[:3], numbers[3:]
        turned = Rotation.from_rotvec(turn / FPS_HZ).as_matrix() @ rotmats
        moved = FPS_HZ * moved_m(poses, turned, delta_m + step / FPS_HZ)
        squares = (moved**2).sum(-1)
        # Geman and McClure's function, of which the weights are the derivative.
        points = squares / (1 + squares / STILL_M_PER_S**2) / SLIP_SIGMA_M_PER_S**2
        prior = ((turn / TURN_SIGMA_RAD_PER_S) ** 2).sum() + (step**2).sum() / STEP_SIGMA_M_PER_S**2
        return points.sum() + prior

    least = minimize(total, np.zeros(6), tol=1e-12).x
    turn = FPS_HZ * Rotation.from_matrix(found @ rotmats.swapaxes(-1, -2)).as_rotvec()[0]
    np.testing.assert_allclose(turn, least[:3], atol=3e-3)
    np.testing.assert_allclose(FPS_HZ * (found_m - delta_m)[0], least[3:], atol=1e-3)


def test_a_mirror_image_is_held_as_its_mirror_image():
    poses = random_poses(6).numpy()
    rng = np.random.default_rng(4)
    rotmats = Rotation.from_rotvec(rng.normal(scale=0.02, size=(5, 3))).as_matrix()
    delta_m = rng.normal(scale=0.01, size=(5, 3))
    found, found_m = held_motions(poses, rotmats, delta_m)
    mirrored = mirror_local(poses), mirror_rotmats(rotmats), mirror_points_m(delta_m)
    there, there_m = held_motions(*mirrored)
    np.testing.assert_allclose(mirror_rotmats(there), found, atol=1e-9)
    np.testing.assert_allclose(mirror_points_m(there_m), found_m, atol=1e-9)


def test_a_slow_motion_is_corrected_alike_at_any_rate():
    """Rates of motions over a tenth and over a thirtieth of a second."""
    turn, pace = np.array([0.05, 0.2, -0.04]), np.array([0.03, 0.01, 0.08])
    rates = []
    for fps_hz in (10.0, 30.0):
        poses = np.broadcast_to(np.eye(3), (2, 23, 3, 3)).copy()
        rotmats = Rotation.from_rotvec(turn[None] / fps_hz).as_matrix()
        found, found_m = held_motions(poses, rotmats, pace[None] / fps_hz, fps_hz)
        rates.append(np.r_[Rotation.from_matrix(found[0]).as_rotvec(), found_m[0]] * fps_hz)
    np.testing.assert_allclose(*rates, atol=3e-3)
    assert np.linalg.norm(rates[0][:3]) < 0.75 * np.linalg.norm(turn)


def test_a_network_asks_soles_only_if_its_config_says_so(walker):
    torch.manual_seed(0)
    config = ModelConfig(layers=1, hidden=6, output_scale=0.1)
    model = Gmr(config).eval()
    plain = predict_deltas(TrainedGmr(model, FPS_HZ, "plain", 3), walker.local_rotmats)
    model.config = config.model_copy(update={"soles_hold": True})
    asked = TrainedGmr(model, FPS_HZ, "asked", 3)
    found = predict_deltas(asked, walker.local_rotmats)
    wanted = held_motions(walker.local_rotmats, *plain)
    # Of rounded answers, which `plain` has made orthonormal.
    np.testing.assert_allclose(found[0], wanted[0], atol=1e-6)
    np.testing.assert_allclose(found[1], wanted[1], atol=1e-6)
    # At the network's own rate nothing is between its moments.
    world = predict_at_source_rate(asked, walker)
    np.testing.assert_allclose(deltas(world.root_rotmats, world.pelvis_m)[0], found[0], atol=1e-9)


@pytest.mark.parametrize("fps_hz", [30.0, 25.0, 120.0])
def test_the_networks_moments_stand_and_soles_hold_between_them(fps_hz):
    """A glide by which feet would slide."""
    model = Gmr(ModelConfig(layers=1, hidden=2, soles_hold=True)).eval()
    with torch.no_grad():
        model.regression.weight.zero_()
        model.regression.bias.copy_(torch.tensor([0.0, 0.02, 0.0, 0.0, 0.0, 0.01]))
    gmr = TrainedGmr(model, FPS_HZ, "gliding", 3)
    rng, body = np.random.default_rng(3), load_body("anny")
    motion = embedded_motions(body, rng, count=1, fps_hz=fps_hz, duration_s=3.0)[0]
    seen = predict_world_motion(gmr, motion, first_root_rotmat=WORLD_FROM_REST)
    world = predict_at_source_rate(gmr, motion)
    whole = np.arange(seen.n_frames) * fps_hz / FPS_HZ
    on_frame = np.abs(whole - whole.round()) < 1e-6
    rows = whole.round().astype(int)[on_frame]
    np.testing.assert_allclose(world.pelvis_m[rows], seen.pelvis_m[on_frame], atol=1e-9)
    np.testing.assert_allclose(world.root_rotmats[rows], seen.root_rotmats[on_frame], atol=1e-9)
    back = resample(seen, fps_hz)
    assert not np.allclose(world.pelvis_m[: back.n_frames], back.pelvis_m, atol=1e-4)
    slid = [
        np.quantile(np.linalg.norm(moved_m(motion.local_rotmats[:n], *deltas(*path)), axis=-1), 0.1)
        for n, path in (
            (back.n_frames, (back.root_rotmats, back.pelvis_m)),
            (motion.n_frames, (world.root_rotmats, world.pelvis_m)),
        )
    ]
    assert slid[1] < slid[0]
