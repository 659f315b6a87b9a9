"""Straight lines of a place, and the focal length that they ask for, of a camera that may rest.

Edges of walls, floors, doors and furniture run along three directions at right angles (a Manhattan
world: Coughlan and Yuille 1999), and lines of one direction meet in one point of the picture.  Only
one focal length has these points at right angles.  Lines are found by LSD (von Gioi et al. 2010),
in OpenCV.

The focal length is a posterior: each line runs along one of the three, or any way at all, as likely
as lines of that slope are in this picture.  So what repeats a slope, as folds of a cloth and rows
of a roof do, tells nothing: lines tell by how their slope changes from place to place.
"""

from typing import NamedTuple

import numpy as np
from pydantic import Field

from gmrdata.cameras.frames import Frames
from gmrdata.stage.jobs import in_threads
from gmrdata.values import limits
from gmrdata.values.camera import Lens
from gmrdata.values.records import Config

BORDER_PX, BAR_SPREAD = 8, 3.0  # about the picture; grey levels of a column in a bar (sd)
FREE_SHARE = 0.7  # of a line, that is not masked
USUAL_FOCAL, USUAL_SIGMA = 0.85, 0.3
"""Focal length over the longer side, and the standard error of its logarithm, of cameras that
nothing is known of: phones have 0.65 to 0.95, 3DPW's 1.02, a car's 0.58, long lenses 2 and more."""
LOG_FOCALS = np.log(USUAL_FOCAL) + np.arange(-0.9, 1.41, 0.075)  # over the longer side
MOST_LINES, FEWEST_LINES = 120, 10  # of a picture, the longest
PARTS = 5  # of the lines, each of which is left out once (a jackknife)
SHARES = 0.2, 0.25, 0.25  # of lines along each direction
SLANT_RAD = np.deg2rad(0.7)  # of a line from its direction
TOLD_SHARE = 0.5
"""Of what a line would tell if it was built and seen on its own: a door has two sides."""
SAME_LINE_RAD = np.deg2rad(1.0)  # the other edge of a pole
SLOPE_BAND_RAD, ANY_SLOPE = np.deg2rad(6.0), 0.25
"""Slopes of a picture's lines are smoothed by this; so many lines have any slope at all."""
TILT_SIGMA_RAD, MOST_TILT_RAD = np.deg2rad(15.0), np.deg2rad(50.0)
"""Of a camera that is held by hand, along each axis."""
STEP_RAD = np.deg2rad(6.0)
REFINED = ((12, 4), (4, 16))
"""How many of the likeliest ways to hold the camera are looked at closer, at what share of the
step."""
OWN_SIGMA, MOST_SIGMA = 0.04, 0.16
"""What is added to the posterior's spread, as places are not quite at right angles and the middle
of the lens is not quite that of the picture, and the largest that is told.  Three of four rooms and
streets tell it (290 of NYU-VP, 102 of York Urban; Kluger et al. 2020), to 3.7 % in the median; 95 %
lie within one standard error, and none beyond three."""


class LinesConfig(Config):
    """Which lines are found."""

    frames: int = Field(default=16, ge=1, le=limits.MOST_FRAMES)
    """In so many pictures, evenly over the sequence."""
    longest_px: int = Field(default=1280, ge=64, le=limits.LARGEST_SIDE_PX)
    """Larger pictures are made smaller."""
    shortest_share: float = Field(default=0.03, gt=0, lt=1)
    """Length of a line, as a share of the picture's diagonal."""
    end_px: float = Field(default=1.5, gt=0)
    """Standard error of a line's end across it, in the picture that is looked at [px]."""


class FocalOfLines(NamedTuple):
    """What lines say of a focal length."""

    focal: float  # over the picture's longer side
    focal_sigma: float  # standard error, as a share of it


class _Pencils(NamedTuple):
    """Lines of a picture, as a pinhole of one focal length sees them."""

    normals: np.ndarray  # (N, 3) of the plane through the camera and each line
    middles: np.ndarray  # (N, 3) rays to their middles
    turn_sigmas: np.ndarray  # (N,) standard errors of their slopes in the picture [rad]
    by_chance: np.ndarray  # (N,) how likely such a slope is in this picture, over any slope


def straight_lines(frames: Frames, config: LinesConfig) -> tuple[list[np.ndarray], float]:
    """Ends (N, 2, 2) of each picture's lines that are not masked, and their standard error across
    the lines [px]."""
    shrink = min(1.0, config.longest_px / max(frames.size_px))
    lines = in_threads(lambda image: _ends(*frames.read(image, shrink), config), frames.images)
    return [ends / shrink for ends in lines], config.end_px / shrink


