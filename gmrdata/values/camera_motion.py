"""The class of a camera's motion, as the paper's Tables 7 and 8 name it, from the path itself.

A camera that travels less than `travel_m` stays in place: it is *static* when neither place nor
orientation changes, *panning* when it turns, and *small* otherwise.  A camera that travels is
*circular* when its path bends round the person, else *linear*, or *linear_panning* when it turns
on its straight way.
"""

from typing import Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from gmrdata.values.errors import BadMotionFile
from gmrdata.values.records import PART, Config
from gmrdata.values.transforms import angles_rad

MotionClass = Literal["static", "small", "panning", "linear", "linear_panning", "circular"]
MOST_ROWS = 400  # pairs of frames are compared on so many evenly spaced rows


class MotionClassConfig(Config):
    """Where one class ends and the next begins."""

    travel_m: float = Field(default=0.3, gt=0)
    """A camera whose places are never further apart stays in place [m]."""
    static_m: float = Field(default=0.02, ge=0)
    """A static camera's places are not further apart [m]."""
    static_deg: float = Field(default=0.5, ge=0)
    """A static camera's orientations do not differ by more [degrees]."""
    pan_deg: float = Field(default=5.0, gt=0)
    """A camera in place whose orientations differ by more is panning [degrees]."""
    turn_deg: float = Field(default=5.0, gt=0)
    """A travelling camera whose orientations differ by more turns on its way [degrees]."""
    bend_deg: float = Field(default=20.0, gt=0)
    """A circular camera's way turns by at least this [degrees]."""
    bend_share: float = Field(default=0.5, gt=0, lt=1)
    """And a circle leaves at most this share of a straight line's residuals."""


@dataclass(frozen=True, config=PART)
class MotionFigures:
    """What a class was decided on."""

    extent_m: float  # largest distance between two places of the camera [m]
    path_m: float  # length of the way, without what is shorter than half a second [m]
    turn_deg: float  # largest angle between two orientations [degrees]
    line_rms_m: float  # root mean square distance of the places from the best straight line [m]
    circle_rms_m: float | None  # the same from the best circle, from above [m]; None if straight
    bend_deg: float  # angle that the way covers on that circle [degrees]
    goes_round: bool  # whether the person is inside that circle
    distance_m: float  # median distance to the person [m]


def classify(
    world_from_cam: np.ndarray, pelvis_m: np.ndarray, fps_hz: float, config: MotionClassConfig
) -> tuple[MotionClass, MotionFigures]:
    """Class of the motion of cameras (T, 4, 4) round a pelvis (T, 3), z-up world [m]; and why."""
    finite = np.isfinite(world_from_cam).all() and np.isfinite(pelvis_m).all()
    if not (finite and 0 < len(world_from_cam) == len(pelvis_m)):
        needed = "a camera's class needs finite cameras and a person in each of its frames"
        given = f"arrays of {world_from_cam.shape} and {pelvis_m.shape}"
        raise BadMotionFile(f"{needed}, not {given}; leave out frames without")
    figures = motion_figures(world_from_cam, pelvis_m, fps_hz)
    return class_of(figures, config), figures


def class_of(figures: MotionFigures, config: MotionClassConfig) -> MotionClass:
    """The class by other thresholds, without another look at the cameras."""
    if figures.extent_m < config.travel_m:
        if figures.extent_m <= config.static_m and figures.turn_deg <= config.static_deg:
            return "static"
        return "panning" if figures.turn_deg > config.pan_deg else "small"
    if (
        figures.goes_round
        and figures.circle_rms_m is not None
        and figures.bend_deg >= config.bend_deg
        and figures.circle_rms_m <= config.bend_share * figures.line_rms_m
    ):
        return "circular"
    return "linear_panning" if figures.turn_deg > config.turn_deg else "linear"


def motion_figures(
    world_from_cam: np.ndarray, pelvis_m: np.ndarray, fps_hz: float
) -> MotionFigures:
    """The figures alone; arguments as in `classify`."""
    rows = np.unique(np.linspace(0, len(world_from_cam) - 1, MOST_ROWS).round().astype(int))
    centres_m = world_from_cam[:, :3, 3]
    places_m = centres_m[rows]
    apart_m = np.linalg.norm(places_m[:, None] - places_m[None], axis=-1)
    relative = world_from_cam[rows][:, None, :3, :3].swapaxes(-1, -2) @ world_from_cam[rows, :3, :3]
    centred_m = centres_m - centres_m.mean(axis=0)
    off_line_m = np.linalg.svd(centred_m, compute_uv=False)[1:]
    # Places every half second: a hand's tremble adds up to metres otherwise.
    step = max(1, round(fps_hz / 2))
    calm_m = centres_m[np.unique(np.r_[: len(centres_m) : step, len(centres_m) - 1])]
    circle_rms_m, bend_deg, goes_round = _circle(centres_m[:, :2], pelvis_m[:, :2])
    return MotionFigures(
        extent_m=float(apart_m.max()),
        path_m=float(np.linalg.norm(np.diff(calm_m, axis=0), axis=1).sum()),
        turn_deg=float(np.rad2deg(angles_rad(relative).max())),
        line_rms_m=float(np.sqrt((off_line_m**2).sum() / len(centres_m))),
        circle_rms_m=circle_rms_m,
        bend_deg=bend_deg,
        goes_round=goes_round,
        distance_m=float(np.median(np.linalg.norm(pelvis_m - centres_m, axis=1))),
    )


def _circle(places_m: np.ndarray, person_m: np.ndarray) -> tuple[float | None, float, bool]:
    """RMS distance from the best circle [m] (Kasa 1976), the angle on it [deg], person inside."""
    centred = places_m - places_m.mean(axis=0)
    size_m = max(float(np.abs(centred).max()), 1e-9)
    unit = centred / size_m
    design = np.c_[2 * unit, np.ones(len(unit))]
    answer, _, rank, _ = np.linalg.lstsq(design, (unit**2).sum(axis=1), rcond=1e-9)
    if rank < 3:
        return None, 0.0, False
    middle = answer[:2]
    radius = np.sqrt(max(answer[2] + middle @ middle, 0.0))
    from_middle = unit - middle
    angles = np.unwrap(np.arctan2(from_middle[:, 1], from_middle[:, 0]))
    person = (person_m.mean(axis=0) - places_m.mean(axis=0)) / size_m
    return (
        float(size_m * np.sqrt(np.mean((np.linalg.norm(from_middle, axis=1) - radius) ** 2))),
        float(np.rad2deg(angles.max() - angles.min())),
        bool(np.linalg.norm(person - middle) < radius),
    )
