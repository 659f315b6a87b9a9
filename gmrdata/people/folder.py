"""Folders of masks: another tool's brought to one sense and one naming, and several as one."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from gmrdata.people.silhouette import dilate
from gmrdata.read.frames import read_gray, read_stored, write_gray
from gmrdata.stage.jobs import in_threads
from gmrdata.stage.progress import console
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.errors import BadFrames, MissingInput, some
from gmrdata.values.frame_set import FrameSet
from gmrdata.values.records import Config, Figure, Record, figure

RECORD_FILE = "masks.json"
NAMED_FRAMES = 5
MOST_OBJECTS = 16  # grey values of a mask of numbered objects; a faint soft mask has more
OBJECT_PX = 15  # side of a square of one grey that no soft edge has


class FolderMaskConfig(Config):
    """How to read a folder of masks made by others."""

    masked_value: Literal[0, 255] = 255
    """Grey value of dynamic objects: 255, or 0 for COLMAP's sense."""
    dilate_px: int = Field(default=0, ge=0, le=1000)
    """Radius by which the masked part is widened."""


def folder_masks(
    masks_dir: Path,
    frames: FrameSet,
    out_dir: Path,
    config: FolderMaskConfig,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Stage: bring a folder of masks to gmrdata's form, `<image stem>.png` with 255 = dynamic."""

    def work(partial: Path) -> None:
        check_masks(masks_dir, frames)
        brightest = 0
        for image in frames.paths:
            grey = _read_mask(find_mask(masks_dir, image), frames.size_px)
            brightest, masked = max(brightest, int(grey.max())), grey > 127
            if config.masked_value == 0:
                masked = ~masked
            mask = dilate(masked.astype(np.uint8) * np.uint8(255), config.dilate_px)
            write_gray(partial / f"{image.stem}.png", mask)
        if 0 < brightest <= 127:
            what = f"masks are no brighter than {brightest} of 255"
            raise BadFrames(f"{masks_dir}: {what}; write 255 where a mask is set, else 0")

    inputs = {"masks": masks_dir} | frames.inputs
    return run_stage("folder_masks", out_dir, config, inputs, work, run=run)


def check_masks(masks_dir: Path, frames: FrameSet) -> None:
    """Refuse a folder that lacks a mask of these images, as far as they have names, or has the
    first one's at another size; errors as of `folder_masks`."""
    _require_of_taken_frames(masks_dir, frames)
    masks = [find_mask(masks_dir, image) for image in frames.paths]
    _read_mask(masks[0], frames.size_px)


def _require_of_taken_frames(masks_dir: Path, frames: FrameSet) -> None:
    """Refuse masks beyond the last image, as of all frames where every n-th was taken, or numbered
    from 1: their names fit the wrong images."""
    if (frames.video is None and frames.video_path is None) or not masks_dir.is_dir():
        return
    if frames.video is not None:
        last, every = max(frames.video.frame_of), frames.video.every
    else:  # of a video that was not read yet, of which two images or more are taken
        last = int(frames.numbers[-1])
        every = int(frames.frame_numbers[-1]) // last
    stems = [path.name.split(".")[0] for path in masks_dir.glob("*.png")]
    numbers = {int(stem) for stem in stems if stem.isdecimal()}
    if 0 not in numbers and 1 in numbers and frames.numbers[0] > 1:
        what = "masks are numbered from 1; number them from 0, as images are"
        raise BadFrames(f"{masks_dir}: {what}, or keep those of the images")
    if every == 1 and frames.n_frames is None:  # a part: masks of the whole video fit its images
        return
    if numbers and max(numbers) > last:
        they_are = "of every frame"
        remedy = f"keep those of frames 0, {every}, {2 * every}, ..., under the images' names"
        if every == 1:
            they_are, remedy = "numbered otherwise, as from 1", "number them from 0, as images are"
        elif frames.n_frames is None:  # a part, whose video may have images after it
            they_are = "of more images than this part, or of every frame"
            remedy = "keep those of its images, under the images' names"
        what = f"masks go beyond image {last}, the last one, so they are {they_are}"
        raise BadFrames(f"{masks_dir}: {what}; {remedy}")


def _read_mask(path: Path, size_px: tuple[int, int]) -> np.ndarray:
    """(H, W) uint8 of another tool's mask; BadFrames for what would be misread in silence."""
    image = read_stored(path, size_px)
    white = int(np.iinfo(image.dtype).max)
    grey = image if image.ndim == 2 else image[..., 0]
    what = None
    if image.ndim == 3 and image.shape[2] == 4 and (image[..., 3] != white).any():
        what = "is see-through in part"
    elif image.ndim == 3 and not (image[..., :3] == grey[..., None]).all():
        what = "holds colours"
    elif len(levels := np.flatnonzero(np.bincount(grey.ravel()))) <= MOST_OBJECTS:
        if 0 < levels[-1] <= white // 2:
            what = f"holds numbers of objects, none of them brighter than {levels[-1]} of {white}"
        elif dark := _dark_objects(grey, levels[1:][levels[1:] <= white // 2]):
            what = f"holds numbers of objects, one of them as dark as {dark[0]} of {white}"
    if what is not None:
        raise BadFrames(f"{path}: {what}; write 255 where a mask is set, else 0")
    return grey if white == 255 else (grey >> 8).astype(np.uint8)


def _dark_objects(grey: np.ndarray, levels: np.ndarray) -> list[int]:
    """Those of some grey values that whole areas have: numbers of objects that were spread from
    black to white, of which the darker half would not count as masked."""
    import cv2

    square = np.ones((OBJECT_PX, OBJECT_PX), np.uint8)
    return [n for n in levels.tolist() if cv2.erode((grey == n).astype(np.uint8), square).any()]


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


class MasksRecord(Record):
    """`masks.json`."""

    format: Literal["gmrdata-masks/1"] = "gmrdata-masks/1"
    sources: tuple[str, ...]
    masked_share: dict[str, dict[str, Figure]]
    """Masked share of each frame's picture, by frame, then by source and "united"."""
    covered: tuple[str, ...]
    """Frames with more than `max_masked_share` masked."""
    unmasked: tuple[str, ...]
    """Frames with nothing masked."""


class UnionConfig(Config):
    """When a mask is suspicious."""

    max_masked_share: float = Field(default=0.9, gt=0, le=1)
    """A mask that covers more of its frame than this is reported: too little background is left."""


def unite_masks(
    source_dirs: Mapping[str, Path],
    frames: FrameSet,
    out_dir: Path,
    config: UnionConfig,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Stage: one `<image stem>.png` per image, 255 where any source says so, and `masks.json`.
    `source_dirs` are folders of masks (255 = dynamic) by the name of what made them."""

    def work(partial_dir: Path) -> None:
        def unite(image: Path) -> dict[str, float]:
            masks = {
                name: _dynamic(read_gray(find_mask(folder, image), frames.size_px))
                for name, folder in source_dirs.items()
            }
            united = np.bitwise_or.reduce(list(masks.values()))
            write_gray(partial_dir / f"{image.stem}.png", united)
            shown = masks | {"united": united}
            return {name: np.count_nonzero(mask) / mask.size for name, mask in shown.items()}

        stems = [image.stem for image in frames.paths]
        shares = dict(zip(stems, in_threads(unite, frames.paths), strict=True))
        united = {stem: figure(by_source["united"]) for stem, by_source in shares.items()}
        MasksRecord(
            sources=tuple(source_dirs),
            masked_share=shares,
            covered=tuple(stem for stem, s in united.items() if s > config.max_masked_share),
            unmasked=tuple(stem for stem, share in united.items() if share == 0.0),
        ).write(partial_dir / RECORD_FILE)

    inputs = frames.inputs | {f"masks {name}": path for name, path in source_dirs.items()}
    made = run_stage("masks", out_dir, config, inputs, work, run=run)
    if not run.only_look:
        _report(made, config)
    return made


def _dynamic(mask: np.ndarray) -> np.ndarray:
    """255 where a mask is more than half dynamic, else 0."""
    import cv2

    return np.asarray(cv2.threshold(mask, 127, 255, cv2.THRESH_BINARY)[1])


def _report(masks_dir: Path, config: UnionConfig) -> None:
    """Name the frames that a person should look at; none of this need be wrong."""
    record = MasksRecord.read(masks_dir / RECORD_FILE)
    say = partial(console.print, markup=False, soft_wrap=True)
    if record.covered:
        what = f"more than {config.max_masked_share:.0%} of the picture is masked in frame"
        remedy = "Look at these masks: such frames may get no camera"
        say(f"{masks_dir}: {what} {some(record.covered, NAMED_FRAMES)}. {remedy}")
    if record.unmasked:
        count = f"{len(record.unmasked)} of {len(record.masked_share)}"
        remedy = "lower the score that the detector asks for, or unite it with another source"
        what = f"nothing is masked in frame {some(record.unmasked, NAMED_FRAMES)} ({count})"
        say(f"{masks_dir}: {what}. If somebody is to be seen there, {remedy}")
