"""Poses before the camera against the truth."""

from dataclasses import dataclass

import numpy as np
from people.real import TWELVE, VIEW_HZ, Dance, View
from poses.score import aligned_mm

from gmrdata.values.body import BodyModel
from gmrdata.values.motion import Motion
from gmrdata.values.people import LocalPoses
from gmrdata.values.skinning import motion_joints_m, motion_vertices_m

ALONG_SIGMA = 0.042
"""Error of a place along the ray, as a share of the distance, for which `within` is told."""
LIDAR_PX = 3.75
"""Pixels of the picture in one of LiDAR's."""
FEWEST_PX = 30


@dataclass(frozen=True)
class ViewRow:
    """One view's figures; joints are the 12 of limbs."""

    view: str
    frames: int
    pa_mm: float
    """Mean distance after each frame's similarity."""
    mpjpe_mm: float
    """The same with the hips' middle moved onto the true one, and nothing else."""
    distance_ratio: float
    """Median of the hips' depth over the true one."""
    reversed_share: float
    """Share of frames whose left and right, by hips and shoulders, are exchanged."""
    along_share: float
    """Mean error of the hips along the ray, as a share of the distance, and its deviation."""
    along_share_sd: float
    memory_s: float
    """Time after which 1 / e of that error is left."""
    within: tuple[float, float]
    """Shares of frames within one and two of `ALONG_SIGMA`."""
    unsure_frames: int
    """Left out, since front and back may be exchanged."""
    doubt: str


def motion_of(poses: LocalPoses, body: BodyModel, fps_hz: float) -> Motion:
    """Local poses as a motion before the camera."""
    return Motion(
        poses.local_rotmats,
        poses.root_rotmats,
        poses.pelvis_m,
        np.zeros(body.n_shape),
        fps_hz,
        body.name,
        "neutral",
        "camera",
        "people",
    )


def view_row(view: View, poses: LocalPoses, body: BodyModel, doubt: str) -> ViewRow:
    """The man's poses against his true joints."""
    fps_hz, true_m = VIEW_HZ, view.true_m[poses.frame_numbers]
    found_m = motion_joints_m(body, motion_of(poses, body, fps_hz))[:, TWELVE]
    hips_m, true_hips_m = found_m[:, 6:8].mean(1), true_m[:, 6:8].mean(1)
    centred = (found_m - hips_m[:, None]) - (true_m - true_hips_m[:, None])
    along = _along(hips_m, true_hips_m) / np.linalg.norm(true_hips_m, axis=1)
    return ViewRow(
        view=view.name,
        frames=len(found_m),
        pa_mm=float(aligned_mm(found_m, true_m).mean()),
        mpjpe_mm=float(1000 * np.linalg.norm(centred, axis=-1).mean()),
        distance_ratio=float(np.median(hips_m[:, 2] / true_hips_m[:, 2])),
        reversed_share=float((_facing(found_m, true_m) < 0).mean()),
        along_share=float(along.mean()),
        along_share_sd=float(along.std()),
        memory_s=_memory_s(along, fps_hz),
        within=within(along / ALONG_SIGMA),
        unsure_frames=len(view.true_m) - len(found_m),
        doubt=doubt,
    )


def within(sizes: np.ndarray) -> tuple[float, float]:
    """Shares of errors, in their standard errors, that are within one and two."""
    return float((np.abs(sizes) < 1).mean()), float((np.abs(sizes) < 2).mean())


def _memory_s(errors: np.ndarray, fps_hz: float) -> float:
    off = errors - errors.mean()
    like = [(off[n:] * off[: len(off) - n]).mean() for n in range(len(off) // 2)]
    return float(np.argmax(np.array(like) < like[0] / np.e) / fps_hz)


def _along(found_m: np.ndarray, true_m: np.ndarray) -> np.ndarray:
    rays = true_m / np.linalg.norm(true_m, axis=1, keepdims=True)
    return np.asarray(((found_m - true_m) * rays).sum(axis=1))


def _facing(found_m: np.ndarray, true_m: np.ndarray) -> np.ndarray:
    """(T,) cosine between the two bodies' left: hips and shoulders together."""

    def left(joints_m: np.ndarray) -> np.ndarray:
        aside = joints_m[:, [0, 6]].sum(1) - joints_m[:, [1, 7]].sum(1)
        return np.asarray(aside / np.linalg.norm(aside, axis=1, keepdims=True))

    return np.asarray((left(found_m) * left(true_m)).sum(axis=1))


@dataclass(frozen=True)
class ShirtRow:
    """The dancer's torso beside LiDAR's."""

    lidar_frames: int
    depth_ratio: float
    """Median over frames of the body's depth over LiDAR's, at the shirt."""
    depth_ratio_16: float
    """What 16 % of the frames are below, and 84 %."""
    depth_ratio_84: float
    within: tuple[float, float]
    """Shares of frames within one and two of `ALONG_SIGMA`."""


def shirt_row(poses: LocalPoses, dance: Dance, body: BodyModel) -> ShirtRow:
    """A person's poses against LiDAR's depth of the shirt."""
    ratios, _ = drawn_shirt(motion_of(poses, body, 30.0), poses.frame_numbers, dance, body)
    known = ratios[np.isfinite(ratios)]
    low, middle, high = np.percentile(known, [16, 50, 84]).tolist()
    return ShirtRow(len(known), middle, low, high, within((known - 1) / ALONG_SIGMA))


def drawn_shirt(
    motion: Motion, numbers: np.ndarray, dance: Dance, body: BodyModel
) -> tuple[np.ndarray, np.ndarray]:
    """Of the body at the shirt's pixels: median depth over LiDAR's (N,), and the median point (N,
    3) before the camera [m]; NaN where not seen."""
    row_of = {int(number): row for row, number in enumerate(numbers)}
    shown = [n for n, number in enumerate(dance.rows) if int(number) in row_of]
    rows = np.array([row_of[int(dance.rows[n])] for n in shown])
    ratios, places_m = np.full(len(dance.rows), np.nan), np.full((len(dance.rows), 3), np.nan)
    for start in range(0, len(shown), 32):
        some = slice(start, start + 32)
        vertices_m = motion_vertices_m(body, motion, rows=rows[some])
        for n, placed_m in zip(shown[some], vertices_m, strict=True):
            drawn_m = _drawn_depth_m(placed_m, body.faces, dance)
            ratio = drawn_m / dance.depth_m[n]
            row, column = np.nonzero(np.isfinite(ratio))
            if len(row) >= FEWEST_PX:
                ratios[n] = np.nanmedian(ratio)
                rays = dance.lens.rays((np.stack([column, row], axis=-1) + 0.5) * LIDAR_PX)
                z = drawn_m[row, column, None]
                places_m[n] = np.median(np.concatenate([rays * z, z], axis=-1), axis=0)
    return ratios, places_m


def _drawn_depth_m(vertices_m: np.ndarray, faces: np.ndarray, dance: Dance) -> np.ndarray:
    """The nearest of vertices and faces' middles at each of LiDAR's pixels; NaN where none is."""
    points_m = np.concatenate([vertices_m, vertices_m[faces].mean(axis=1)])
    at_px = points_m[:, :2] / points_m[:, 2:] * dance.lens.focal_px + dance.lens.centre_px
    column, row = np.floor(at_px / LIDAR_PX).astype(int).T
    height, width = dance.depth_m.shape[1:]
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    drawn = np.full((height, width), np.inf)
    np.minimum.at(drawn, (row[inside], column[inside]), points_m[inside, 2])
    return np.where(np.isfinite(drawn), drawn, np.nan)
