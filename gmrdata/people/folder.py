"""Masks that another tool made: checked, and brought to one sense and one naming."""

from collections.abc import Collection
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from gmrdata.people.silhouette import dilate
from gmrdata.read.frames import check_images, list_images, read_gray, write_gray
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.errors import BadFrames, MissingInput
from gmrdata.values.records import Config


class FolderMaskConfig(Config):
    """How to read a folder of masks made by others."""

    masked_value: Literal[0, 255] = 255
    """Grey value of dynamic objects: 255, or 0 for COLMAP's sense."""
    dilate_px: int = Field(default=0, ge=0, le=1000)
    """Radius by which the masked part is widened."""


def folder_masks(
    masks_dir: Path,
    images_dir: Path,
    out_dir: Path,
    config: FolderMaskConfig,
    *,
    left_out: Collection[int] = (),
    run: Run = DEFAULT_RUN,
) -> Path:
    """Stage: bring a folder of masks to gmrdata's form, `<image stem>.png` with 255 = dynamic."""

    def work(partial: Path) -> None:
        images = list_images(images_dir, left_out)
        size_px = check_images(images)
        for image in images:
            masked = read_gray(find_mask(masks_dir, image), size_px) > 127
            if config.masked_value == 0:
                masked = ~masked
            mask = dilate(masked.astype(np.uint8) * np.uint8(255), config.dilate_px)
            write_gray(partial / f"{image.stem}.png", mask)

    inputs = {"masks": masks_dir, "images": images_dir}
    return run_stage("folder_masks", out_dir, config, inputs, work, run=run)


def find_mask(masks_dir: Path, image: Path) -> Path:
    """The mask of an image: `<stem>.png` or, as COLMAP names it, `<image file name>.png`.
    BadFrames where there is none: a frame is never used unmasked in silence."""
    if not masks_dir.is_dir():
        raise MissingInput(f"{masks_dir}: no such folder of masks")
    names = (f"{image.stem}.png", f"{image.name}.png")
    for path in map(masks_dir.joinpath, names):
        if path.is_file():
            return path
    raise BadFrames(f"{masks_dir}: no mask for {image.name}; expected {' or '.join(names)}")
