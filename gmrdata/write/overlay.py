"""Bodies and their paths on the floor, drawn over the frames; and that as a video."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from gmrdata.read.frames import read_color
from gmrdata.values import transforms
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath, project_cam
from gmrdata.values.errors import BadFrames, BadMotionFile
from gmrdata.values.skinning import motion_vertices_m
from gmrdata.write.take import Performer, Take, check_take
from gmrdata.write.video import write_video

OVERLAY_BGR = {"body": (255, 210, 130), "outline": (255, 255, 255), "path": (90, 225, 255)}
BODY_ALPHA = 0.8
LINE_PX = 2
TOWARDS_LIGHT = np.array([-0.35, -0.6, -0.72])
"""The body is lit from above the camera's left shoulder."""
_SUPERSAMPLE = 2
_FAR_PX = 20000.0
"""OpenCV's drawing takes 16-bit coordinates once they are shifted; a NaN is beyond it too."""
Bend = Callable[[np.ndarray], np.ndarray]
"""Moves points (N, 3) in the camera to where a pinhole shows them as the lens does."""


def straight(points_cam_m: np.ndarray) -> np.ndarray:
    """What a lens without distortion does."""
    return points_cam_m


def write_overlay(
    path: Path, take: Take, images: Sequence[Path | None], bend: Bend = straight
) -> None:
    """Write the frames of a take as an mp4 of its rate, with the bodies and their paths drawn in.

    A row without a known camera shows its frame as it is, one without a frame is black.  A dot
    stands on the path, which lies on the floor z = 0, at each second.

    Args:
        path: The .mp4 file; an odd width or height is made even, as `write_video` says.
        take: With a camera.
        images: The frame of each row; None for none.
        bend: What the lens does.
    """
    check_take(take)
    if take.camera is None:
        raise BadMotionFile(f"take {take.name}: no camera, so nothing can be drawn over the frames")
    if len(images) != take.n_frames:
        raise BadFrames(f"take {take.name}: {len(images)} images for {take.n_frames} rows")
    if not any(images):
        raise BadFrames(f"take {take.name}: no row has an image")
    write_video(_overlays(take, take.camera, images, bend), path, take.fps_hz)


def _overlays(
    take: Take, path: CameraPath, images: Sequence[Path | None], bend: Bend
) -> Iterator[np.ndarray]:
    """Each frame (H, W, 3), red first, with all that is known in it."""
    for row, image in enumerate(images):
        drawn = read_frame(image, path)
        if image is not None and path.has_camera[row]:
            drawn = draw_people(drawn, take.people, path, row, round(take.fps_hz), bend)
        yield drawn[..., ::-1]


def read_frame(image: Path | None, path: CameraPath) -> np.ndarray:
    """A frame (H, W, 3) BGR of the camera's size; black where there is none."""
    size = (path.height_px, path.width_px, 3)
    if image is None:
        return np.zeros(size, np.uint8)
    frame = read_color(image)
    if frame.shape != size:
        sizes = "{1}x{0} px, but its camera has {3}x{2} px".format(*frame.shape[:2], *size[:2])
        raise BadFrames(f"{image}: {sizes}")
    return frame


def draw_people(
    image: np.ndarray,
    people: Sequence[Performer],
    path: CameraPath,
    row: int,
    every: int,
    bend: Bend = straight,
) -> np.ndarray:
    """A copy of a BGR image with those who are shown in a row, near ones over far ones, and with
    everybody's path on the floor, a dot at each `every`-th row."""
    cam_from_world = transforms.invert(path.world_from_cam[row])
    drawn, every = image, max(1, every)
    for person in people:
        floor_m = bend(transforms.apply(cam_from_world, floor_path_m(person, every)))
        drawn = draw_floor_path(drawn, path.intrinsics_px, floor_m, every)
    there = [person for person in people if person.shown[row]]
    towards = path.world_from_cam[row, :3, 2]
    for person in sorted(there, key=lambda one: -float(one.motion.pelvis_m[row] @ towards)):
        now = person.motion.take(slice(row, row + 1))
        vertices_m = bend(transforms.apply(cam_from_world, motion_vertices_m(person.body, now)[0]))
        drawn = draw_body(drawn, path.intrinsics_px, vertices_m, person.body)
    return drawn


