"""Keyframes of which a model explains little, and the points that would hold them.

A mapper makes points by the places that its cameras have at that time.  A keyframe whose place is
wrong then keeps few of its matches, and bundle adjustment has little to lead it back by.  The
points of all keyframes are made anew from the matches then, and adjusted, twice (re-triangulation,
Schoenberger and Frahm 2016, 4.4).
"""

from contextlib import closing
from pathlib import Path
from typing import Any

from gmrdata.cameras.colmap import pycolmap
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.match.matches import Matches, matched_points
from gmrdata.cameras.recipe import SfmConfig


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
