"""Camera programmes: how a camera moves while it films a person.

Each programme is a pure function of time and of the subject's path, so the same recipe drives
Blender, tests, and cameras that are never rendered.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from gmrdata.config import Config
from gmrdata.errors import BadMotionFile, BadRecipe
from gmrdata.geometry.camera import CameraPath, intrinsics_from_fov
from gmrdata.geometry.framing import in_frame_share, person_box
from gmrdata.geometry.look_at import look_at, smooth_path
from gmrdata.geometry.transforms import rigid

FOLLOW_SIGMA_S = 0.35
"""Low-pass on the subject's path: steps bob at about 2 Hz, and an operator doesn't follow those."""
STANDING_M = 0.5
"""A subject that ends this close to its start has no walking direction."""
SLOWEST_M_PER_S = 0.3
"""Speed of a travelling camera whose subject stays in place."""
FRAME_MARGIN_SHARE = 0.03
DISTANCES_M = np.arange(2.0, 25.01, 0.25)
"""Distances that are tried, nearest first, until the subject stays in frame."""


class View(Config):
    """Where the camera is, seen from the subject at the middle of the clip."""

    height_m: float = Field(default=1.5, gt=0, le=20)
    """Height of the optical centre above the ground [m]."""
    azimuth_deg: float | None = None
    """Direction from the subject to the camera, from x to y [degrees]; None: by the path."""
    distance_m: float | None = Field(default=None, gt=0)
    """Distance to the middle of the path on the ground [m]; None: the nearest that frames all."""
    lag_s: float = Field(default=0.1, ge=0, le=2)
    """How late the camera follows the subject [s]."""


class Moving(View):
    """A camera that moves, on wheels unless it is held in the hand."""

    handheld_deg: float = Field(default=0.0, ge=0, le=5)
    """Hand-held shake: standard deviation of the rotation per axis [degrees], with a 1/f spectrum
    from 0.1 to 3 Hz."""
    handheld_m: float = Field(default=0.0, ge=0, le=0.3)
    """The same for the position per axis [m]."""


class Circular(Moving):
    """On a circle round the middle of the subject's path, looking at the subject."""

    kind: Literal["circular"] = "circular"
    rate_deg_per_s: float = Field(default=25.0, gt=0, le=180)
    """Angular speed on the circle [degrees/s]."""
    direction: Literal["counterclockwise", "clockwise"] = "counterclockwise"
    """Direction of travel seen from above."""
    radius_m: float | None = Field(default=None, gt=0)
    """Radius of the circle [m]; None: `distance_m`, or the smallest that frames all."""


class Linear(Moving):
    """Along a straight line at constant speed."""

    kind: Literal["linear"] = "linear"
    move: Literal["truck", "dolly"] = "truck"
    """Truck: sideways, beside the subject.  Dolly: along the line of sight, ahead of it."""
    speed_m_per_s: float | None = None
    """Speed, positive along the subject's walking direction [m/s]; None: that of the subject."""
    look: Literal["fixed", "subject"] = "fixed"
    """Keep the orientation, or turn to the subject."""


class Panning(Moving):
    """A pure rotation about a fixed point: a tripod head that follows the subject."""

    kind: Literal["panning"] = "panning"


class LinearPanning(Moving):
    """Along a straight line, slower than the subject, turning to it."""

    kind: Literal["linear_panning"] = "linear_panning"
    move: Literal["truck", "dolly"] = "truck"
    """Truck: sideways.  Dolly: along the line of sight at the middle of the clip."""
    speed_m_per_s: float | None = None
    """Speed, positive along the subject's walking direction [m/s]; None: half of the subject's."""


class Small(View):
    """Held in the hand by someone who stands still: a drift of some centimetres."""

    kind: Literal["small"] = "small"
    drift_m: float = Field(default=0.03, gt=0, le=0.3)
    """Standard deviation of the position per axis [m]."""
    shake_deg: float = Field(default=0.4, ge=0, le=5)
    """Standard deviation of the rotation per axis [degrees]."""


class Static(View):
    """On a tripod, not moving."""

    kind: Literal["static"] = "static"


Programme = Annotated[
    Circular | Linear | Panning | LinearPanning | Small | Static, Field(discriminator="kind")
]


@dataclass(frozen=True, eq=False)
class _Scene:
    """What a programme knows of its subject, and the random choices that it may use."""

    time_s: np.ndarray  # (T,), 0 at the middle of the clip
    target_m: np.ndarray  # (T, 3) smoothed pelvis
    centre_m: np.ndarray  # (3,) middle of the path
    heading_rad: float  # walking direction
    speed_m_per_s: float  # along the walking direction, 0 when standing
    side: float  # +1 or -1: which side of the path the camera takes
    jitter_rad: float
    waves: np.ndarray  # (T, 6) smooth unit noise: 3 of position, 3 of rotation


