"""What is drawn over a frame: the path on the floor, the body, the mask's outline."""

from itertools import pairwise

import cv2
import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.geometry import camera, transforms

BODY_BGR = (255, 210, 130)
OUTLINE_BGR = (255, 255, 255)
PATH_BGR = (90, 225, 255)
BODY_ALPHA = 0.8
LINE_PX = 2
_SUPERSAMPLE = 2
_FAR_PX = 20000.0  # OpenCV's drawing takes 16-bit coordinates once they are shifted


def draw_mask_outline(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """A copy of a BGR image with the outline of a mask (H, W), non-zero = dynamic object."""
    contours, _ = cv2.findContours(
        (mask > 0).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    return cv2.polylines(image.copy(), contours, True, OUTLINE_BGR, LINE_PX, cv2.LINE_AA)


def draw_floor_path(
    image: np.ndarray,
    world_from_cam: np.ndarray,
    intrinsics_px: np.ndarray,
    path_world_m: np.ndarray,
    every: int,
) -> np.ndarray:
    """A copy of a BGR image with a path on the floor drawn into it, a dot at each `every`-th point.

    A path that is fixed in the world stays where it is in the scene from frame to frame only if the
    camera is right.
    """
    points_px = camera.project(world_from_cam, path_world_m, intrinsics_px)
    out = image.copy()
    for start, stop in pairwise(points_px):
        if _drawable(start) and _drawable(stop):
            cv2.line(out, _fixed(start), _fixed(stop), PATH_BGR, LINE_PX, cv2.LINE_AA, 4)
    for point in points_px[::every]:
        if _drawable(point):
            cv2.circle(out, _fixed(point), 3 * LINE_PX << 4, PATH_BGR, -1, cv2.LINE_AA, 4)
    return out


def draw_body(
    image: np.ndarray,
    world_from_cam: np.ndarray,
    intrinsics_px: np.ndarray,
    vertices_world_m: np.ndarray,
    body: BodyModel,
) -> np.ndarray:
    """A copy of a BGR image with a shaded, see-through body mesh over it.

    Args:
        image: (H, W, 3) BGR.
        world_from_cam: (4, 4) [m].
        intrinsics_px: (3, 3) [px].
        vertices_world_m: (V, 3) [m].
        body: Gives the faces.
    """
    points_cam_m = transforms.apply(transforms.invert(world_from_cam), vertices_world_m)
    triangles_m = points_cam_m[body.faces]
    normals = np.cross(triangles_m[:, 1] - triangles_m[:, 0], triangles_m[:, 2] - triangles_m[:, 0])
    facing = np.einsum("fi,fi->f", normals, triangles_m.mean(axis=1)) < 0
    shown = facing & (triangles_m[..., 2] > 0.01).all(axis=1)
    triangles_m, normals = triangles_m[shown], normals[shown]
    order = np.argsort(-triangles_m[..., 2].mean(axis=1), kind="stable")
    points_px = camera.project_cam(triangles_m[order], intrinsics_px)
    return _paint(image, points_px, _shades(normals[order]))


def _shades(normals: np.ndarray) -> np.ndarray:
    """(F,) brightness in 0.55..1 of faces lit from above the camera's left shoulder."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    towards_light = np.array([-0.35, -0.6, -0.72])
    lambert = (normals / np.maximum(length, 1e-12)) @ towards_light
    return np.clip(0.55 + 0.55 * np.clip(lambert, 0.0, 1.0), 0.0, 1.0)


def _paint(image: np.ndarray, triangles_px: np.ndarray, shades: np.ndarray) -> np.ndarray:
    """Fill triangles from back to front at twice the size, then blend the smoothed layer in."""
    height, width = image.shape[:2]
    layer = np.zeros((height * _SUPERSAMPLE, width * _SUPERSAMPLE), np.uint8)  # 0 = no body
    drawable = np.isfinite(triangles_px).all(axis=(1, 2)) & (np.abs(triangles_px) < _FAR_PX).all(
        axis=(1, 2)
    )
    corners = np.round((triangles_px[drawable] * _SUPERSAMPLE - 0.5) * 16).astype(np.int32)
    greys = np.round(255 * shades[drawable]).tolist()
    for triangle, grey in zip(corners, greys, strict=True):
        cv2.fillConvexPoly(layer, triangle, (grey,), cv2.LINE_8, 4)
    cover = cv2.resize(
        (layer > 0).astype(np.float32), (width, height), interpolation=cv2.INTER_AREA
    )
    shade = cv2.resize(layer.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
    # `shade` is 0 outside the body, so at its edge it is already shade x cover.
    body = shade[..., None] / 255.0 * np.array(BODY_BGR)
    blend = (1 - BODY_ALPHA * cover[..., None]) * image + BODY_ALPHA * body
    return np.clip(np.round(blend), 0, 255).astype(np.uint8)


def _drawable(point_px: np.ndarray) -> bool:
    return bool(np.isfinite(point_px).all() and (np.abs(point_px) < _FAR_PX).all())


def _fixed(point_px: np.ndarray) -> tuple[int, int]:
    """An image point for OpenCV's drawing: pixel centres at whole numbers, 4 fractional bits."""
    x, y = np.round((point_px - 0.5) * 16).astype(int)
    return int(x), int(y)