def floor_path_m(person: Performer, every: int = 1) -> np.ndarray:
    """(N, 3) pelvis path on the floor z = 0, NaN in frames without a pose, where it is broken: from
    the `every`-th row at or before the first pose to the last one.  A film's other minutes are no
    part of it."""
    rows = np.flatnonzero(person.shown)
    time = slice(rows[0] // every * every, rows[-1] + 1) if len(rows) else slice(0)
    path_m = np.where(person.shown[time, None], person.motion.pelvis_m[time], np.nan)
    path_m[:, 2] = 0.0
    return path_m


def draw_floor_path(
    image: np.ndarray, intrinsics_px: np.ndarray, path_cam_m: np.ndarray, every: int
) -> np.ndarray:
    """A copy of a BGR image with a path on the floor (N, 3), in the camera's axes, drawn in, a dot
    at each `every`-th point."""
    points_px = project_cam(path_cam_m, intrinsics_px)
    # OpenCV's pixel centres are whole numbers, and the drawing takes 4 fractional bits.
    fixed = np.round((points_px - 0.5) * 16)
    out, margin_px, size_px = image.copy(), 4 * LINE_PX, image.shape[1::-1]

    # Of ten minutes' path a picture shows little, and each call of OpenCV takes its time.
    def shown(low_px: np.ndarray, high_px: np.ndarray) -> np.ndarray:
        near = (high_px > -margin_px) & (low_px < np.add(size_px, margin_px))
        near &= (high_px < _FAR_PX) & (low_px > -_FAR_PX)
        return np.flatnonzero(near.all(axis=1))

    start_px, stop_px = points_px[:-1], points_px[1:]
    lines = shown(np.minimum(start_px, stop_px), np.maximum(start_px, stop_px))
    for start, stop in np.stack([fixed[lines], fixed[lines + 1]], axis=1).astype(int).tolist():
        cv2.line(out, start, stop, OVERLAY_BGR["path"], LINE_PX, cv2.LINE_AA, 4)
    dots = shown(points_px[::every], points_px[::every])
    for point in fixed[::every][dots].astype(int).tolist():
        cv2.circle(out, point, 3 * LINE_PX << 4, OVERLAY_BGR["path"], -1, cv2.LINE_AA, 4)
    return out


def draw_body(
    image: np.ndarray, intrinsics_px: np.ndarray, vertices_cam_m: np.ndarray, body: BodyModel
) -> np.ndarray:
    """A copy of a BGR image with a shaded, see-through body mesh (V, 3), in the camera's axes, over
    it."""
    triangles_m = vertices_cam_m[body.faces]
    normals = np.cross(triangles_m[:, 1] - triangles_m[:, 0], triangles_m[:, 2] - triangles_m[:, 0])
    facing = np.einsum("fi,fi->f", normals, triangles_m.mean(axis=1)) < 0
    shown = facing & (triangles_m[..., 2] > 0.01).all(axis=1)
    triangles_m, normals = triangles_m[shown], normals[shown]
    order = np.argsort(-triangles_m[..., 2].mean(axis=1), kind="stable")
    points_px = project_cam(triangles_m[order], intrinsics_px)
    lengths = np.linalg.norm(normals[order], axis=1, keepdims=True)
    lambert = (normals[order] / np.maximum(lengths, 1e-12)) @ TOWARDS_LIGHT
    return _paint(image, points_px, np.minimum(0.55 + 0.55 * np.clip(lambert, 0.0, 1.0), 1.0))


def _paint(image: np.ndarray, triangles_px: np.ndarray, shades: np.ndarray) -> np.ndarray:
    """Fill triangles from back to front at twice the size, then blend the smoothed layer in."""
    height, width = image.shape[:2]
    layer = np.zeros((height * _SUPERSAMPLE, width * _SUPERSAMPLE), np.uint8)  # 0 = no body
    drawable = (np.abs(triangles_px) < _FAR_PX).all(axis=(1, 2))
    corners = np.round((triangles_px[drawable] * _SUPERSAMPLE - 0.5) * 16).astype(np.int32)
    greys = np.round(255 * shades[drawable]).tolist()
    for triangle, grey in zip(corners, greys, strict=True):
        cv2.fillConvexPoly(layer, triangle, (grey,), cv2.LINE_8, 4)
    # What the body leaves free stays as it is.
    left, top, wide, high = cv2.boundingRect(layer)
    if not wide:
        return image.copy()
    rows, columns = (
        slice(first // _SUPERSAMPLE, -(-(first + count) // _SUPERSAMPLE))
        for first, count in ((top, high), (left, wide))
    )
    cut = layer[_twice(rows), _twice(columns)].astype(np.float32)
    size_px = (columns.stop - columns.start, rows.stop - rows.start)
    cover, shade = (
        cv2.resize(part, size_px, interpolation=cv2.INTER_AREA)[..., None]
        for part in ((cut > 0).astype(np.float32), cut)
    )
    # `shade` is 0 outside the body, so at its edge it is already shade x cover.
    body = shade / 255.0 * np.array(OVERLAY_BGR["body"])
    blend = (1 - BODY_ALPHA * cover) * image[rows, columns] + BODY_ALPHA * body
    out = image.copy()
    out[rows, columns] = np.clip(np.round(blend), 0, 255).astype(np.uint8)
    return out


def _twice(pixels: slice) -> slice:
    """The same stretch in the layer of twice the size."""
    return slice(pixels.start * _SUPERSAMPLE, pixels.stop * _SUPERSAMPLE)
