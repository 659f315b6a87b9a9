"""Masks at a glance: a contact sheet of frames with the masked part tinted and outlined.

Frames or a video to masks and a picture of them: what `gmrdata masks` does.
"""

from pathlib import Path

import numpy as np
from pydantic import Field

from gmrdata.masks.folder import find_mask
from gmrdata.masks.sources import MasksConfig, make_masks
from gmrdata.read.frames import check_images, list_images, read_color, read_gray
from gmrdata.read.video import extract_video, is_video
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.errors import BadFrames
from gmrdata.values.files import atomic_path
from gmrdata.values.people import PersonFiles
from gmrdata.values.records import Config

CONTACT_FILE = "contact.jpg"
COLUMNS = 4
GAP_PX = 4
JPEG_QUALITY = 88
TINT_BGR = (60, 60, 235)
TINT_ALPHA = 0.35


class MaskSheetConfig(Config):
    """What the contact sheet shows."""

    n_frames: int = Field(default=16, ge=1)
    """Frames, evenly spaced from the first to the last."""
    tile_width_px: int = Field(default=400, ge=16)
    """Width of one frame [px]."""


def make_mask_sheet(
    images_dir: Path, masks_dir: Path, out_dir: Path, config: MaskSheetConfig | None = None
) -> Path:
    """Stage: `contact.jpg`, made anew when frames or masks changed.

    Args:
        images_dir: The frames.
        masks_dir: A mask (255 = dynamic) for each.
        out_dir: Folder to make.
        config: What the sheet shows.

    Returns:
        The picture.

    Raises:
        BadFrames: an image or mask is missing or can't be read.
    """
    import cv2

    config = config or MaskSheetConfig()

    def work(partial: Path) -> None:
        sheet = mask_sheet(images_dir, masks_dir, config)
        ok, encoded = cv2.imencode(".jpg", sheet, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        if not ok:
            raise BadFrames(f"{masks_dir}: its contact sheet can't be encoded as JPEG")
        with atomic_path(partial / CONTACT_FILE) as temporary:
            temporary.write_bytes(encoded.tobytes())

    inputs = {"images": images_dir, "masks": masks_dir}
    return run_stage("mask_sheet", out_dir, config, inputs, work, run=Run(redo=True)) / CONTACT_FILE


def mask_sheet(images_dir: Path, masks_dir: Path, config: MaskSheetConfig) -> np.ndarray:
    """Evenly spaced frames with their masks, side by side: (H, W, 3) BGR."""
    from gmrdata.pages.strip import tile_sheet

    images = list_images(images_dir)
    size_px = check_images(images)
    spaced = np.linspace(0, len(images) - 1, min(config.n_frames, len(images))).round().astype(int)
    tiles = [
        masked_tile(
            read_color(images[i]),
            read_gray(find_mask(masks_dir, images[i]), size_px),
            config.tile_width_px,
        )
        for i in spaced
    ]
    return tile_sheet(tiles, COLUMNS, GAP_PX)


def masked_tile(image: np.ndarray, mask: np.ndarray, width_px: int) -> np.ndarray:
    """A frame (H, W, 3) BGR made small, with its mask (H, W) tinted and outlined."""
    import cv2

    from gmrdata.pages.strip import draw_mask_outline

    size_px = (width_px, max(1, round(width_px * image.shape[0] / image.shape[1])))
    small = cv2.resize(image, size_px, interpolation=cv2.INTER_AREA)
    masked = cv2.resize(mask, size_px, interpolation=cv2.INTER_NEAREST) > 127
    tinted = (1 - TINT_ALPHA) * small[masked] + TINT_ALPHA * np.array(TINT_BGR)
    small[masked] = tinted.round().astype(np.uint8)
    return draw_mask_outline(small, masked.astype(np.uint8))


def masks_of_frames(
    frames: Path,
    out_dir: Path,
    config: MasksConfig,
    *,
    people: tuple[PersonFiles, ...] = (),
    run: Run = DEFAULT_RUN,
) -> tuple[Path, Path]:
    """Make `out_dir/masks` (and `masks_by`), `out_dir/sheet`, and `out_dir/frames` of a video.

    Args:
        frames: Folder of numbered images, or a video file.
        out_dir: The output folder.
        config: The recipe.
        people: Camera-frame clips and their bodies, which silhouettes need.

    Returns:
        The folder of the masks, and the contact sheet.

    Raises:
        GmrdataError: as `make_masks` says.
    """
    if is_video(frames):
        frames = extract_video(frames, out_dir / "frames", run=run)
    masks_dir = make_masks(frames, out_dir / "masks", config, people=people, run=run)
    return masks_dir, make_mask_sheet(frames, masks_dir, out_dir / "sheet")
