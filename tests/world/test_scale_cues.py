"""Scale from the ground and from a data set's own path, with cameras that are known exactly."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.film.programmes import Circular, Linear, Programme, Small, camera_path
from gmrdata.motion.gait import make_gait
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import apply, invert, rigid
from gmrdata.world.compose import motion_in_camera
from gmrdata.world.planted_feet import SeenFeet, foot_points_m, ground_contact_scale
from gmrdata.world.recipe import CueEstimate, ScaleConfig
from gmrdata.world.scale import SeenPerson, estimate_scale, short_windows_scale

CONFIG = ScaleConfig()
UNIT_M = 0.37
WORLD = rigid(Rotation.from_rotvec([0.4, 1.0, -2.0]).as_matrix(), np.array([3.0, -1.0, 2.0]))


def walk(
    body: BodyModel, programme: Programme, seed: int = 3, n_seconds: float = 4.8
) -> tuple[Motion, CameraPath]:
    motion = make_gait("walk", n_seconds, 30.0, body, np.random.default_rng(seed))
    rng = np.random.default_rng(seed)
    return motion, camera_path(programme, motion.pelvis_m, 30.0, 640, 360, 60.0, rng)


def reconstructed(path: CameraPath, points_m: np.ndarray) -> tuple[CameraPath, np.ndarray]:
    """Path and points in another world and another unit."""
    moved = WORLD @ path.world_from_cam
    moved[:, :3, 3] /= UNIT_M
    return replace(path, world_from_cam=moved), apply(WORLD, points_m) / UNIT_M


def scenery(motion: Motion, noise_m: float, n_ground: int, seed: int = 0) -> np.ndarray:
    """Points of a floor round the person's path, of a table beside it and of a wall."""
    rng = np.random.default_rng(seed)
    middle = motion.pelvis_m.mean(axis=0) * [1, 1, 0]
    floor = np.c_[rng.uniform(-6, 6, (n_ground, 2)), np.zeros(n_ground)]
    table = np.c_[rng.uniform([0.5, 0.5], [1.5, 1.5], (60, 2)), np.full(60, 0.35)]
    wall = np.c_[rng.uniform(-6, 6, 200), np.full(200, 2.0), rng.uniform(0, 3, 200)]
    points = np.concatenate([floor, table, wall]) + middle
    return points + rng.normal(0, noise_m, points.shape)


def ground_cue(
    motion: Motion, path: CameraPath, points_m: np.ndarray, body: BodyModel, rough: float
) -> CueEstimate | None:
    found, points = reconstructed(path, points_m)
    person = motion_in_camera(motion, path.world_from_cam)
    feet_cam_m = foot_points_m(body, person)
    up_cam = person.root_rotmats[:, :, 1]
    seen = SeenFeet(found, feet_cam_m, up_cam, 30.0)
    return ground_contact_scale(seen, points, rough, CONFIG)


@pytest.mark.parametrize("programme", [Circular(), Linear(), Small()], ids=str)
@pytest.mark.parametrize("rough", [0.85, 1.0, 1.15])
def test_soles_on_the_ground_tell_the_scale(
    programme: Programme, rough: float, small_body: BodyModel
) -> None:
    motion, path = walk(small_body, programme)
    cue = ground_cue(motion, path, scenery(motion, 0.01, 600), small_body, rough * UNIT_M)
    assert cue is not None and cue.name == "ground_contact" and cue.support > 50
    assert cue.scale == pytest.approx(UNIT_M, rel=0.012)
    assert abs(cue.scale - UNIT_M) < 2 * cue.sigma < 0.06 * UNIT_M


@pytest.mark.parametrize("lean_deg", [12, 24])
def test_the_foot_in_the_air_and_a_person_who_leans_do_not_lower_the_camera(
    lean_deg: float, small_body: BodyModel
) -> None:
    """The left foot is on the ground heel and all; the right one, in front, waits 4 cm above it."""
    motion, path = walk(small_body, Circular())
    middle_m = motion.pelvis_m.mean(axis=0) * [1, 1, 0]
    sole_m = np.array([[0, 0, 0.07], [0.1, 0, 0.03], [-0.05, 0, 0], [0.15, 0, 0], [0.2, 0, 0.005]])
    feet_m = middle_m + np.stack([sole_m, sole_m + np.array([0.6, 0.2, 0.04])])
    cam_from_world = invert(path.world_from_cam)
    feet_cam_m = apply(cam_from_world, np.tile(feet_m.reshape(-1, 3), (path.n_frames, 1, 1)))
    lean = Rotation.from_euler("y", lean_deg, degrees=True).apply([0.0, 0.0, 1.0])
    found, points = reconstructed(path, scenery(motion, 0.0, 600))
    feet_cam_m, up_cam = feet_cam_m.reshape(-1, 2, 5, 3), cam_from_world[:, :3, :3] @ lean
    seen = SeenFeet(found, feet_cam_m, up_cam, 30.0)
    cue = ground_contact_scale(seen, points, 0.9 * UNIT_M, CONFIG)
    assert cue is not None and cue.scale == pytest.approx(UNIT_M, rel=1e-4)


