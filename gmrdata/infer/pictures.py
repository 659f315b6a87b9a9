"""What a world motion looks like: its path from above, and a video of the body on a ground grid."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from gmrdata.body.model import BodyModel
from gmrdata.body.skin import motion_vertices_m
from gmrdata.geometry.camera import intrinsics_from_fov
from gmrdata.infer.draw_body import Film, draw_body
from gmrdata.infer.film_camera import HFOV_DEG, film_camera
from gmrdata.motion.motion import Motion
from gmrdata.progress import track
from gmrdata.report.style import picture
from gmrdata.report.topview import RECOVERED_WIDTH, draw_path, finish_view, mark_start
from gmrdata.store import atomic_path
from gmrdata.video_out import write_video

PLOT_IN = 5.0
LARGEST_VIDEO_HZ = 30.0
"""A motion of a higher rate is filmed at every second, third, ... frame."""
POSED_AT_ONCE = 32


def write_top_view(path: Path, motion: Motion) -> None:
    """A PNG of the pelvis's path from above, with a metric grid.

    Args:
        path: The file.
        motion: In a z-up world.
    """

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        draw_path(axes, motion.pelvis_m, "gmr", RECOVERED_WIDTH)
        mark_start(axes, motion.pelvis_m, "gmr", "start", None)
        finish_view(axes)

    with atomic_path(path) as temporary:
        temporary.write_bytes(picture(draw, PLOT_IN, PLOT_IN, dpi=120))


def write_body_video(
    path: Path, motion: Motion, body: BodyModel, size_px: tuple[int, int], name: str
) -> None:
    """An mp4 of the body on the ground, in real time.

    Args:
        path: The file.
        motion: In a z-up world with the floor at z = 0.
        body: Its body.
        size_px: Width and height of the pictures.
        name: What the progress bar calls it.
    """
    step = max(1, int(np.ceil(motion.fps_hz / LARGEST_VIDEO_HZ - 1e-6)))
    rows = np.arange(0, motion.n_frames, step)
    frames = track(_frames(motion, body, rows, size_px), f"drawing {name}", total=len(rows))
    write_video(frames, path, motion.fps_hz / step)


def _frames(
    motion: Motion, body: BodyModel, rows: np.ndarray, size_px: tuple[int, int]
) -> Iterator[np.ndarray]:
    world_from_cam = film_camera(motion)
    film = Film(intrinsics_from_fov(HFOV_DEG, *size_px), *size_px)
    for start in range(0, len(rows), POSED_AT_ONCE):
        now = rows[start : start + POSED_AT_ONCE]
        for row, vertices_m in zip(now, motion_vertices_m(body, motion, rows=now), strict=True):
            yield draw_body(vertices_m.astype(np.float64), body.faces, world_from_cam[row], film)
