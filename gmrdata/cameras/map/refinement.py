"""A model of a mapper made better: adjusted, its weak keyframes held again, those that jump mended.

A mapper makes points by the places that its cameras have at that time.  A keyframe whose place is
wrong then keeps few of its matches, and bundle adjustment has little to lead it back by.  The
points of all keyframes are made anew from the matches then, and adjusted, twice (re-triangulation,
Schoenberger and Frahm 2016, 4.4).
"""

from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.cameras.colmap import (
    LEAST_NOISE_PX,
    LOSS_PX,
    MIN_PARALLAX_DEG,
    bundle_adjuster,
    pycolmap,
)
from gmrdata.cameras.files import ModelRecord
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.map.jumps import mend_jumps
from gmrdata.cameras.map.models import join_models
from gmrdata.cameras.match.behind_masks import see_again
from gmrdata.cameras.match.matches import DATABASE_FILE, Matches, matched_points
from gmrdata.cameras.recipe import SfmConfig


def refined_model(
    models: list[Any], frames: Frames, matches: Matches, work_dir: Path, config: SfmConfig
) -> tuple[Any, tuple[ModelRecord, ...]]:
    """One adjusted model of those that a mapper found, with background inside masks; what became
    of each."""
    model, records = join_models(models, config)
    _adjust_and_filter(model, config)
    # Where a camera hardly travels, most points lack parallax: few are held, and rightly so.
    if not _is_short_model(model, config) and has_weak(model, matches, frames, config):
        for _ in range(config.mapping.triangulated_again):
            triangulate_again(model, work_dir / DATABASE_FILE, config)
            _adjust_and_filter(model, config)
    see_again(model, matches, frames, config.masks)
    bundle_adjuster(model).solve()
    return mend_jumps(model, frames, config), records


def _adjust_and_filter(model: Any, config: SfmConfig) -> None:
    bundle_adjuster(model).solve()
    model.update_point_3d_errors()
    manager = pycolmap.ObservationManager(model)
    manager.filter_all_points3D(config.max_reprojection_px, MIN_PARALLAX_DEG)


def sharpen(model: Any, config: SfmConfig) -> float:
    """Adjust a model anew where its camera hardly travels, by a loss as narrow as most errors are;
    the scale of the loss of its last adjustment [px].

    A tenth of the image points is half a pixel off where most are a tenth, which tells over a short
    path alone.
    """
    if not _is_short_model(model, config):
        return LOSS_PX
    model.update_point_3d_errors()
    median_px = float(np.median([model.point3D(i).error for i in sorted(model.point3D_ids())]))
    loss_px = min(LOSS_PX, max(LEAST_NOISE_PX, median_px))
    bundle_adjuster(model, loss_px=loss_px).solve()
    return loss_px


def is_short(centres: np.ndarray, points: np.ndarray, share: float) -> bool:
    """Whether centres (T, 3) are less apart than a share of the distance to points (N, 3)."""
    if not len(centres) or not len(points):
        return False
    extent = np.linalg.norm(centres[:, None] - centres[None], axis=-1).max()
    return bool(extent < share * background_distance(centres, points))


def _is_short_model(model: Any, config: SfmConfig) -> bool:
    """The same of a COLMAP model."""
    centres = [model.image(i).projection_center() for i in sorted(model.reg_image_ids())]
    points = [model.point3D(i).xyz for i in sorted(model.point3D_ids())]
    return is_short(np.array(centres), np.array(points), config.small_travel_share)


def background_distance(centres: np.ndarray, points: np.ndarray) -> float:
    """Median distance of points (N, 3) from the middle of centres (T, 3)."""
    return float(np.median(np.linalg.norm(points - centres.mean(axis=0), axis=1)))


def has_weak(model: Any, matches: Matches, frames: Frames, config: SfmConfig) -> bool:
    """Whether a model has a keyframe that it explains little of."""
    n_matched, row_of_name = matched_points(matches), frames.row_of_name
    least = config.mapping.least_held
    images = map(model.image, model.reg_image_ids())
    return any(image.num_points3D < least * n_matched[row_of_name[image.name]] for image in images)


def triangulate_again(model: Any, database_path: Path, config: SfmConfig) -> None:
    """Lengthen a model's tracks, merge them, and make points of matches that have none."""
    graph = _matches_of(model, database_path, config).correspondence_graph
    manager = pycolmap.ObservationManager(model, graph)
    triangulator = pycolmap.IncrementalTriangulator(graph, model, manager)
    options = pycolmap.IncrementalTriangulatorOptions()
    options.random_seed = config.seed
    options.min_angle = config.mapping.min_triangulation_deg
    options.complete_max_reproj_error = config.max_reprojection_px
    options.merge_max_reproj_error = config.max_reprojection_px
    triangulator.complete_all_tracks(options)
    triangulator.merge_all_tracks(options)
    for image_id in sorted(model.reg_image_ids()):
        triangulator.triangulate_image(options, image_id)


def _matches_of(model: Any, database_path: Path, config: SfmConfig) -> Any:
    """COLMAP's matches between the images of a model alone: it looks up every one that it has."""
    options = pycolmap.DatabaseCacheOptions()
    options.min_num_matches = config.min_pair_inliers
    options.image_names = {model.image(i).name for i in model.reg_image_ids()}
    with closing(pycolmap.Database.open(database_path)) as database:
        return pycolmap.DatabaseCache.create(database, options)
