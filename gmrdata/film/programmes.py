"""Camera programmes: how a camera moves while it films a person, and a motion made ready for it.

Each programme is a pure function of time and of the subject's path, so the same recipe drives
Blender, tests, and cameras that are never rendered.  The static twin is the same take with the
camera's motion off (Table 6 of the paper).
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError

from gmrdata.film import camera_moves as moves
from gmrdata.film.camera_moves import SubjectPath, look_at, subject_path
from gmrdata.motion.resample import resample, slice_motion
from gmrdata.values import limits
from gmrdata.values.camera import CameraPath, in_frame, intrinsics_from_fov, person_box
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadMotionFile, BadRecipe
from gmrdata.values.motion import Motion
from gmrdata.values.records import Config
from gmrdata.values.transforms import rigid

FRAME_MARGIN_SHARE = 0.03  # border that is kept free, as a share of the image's height
STEP_M = 0.25
DISTANCES_M = np.arange(2.0, 25.01, STEP_M)
"""Distances that are tried, nearest first, until the subject stays in frame."""
At = Callable[[float], CameraPath]  # a camera by its distance [m]


class View(Config):
    """Where the camera is, seen from the subject at the middle of the clip."""

    height_m: float = Field(default=1.5, gt=0, le=20)
    """Height of the optical centre above the ground [m]."""
    azimuth_deg: float | None = None
    """Direction from the subject to the camera, from x to y [degrees]; None: by the path."""
    distance_m: float | None = Field(default=None, gt=0, le=10_000)
    """Distance to the middle of the path on the ground [m]; None: the nearest that frames all."""
    lag_s: float = Field(default=0.1, ge=0, le=2)
    """How late the camera follows the subject [s]."""


class Moving(View):
    """A camera that moves, on wheels unless it is held in the hand."""

    handheld_deg: float = Field(default=0.0, ge=0, le=5)
    """Shake: standard deviation of the rotation per axis [degrees]; 1/f from 0.1 to 3 Hz."""
    handheld_m: float = Field(default=0.0, ge=0, le=0.3)
    """The same for the position per axis [m]."""


class Circular(Moving):
    """On a circle round the middle of the subject's path, looking at the subject."""

    kind: Literal["circular"] = "circular"
    rate_deg_per_s: float = Field(default=25.0, gt=0, le=180)
    direction: Literal["counterclockwise", "clockwise"] = "counterclockwise"
    """Seen from above."""
    radius_m: float | None = Field(default=None, gt=0, le=10_000)
    """Radius of the circle [m]; None: `distance_m`, or the smallest that frames all."""


class Travelling(Moving):
    """Along a straight line at constant speed."""

    move: Literal["truck", "dolly"] = "truck"
    """Truck: sideways, beside the subject.  Dolly: along the line of sight, ahead of it."""
    speed_m_per_s: float | None = Field(default=None, ge=-100, le=100)
    """Speed, positive along the subject's walking direction [m/s]; None: that of the subject, and
    half of it for `linear_panning`."""


class Linear(Travelling):
    kind: Literal["linear"] = "linear"
    look: Literal["fixed"] = "fixed"
    """It keeps the orientation.  The key stays, so that plans which name it are not made again."""


class LinearPanning(Travelling):
    """Slower than the subject, turning to it."""

    kind: Literal["linear_panning"] = "linear_panning"


class Panning(Moving):
    """A pure rotation about a fixed point: a tripod head that follows the subject."""

    kind: Literal["panning"] = "panning"


class Small(View):
    """Held in the hand by someone who stands still: a drift of some centimetres."""

    kind: Literal["small"] = "small"
    drift_m: float = Field(default=0.03, gt=0, le=0.3)
    """Standard deviation of the position per axis [m]."""
    shake_deg: float = Field(default=0.4, ge=0, le=5)
    """The same for the rotation per axis [degrees]."""


