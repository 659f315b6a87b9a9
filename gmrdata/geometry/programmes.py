"""Camera programmes: how a camera moves while it films a person.

Each programme is a pure function of time and of the subject's path, so the same recipe drives
Blender, tests, and cameras that are never rendered.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from gmrdata.config import Config
from gmrdata.errors import BadMotionFile
from gmrdata.geometry import moves
from gmrdata.geometry.camera import CameraPath, intrinsics_from_fov
from gmrdata.geometry.distance import nearest_in_frame
from gmrdata.geometry.subject_path import SubjectPath, subject_path


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
    subject = subject_path(pelvis, fps_hz, programme.lag_s, rng)
    intrinsics_px = intrinsics_from_fov(hfov_deg, width_px, height_px)

    def at(distance_m: float) -> CameraPath:
        world_from_cam = _world_from_cam(programme, subject, distance_m)
        has_camera = np.ones(len(pelvis), dtype=bool)
        return CameraPath(intrinsics_px, width_px, height_px, world_from_cam, has_camera)

    given_m = programme.distance_m
    if isinstance(programme, Circular) and programme.radius_m is not None:
        given_m = programme.radius_m
    return at(given_m) if given_m is not None else nearest_in_frame(at, pelvis, programme.kind)


def _world_from_cam(programme: Programme, subject: SubjectPath, distance_m: float) -> np.ndarray:
    """The programme's camera (T, 4, 4) at a distance [m]."""
    if isinstance(programme, Circular):
        steady = _circular(programme, subject, distance_m)
    elif isinstance(programme, Linear):
        place_m, centres_m = _travel(programme, subject, distance_m, share=1.0)
        steady = (
            moves.following(subject, centres_m)
            if programme.look == "subject"
            else moves.looking_ahead(subject, centres_m, place_m)
        )
    elif isinstance(programme, LinearPanning):
        _, centres_m = _travel(programme, subject, distance_m, share=0.5)
        steady = moves.following(subject, centres_m)
    else:
        azimuth_rad = _beside_rad(programme, subject)
        place_m = moves.station(subject, azimuth_rad, distance_m, programme.height_m)
        centres_m = moves.at_rest(subject, place_m)
        steady = (
            moves.following(subject, centres_m)
            if isinstance(programme, Panning)
            else moves.looking_ahead(subject, centres_m, place_m)
        )
    if isinstance(programme, Moving):
        return moves.held(subject, steady, programme.handheld_m, programme.handheld_deg)
    if isinstance(programme, Small):
        return moves.held(subject, steady, programme.drift_m, programme.shake_deg)
    return steady


def _circular(programme: Circular, subject: SubjectPath, distance_m: float) -> np.ndarray:
    turn = 1.0 if programme.direction == "counterclockwise" else -1.0
    # On this side the camera travels with the subject, which keeps their distance even.
    chosen_rad = subject.heading_rad - turn * np.pi / 2 + subject.jitter_rad
    rate_rad_per_s = turn * np.deg2rad(programme.rate_deg_per_s)
    centres_m = moves.circle(
        subject,
        _azimuth_rad(programme, chosen_rad),
        rate_rad_per_s,
        distance_m,
        programme.height_m,
    )
    return moves.following(subject, centres_m)


def _travel(
    programme: Linear | LinearPanning, subject: SubjectPath, distance_m: float, share: float
) -> tuple[np.ndarray, np.ndarray]:
    """Place (3,) in the middle of the clip and centres (T, 3) of a camera on a straight line."""
    if programme.move == "truck":
        azimuth_rad = _beside_rad(programme, subject)
        along_rad = azimuth_rad + np.pi / 2
    else:
        azimuth_rad = _azimuth_rad(programme, subject.heading_rad + subject.jitter_rad)
        along_rad = azimuth_rad
    place_m = moves.station(subject, azimuth_rad, distance_m, programme.height_m)
    return place_m, moves.line(subject, place_m, along_rad, programme.speed_m_per_s, share)


def _beside_rad(view: View, subject: SubjectPath) -> float:
    """Azimuth of a camera beside the path, where a walk crosses the picture."""
    chosen_rad = subject.heading_rad + subject.side * np.pi / 2 + subject.jitter_rad
    return _azimuth_rad(view, chosen_rad)


def _azimuth_rad(view: View, chosen_rad: float) -> float:
    return chosen_rad if view.azimuth_deg is None else float(np.deg2rad(view.azimuth_deg))
