"""Frames with what was found drawn over them: masks, the body, its path on the floor."""

import base64
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from markupsafe import Markup, escape

from gmrdata.pages.report_data import ClipReport
from gmrdata.people.folder import find_mask
from gmrdata.read import frames as frame_files
from gmrdata.stage.run import Run
from gmrdata.stage.store import run_stage
from gmrdata.values import transforms
from gmrdata.values.camera import project_cam
from gmrdata.values.errors import BadFrames
from gmrdata.values.files import write_bytes
from gmrdata.values.records import Config
from gmrdata.values.skinning import motion_vertices_m
from gmrdata.write.overlay import LINE_PX, OVERLAY_BGR, draw_body, draw_floor_path

TINT_BGR = (60, 60, 235)
TINT_ALPHA = 0.35
GAP_PX = 4  # between the frames of a sheet [px]
DRAWING_SCALE = 2
"""Overlays are drawn on frames of twice their size, so that lines and close-ups are smooth."""
CONTACT_FILE = "contact.jpg"
MASK_COLUMNS = 4


def jpeg(image: np.ndarray, quality: int = 88) -> bytes:
    """JPEG bytes of an image (H, W, 3) BGR."""
    ok, encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not ok:
        raise BadFrames(f"a picture of {image.shape} can't be encoded as JPEG")
    return encoded.tobytes()


def jpeg_image(image: np.ndarray, alt: str, quality: int = 88) -> Markup:
    """An `<img>` that carries an image (H, W, 3) BGR in itself."""
    encoded = base64.b64encode(jpeg(image, quality)).decode("ascii")
    height_px, width_px = image.shape[:2]
    return Markup(
        f'<img src="data:image/jpeg;base64,{encoded}" alt="{escape(alt)}"'
        f' width="{width_px}" height="{height_px}">'
    )


def spaced(n: int, n_wanted: int) -> list[int]:
    """Rows of at most `n_wanted` of n frames, evenly spaced from the first to the last."""
    return [int(row) for row in np.linspace(0, n - 1, min(n_wanted, n)).round()]


