"""What a world motion looks like: its path from above, and a video of the body on a ground grid.

The body is drawn with OpenCV: no graphics card, no window.  Triangles that face the camera are
filled from the farthest to the nearest (painter's algorithm), each in one shade by the light's
angle; a mesh of some ten thousand small ones looks smooth so.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from matplotlib.figure import Figure

from gmrdata.film.camera_moves import look_at, smooth_path
from gmrdata.gmr.infer import InferConfig
from gmrdata.pages.plots import RECOVERED_WIDTH, finish_view, mark_start, picture, plot_path
from gmrdata.pages.view3d import ViewedPerson, ViewedWorld, write_view
from gmrdata.solve.verdict import VIEW
from gmrdata.stage.progress import track
from gmrdata.values import transforms
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import intrinsics_from_fov, project_cam
from gmrdata.values.clip import Clip
from gmrdata.values.files import write_bytes
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_vertices_m
from gmrdata.write.video import write_video

HFOV_DEG = 50.0
DISTANCE_M = 4.2
HEIGHT_M = 1.7
FOLLOW_SIGMA_S = 0.6
SHORTEST_WAY_M = 0.5  # on a shorter path the camera stands before the person, else beside the path


def film_camera(motion: Motion) -> np.ndarray:
    """Cameras (T, 4, 4), world_from_cam [m], that look across the longest way of the path from the
    side that the body's front shows to.  They never turn: what turns in the film is the person."""
    targets_m = smooth_path(motion.pelvis_m, motion.fps_hz, FOLLOW_SIGMA_S, lag_s=0.0)
    targets_m[:, 2] = max(0.5, float(np.median(motion.pelvis_m[:, 2])))
    centres_m = targets_m + DISTANCE_M * _side(motion)
    centres_m[:, 2] = max(HEIGHT_M, targets_m[0, 2] + 0.5)
    return transforms.rigid(look_at(centres_m, targets_m), centres_m)


def _side(motion: Motion) -> np.ndarray:
    """The horizontal direction (3,) from the person to the camera."""
    front = motion.root_rotmats[:, :2, 2].mean(axis=0)  # +z in the rest pose
    if np.linalg.norm(front) < 1e-3:
        front = np.array([0.0, -1.0])
    front = front / np.linalg.norm(front)
    centred_m = motion.pelvis_m[:, :2] - motion.pelvis_m[:, :2].mean(axis=0)
    _, spreads, axes = np.linalg.svd(centred_m, full_matrices=False)
    along = axes[0]
    if spreads[0] / np.sqrt(len(centred_m)) < SHORTEST_WAY_M / 4:
        along = np.array([front[1], -front[0]])
    across = np.array([-along[1], along[0]])
    across = across if across @ front >= 0 else -across
    # Not square across: a step towards the front shows the face and the depth of the path.
    direction = across + 0.5 * front
    direction /= np.linalg.norm(direction)
    return np.array([*direction, 0.0])


BACKGROUND = np.array([244.0, 245.0, 246.0])
GRID = np.array([176.0, 182.0, 188.0])
SKIN = np.array([128.0, 164.0, 208.0])
SHADOW = 0.8  # brightness of the ground in the shadow
LIGHT_FROM_CAMERA = (0.4, 0.5, 1.0)
"""Direction to the light: to the camera's right, from the person to the camera, up."""
AMBIENT = 0.45
OVERSAMPLING = 2
GRID_REACH = 12  # lines of the grid on each side of its middle; they are 1 m apart
FADE_M = 9.0
NEAREST_M = 0.1
_BITS = 4  # cv2 takes polygon corners as integers with this many fractional bits


class Framing(NamedTuple):
    """What all pictures share."""

    intrinsics_px: np.ndarray
    width_px: int
    height_px: int