class Static(View):
    """On a tripod, not moving."""

    kind: Literal["static"] = "static"


Programme = Annotated[
    Circular | Linear | Panning | LinearPanning | Small | Static, Field(discriminator="kind")
]


def camera_programme(kind: str, **settings: object) -> Programme:
    """A camera programme by its `kind` in a recipe ("circular", ...), and its keys there."""
    try:
        return TypeAdapter[Programme](Programme).validate_python({"kind": kind, **settings})
    except ValidationError as error:
        texts = (f"{'.'.join(map(str, each['loc']))}: {each['msg']}" for each in error.errors())
        problems = "; ".join(problem.removeprefix(": ") for problem in texts)
        raise BadRecipe(f"camera programme {kind}: {problems}") from None


def camera_path(
    programme: Programme,
    pelvis_world_m: np.ndarray,
    fps_hz: float,
    width_px: int,
    height_px: int,
    hfov_deg: float,
    rng: np.random.Generator,
) -> CameraPath:
    """The camera of a programme for one subject, in each of its T frames.

    The subject's pelvis path (T, 3) is in a z-up world with the ground at z = 0 [m].  `rng` chooses
    what the recipe leaves open: side, azimuth, the drift of a held camera.  BadRecipe where no
    distance keeps the subject in frame, or no camera has such a picture.
    """
    if not (0 < fps_hz < np.inf and min(width_px, height_px) > 0 and 0 < hfov_deg < 180):
        what = f"{width_px} x {height_px} px, hfov_deg {hfov_deg}, {fps_hz} Hz"
        raise BadRecipe(f"camera of {what}: all are above 0, and hfov_deg is below 180")
    pelvis = np.asarray(pelvis_world_m, dtype=np.float64)
    if pelvis.shape != (len(pelvis), 3) or not len(pelvis) or not np.isfinite(pelvis).all():
        what = "the subject's path must be (T, 3) finite numbers"
        raise BadMotionFile(f"{what}, this one is {pelvis.shape}")
    subject = subject_path(pelvis, fps_hz, programme.lag_s, rng)
    intrinsics_px = intrinsics_from_fov(hfov_deg, width_px, height_px)

    def at(distance_m: float) -> CameraPath:
        world_from_cam = _world_from_cam(programme, subject, distance_m)
        has_camera = np.ones(len(pelvis), dtype=bool)
        return CameraPath(intrinsics_px, width_px, height_px, world_from_cam, has_camera)

    given_m = (isinstance(programme, Circular) and programme.radius_m) or programme.distance_m
    if given_m is not None:
        return at(given_m)
    return _nearest_in_frame(at, DISTANCES_M, pelvis, programme.kind, "give distance_m")


def _nearest_in_frame(
    at: At, distances_m: np.ndarray, pelvis_m: np.ndarray, kind: str, remedy: str
) -> CameraPath:
    """The first of the cameras at some distances with the whole subject in frame all the time."""
    box = person_box(pelvis_m)
    for distance_m in distances_m:
        camera = at(float(distance_m))
        if in_frame(camera, box, FRAME_MARGIN_SHARE).all():
            return camera
    what = f"keep the subject in frame from any distance up to {distances_m[-1]:.0f} m"
    raise BadRecipe(f"a {kind} camera can't {what}; widen hfov_deg, shorten the clip, or {remedy}")


def _world_from_cam(programme: Programme, subject: SubjectPath, distance_m: float) -> np.ndarray:
    """The programme's camera (T, 4, 4) at a distance [m]."""
    follows = isinstance(programme, Circular | LinearPanning | Panning)
    if isinstance(programme, Circular):
        place_m, centres_m = _round(programme, subject, distance_m)
    elif isinstance(programme, Travelling):
        place_m, centres_m = _travel(programme, subject, distance_m)
    else:
        azimuth_rad = _beside_rad(programme, subject)
        place_m = moves.station(subject, azimuth_rad, distance_m, programme.height_m)
        centres_m = np.tile(place_m, (len(subject.time_s), 1))
    eyes_m, seen_m = (centres_m, subject.target_m) if follows else (place_m, subject.centre_m)
    steady = rigid(look_at(eyes_m, seen_m), centres_m)
    if isinstance(programme, Moving):
        return moves.held(subject, steady, programme.handheld_m, programme.handheld_deg)
    if isinstance(programme, Small):
        return moves.held(subject, steady, programme.drift_m, programme.shake_deg)
    return steady