def camera_path(
    programme: Programme,
    pelvis_world_m: np.ndarray,
    fps_hz: float,
    width_px: int,
    height_px: int,
    hfov_deg: float,
    rng: np.random.Generator,
) -> CameraPath:
    """The camera of a programme for one subject.

    Args:
        programme: The recipe.
        pelvis_world_m: (T, 3) pelvis path of the subject, z-up world with the ground at z = 0 [m].
        fps_hz: Frame rate [Hz].
        width_px: Image width [px].
        height_px: Image height [px].
        hfov_deg: Horizontal field of view [degrees].
        rng: Chooses what the recipe leaves open: side, azimuth, the drift of a held camera.

    Returns:
        CameraPath of T frames, each with a camera.

    Raises:
        BadMotionFile: the path is empty or not finite.
        BadRecipe: no distance keeps the subject in frame.
    """
    pelvis = np.asarray(pelvis_world_m, dtype=np.float64)
    if pelvis.ndim != 2 or pelvis.shape[1] != 3 or not len(pelvis) or not np.isfinite(pelvis).all():
        raise BadMotionFile(
            f"the subject's path must be (T, 3) finite numbers, this one is {pelvis.shape}"
        )
    scene = _scene(programme, pelvis, fps_hz, rng)
    intrinsics_px = intrinsics_from_fov(hfov_deg, width_px, height_px)

    def at(distance_m: float) -> CameraPath:
        world_from_cam = _MOVES[programme.kind](programme, scene, distance_m)
        if isinstance(programme, Moving):
            hand = programme.handheld_m, programme.handheld_deg
            world_from_cam = _held(world_from_cam, scene.waves, *hand)
        has_camera = np.ones(len(pelvis), dtype=bool)
        return CameraPath(intrinsics_px, width_px, height_px, world_from_cam, has_camera)

    given_m = programme.distance_m
    if isinstance(programme, Circular) and programme.radius_m is not None:
        given_m = programme.radius_m
    return at(given_m) if given_m is not None else _nearest_in_frame(at, pelvis, programme.kind)


def _nearest_in_frame(
    at: Callable[[float], CameraPath], pelvis: np.ndarray, kind: str
) -> CameraPath:
    box = person_box(pelvis)
    for distance_m in DISTANCES_M:
        camera = at(float(distance_m))
        if in_frame_share(camera, box, FRAME_MARGIN_SHARE) == 1.0:
            return camera
    raise BadRecipe(
        f"a {kind} camera can't keep the subject in frame from any distance up to "
        f"{DISTANCES_M[-1]:.0f} m; widen hfov_deg, shorten the clip, or give distance_m"
    )


def _scene(
    programme: Programme, pelvis: np.ndarray, fps_hz: float, rng: np.random.Generator
) -> _Scene:
    n_frames = len(pelvis)
    time_s = (np.arange(n_frames) - (n_frames - 1) / 2) / fps_hz
    target = smooth_path(pelvis, fps_hz, FOLLOW_SIGMA_S, programme.lag_s)
    # The same draws in the same order for every programme, so that seeds are comparable.
    any_heading_rad, side = rng.uniform(-np.pi, np.pi), rng.choice([-1.0, 1.0])
    jitter_rad = np.deg2rad(rng.uniform(-8, 8))
    waves = _hand_waves(time_s, rng)
    span = pelvis[-1, :2] - pelvis[0, :2]
    walks = np.linalg.norm(span) > STANDING_M
    return _Scene(
        time_s=time_s,
        target_m=target,
        centre_m=(pelvis.min(axis=0) + pelvis.max(axis=0)) / 2,
        heading_rad=float(np.arctan2(span[1], span[0]) if walks else any_heading_rad),
        speed_m_per_s=float(np.linalg.norm(span) * fps_hz / (n_frames - 1)) if walks else 0.0,
        side=float(side),
        jitter_rad=float(jitter_rad),
        waves=waves,
    )