class _View(NamedTuple):
    """A picture that is drawn into, and who sees it."""

    picture: np.ndarray
    cam_from_world: np.ndarray
    intrinsics_px: np.ndarray

    def corners(self, points_cam_m: np.ndarray) -> np.ndarray:
        """Image points as cv2 takes them: its (0, 0) is the first pixel's centre, ours a corner."""
        points_px = project_cam(points_cam_m, self.intrinsics_px)
        far_px = 8.0 * max(self.picture.shape)  # further out cv2's integers would run over
        bounded = np.clip(np.nan_to_num(points_px, nan=0.0) - 0.5, -far_px, far_px)
        return np.rint(bounded * (1 << _BITS)).astype(np.int32)


def draw_body(
    vertices_m: np.ndarray, faces: np.ndarray, world_from_cam: np.ndarray, film: Framing
) -> np.ndarray:
    """The picture (height, width, 3) uint8, red first, of a body (V, 3) [m] above the floor z = 0,
    whose faces (F, 3) go counter-clockwise seen from outside."""
    large = (film.height_px * OVERSAMPLING, film.width_px * OVERSAMPLING, 3)
    intrinsics_px = film.intrinsics_px * [[OVERSAMPLING], [OVERSAMPLING], [1.0]]
    picture = np.empty(large, np.uint8)
    picture[:] = BACKGROUND.astype(np.uint8)
    view = _View(picture, transforms.invert(world_from_cam), intrinsics_px)
    light = _light(world_from_cam)
    _draw_grid(view, vertices_m.mean(axis=0))
    _draw_shadow(view, vertices_m, faces, light)
    _draw_mesh(view, vertices_m, faces, light)
    small = (film.width_px, film.height_px)
    return np.asarray(cv2.resize(picture, small, interpolation=cv2.INTER_AREA))


def _light(world_from_cam: np.ndarray) -> np.ndarray:
    """(3,) unit direction to the light, which stands above the camera and to its right."""
    rightwards, towards = world_from_cam[:3, 0], -world_from_cam[:3, 2] * [1.0, 1.0, 0.0]
    right, near, up = LIGHT_FROM_CAMERA
    light = right * rightwards + near * towards / np.linalg.norm(towards) + [0.0, 0.0, up]
    return np.asarray(light / np.linalg.norm(light))


def _draw_grid(view: _View, middle_m: np.ndarray) -> None:
    """Lines 1 m apart at whole metres, which fade with the distance from the person."""
    near = np.floor(middle_m[:2]).astype(int)
    steps = np.arange(-GRID_REACH, GRID_REACH + 1)
    for axis in (0, 1):
        for line in steps + near[axis]:
            points_m = np.zeros((len(steps), 3))
            points_m[:, axis], points_m[:, 1 - axis] = line, steps + near[1 - axis]
            _draw_fading_line(view, points_m, middle_m)


def _draw_fading_line(view: _View, points_m: np.ndarray, middle_m: np.ndarray) -> None:
    points_cam_m = transforms.apply(view.cam_from_world, points_m)
    corners = view.corners(points_cam_m)
    ahead = points_cam_m[:, 2] > NEAREST_M
    centres_m = (points_m[1:, :2] + points_m[:-1, :2]) / 2
    strength = np.exp(-((np.linalg.norm(centres_m - middle_m[:2], axis=1) / FADE_M) ** 2))
    for i in np.flatnonzero(ahead[1:] & ahead[:-1] & (strength > 0.02)):
        colour = BACKGROUND + strength[i] * (GRID - BACKGROUND)
        start, end = (tuple(map(int, corner)) for corner in corners[i : i + 2])
        cv2.line(view.picture, start, end, colour.tolist(), OVERSAMPLING, cv2.LINE_AA, _BITS)


def _draw_shadow(view: _View, vertices_m: np.ndarray, faces: np.ndarray, light: np.ndarray) -> None:
    fallen_m = vertices_m - vertices_m[:, 2:] / light[2] * light
    fallen_cam_m = transforms.apply(view.cam_from_world, fallen_m)
    lit = faces[_normals(vertices_m, faces) @ light > 0]
    lit = lit[(fallen_cam_m[:, 2] > NEAREST_M)[lit].all(axis=1)]
    mask = np.zeros(view.picture.shape[:2], np.uint8)
    for triangle in view.corners(fallen_cam_m)[lit]:
        cv2.fillConvexPoly(mask, triangle, [255], cv2.LINE_8, _BITS)
    soft = cv2.blur(mask, (5 * OVERSAMPLING, 5 * OVERSAMPLING)).astype(np.float32) / 255
    view.picture[:] = (view.picture * (1 - (1 - SHADOW) * soft[..., None])).astype(np.uint8)


