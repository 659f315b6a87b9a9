"""What each camera programme promises."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from scipy.spatial.transform import Rotation

from gmrdata.film.programmes import (
    Circular,
    Linear,
    LinearPanning,
    Panning,
    Programme,
    Small,
    Static,
    camera_path,
)
from gmrdata.values.camera import CameraPath, in_frame, person_box
from gmrdata.values.errors import BadMotionFile, BadRecipe

FPS_HZ, N_FRAMES = 10.0, 48
PROGRAMMES = (
    Circular(),
    Circular(direction="clockwise", rate_deg_per_s=30),
    Linear(),
    Linear(look="subject"),
    Linear(move="dolly"),
    Panning(),
    LinearPanning(),
    LinearPanning(move="dolly"),
    Small(),
    Static(),
)
programmes = st.sampled_from(PROGRAMMES)


@st.composite
def walks(draw: st.DrawFn) -> np.ndarray:
    """Pelvis paths (48, 3) of people who walk, turn or stand, anywhere, in any direction."""
    speed, turn = draw(st.floats(0, 1.6)), draw(st.floats(-0.4, 0.4))
    heading = draw(st.floats(-np.pi, np.pi))
    start = np.array([draw(st.floats(-20, 20)), draw(st.floats(-20, 20))])
    time_s = np.arange(N_FRAMES) / FPS_HZ
    angle = heading + turn * time_s
    steps = speed / FPS_HZ * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    bob = 0.93 + 0.025 * np.sin(2 * np.pi * 1.9 * time_s)
    return np.c_[start + np.cumsum(steps, axis=0), bob]


def film(programme: Programme, pelvis: np.ndarray, seed: int = 0) -> CameraPath:
    return camera_path(programme, pelvis, FPS_HZ, 640, 360, 60.0, np.random.default_rng(seed))


def turn_deg(camera: CameraPath) -> np.ndarray:
    rotmats = camera.world_from_cam[:, :3, :3]
    trace = np.einsum("ij,tij->t", rotmats[0], rotmats)
    return np.rad2deg(np.arccos(np.clip((trace - 1) / 2, -1, 1)))


@given(programmes, walks(), st.integers(0, 2**32 - 1))
def test_every_programme_gives_real_cameras_with_the_person_in_frame(
    programme: Programme, pelvis: np.ndarray, seed: int
) -> None:
    camera = film(programme, pelvis, seed)
    rotmats = camera.world_from_cam[:, :3, :3]
    assert camera.n_frames == N_FRAMES and camera.has_camera.all()
    assert np.isfinite(camera.world_from_cam).all()
    np.testing.assert_allclose(
        rotmats @ np.swapaxes(rotmats, -1, -2), np.tile(np.eye(3), (N_FRAMES, 1, 1)), atol=1e-9
    )
    np.testing.assert_allclose(np.linalg.det(rotmats), 1.0, atol=1e-9)
    assert in_frame(camera, person_box(pelvis)).mean() == 1.0
    assert np.linalg.norm(camera.centres_world_m - pelvis, axis=1).min() > 1.0
    again = film(programme, pelvis, seed)
    assert again.world_from_cam.tobytes() == camera.world_from_cam.tobytes()


@settings(max_examples=20)
@given(walks(), st.sampled_from(["clockwise", "counterclockwise"]), st.floats(20, 30))
def test_circular_keeps_its_distance_and_turns_far(
    pelvis: np.ndarray, direction: str, rate_deg_per_s: float
) -> None:
    programme = TypeAdapter(Programme).validate_python(
        {"kind": "circular", "direction": direction, "rate_deg_per_s": rate_deg_per_s}
    )
    centres = film(programme, pelvis).centres_world_m
    middle = (pelvis.min(axis=0) + pelvis.max(axis=0))[:2] / 2
    arms = centres[:, :2] - middle
    distance = np.linalg.norm(arms, axis=1)
    np.testing.assert_allclose(distance, distance[0], rtol=1e-9)
    angles_deg = np.rad2deg(np.unwrap(np.arctan2(arms[:, 1], arms[:, 0])))
    sign = 1 if direction == "counterclockwise" else -1
    total_deg = rate_deg_per_s * (N_FRAMES - 1) / FPS_HZ
    np.testing.assert_allclose(angles_deg[-1] - angles_deg[0], sign * total_deg, rtol=1e-6)
    np.testing.assert_allclose(centres[:, 2], programme.height_m)


@settings(max_examples=20)
@given(walks())
def test_panning_is_a_pure_rotation(pelvis: np.ndarray) -> None:
    camera = film(Panning(), pelvis)
    assert np.all(camera.centres_world_m == camera.centres_world_m[0])


def test_panning_follows_a_walk_across_the_picture() -> None:
    pelvis = np.c_[np.arange(N_FRAMES) * 0.13, np.zeros(N_FRAMES), np.full(N_FRAMES, 0.93)]
    assert turn_deg(film(Panning(), pelvis))[-1] > 40


@settings(max_examples=20)
@given(walks(), st.sampled_from(["truck", "dolly"]))
def test_linear_translates_only_at_constant_speed_on_a_line(pelvis: np.ndarray, move: str) -> None:
    camera = film(TypeAdapter(Programme).validate_python({"kind": "linear", "move": move}), pelvis)
    np.testing.assert_allclose(turn_deg(camera), 0, atol=1e-5)
    steps = np.diff(camera.centres_world_m, axis=0)
    np.testing.assert_allclose(steps, np.tile(steps[0], (N_FRAMES - 1, 1)), atol=1e-9)
    assert np.linalg.norm(steps[0]) * FPS_HZ >= 0.3 - 1e-9


def test_linear_panning_does_both() -> None:
    pelvis = np.c_[np.arange(N_FRAMES) * 0.13, np.zeros(N_FRAMES), np.full(N_FRAMES, 0.93)]
    camera = film(LinearPanning(), pelvis)
    steps = np.diff(camera.centres_world_m, axis=0)
    np.testing.assert_allclose(steps, np.tile(steps[0], (N_FRAMES - 1, 1)), atol=1e-9)
    assert turn_deg(camera)[-1] > 15
    assert np.linalg.norm(steps[0]) * FPS_HZ > 0.5


def test_small_drifts_by_centimetres() -> None:
    pelvis = np.tile([1.0, 2.0, 0.93], (300, 1))
    centres = film(Small(drift_m=0.03), pelvis, seed=3).centres_world_m
    spread_m = centres.std(axis=0)
    assert np.all((spread_m > 0.01) & (spread_m < 0.05))
    assert turn_deg(film(Small(), pelvis)).max() < 4


def test_static_does_not_move() -> None:
    pelvis = np.c_[np.arange(N_FRAMES) * 0.05, np.zeros(N_FRAMES), np.full(N_FRAMES, 0.93)]
    world_from_cam = film(Static(), pelvis).world_from_cam
    assert np.all(world_from_cam == world_from_cam[0])


def test_what_the_recipe_gives_is_kept() -> None:
    pelvis = np.tile([3.0, -1.0, 0.9], (5, 1))
    view = film(Static(azimuth_deg=90, distance_m=7, height_m=2.5), pelvis).centres_world_m
    np.testing.assert_allclose(view, np.tile([3.0, 6.0, 2.5], (5, 1)), atol=1e-12)
    ring = film(Circular(radius_m=6.0), pelvis).centres_world_m
    np.testing.assert_allclose(np.linalg.norm((ring - pelvis)[:, :2], axis=1), 6.0)


def test_one_frame_is_enough() -> None:
    for programme in PROGRAMMES:
        camera = film(programme, np.array([[0.0, 0.0, 0.9]]))
        assert camera.world_from_cam.shape == (1, 4, 4)
        assert np.isfinite(camera.world_from_cam).all()


def test_a_subject_that_cannot_be_framed_is_an_error() -> None:
    marathon = np.c_[np.arange(N_FRAMES) * 3.0, np.zeros(N_FRAMES), np.full(N_FRAMES, 0.93)]
    with pytest.raises(BadRecipe, match="static camera can't keep the subject in frame"):
        film(Static(), marathon)


@pytest.mark.parametrize("path", [np.zeros((0, 3)), np.zeros((4, 2)), np.full((4, 3), np.nan)])
def test_a_broken_path_is_an_error(path: np.ndarray) -> None:
    with pytest.raises(BadMotionFile, match="finite numbers"):
        film(Static(), path)


@pytest.mark.parametrize(
    "recipe",
    [{"kind": "spiral"}, {"kind": "circular", "radius": 3}, {"kind": "small", "drift_m": -1}, {}],
)
def test_unknown_kinds_and_keys_are_refused(recipe: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Programme).validate_python(recipe)


def test_out_of_frame_is_counted() -> None:
    camera = film(Static(azimuth_deg=-90, distance_m=5), np.tile([0.0, 0, 0.93], (4, 1)))
    points = np.array([[0.0, 0, 1], [0, -9, 1], [30, 0, 1], [0, 0, 1.2]])  # behind, aside
    assert in_frame(camera, points).mean() == 0.5
    assert in_frame(camera, np.stack([points, points[:1].repeat(4, axis=0)], axis=1)).mean() == 0.5


@pytest.mark.parametrize(
    "programme", [Circular(), Linear(), Panning(), LinearPanning()], ids=lambda p: p.kind
)
def test_a_hand_adds_its_unrest_to_every_moving_camera(programme: Programme) -> None:
    pelvis = np.c_[np.linspace(-2, 2, 600), np.zeros(600), np.full(600, 0.95)]
    wheels = programme.model_copy(update={"distance_m": 9.0})
    hand = wheels.model_copy(update={"handheld_deg": 0.5, "handheld_m": 0.02})
    smooth, held = film(wheels, pelvis), film(hand, pelvis)
    moved_m = held.centres_world_m - smooth.centres_world_m
    # 60 s hold the slowest wave seven times or more, so its standard deviation is there.
    np.testing.assert_allclose(moved_m.std(axis=0), 0.02, rtol=0.1)
    turned = smooth.world_from_cam[:, :3, :3].transpose(0, 2, 1) @ held.world_from_cam[:, :3, :3]
    angles_deg = np.rad2deg(Rotation.from_matrix(turned).as_rotvec())
    np.testing.assert_allclose(angles_deg.std(axis=0), 0.5, rtol=0.1)
    # Energy falls with the frequency and ends below 3 Hz.
    power = (np.abs(np.fft.rfft(moved_m * np.hanning(600)[:, None], axis=0)) ** 2).sum(axis=1)
    hz = np.fft.rfftfreq(600, 1 / FPS_HZ)
    bands = [power[(hz >= low) & (hz < high)].sum() for low, high in ((0.1, 0.5), (0.5, 1), (1, 3))]
    assert bands[0] > bands[1] > bands[2] > 100 * power[hz >= 3.2].sum()


def test_a_held_camera_keeps_the_person_in_frame() -> None:
    pelvis = np.c_[np.linspace(-2, 2, N_FRAMES), np.zeros(N_FRAMES), np.full(N_FRAMES, 0.95)]
    camera = film(Circular(handheld_deg=2.0, handheld_m=0.1), pelvis)
    assert in_frame(camera, person_box(pelvis)).mean() == 1.0
