"""Plain pycolmap on a sequence: its defaults, incremental and global, on the same masks."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from real.sequences import RealSequence
from sfm.plain import fixed_lens, largest_model, matched

from gmrdata.cameras.colmap import pycolmap
from gmrdata.read.frames import list_images


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
    database = matched(images, given.masks_dir, given.intrinsics_px, work_dir, seed)
    given_s = time.perf_counter() - start
    found = []
    for mapper, run in (("incremental", _incremental), ("global", _global)):
        start, out_dir = time.perf_counter(), work_dir / mapper
        out_dir.mkdir()
        models = run(database, given.images_dir, out_dir, seed)
        seconds = given_s + time.perf_counter() - start
        found.append(Plain(mapper, largest_model(models, images), seconds))
    return found


def _incremental(database: Path, images_dir: Path, out_dir: Path, seed: int) -> Any:
    options = fixed_lens()
    options.random_seed = options.mapper.random_seed = seed
    return pycolmap.incremental_mapping(database, images_dir, out_dir, options)


def _global(database: Path, images_dir: Path, out_dir: Path, seed: int) -> Any:
    options = pycolmap.GlobalPipelineOptions()
    options.random_seed = options.mapper.random_seed = seed
    options.mapper.bundle_adjustment.refine_focal_length = False
    options.mapper.bundle_adjustment.refine_extra_params = False
    options.mapper.bundle_adjustment.ceres.use_gpu = False
    options.mapper.global_positioning.use_gpu = False
    return pycolmap.global_mapping(database, images_dir, out_dir, options)