def _round(
    programme: Circular, subject: SubjectPath, distance_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Place (3,) in the middle of the clip and centres (T, 3) of a camera on a circle [m]."""
    turn = 1.0 if programme.direction == "counterclockwise" else -1.0
    # On this side the camera travels with the subject, which keeps their distance even.
    chosen_rad = subject.heading_rad - turn * np.pi / 2 + subject.jitter_rad
    rate_rad_per_s = turn * np.deg2rad(programme.rate_deg_per_s)
    middle_rad = _azimuth_rad(programme, chosen_rad)
    middle_m, *centres_m = (
        moves.station(subject, angle_rad, distance_m, programme.height_m)
        for angle_rad in (middle_rad, *(middle_rad + rate_rad_per_s * subject.time_s))
    )
    return middle_m, np.stack(centres_m)


def _travel(
    programme: Travelling, subject: SubjectPath, distance_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Place (3,) in the middle of the clip and centres (T, 3) of a camera on a straight line."""
    if programme.move == "truck":
        azimuth_rad = _beside_rad(programme, subject)
        along_rad = azimuth_rad + np.pi / 2
    else:
        azimuth_rad = _azimuth_rad(programme, subject.heading_rad + subject.jitter_rad)
        along_rad = azimuth_rad
    place_m = moves.station(subject, azimuth_rad, distance_m, programme.height_m)
    share = 0.5 if isinstance(programme, LinearPanning) else 1.0
    return place_m, moves.line(subject, place_m, along_rad, programme.speed_m_per_s, share)


def _beside_rad(view: View, subject: SubjectPath) -> float:
    """Azimuth of a camera beside the path, where a walk crosses the picture."""
    chosen_rad = subject.heading_rad + subject.side * np.pi / 2 + subject.jitter_rad
    return _azimuth_rad(view, chosen_rad)


def _azimuth_rad(view: View, chosen_rad: float) -> float:
    return chosen_rad if view.azimuth_deg is None else float(np.deg2rad(view.azimuth_deg))


def static_twin(camera: CameraPath, pelvis_world_m: np.ndarray) -> CameraPath:
    """A static camera where a moving one stands at the middle of the clip.

    It looks at the middle of the subject's path, whose pelvis (T, 3) is given in the world [m].
    Where that doesn't keep the subject in frame for the whole clip, it steps back on the same side,
    at the same height, as far as it must.  Lens and length are those of the moving camera.
    """
    place_m = camera.centres_world_m[camera.n_frames // 2]
    if not np.isfinite(place_m).all():
        raise BadRecipe("a clip whose middle frame has no camera has no twin with its motion off")
    target_m = (pelvis_world_m.min(axis=0) + pelvis_world_m.max(axis=0)) / 2
    across_m = place_m[:2] - target_m[:2]
    near_m = float(np.linalg.norm(across_m))
    resting = replace(camera, has_camera=np.ones(camera.n_frames, dtype=bool))

    def at(distance_m: float) -> CameraPath:
        stand_m = np.array([*(target_m[:2] + across_m / near_m * distance_m), place_m[2]])
        pose = rigid(look_at(stand_m, target_m), stand_m)
        return replace(resting, world_from_cam=np.tile(pose, (camera.n_frames, 1, 1)))

    distances_m = np.arange(near_m, max(near_m, DISTANCES_M[-1]) + STEP_M, STEP_M)
    return _nearest_in_frame(at, distances_m, pelvis_world_m, "static", "leave camera_off out")


RATES_HZ = (30.0, 20.0, 10.0)
"""Multiples of the 10 fps at which GMR works, so that every phase is a set of real frames."""
MIN_FRAMES = 5


class Film(Config):
    """What the clips of a set share."""

    duration_s: float = Field(default=4.8, gt=0, le=limits.LONGEST_S)
    """Longest clip [s]; a longer motion is cut after it."""
    fps_hz: float | None = Field(default=None, ge=1, le=240)
    """Frame rate [Hz]; when left out 30, 20 or 10: the highest within `max_frames` and that of the
    motion.  A motion of a lower one is refused."""
    max_frames: int = Field(default=56, ge=10, le=limits.MOST_FRAMES)
    """Most frames of a clip whose rate is chosen; a long one gets 10 fps and more frames."""
    width_px: int = Field(default=640, ge=64, le=limits.LARGEST_SIDE_PX)
    height_px: int = Field(default=360, ge=64, le=limits.LARGEST_SIDE_PX)
    hfov_deg: float = Field(default=60.0, gt=10, lt=120)
    """Horizontal field of view [degrees]."""


def frame_rate_hz(duration_s: float, film: Film, fastest_hz: float = np.inf) -> float:
    """The recipe's rate, or the highest multiple of 10 fps within `film.max_frames`, of those that
    are not faster than a motion."""
    known = (rate_hz for rate_hz in RATES_HZ if rate_hz <= fastest_hz)
    fitting = (rate_hz for rate_hz in known if round(duration_s * rate_hz, 6) <= film.max_frames)
    return film.fps_hz or next(fitting, RATES_HZ[-1])


def film_motion(motion: Motion, film: Film) -> Motion:
    """The part of a motion that is filmed, at its frame rate, with its middle over the origin."""
    duration_s = min(motion.n_frames / motion.fps_hz, film.duration_s)
    rate_hz = min(frame_rate_hz(duration_s, film, motion.fps_hz), motion.fps_hz)
    if film.fps_hz is not None and rate_hz < film.fps_hz:
        what = f"{motion.fps_hz:g} Hz are fewer than the {film.fps_hz:g} of film.fps_hz"
        raise BadMotionFile(f"{motion.source}: {what}. Take a faster motion, or a lower rate")
    cut = resample(slice_motion(motion, 0, max(1, round(duration_s * motion.fps_hz))), rate_hz)
    if cut.n_frames < MIN_FRAMES:
        enough = f"it takes {MIN_FRAMES / rate_hz:.2f} s, {MIN_FRAMES} frames at {rate_hz:g} Hz"
        what = f"{duration_s:.2f} s are too short to film; {enough}"
        raise BadMotionFile(f"{motion.source}: {what}. Take a longer trial or duration_s")
    low, high = cut.pelvis_m.min(axis=0), cut.pelvis_m.max(axis=0)
    middle_m = np.array([*(low + high)[:2] / 2, 0.0])
    return replace(cut, pelvis_m=cut.pelvis_m - middle_m)


def plan_clip(
    clip_id: str, motion: Motion, programme: Programme, film: Film, rng: np.random.Generator
) -> Clip:
    """A motion with the camera that is to film it; `rng` chooses what the programme leaves open."""
    lens = film.width_px, film.height_px, film.hfov_deg
    camera = camera_path(programme, motion.pelvis_m, motion.fps_hz, *lens, rng)
    # Nanometres and nanoradians: once in many runs a last bit of the path differed, and a clip's
    # bytes count in the recipe of everything that is made of it.
    camera = replace(camera, world_from_cam=np.round(camera.world_from_cam, 9) + 0.0)
    n = motion.n_frames
    return Clip(clip_id, motion, np.ones(n, dtype=bool), np.arange(n), camera)