def _ends(gray: np.ndarray, background: np.ndarray, config: LinesConfig) -> np.ndarray:
    import cv2

    lines = cv2.createLineSegmentDetector().detect(gray)[0]
    # It counts from the middle of the first pixel.
    ends = np.zeros((0, 2, 2)) if lines is None else lines.reshape(-1, 2, 2).astype(float) + 0.5
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    ends = ends[lengths > config.shortest_share * np.hypot(*gray.shape)]
    ends = ends[~_on_border(ends, gray)]
    shares = np.linspace(0, 1, 9)[:, None, None]
    along = ends[:, 0] + shares * (ends[:, 1] - ends[:, 0])
    x, y = np.moveaxis(np.clip(along.astype(int), 0, np.array(gray.shape)[::-1] - 1), -1, 0)
    return np.asarray(ends[background[y, x].mean(axis=0) > FREE_SHARE])


def _on_border(ends: np.ndarray, gray: np.ndarray) -> np.ndarray:
    """(N,) bool: lines (N, 2, 2) along a side of a picture (h, w), or of bars about it: these are
    no lines of the place."""
    shown = (np.flatnonzero(gray.std(axis=axis) > BAR_SPREAD) for axis in (0, 1))
    low, high = np.array([(at[0], at[-1] + 1) if len(at) else (0, 0) for at in shown]).T
    along = np.all((ends < low + BORDER_PX) | (ends > high - BORDER_PX), axis=1)
    return np.asarray(np.any(along, axis=1))


def focal_of_lines(frames: Frames, lens: Lens | None, config: LinesConfig) -> FocalOfLines | None:
    """The focal length that lines ask for; None where they hardly tell.

    Args:
        lens: The one that is believed, whose middle and distortion count alone; None for none.
    """
    longest_px = max(frames.size_px)
    lens = lens or Lens.centred(longest_px, frames.size_px)
    rows = np.unique(np.linspace(0, len(frames.images) - 1, config.frames).round().astype(int))
    lines, end_px = straight_lines(frames.some(rows), config)

    def evidence(ends_px: np.ndarray) -> np.ndarray:
        return log_evidence(lens.rays(ends_px) * lens.focal_px[0] / longest_px, end_px / longest_px)

    # Pictures of a video show the same place, so their evidence is not added up.
    return focal_by(np.mean(in_threads(evidence, lines), axis=0))


def focal_by(logs: np.ndarray) -> FocalOfLines | None:
    """The focal length by the evidence (F, 1 + PARTS) of `log_evidence` and what is usual; None
    where lines hardly tell."""
    logs = logs - 0.5 * ((LOG_FOCALS[:, None] - np.log(USUAL_FOCAL)) / USUAL_SIGMA) ** 2
    weights = np.exp(logs - logs.max(axis=0))
    weights /= weights.sum(axis=0)
    mean, *others = LOG_FOCALS @ weights
    moved = np.array(others) - np.mean(others)
    variance = weights[:, 0] @ (LOG_FOCALS - mean) ** 2
    sigma = float(np.sqrt(variance + (PARTS - 1) / PARTS * moved @ moved + OWN_SIGMA**2))
    return None if sigma > MOST_SIGMA else FocalOfLines(float(np.exp(mean)), sigma)


def log_evidence(ends: np.ndarray, end_sigma: float) -> np.ndarray:
    """Log likelihood (F, 1 + PARTS) of each of `LOG_FOCALS`, over that of no directions at all, by
    all lines and by all but each part of them; of the likeliest way to hold the camera.

    Args:
        ends: (N, 2, 2) of the lines, from the principal point, over the picture's longer side.
        end_sigma: Standard error of an end across its line, in the same unit.
    """
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    ends = ends[np.argsort(-lengths, kind="stable")[:MOST_LINES]]
    ends = ends[apart(_planes(ends, USUAL_FOCAL)[0])]
    if len(ends) < FEWEST_LINES:
        return np.zeros((len(LOG_FOCALS), 1 + PARTS))
    turn_sigmas = np.sqrt(2) * end_sigma / np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    by_chance = _by_chance(ends)

    def of_focal(log_focal: float) -> np.ndarray:
        return _likeliest(_Pencils(*_planes(ends, np.exp(log_focal)), turn_sigmas, by_chance))

    return np.array([of_focal(log_focal) for log_focal in LOG_FOCALS])