def tile_sheet(images: Sequence[np.ndarray], columns: int, gap_px: int = GAP_PX) -> np.ndarray:
    """Images of one size side by side on white, `columns` to a row: (H', W', 3) BGR."""
    height, width = images[0].shape[:2]
    n_rows, used = -(-len(images) // columns), min(columns, len(images))
    size_px = n_rows * (height + gap_px) - gap_px, used * (width + gap_px) - gap_px
    sheet = np.full((*size_px, 3), 255, np.uint8)
    for i, image in enumerate(images):
        top, left = (i // columns) * (height + gap_px), (i % columns) * (width + gap_px)
        sheet[top : top + height, left : left + width] = image
    return sheet


def make_mask_sheet(images_dir: Path, masks_dir: Path, out_dir: Path) -> Path:
    """Stage: `contact.jpg`, made anew when frames or masks (255 = dynamic) changed."""

    def work(partial: Path) -> None:
        write_bytes(partial / CONTACT_FILE, jpeg(mask_sheet(images_dir, masks_dir)))

    inputs, anew = {"images": images_dir, "masks": masks_dir}, Run(anew=True)
    return run_stage("mask_sheet", out_dir, Config(), inputs, work, run=anew) / CONTACT_FILE


def mask_sheet(
    images_dir: Path, masks_dir: Path, n_frames: int = 16, tile_width_px: int = 400
) -> np.ndarray:
    """Evenly spaced frames with their masks, side by side: (H, W, 3) BGR."""
    some = masked_frames(images_dir, masks_dir, n_frames)
    return tile_sheet([masked_tile(*one, tile_width_px) for one in some], MASK_COLUMNS)


def masked_frames(
    images_dir: Path, masks_dir: Path, n_frames: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Evenly spaced frames (H, W, 3) BGR, each with its mask (H, W), 255 = dynamic."""
    images = frame_files.list_images(images_dir)
    size_px = frame_files.check_images(images)
    for row in spaced(len(images), n_frames):
        mask = frame_files.read_gray(find_mask(masks_dir, images[row]), size_px)
        yield frame_files.read_color(images[row]), mask


def masked_tile(image: np.ndarray, mask: np.ndarray, width_px: int) -> np.ndarray:
    """A frame (H, W, 3) BGR made small, with its mask (H, W) tinted and outlined."""
    small = narrowed(image, width_px)
    masked = cv2.resize(mask, small.shape[1::-1], interpolation=cv2.INTER_NEAREST) > 127
    tinted = (1 - TINT_ALPHA) * small[masked] + TINT_ALPHA * np.array(TINT_BGR)
    small[masked] = tinted.round().astype(np.uint8)
    return draw_mask_outline(small, masked.astype(np.uint8))


def narrowed(image: np.ndarray, width_px: int) -> np.ndarray:
    """An image (H, W, 3) made `width_px` wide."""
    size_px = (width_px, max(1, round(width_px * image.shape[0] / image.shape[1])))
    return np.asarray(cv2.resize(image, size_px, interpolation=cv2.INTER_AREA))


def draw_mask_outline(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """A copy of a BGR image with the outline of a mask (H, W), non-zero = dynamic object."""
    if mask.shape != image.shape[:2]:
        sizes = "{1}x{0} px, its frame is {3}x{2} px".format(*mask.shape, *image.shape[:2])
        raise BadFrames(f"a mask is {sizes}; make the masks again from these frames")
    inside = (mask > 0).astype(np.uint8)
    contours, _ = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return cv2.polylines(image.copy(), contours, True, OVERLAY_BGR["outline"], LINE_PX, cv2.LINE_AA)


@dataclass(frozen=True, eq=False)
class ClipTile:
    """One frame of a clip, with what was recovered."""

    drawn: np.ndarray  # (DRAWING_SCALE * H, DRAWING_SCALE * W, 3) BGR, with the overlay
    person_px: np.ndarray  # (4,) left, top, right, bottom in `drawn` [px]; all of it if unknown
    image_number: int
    time_s: float  # since the clip's first frame
    has_camera: bool  # without one only the mask is drawn

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
        how = cv2.INTER_AREA if h > height_px else cv2.INTER_CUBIC
        cut = self.drawn[y : y + h, x : x + w]
        return np.asarray(cv2.resize(cut, (width_px, height_px), interpolation=how))


def frame_tiles(clip: ClipReport, n_frames: int = 6) -> list[ClipTile]:
    """Evenly spaced frames with the mask's outline, the recovered body, and its path on the floor.

    Body and mask follow from the camera-frame body whatever the recovered camera is (eqs. 6-8); the
    path on the floor is fixed in the world and so shows whether the camera is right.
    """
    images = {
        frame_files.image_number(path): path for path in frame_files.list_images(clip.images_dir)
    }
    with_image = np.flatnonzero(clip.pseudo.image_numbers >= 0)
    if not len(with_image):
        raise BadFrames(f"clip {clip.id}: no row of its pseudo ground truth has an image number")
    rows = with_image[spaced(len(with_image), n_frames)]
    vertices_m = motion_vertices_m(clip.body, clip.pseudo.motion, rows=rows)
    floor_m, drawn = _floor_path_m(clip), zip(rows.tolist(), vertices_m, strict=True)
    return [_clip_tile(clip, images, row, vertices, floor_m) for row, vertices in drawn]


def _clip_tile(
    clip: ClipReport, images: dict[int, Path], row: int, vertices_m: np.ndarray, floor_m: np.ndarray
) -> ClipTile:
    number = int(clip.pseudo.image_numbers[row])
    if number not in images:
        raise BadFrames(f"{clip.images_dir}: clip {clip.id} has no image of number {number}")
    drawn = _enlarged(frame_files.read_color(images[number]), cv2.INTER_CUBIC)
    person_px = np.array([0.0, 0.0, drawn.shape[1], drawn.shape[0]])
    path, has_camera = clip.pseudo.camera, bool(clip.has_camera[row])
    if path is not None and has_camera:
        # Pixel (0, 0) is an outer corner, so the intrinsics scale with the frame.
        enlarged_px = np.diag([DRAWING_SCALE, DRAWING_SCALE, 1.0]) @ path.intrinsics_px
        cam_from_world = transforms.invert(path.world_from_cam[row])
        floor_m, vertices_m = (transforms.apply(cam_from_world, m) for m in (floor_m, vertices_m))
        every = max(1, round(clip.pseudo.motion.fps_hz))
        drawn = draw_floor_path(drawn, enlarged_px, floor_m, every)
        drawn = draw_body(drawn, enlarged_px, vertices_m, clip.body)
        points_px = project_cam(vertices_m, enlarged_px)
        person_px = np.concatenate([np.nanmin(points_px, axis=0), np.nanmax(points_px, axis=0)])
    if clip.masks_dir is not None:
        mask_path = clip.masks_dir / f"{images[number].stem}.png"
        frame_px = (drawn.shape[1] // DRAWING_SCALE, drawn.shape[0] // DRAWING_SCALE)
        mask = _enlarged(frame_files.read_gray(mask_path, frame_px), cv2.INTER_NEAREST)
        drawn = draw_mask_outline(drawn, mask)
    return ClipTile(drawn, person_px, number, row / clip.pseudo.motion.fps_hz, has_camera)


def _floor_path_m(clip: ClipReport) -> np.ndarray:
    """(T, 3) recovered pelvis path dropped to the true floor, in the recovered world [m]."""
    path_true_m = transforms.apply(clip.true_from_pseudo, clip.pseudo.motion.pelvis_m)
    path_true_m[~clip.has_camera] = np.nan
    path_true_m[:, 2] = 0.0
    return transforms.apply(transforms.invert(clip.true_from_pseudo), path_true_m)


def _enlarged(image: np.ndarray, how: int) -> np.ndarray:
    return np.asarray(
        cv2.resize(image, None, fx=DRAWING_SCALE, fy=DRAWING_SCALE, interpolation=how)
    )
