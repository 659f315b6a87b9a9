"""Frames of a clip with what was recovered drawn over them.

What is drawn over a frame: the path on the floor, the body, the mask's outline.
"""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from gmrdata.pages.curves import usable
from gmrdata.pages.report_data import ClipReport
from gmrdata.read.frames import image_number, list_images
from gmrdata.values import camera, transforms
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath, project
from gmrdata.values.errors import BadFrames
from gmrdata.values.skinning import motion_vertices_m

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


DRAWING_SCALE = 2
"""Overlays are drawn on frames of twice their size, so that lines and close-ups are smooth."""


@dataclass(frozen=True, eq=False)
class Tile:
    """One frame of a strip."""

    drawn: np.ndarray
    """(DRAWING_SCALE * H, DRAWING_SCALE * W, 3) BGR, with the overlay."""
    person_px: np.ndarray
    """(4,) left, top, right, bottom of the person in `drawn` [px]; the whole frame if unknown."""
    image_number: int
    """Number in the image's file name."""
    time_s: float
    """Time since the clip's first frame [s]."""
    has_camera: bool
    """Whether a camera was recovered; without one only the mask is drawn."""

    def frame(self) -> np.ndarray:
        """(H, W, 3) BGR: the whole frame."""
        height, width = self.drawn.shape[:2]
        size = (width // DRAWING_SCALE, height // DRAWING_SCALE)
        return np.asarray(cv2.resize(self.drawn, size, interpolation=cv2.INTER_AREA))

    def close_up(self, width_px: int, height_px: int, around: float = 1.25) -> np.ndarray:
        """(height_px, width_px, 3) BGR: the person, with `around` times its height in view."""
        full_height, full_width = self.drawn.shape[:2]
        left, top, right, bottom = self.person_px
        aspect = width_px / height_px
        wanted = max(around * (bottom - top), around * (right - left) / aspect)
        height = min(wanted, full_height, full_width / aspect)
        size = np.array([height * aspect, height])
        corner = np.array([(left + right) / 2, (top + bottom) / 2]) - size / 2
        corner = np.clip(corner, 0, np.array([full_width, full_height]) - size)
        x, y = corner.round().astype(int)
        w, h = size.round().astype(int)
        smaller = h > height_px
        return np.asarray(
            cv2.resize(
                self.drawn[y : y + h, x : x + w],
                (width_px, height_px),
                interpolation=cv2.INTER_AREA if smaller else cv2.INTER_CUBIC,
            )
        )


def frame_tiles(clip: ClipReport, n_frames: int = 6) -> list[Tile]:
    """Evenly spaced frames with the mask's outline, the recovered body, and its path on the floor.

    Body and floor path are the pseudo clip's, drawn through the recovered camera.  Body and mask
    follow from the camera-frame body whatever the camera is (eqs. 6-8); the path on the floor is
    fixed in the world and so shows whether the camera is right.

    Raises:
        BadFrames: an image or mask is missing or can't be read.
    """
    images = {image_number(path): path for path in list_images(clip.images_dir)}
    numbers = clip.pseudo.image_numbers
    with_image = np.flatnonzero(numbers >= 0)
    if not len(with_image):
        raise BadFrames(f"clip {clip.id}: no row of its pseudo ground truth has an image number")
    spaced = np.linspace(0, len(with_image) - 1, min(n_frames, len(with_image)))
    rows = with_image[spaced.round().astype(int)]
    vertices_m = motion_vertices_m(clip.body, clip.pseudo.motion, rows=rows)
    floor_m = _floor_path_m(clip)
    return [
        _tile(clip, images, int(row), vertices, floor_m)
        for row, vertices in zip(rows, vertices_m, strict=True)
    ]


def frame_strip(clip: ClipReport, n_frames: int = 6, columns: int = 6, gap_px: int = 6) -> bytes:
    """PNG bytes of whole frames side by side on white, `columns` to a row."""
    images = [tile.frame() for tile in frame_tiles(clip, n_frames)]
    ok, encoded = cv2.imencode(".png", tile_sheet(images, columns, gap_px))
    if not ok:
        raise BadFrames(f"clip {clip.id}: its frame strip can't be encoded as PNG")
    return encoded.tobytes()


def tile_sheet(images: list[np.ndarray], columns: int, gap_px: int) -> np.ndarray:
    """Images of one size side by side on white, `columns` to a row: (H', W', 3) BGR."""
    height, width = images[0].shape[:2]
    n_rows = -(-len(images) // columns)
    used = min(columns, len(images))
    sheet = np.full(
        (n_rows * (height + gap_px) - gap_px, used * (width + gap_px) - gap_px, 3), 255, np.uint8
    )
    for i, image in enumerate(images):
        top, left = (i // columns) * (height + gap_px), (i % columns) * (width + gap_px)
        sheet[top : top + height, left : left + width] = image
    return sheet


def _tile(
    clip: ClipReport,
    images: dict[int, Path],
    row: int,
    vertices_m: np.ndarray,
    floor_m: np.ndarray,
) -> Tile:
    number = int(clip.pseudo.image_numbers[row])
    if number not in images:
        raise BadFrames(f"{clip.images_dir}: clip {clip.id} has no image of number {number}")
    drawn = _read(images[number], cv2.IMREAD_COLOR)
    person_px = np.array([0.0, 0.0, drawn.shape[1], drawn.shape[0]])
    camera, has_camera = clip.pseudo.camera, bool(usable(clip.pseudo)[row])
    if camera is not None and has_camera:
        view = camera.world_from_cam[row], _drawing_intrinsics_px(camera)
        every = max(1, round(clip.pseudo.motion.fps_hz))
        drawn = draw_floor_path(drawn, *view, floor_m, every)
        drawn = draw_body(drawn, *view, vertices_m, clip.body)
        points_px = project(view[0], vertices_m, view[1])
        person_px = np.concatenate([np.nanmin(points_px, axis=0), np.nanmax(points_px, axis=0)])
    if clip.masks_dir is not None:
        mask = _read(clip.masks_dir / f"{images[number].stem}.png", cv2.IMREAD_GRAYSCALE)
        drawn = draw_mask_outline(drawn, mask)
    return Tile(drawn, person_px, number, row / clip.pseudo.motion.fps_hz, has_camera)


def _drawing_intrinsics_px(camera: CameraPath) -> np.ndarray:
    """Intrinsics (3, 3) of the enlarged frame; pixel (0, 0) is an outer corner, so they scale."""
    return np.diag([DRAWING_SCALE, DRAWING_SCALE, 1.0]) @ camera.intrinsics_px


def _floor_path_m(clip: ClipReport) -> np.ndarray:
    """(T, 3) recovered pelvis path dropped to the true floor, in the recovered world [m]."""
    path_true_m = transforms.apply(clip.true_from_pseudo, clip.pseudo.motion.pelvis_m)
    path_true_m[~usable(clip.pseudo)] = np.nan
    path_true_m[:, 2] = 0.0
    return transforms.apply(transforms.invert(clip.true_from_pseudo), path_true_m)


def _read(path: Path, mode: int) -> np.ndarray:
    """An image, enlarged by DRAWING_SCALE."""
    image = cv2.imread(str(path), mode)
    if image is None:
        raise BadFrames(f"{path}: missing, or not an image; make the frames or masks again")
    size = (image.shape[1] * DRAWING_SCALE, image.shape[0] * DRAWING_SCALE)
    kind = cv2.INTER_NEAREST if mode == cv2.IMREAD_GRAYSCALE else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(image, size, interpolation=kind))