def _draw_mesh(view: _View, vertices_m: np.ndarray, faces: np.ndarray, light: np.ndarray) -> None:
    cam_m = transforms.apply(view.cam_from_world, vertices_m)
    corners_m = cam_m[faces]
    faces_camera = (_normals(cam_m, faces) * corners_m[:, 0]).sum(axis=1) < 0
    seen = np.flatnonzero(faces_camera & (corners_m[..., 2] > NEAREST_M).all(axis=1))
    seen = seen[np.argsort(-corners_m[seen, :, 2].mean(axis=1), kind="stable")]
    shade = AMBIENT + (1 - AMBIENT) * np.clip(_normals(vertices_m, faces[seen]) @ light, 0.0, 1.0)
    colours = np.clip(shade[:, None] * SKIN * 1.15, 0, 255).tolist()
    for triangle, colour in zip(view.corners(cam_m)[faces[seen]], colours, strict=True):
        cv2.fillConvexPoly(view.picture, triangle, colour, cv2.LINE_8, _BITS)


def _normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(F, 3) unit normals; zero for a triangle without area."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12))


PLOT_IN = 5.0
LARGEST_VIDEO_HZ = 30.0  # a motion of a higher rate is filmed at every second, third, ... frame
POSED_AT_ONCE = 32


def draw_motion(folder: Path, clip: Clip, body: BodyModel, config: InferConfig) -> None:
    """Add `path.png`, `view3d.html` and, if wanted, `body.mp4` to a folder; what is there is whole
    and kept."""
    path, view, video = folder / "path.png", folder / VIEW, folder / "body.mp4"
    if not path.exists():
        write_top_view(path, clip.motion)
    if not view.exists():
        times_s = np.arange(clip.motion.n_frames) / clip.motion.fps_hz
        write_view(view, ViewedWorld(times_s, [ViewedPerson(clip, "gmr", body)]))
    if config.video and not video.exists():
        size_px = (config.width_px, config.height_px)
        write_body_video(video, clip.motion, body, size_px, folder.name)


def write_top_view(path: Path, motion: Motion) -> None:
    """A PNG of the pelvis's path from above, in a z-up world, with a metric grid."""

    def draw(plot: Figure) -> None:
        axes = plot.subplots()
        plot_path(axes, motion.pelvis_m, "gmr", RECOVERED_WIDTH)
        mark_start(axes, motion.pelvis_m, "gmr", "start", None)
        finish_view(axes)

    write_bytes(path, picture(draw, PLOT_IN, PLOT_IN, dpi=120))


def write_body_video(
    path: Path, motion: Motion, body: BodyModel, size_px: tuple[int, int], name: str
) -> None:
    """An mp4 of the body in a z-up world, the floor at z = 0, in real time; the bar says `name`."""
    step = max(1, int(np.ceil(motion.fps_hz / LARGEST_VIDEO_HZ - 1e-6)))
    rows = np.arange(0, motion.n_frames, step)
    world_from_cam = film_camera(motion)
    film = Framing(intrinsics_from_fov(HFOV_DEG, *size_px), *size_px)

    def frames() -> Iterator[np.ndarray]:
        for start in range(0, len(rows), POSED_AT_ONCE):
            now = rows[start : start + POSED_AT_ONCE]
            for row, vertices_m in zip(now, motion_vertices_m(body, motion, rows=now), strict=True):
                yield draw_body(vertices_m.astype(float), body.faces, world_from_cam[row], film)

    pictures = track(frames(), f"drawing {name}", total=len(rows))
    write_video(pictures, path, motion.fps_hz / step)
