"""Keyframes of which a model explains little, and the points that would hold them.

A mapper makes points by the places that its cameras have at that time.  A keyframe whose place is
wrong then keeps few of its matches, and bundle adjustment has little to lead it back by: of 50
photos round a fox one kept 53 of 976 points and was 134 mm off over 7 m.  The points of all
keyframes are made anew from the matches then, and adjusted, twice (re-triangulation, Schoenberger
and Frahm 2016, 4.4), which leaves that keyframe 6 mm off.
"""

from contextlib import closing
from pathlib import Path
from typing import Any

from gmrdata.cameras.colmap import pycolmap
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.match.matches import Matches, matched_points
from gmrdata.cameras.recipe import SfmConfig

LEAST_HELD = 0.2
"""Share of a keyframe's matched points below which it is weak.  Measured, of the weakest keyframe:
0.25 and more on unmasked videos of a dancer, a hand and a car, 0.16 in one window behind filled
boxes, 0.11 to 0.16 where the dancer was taken three times a second and less, 0.05 on photos round a
fox."""
MIN_TRIANGULATION_DEG = 1.0  # of a point that is made anew


def has_weak(model: Any, matches: Matches, frames: Frames) -> bool:
    """Whether a model has a keyframe that it explains little of."""
    n_matched, row_of_name = matched_points(matches), frames.row_of_name
    images = map(model.image, model.reg_image_ids())
    return any(
        image.num_points3D < LEAST_HELD * n_matched[row_of_name[image.name]] for image in images
    )


def triangulate_again(model: Any, database_path: Path, config: SfmConfig) -> None:
    """Lengthen a model's tracks, merge them, and make points of matches that have none."""
    graph = _matches_of(model, database_path, config).correspondence_graph
    manager = pycolmap.ObservationManager(model, graph)
    triangulator = pycolmap.IncrementalTriangulator(graph, model, manager)
    options = pycolmap.IncrementalTriangulatorOptions()
    options.random_seed, options.min_angle = config.seed, MIN_TRIANGULATION_DEG
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
