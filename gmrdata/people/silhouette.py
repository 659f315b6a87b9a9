"""Masks from the bodies themselves: their skinned meshes, projected, filled and widened."""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from gmrdata.read.frames import write_gray
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, clip_on_body, load_camera_clip, rows_of_numbers
from gmrdata.values.errors import BadFrames, MissingInput
from gmrdata.values.frame_set import FrameSet
from gmrdata.values.people import PersonFiles, stage_inputs
from gmrdata.values.records import Config

NEAREST_DEPTH_M = 0.05
SUBPIXEL_BITS = 4  # cv2 takes polygon corners as integers with this many fractional bits
DOT_SPACING_PX = 2.0
MOST_DOT_STEPS = 8  # Triangles with longer sides than so many dots are filled
DOTTED_RADII = 0.5  # Discs half a radius apart leave a rim rough by less than 0.14 px
FRAMES_AT_ONCE = 64  # Frames whose bodies are posed together


class SilhouetteConfig(Config):
    """How the projected bodies become a mask of what must not be used as background."""

    dilate_px: int = Field(default=8, ge=0, le=1000)
    """Radius by which the silhouettes are widened, for clothes, hair and fit errors [px]."""
    bridge_frames: int = Field(default=15, ge=0)
    """A person whose body is not valid in a frame may be anywhere that the next valid ones before
    and after show, if both are at most so far away [frames]."""
    without_body: Literal["everything", "nothing"] = "everything"
    """What is masked in a frame that is further from valid ones: all of it, or, where another
    source looks for people as well, nothing for this person."""


