"""Frames of a clip with what was recovered drawn over them."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from gmrdata.body.forward import motion_vertices_m
from gmrdata.errors import BadFrames
from gmrdata.frames import image_number, list_images
from gmrdata.geometry import transforms
from gmrdata.report import overlay
from gmrdata.report.data import ClipReport
from gmrdata.report.series import usable


@dataclass(frozen=True, eq=False)
class Tile:
    """One frame of a strip."""

    image: np.ndarray
    """(H, W, 3) BGR, with the overlay."""
    image_number: int
    """Number in the image's file name."""
    time_s: float
    """Time since the clip's first frame [s]."""
    has_camera: bool
    """Whether a camera was recovered; without one only the mask is drawn."""


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
    """PNG bytes of `frame_tiles` side by side on white, `columns` to a row."""
    ok, encoded = cv2.imencode(
        ".png", tile_sheet([tile.image for tile in frame_tiles(clip, n_frames)], columns, gap_px)
    )
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
    image = _read(images[number], cv2.IMREAD_COLOR)
    camera, has_camera = clip.pseudo.camera, bool(usable(clip.pseudo)[row])
    if camera is not None and has_camera:
        view = camera.world_from_cam[row], camera.intrinsics_px
        every = max(1, round(clip.pseudo.motion.fps_hz))
        image = overlay.draw_floor_path(image, *view, floor_m, every)
        image = overlay.draw_body(image, *view, vertices_m, clip.body)
    if clip.masks_dir is not None:
        mask = _read(clip.masks_dir / f"{images[number].stem}.png", cv2.IMREAD_GRAYSCALE)
        image = overlay.draw_mask_outline(image, mask)
    return Tile(image, number, row / clip.pseudo.motion.fps_hz, has_camera)


def _floor_path_m(clip: ClipReport) -> np.ndarray:
    """(T, 3) recovered pelvis path dropped to the true floor, in the recovered world [m]."""
    path_true_m = transforms.apply(clip.true_from_pseudo, clip.pseudo.motion.pelvis_m)
    path_true_m[~usable(clip.pseudo)] = np.nan
    path_true_m[:, 2] = 0.0
    return transforms.apply(transforms.invert(clip.true_from_pseudo), path_true_m)


def _read(path: Path, mode: int) -> np.ndarray:
    image = cv2.imread(str(path), mode)
    if image is None:
        raise BadFrames(f"{path}: missing, or not an image; make the frames or masks again")
    return np.asarray(image)