def test_without_a_ground_there_is_no_such_cue(small_body: BodyModel) -> None:
    motion, path = walk(small_body, Circular())
    wall_m = scenery(motion, 0.01, 0)[60:]
    assert ground_cue(motion, path, wall_m, small_body, UNIT_M) is None
    assert ground_cue(motion, path, np.zeros((0, 3)), small_body, UNIT_M) is None
    low = replace(path, world_from_cam=path.world_from_cam.copy())
    low.world_from_cam[:, 2, 3] = 0.2  # a camera near the ground sees it too flat
    assert ground_cue(motion, low, scenery(motion, 0.01, 600), small_body, UNIT_M) is None


def drifting(path: CameraPath, drift_m: float, seed: int) -> np.ndarray:
    """A path that drifts slowly by so much over the clip, and trembles by a millimetre."""
    rng = np.random.default_rng(seed)
    n = path.n_frames
    direction = rng.normal(size=3)
    way = np.sin(np.linspace(0, np.pi / 2, n))[:, None] * direction / np.linalg.norm(direction)
    dataset_camera = path.world_from_cam.copy()
    dataset_camera[:, :3, 3] += drift_m * way + rng.normal(0, 0.001, (n, 3))
    turns = np.linspace(0, np.deg2rad(5), n)[:, None] * [0.0, 0.0, 1.0]
    turned = rigid(Rotation.from_rotvec(turns).as_matrix(), np.zeros(3))
    return np.asarray(turned @ dataset_camera)


def test_a_data_sets_own_path_tells_the_scale_where_it_drifts_little(
    small_body: BodyModel,
) -> None:
    inside = 0
    for seed in range(8):
        _, path = walk(small_body, Circular(), seed)
        found, _ = reconstructed(path, np.zeros((0, 3)))
        exact = short_windows_scale(found, path.world_from_cam, 30.0, CONFIG)
        assert exact is not None and exact.scale == pytest.approx(UNIT_M, rel=1e-9)
        cue = short_windows_scale(found, drifting(path, 0.4, seed), 30.0, CONFIG)
        assert cue is not None and cue.name == "short_windows"
        assert cue.scale == pytest.approx(UNIT_M, rel=0.15)
        inside += abs(cue.scale - UNIT_M) < 2 * cue.sigma
    assert inside >= 7


def test_frames_that_either_path_lacks_are_left_out(small_body: BodyModel) -> None:
    _, path = walk(small_body, Linear())
    found, _ = reconstructed(path, np.zeros((0, 3)))
    found.world_from_cam[5:9] = np.nan
    dataset_camera = path.world_from_cam.copy()
    dataset_camera[60:] = np.nan
    cue = short_windows_scale(found, dataset_camera, 30.0, CONFIG)
    assert cue is not None and cue.scale == pytest.approx(UNIT_M, rel=1e-9)
    dataset_camera[:] = np.nan
    assert short_windows_scale(found, dataset_camera, 30.0, CONFIG) is None
    still = np.tile(np.eye(4), (path.n_frames, 1, 1))
    assert short_windows_scale(replace(path, world_from_cam=still), still, 30.0, CONFIG) is None


def test_all_cues_together_are_better_than_feet_alone(small_body: BodyModel) -> None:
    motion, path = walk(small_body, Circular())
    found, points = reconstructed(path, scenery(motion, 0.01, 600))
    person = motion_in_camera(motion, path.world_from_cam)
    feet = estimate_scale([SeenPerson(person, small_body, found)], "full", CONFIG)
    every = estimate_scale(
        [SeenPerson(person, small_body, found)],
        "full",
        CONFIG,
        points=points,
        dataset_camera=drifting(path, 0.3, 0),
    )
    assert [cue.name for cue in every.cues] == ["planted_feet", "ground_contact", "short_windows"]
    assert feet.sigma is not None and every.sigma is not None and every.scale is not None
    assert every.sigma < feet.sigma
    assert abs(every.scale - UNIT_M) < 2 * every.sigma
    assert every.disagreement is not None and every.disagreement < 2


def test_the_ground_is_found_though_steps_are_too_short(anny: BodyModel) -> None:
    """As of poses from pictures, whose planted feet seem to creep."""
    motion, path = walk(anny, Circular(rate_deg_per_s=25.0))
    local = motion.local_rotmats.copy()
    for hip in (0, 1):
        turns = Rotation.from_matrix(local[:, hip]).as_rotvec()
        local[:, hip] = Rotation.from_rotvec(0.3 * turns).as_matrix()
    found, points = reconstructed(path, scenery(motion, 0.005, 400))
    person = motion_in_camera(replace(motion, local_rotmats=local), path.world_from_cam)
    estimate = estimate_scale([SeenPerson(person, anny, found)], "full", CONFIG, points=points)
    feet, ground = estimate.cues
    assert feet.scale < 0.8 * UNIT_M
    assert ground.scale == pytest.approx(UNIT_M, rel=0.05)