def _planes(ends: np.ndarray, focal: float) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (N, 3) of the planes through the camera and each line, and unit rays (N, 3) to
    the lines' middles."""
    rays = np.concatenate([ends / focal, np.ones((*ends.shape[:2], 1))], axis=-1)
    both = np.cross(rays[:, 0], rays[:, 1]), rays.mean(axis=1)
    normals, middles = (row / np.linalg.norm(row, axis=1, keepdims=True) for row in both)
    return normals, middles


def apart(normals: np.ndarray) -> list[int]:
    """Rows of planes by their unit normals (N, 3), of which no two are one: the first stays."""
    kept: list[int] = []
    for row, normal in enumerate(normals):
        if np.abs(normals[kept] @ normal).max(initial=0.0) < np.cos(SAME_LINE_RAD):
            kept.append(row)
    return kept


def _by_chance(ends: np.ndarray) -> np.ndarray:
    """How likely each line's slope is by the slopes of all others (N,), over any slope."""
    x, y = (ends[:, 1] - ends[:, 0]).T
    slopes_rad = np.arctan2(y, x)
    off_rad = (slopes_rad[:, None] - slopes_rad + np.pi / 2) % np.pi - np.pi / 2
    near = np.sqrt(np.pi / 2) / SLOPE_BAND_RAD * np.exp(-0.5 * (off_rad / SLOPE_BAND_RAD) ** 2)
    np.fill_diagonal(near, 0.0)
    return np.asarray(ANY_SLOPE + (1 - ANY_SLOPE) * near.sum(axis=1) / (len(ends) - 1))


def _likeliest(lines: _Pencils) -> np.ndarray:
    """Log likelihoods (1 + PARTS,) of a focal length, at the likeliest way to hold the camera."""
    ways, blur_rad = _all_ways(), STEP_RAD / 2
    for most, share in REFINED:
        likely = _told(ways, lines, blur_rad).sum(axis=1) + _held(ways)
        step_rad, blur_rad = STEP_RAD / share, STEP_RAD / share / 2
        around = np.stack(np.meshgrid(*[step_rad * np.arange(-2.0, 3.0)] * 3), axis=-1)
        ways = (ways[np.argsort(-likely)[:most], None] + around.reshape(-1, 3)).reshape(-1, 3)
    parts = 1.0 - (np.arange(len(lines.normals))[:, None] % PARTS == np.arange(-1, PARTS))
    told = _told(ways, lines, 0.0) @ parts + _held(ways)[:, None]
    # There may be no such directions, as in a forest.
    return np.asarray(np.logaddexp(0.0, told).max(axis=0))


def _all_ways() -> np.ndarray:
    """Ways (M, 3) to hold a camera: tilts of the direction next to the picture's up to the right
    and to the front, and the turn of the other two about it [rad]."""
    tilts_rad = np.arange(-MOST_TILT_RAD, MOST_TILT_RAD + 1e-9, STEP_RAD)
    turns_rad = np.arange(0.0, np.pi / 2, STEP_RAD)
    ways = np.stack(np.meshgrid(tilts_rad, tilts_rad, turns_rad), axis=-1).reshape(-1, 3)
    return np.asarray(ways[np.linalg.norm(ways[:, :2], axis=1) < MOST_TILT_RAD])


def _held(ways: np.ndarray) -> np.ndarray:
    return np.asarray(-0.5 * (ways[:, :2] ** 2).sum(axis=1) / TILT_SIGMA_RAD**2)


def _told(ways: np.ndarray, lines: _Pencils, blur_rad: float) -> np.ndarray:
    """What each line tells (M, N) for ways to hold the camera (M, 3); each stands for those about
    it."""
    likely = (1 - sum(SHARES)) * lines.by_chance
    for share, direction in zip(SHARES, _directions(ways), strict=True):
        off = direction @ lines.normals.T
        # Near the point in which they meet, lines of a direction have any slope.
        across2 = np.maximum(1 - (direction @ lines.middles.T) ** 2, 1e-6)
        variances = SLANT_RAD**2 + blur_rad**2 + lines.turn_sigmas**2 * across2
        near = np.sqrt(np.pi / 2 * across2 / variances) * np.exp(-0.5 * off**2 / variances)
        likely = likely + share * near
    return np.asarray(TOLD_SHARE * np.log(likely / lines.by_chance))


def _directions(ways: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The three directions (M, 3) in the camera, of ways (M, 3) to hold it."""
    right, front, turn = ways.T
    up = np.stack([np.tan(right), -np.ones(len(ways)), np.tan(front)], axis=1)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    east = np.cross(up, [0.0, 0.0, 1.0])
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    north = np.cross(up, east)
    cosine, sine = np.cos(turn)[:, None], np.sin(turn)[:, None]
    return up, cosine * east + sine * north, cosine * north - sine * east