def _hand_waves(time_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(T, 6) smooth noise of unit variance: sway below 1 Hz and some tremor above, as 1/f."""
    frequencies_hz = np.array([0.15, 0.35, 0.7, 1.3, 2.4]) * rng.uniform(0.8, 1.2, (6, 5))
    phases_rad = rng.uniform(0, 2 * np.pi, (6, 5))
    amplitudes = 1 / frequencies_hz
    amplitudes /= np.sqrt((amplitudes**2).sum(axis=1, keepdims=True) / 2)
    angles = 2 * np.pi * frequencies_hz * time_s[:, None, None] + phases_rad
    return np.asarray((amplitudes * np.sin(angles)).sum(axis=-1))


def _direction(angle_rad: float) -> np.ndarray:
    return np.array([np.cos(angle_rad), np.sin(angle_rad), 0.0])


def _azimuth_rad(view: View, chosen_rad: float) -> float:
    return chosen_rad if view.azimuth_deg is None else float(np.deg2rad(view.azimuth_deg))


def _beside_rad(view: View, scene: _Scene) -> float:
    """Azimuth of a camera beside the path, where a walk crosses the picture."""
    return _azimuth_rad(view, scene.heading_rad + scene.side * np.pi / 2 + scene.jitter_rad)


def _station(view: View, scene: _Scene, azimuth_rad: float, distance_m: float) -> np.ndarray:
    """The camera's place (3,) at the middle of the clip [m]."""
    place = scene.centre_m + distance_m * _direction(azimuth_rad)
    return np.array([place[0], place[1], view.height_m])


def _fixed(centres_m: np.ndarray, scene: _Scene, station_m: np.ndarray) -> np.ndarray:
    """Cameras (T, 4, 4) with one orientation: from the station to the middle of the path."""
    return rigid(look_at(station_m, scene.centre_m), centres_m)


def _circular(programme: Circular, scene: _Scene, distance_m: float) -> np.ndarray:
    turn = 1.0 if programme.direction == "counterclockwise" else -1.0
    # On this side the camera travels with the subject, which keeps their distance even.
    middle_rad = _azimuth_rad(programme, scene.heading_rad - turn * np.pi / 2 + scene.jitter_rad)
    angles_rad = middle_rad + turn * np.deg2rad(programme.rate_deg_per_s) * scene.time_s
    centres = np.stack([_station(programme, scene, a, distance_m) for a in angles_rad])
    return rigid(look_at(centres, scene.target_m), centres)


def _travel(
    programme: Linear | LinearPanning, scene: _Scene, distance_m: float, share: float
) -> tuple[np.ndarray, np.ndarray]:
    """Station (3,) and centres (T, 3) of a camera on a straight line."""
    heading = _direction(scene.heading_rad)
    if programme.move == "truck":
        azimuth_rad = _beside_rad(programme, scene)
        along = _direction(azimuth_rad + np.pi / 2)
    else:
        azimuth_rad = _azimuth_rad(programme, scene.heading_rad + scene.jitter_rad)
        along = _direction(azimuth_rad)
    along = along if along @ heading >= 0 else -along
    speed = programme.speed_m_per_s
    if speed is None:
        speed = max(share * scene.speed_m_per_s * float(along @ heading), SLOWEST_M_PER_S)
    station = _station(programme, scene, azimuth_rad, distance_m)
    return station, station + speed * scene.time_s[:, None] * along


def _linear(programme: Linear, scene: _Scene, distance_m: float) -> np.ndarray:
    station, centres = _travel(programme, scene, distance_m, share=1.0)
    if programme.look == "subject":
        return rigid(look_at(centres, scene.target_m), centres)
    return _fixed(centres, scene, station)


def _linear_panning(programme: LinearPanning, scene: _Scene, distance_m: float) -> np.ndarray:
    _, centres = _travel(programme, scene, distance_m, share=0.5)
    return rigid(look_at(centres, scene.target_m), centres)


def _panning(programme: Panning, scene: _Scene, distance_m: float) -> np.ndarray:
    station = _station(programme, scene, _beside_rad(programme, scene), distance_m)
    centres = np.tile(station, (len(scene.time_s), 1))
    return rigid(look_at(centres, scene.target_m), centres)


def _small(programme: Small, scene: _Scene, distance_m: float) -> np.ndarray:
    station = _station(programme, scene, _beside_rad(programme, scene), distance_m)
    at_rest = _fixed(np.tile(station, (len(scene.time_s), 1)), scene, station)
    return _held(at_rest, scene.waves, programme.drift_m, programme.shake_deg)


def _held(
    world_from_cam: np.ndarray, waves: np.ndarray, drift_m: float, shake_deg: float
) -> np.ndarray:
    """Cameras (T, 4, 4) with a hand's unrest (T, 6) on them; the same for amplitudes of zero."""
    held = world_from_cam.copy()
    if drift_m > 0:
        held[:, :3, 3] += drift_m * waves[:, :3]
    if shake_deg > 0:
        shake = Rotation.from_rotvec(np.deg2rad(shake_deg) * waves[:, 3:])
        held[:, :3, :3] = held[:, :3, :3] @ shake.as_matrix()
    return held


def _static(programme: Static, scene: _Scene, distance_m: float) -> np.ndarray:
    station = _station(programme, scene, _beside_rad(programme, scene), distance_m)
    return _fixed(np.tile(station, (len(scene.time_s), 1)), scene, station)


_MOVES: dict[str, Callable[..., np.ndarray]] = {
    "circular": _circular,
    "linear": _linear,
    "linear_panning": _linear_panning,
    "panning": _panning,
    "small": _small,
    "static": _static,
}
