"""Masks from the body itself: its skinned mesh, projected, filled and widened."""

from collections.abc import Collection
from pathlib import Path

import numpy as np
from pydantic import Field

from gmrdata.clip import Clip, load_clip
from gmrdata.config import Config
from gmrdata.errors import BadFrames, BadMotionFile
from gmrdata.frames import check_images, image_number, list_images, write_gray
from gmrdata.store import run_stage

NEAREST_DEPTH_M = 0.05
SUBPIXEL_BITS = 4
"""cv2 takes polygon corners as integers with this many fractional bits."""


class SilhouetteConfig(Config):
    """How the projected body becomes a mask of what must not be used as background."""

    dilate_px: int = Field(default=8, ge=0)
    """Radius by which the silhouette is widened, for clothes, hair and fit errors [px]."""


def silhouette_masks(
    clip_path: Path,
    body_path: Path,
    images_dir: Path,
    out_dir: Path,
    config: SilhouetteConfig,
    *,
    left_out: Collection[int] = (),
    redo: bool = False,
) -> Path:
    """Stage: one `<image stem>.png` per image, 255 where the person is, 0 elsewhere.

    Args:
        clip_path: Clip whose motion is in the camera frame, with intrinsics and image numbers.
        body_path: The clip's body model.
        images_dir: The frames.
        out_dir: Folder to make.
        config: The recipe.
        left_out: Numbers of images that are known to be unusable and get no mask.
        redo: Replace a folder that another recipe made.

    Raises:
        BadFrames: an image has no row in the clip, or the sizes differ.
        BadMotionFile: the clip is not in the camera frame, or has no intrinsics.
    """

    def work(partial: Path) -> None:
        images = list_images(images_dir, left_out)
        _write_silhouettes(load_clip(clip_path), clip_path, body_path, images, partial, config)

    inputs = {"clip": clip_path, "body": body_path, "images": images_dir}
    return run_stage("silhouette_masks", out_dir, config, inputs, work, redo=redo)


def silhouette(
    vertices_cam_m: np.ndarray,
    faces: np.ndarray,
    intrinsics_px: np.ndarray,
    size_px: tuple[int, int],
    dilate_px: int = 0,
) -> np.ndarray:
    """Fill the projection of a mesh.

    Faces that reach behind the camera are left out.

    Args:
        vertices_cam_m: (V, 3) vertices in the camera frame [m].
        faces: (F, 3) vertex indices.
        intrinsics_px: (3, 3) calibration matrix [px].
        size_px: (width, height) of the mask.
        dilate_px: Radius of a disc to widen the mask by [px].

    Returns:
        (height, width) uint8, 255 inside.
    """
    import cv2

    from gmrdata.geometry.camera import project_cam

    width_px, height_px = size_px
    mask = np.zeros((height_px, width_px), dtype=np.uint8)
    in_front = vertices_cam_m[:, 2] > NEAREST_DEPTH_M
    visible = faces[in_front[faces].all(axis=1)]
    # cv2's (0, 0) is the centre of the first pixel, ours its outer corner.
    corners_px = project_cam(vertices_cam_m, intrinsics_px)[visible] - 0.5
    near_px = 4.0 * max(size_px)
    corners_px = corners_px[(np.abs(corners_px) < near_px).all(axis=(1, 2))]
    fixed_point = np.rint(corners_px * (1 << SUBPIXEL_BITS)).astype(np.int32)
    for triangle in fixed_point:
        cv2.fillConvexPoly(mask, triangle, [255], lineType=cv2.LINE_8, shift=SUBPIXEL_BITS)
    return dilate(mask, dilate_px)


def dilate(mask: np.ndarray, radius_px: int) -> np.ndarray:
    """Widen the non-zero part of a mask by a disc."""
    import cv2

    if radius_px == 0:
        return mask
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius_px + 1, 2 * radius_px + 1))
    return np.asarray(cv2.dilate(mask, disc))


def _write_silhouettes(
    clip: Clip,
    clip_path: Path,
    body_path: Path,
    images: list[Path],
    partial: Path,
    config: SilhouetteConfig,
) -> None:
    from gmrdata.body.load import load_body
    from gmrdata.body.skin import motion_vertices_m

    if clip.motion.frame != "camera" or clip.camera is None:
        raise BadMotionFile(f"{clip_path}: silhouettes need a camera-frame motion with intrinsics")
    size_px = check_images(images)
    if size_px != (clip.camera.width_px, clip.camera.height_px):
        raise BadFrames(
            f"{images[0]}: {size_px[0]}x{size_px[1]} px, but {clip_path} says "
            f"{clip.camera.width_px}x{clip.camera.height_px} px"
        )
    rows = _rows_of_images(clip, clip_path, images)
    body = load_body(str(body_path))
    for image, row in zip(images, rows, strict=True):
        vertices_cam_m = motion_vertices_m(body, clip.motion, rows=np.array([row]))[0]
        mask = silhouette(
            vertices_cam_m, body.faces, clip.camera.intrinsics_px, size_px, config.dilate_px
        )
        write_gray(partial / f"{image.stem}.png", mask)


def _rows_of_images(clip: Clip, clip_path: Path, images: list[Path]) -> list[int]:
    row_of_number = {int(n): row for row, n in enumerate(clip.image_numbers) if n >= 0}
    for image in images:
        if image_number(image) not in row_of_number:
            raise BadFrames(f"{image}: {clip_path} has no pose for this image, so it has no mask")
    return [row_of_number[image_number(image)] for image in images]