def silhouette_masks(
    people: tuple[PersonFiles, ...],
    frames: FrameSet,
    out_dir: Path,
    config: SilhouetteConfig,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Stage: one `<image stem>.png` per image, 255 where the people are, 0 elsewhere.
    The clips are in the camera frame, with intrinsics and image numbers."""
    if not people:
        what = "at least one person in the camera frame: pass --camera-body"
        raise MissingInput(f"{frames.folder}: masks from the silhouette need {what}")

    def work(partial: Path) -> None:
        _write_silhouettes(people, frames, partial, config)

    inputs = stage_inputs(people) | frames.inputs
    return run_stage("silhouette_masks", out_dir, config, inputs, work, run=run)


def silhouette(
    vertices_cam_m: np.ndarray,
    faces: np.ndarray,
    intrinsics_px: np.ndarray,
    size_px: tuple[int, int],
    dilate_px: int = 0,
) -> np.ndarray:
    """Fill the projection of a mesh (V, 3) with faces (F, 3), widened by a disc of a radius.

    Faces that reach behind the camera, or have a corner that is no number, are left out.  The mask
    of (width, height) is (height, width) uint8, 255 inside.
    """
    import cv2

    from gmrdata.values.camera import project_cam

    mask = np.zeros(size_px[::-1], dtype=np.uint8)
    in_front = vertices_cam_m[:, 2] > NEAREST_DEPTH_M
    visible = faces if in_front.all() else faces[in_front[faces].all(axis=1)]
    # cv2's (0, 0) is the centre of the first pixel, ours its outer corner.
    corners_px = project_cam(vertices_cam_m, intrinsics_px)[visible] - 0.5
    near = np.abs(corners_px) < 4.0 * max(size_px)
    if not near.all():
        corners_px = corners_px[near.all(axis=(1, 2))]
    if dilate_px:
        spacing_px = min(DOT_SPACING_PX, DOTTED_RADII * dilate_px)
        corners_px = _dot_small(mask, corners_px, spacing_px)
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
    left, top, width, height = cv2.boundingRect(mask)
    rows = slice(max(0, top - radius_px), top + height + radius_px)
    columns = slice(max(0, left - radius_px), left + width + radius_px)
    widened = np.zeros_like(mask)
    widened[rows, columns] = cv2.dilate(mask[rows, columns], disc)
    return widened


def _dot_small(mask: np.ndarray, corners_px: np.ndarray, spacing_px: float) -> np.ndarray:
    """Draw small triangles as dots so far apart; the larger ones (n, 3, 2) are left.

    A body has 27 000 triangles, most of a few pixels, and filling them one by one takes most of a
    mask's time.  Dots that are widened to overlapping discs cover the same.
    """
    height_px, width_px = mask.shape
    a, b, c = np.moveaxis(corners_px, 1, 0)
    edges_px = [np.hypot(*(start - end).T) for start, end in ((a, b), (b, c), (c, a))]
    steps = np.ceil(np.maximum.reduce(edges_px) / spacing_px).astype(int).clip(min=1)
    for count in range(1, MOST_DOT_STEPS + 1):
        i, j = np.nonzero(np.add.outer(np.arange(count + 1), np.arange(count + 1)) <= count)
        shares = np.stack([i, j, count - i - j], axis=1) / count
        dots = np.rint(shares @ corners_px[steps == count]).astype(int)
        x, y = dots[..., 0].ravel(), dots[..., 1].ravel()
        inside = (x >= 0) & (x < width_px) & (y >= 0) & (y < height_px)
        mask[y[inside], x[inside]] = 255
    return np.asarray(corners_px[steps > MOST_DOT_STEPS])


def _write_silhouettes(
    people: tuple[PersonFiles, ...], frames: FrameSet, partial: Path, config: SilhouetteConfig
) -> None:
    from gmrdata.read.bodies import load_body

    images, size_px = frames.paths, frames.size_px
    clips = [_clip(person.clip_path, images[0], size_px) for person in people]
    bodies = [load_body(person.body_path) for person in people]
    clips = list(map(clip_on_body, clips, bodies))
    pairs = zip(clips, people, strict=True)
    rows = [_rows_of_images(clip, person.clip_path, frames) for clip, person in pairs]
    for start in range(0, len(images), FRAMES_AT_ONCE):
        some = slice(start, start + FRAMES_AT_ONCE)
        by_person = [
            _masks_of_person(clip, body, of_person[some], size_px, config)
            for clip, body, of_person in zip(clips, bodies, rows, strict=True)
        ]
        for image, masks in zip(images[some], zip(*by_person, strict=True), strict=True):
            write_gray(partial / f"{image.stem}.png", np.bitwise_or.reduce(masks))


def _masks_of_person(
    clip: Clip, body: BodyModel, rows: list[int], size_px: tuple[int, int], config: SilhouetteConfig
) -> Iterator[np.ndarray]:
    from gmrdata.values.skinning import motion_vertices_m

    shown = [rows_that_show(clip.valid, row, config.bridge_frames) for row in rows]
    posed = sorted({row for some in shown for row in some})
    vertices_cam_m = motion_vertices_m(body, clip.motion, rows=np.array(posed, dtype=int))
    intrinsics_px = camera_of(clip).intrinsics_px
    everything = 255 if config.without_body == "everything" else 0
    for some in shown:
        mask = np.full(size_px[::-1], 0 if some else everything, dtype=np.uint8)
        for row in some:
            posed_m = vertices_cam_m[posed.index(row)]
            mask |= silhouette(posed_m, body.faces, intrinsics_px, size_px, config.dilate_px)
        yield mask


def rows_that_show(valid: np.ndarray, row: int, bridge_frames: int) -> list[int]:
    """Rows whose bodies cover where a person may be at a row: it, or its one or two neighbours that
    are `valid` (T,), `bridge_frames` away at most; none where the person may be anywhere."""
    if valid[row]:
        return [row]
    known = np.flatnonzero(valid)
    before, after = known[known < row][-1:], known[known > row][:1]
    near = [int(r) for r in (*before, *after) if abs(r - row) <= bridge_frames]
    return near if len(near) == len(before) + len(after) else []


def _clip(clip_path: Path, image: Path, size_px: tuple[int, int]) -> Clip:
    clip = load_camera_clip(clip_path)
    if size_px != (own_px := camera_of(clip).lens.size_px):
        said = f"{clip_path} says {own_px[0]}x{own_px[1]} px"
        raise BadFrames(f"{image}: {size_px[0]}x{size_px[1]} px, but {said}")
    return clip


def _rows_of_images(clip: Clip, clip_path: Path, frames: FrameSet) -> list[int]:
    rows = rows_of_numbers(clip.image_numbers, frames.numbers).tolist()
    if -1 in rows:
        unknown = frames.paths[rows.index(-1)]
        raise BadFrames(f"{unknown}: {clip_path} has no pose for this image, so it has no mask")
    return rows
