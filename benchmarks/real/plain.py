"""Plain pycolmap on a sequence: its defaults, incremental and global, on the same masks."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from real.sequences import RealSequence

from gmrdata.cameras.colmap import matrix_of, pycolmap
from gmrdata.people.folder import find_mask
from gmrdata.read.frames import check_images, list_images, read_gray, write_gray
from gmrdata.values.transforms import invert


@dataclass(frozen=True, eq=False)
class Plain:
    """What a mapper of plain pycolmap found."""

    mapper: str
    world_from_cam: np.ndarray
    """(T, 4, 4) of the largest model; NaN where it has no camera."""
    seconds: float
    """With features and matches, without masks [s]."""


def solve_plain(given: RealSequence, work_dir: Path, seed: int) -> list[Plain]:
    """Features and matches once, then both mappers; intrinsics are kept as they are given."""
    images, start = list_images(given.images_dir), time.perf_counter()
    database = work_dir / "database.db"
    work_dir.mkdir(parents=True)
    pycolmap.set_random_seed(seed)
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = "PINHOLE"
    params = given.intrinsics_px[[0, 1, 0, 1], [0, 1, 2, 2]]
    reader.camera_params = ",".join(repr(float(value)) for value in params)
    if given.masks_dir is not None:
        _write_masks(images, given.masks_dir, work_dir / "masks")
        reader.mask_path = str(work_dir / "masks")
    pycolmap.extract_features(
        database,
        given.images_dir,
        image_names=[image.name for image in images],
        camera_mode=pycolmap.CameraMode.SINGLE,
        reader_options=reader,
    )
    pycolmap.match_sequential(database)
    given_s = time.perf_counter() - start
    found = []
    for mapper, run in (("incremental", _incremental), ("global", _global)):
        start, out_dir = time.perf_counter(), work_dir / mapper
        out_dir.mkdir()
        models = list(run(database, given.images_dir, out_dir, seed).values())
        seconds = given_s + time.perf_counter() - start
        found.append(Plain(mapper, _largest(models, images), seconds))
    return found


def _incremental(database: Path, images_dir: Path, out_dir: Path, seed: int) -> Any:
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed = options.mapper.random_seed = seed
    options.ba_refine_focal_length = options.ba_refine_extra_params = False
    options.mapper.abs_pose_refine_focal_length = False
    options.mapper.abs_pose_refine_extra_params = False
    return pycolmap.incremental_mapping(database, images_dir, out_dir, options)


def _global(database: Path, images_dir: Path, out_dir: Path, seed: int) -> Any:
    options = pycolmap.GlobalPipelineOptions()
    options.random_seed = options.mapper.random_seed = seed
    options.mapper.bundle_adjustment.refine_focal_length = False
    options.mapper.bundle_adjustment.refine_extra_params = False
    options.mapper.bundle_adjustment.ceres.use_gpu = False
    options.mapper.global_positioning.use_gpu = False
    return pycolmap.global_mapping(database, images_dir, out_dir, options)


def _largest(models: list[Any], images: list[Path]) -> np.ndarray:
    world_from_cam = np.full((len(images), 4, 4), np.nan)
    if models:
        model = max(models, key=lambda model: model.num_reg_images())
        row_of_name = {image.name: row for row, image in enumerate(images)}
        for image_id in model.reg_image_ids():
            image = model.image(image_id)
            cam_from_world = matrix_of(image.cam_from_world())
            world_from_cam[row_of_name[image.name]] = invert(cam_from_world)
    return world_from_cam


def _write_masks(images: list[Path], masks_dir: Path, out_dir: Path) -> None:
    """COLMAP's sense: no features where the mask is 0."""
    out_dir.mkdir()
    size_px = check_images(images)
    for image in images:
        background = read_gray(find_mask(masks_dir, image), size_px) <= 127
        write_gray(out_dir / f"{image.name}.png", 255 * background.astype(np.uint8))
