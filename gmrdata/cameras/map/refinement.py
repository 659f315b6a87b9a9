"""A model of a mapper made better: adjusted, its weak keyframes held again, those that jump mended.

A mapper makes points by the places that its cameras have at that time.  A keyframe whose place is
wrong then keeps few of its matches, and bundle adjustment has little to lead it back by.  The
points of all keyframes are made anew from the matches then, and adjusted, twice (re-triangulation,
Schoenberger and Frahm 2016, 4.4).
"""

from contextlib import closing
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation, Slerp

from gmrdata.cameras.colmap import (
    LEAST_NOISE_PX,
    LOSS_PX,
    MIN_PARALLAX_DEG,
    ROUGH,
    bundle_adjuster,
    camera_adjuster,
    camera_of,
    observations_of,
    project_into,
    pycolmap,
    seen_by,
)
from gmrdata.cameras.files import ModelRecord
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.map.covered import Core, core_of
from gmrdata.cameras.map.models import join_models
from gmrdata.cameras.match.matches import DATABASE_FILE, Matches, matched_points
from gmrdata.cameras.recipe import BehindMasksConfig, SfmConfig
from gmrdata.values import transforms

ASTRAY = 10.0  # times the error that is allowed: no adjustment leaves so much of what is right


def refined_model(
    models: list[Any], frames: Frames, matches: Matches, work_dir: Path, config: SfmConfig
) -> tuple[Core, tuple[ModelRecord, ...]]:
    """One adjusted model of those that a mapper found, with background inside masks; what became
    of each."""
    core, records = joined_core(models, frames, len(frames.images), matches, work_dir, config)
    model = core.model
    _adjust_and_filter(model, config)
    # Where a camera hardly travels, most points lack parallax: few are held, and rightly so.
    weak = not _is_short_model(model, config) and has_weak(model, matches, frames, config)
    for _ in range(config.mapping.triangulated_again if weak else 0):
        triangulate_again(model, work_dir / DATABASE_FILE, config)
        _adjust_and_filter(model, config)
    see_again(model, matches, frames, config.masks)
    adjust(model, config)
    return replace(core, model=mend_jumps(model, frames, config)), records


def adjust(model: Any, config: SfmConfig) -> None:
    """Adjust a model in place, and once more where something was left astray."""
    bundle_adjuster(model).solve()
    if forget_astray(model, config):
        bundle_adjuster(model).solve()


def joined_core(
    models: list[Any],
    frames: Frames,
    n_keyframes: int,
    matches: Matches,
    work_dir: Path,
    config: SfmConfig,
) -> tuple[Core, tuple[ModelRecord, ...]]:
    """The models of so many keyframes as one, of many without those that others cover, and then the
    list is emptied; what became of each."""
    model, records = join_models(models, config)
    if not config.mapping.in_parts(n_keyframes):
        return Core(model, {}), records
    models.clear()  # some hundred megabytes of a long video, before its matches are read
    # Parts don't know what frames of another one see, by which a path comes back to where it was,
    # and by which a keyframe is not needed.
    triangulate_again(model, work_dir / DATABASE_FILE, config)
    return core_of(model, frames, matches, config.mapping), records


def _adjust_and_filter(model: Any, config: SfmConfig) -> None:
    # What is filtered hardly hangs on the last thousandth of the cost, which takes half of the time
    # and which the last adjustment finds.
    bundle_adjuster(model, tolerance=ROUGH).solve()
    model.update_point_3d_errors()
    manager = pycolmap.ObservationManager(model)
    manager.filter_all_points3D(config.max_reprojection_px, MIN_PARALLAX_DEG)


def forget_astray(model: Any, config: SfmConfig) -> int:
    """Take away image points whose point an adjustment has led behind their camera, or far from
    where they are seen; how many.

    Two keyframes that share little else may draw all points of theirs into one of them.
    """
    model.update_point_3d_errors()
    manager = pycolmap.ObservationManager(model)
    behind: int = manager.filter_observations_with_negative_depth()
    astray: int = manager.filter_all_points3D(ASTRAY * config.max_reprojection_px, 0.0)
    return behind + astray


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
    most, sides = share * background_distance(centres, points), np.ptp(centres, axis=0)
    # The box round them nearly always tells, without a long video's 230 MB of distances.
    if sides.max() >= most or np.linalg.norm(sides) < most:
        return bool(sides.max() < most)
    return bool(pdist(centres).max(initial=0.0) < most)


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
    n_matched, least = matched_points(matches), config.mapping.least_held
    return any(image.num_points3D < least * n_matched[row] for row, image in frames.rows_of(model))


def triangulate_again(model: Any, database_path: Path, config: SfmConfig) -> None:
    """Lengthen a model's tracks, merge them, and make points of matches that have none."""
    graph = _matches_of(model, database_path, config).correspondence_graph
    if not all(map(graph.exists_image, model.reg_image_ids())):
        return  # an image matches none of the others, and COLMAP ends with that
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


FEWEST = 6  # keyframes that tell what is usual
MOST_ITERATIONS = 100


def mend_jumps(model: Any, frames: Frames, config: SfmConfig) -> Any:
    """The model, or a better one in which keyframes that jump begin again from the middle: one of
    less cost that explains as many image points.

    A keyframe that sees little but far points can turn where it should travel.  Bundle adjustment
    does not lead it back: its own points have gone with it.
    Most go back to where they were, which a keyframe alone tells, in a hundredth of the time.
    """
    most_px, images = config.max_reprojection_px, sorted(frames.rows_of(model), key=itemgetter(0))
    ids, numbers = [image.image_id for _, image in images], frames.numbers[[at for at, _ in images]]
    centres = np.array([camera_of(image)[:3, 3] for _, image in images]).reshape(-1, 3)
    jumping = jumps(centres, numbers, config.mapping.jump)[: config.mapping.most_jumps]
    gain = config.mapping.jump_gain
    middles = {at: _middle(model, ids, numbers, at) for at in jumping}
    astray = [at for at, camera in middles.items() if _is_astray(model, ids[at], camera, gain)]
    if not astray:
        return model
    cost, explained = _adjusted(model), _explained(model, most_px)
    for at in astray:
        other = pycolmap.Reconstruction(model)
        _put(other, ids[at], _middle(other, ids, numbers, at))
        other_cost, other_explained = _adjusted(other), _explained(other, most_px)
        if other_cost < cost and other_explained >= explained:
            model, cost, explained = other, other_cost, other_explained
    return model


def jumps(centres: np.ndarray, numbers: np.ndarray, most: float) -> np.ndarray:
    """Which cameras (T,) of a path (T, 3) at times (T,) lie far from between their neighbours, by
    more than so many medians, the furthest first."""
    if len(centres) < FEWEST:
        return np.zeros(0, np.int64)
    shares = (numbers[1:-1] - numbers[:-2]) / (numbers[2:] - numbers[:-2])
    middles = centres[:-2] + shares[:, None] * (centres[2:] - centres[:-2])
    apart = np.linalg.norm(centres[1:-1] - middles, axis=1)
    far = np.flatnonzero(apart > most * np.median(apart))
    return np.asarray(far[np.argsort(-apart[far])] + 1)


def _middle(model: Any, ids: list[int], numbers: np.ndarray, at: int) -> np.ndarray:
    """The camera (4, 4) on the straight way between a keyframe's neighbours, of images in order at
    times (T,)."""
    before, after = (camera_of(model.image(ids[at + step])) for step in (-1, 1))
    share = float((numbers[at] - numbers[at - 1]) / (numbers[at + 1] - numbers[at - 1]))
    turns = Rotation.from_matrix([before[:3, :3], after[:3, :3]])
    place = (1 - share) * before[:3, 3] + share * after[:3, 3]
    return transforms.rigid(Slerp([0, 1], turns)(share).as_matrix(), place)


def _is_astray(model: Any, image_id: int, world_from_cam: np.ndarray, least: float) -> bool:
    """Whether a camera that begins elsewhere (4, 4) ends in a better place, all others held, by at
    least a share of the cost."""
    if not model.image(image_id).num_points3D:
        return False  # no cost tells, and the summary of an empty problem has none
    tried = pycolmap.Reconstruction(model)
    here = camera_adjuster(tried, image_id, max_iterations=0).solve().ceres_summary.final_cost
    _put(tried, image_id, world_from_cam)
    there = camera_adjuster(tried, image_id, MOST_ITERATIONS).solve().ceres_summary.final_cost
    return bool(there < (1 - least) * here)


def _put(model: Any, image_id: int, world_from_cam: np.ndarray) -> None:
    cam_from_world = transforms.invert(world_from_cam)
    rotation = pycolmap.Rotation3d(cam_from_world[:3, :3])
    frame = model.frame(model.image(image_id).frame_id)
    frame.rig_from_world = pycolmap.Rigid3d(rotation, cam_from_world[:3, 3])


def _adjusted(model: Any) -> float:
    """Adjust a model in place; the cost that is left."""
    summary = bundle_adjuster(model, max_iterations=MOST_ITERATIONS).solve()
    return float(summary.ceres_summary.final_cost)


def _explained(model: Any, most_px: float) -> int:
    """How many image points are where the model's points appear, and before the camera."""
    count = 0
    for image in map(model.image, model.reg_image_ids()):
        _, seen_px, points = seen_by(model, image)
        apart_px = np.linalg.norm(project_into(image, points) - seen_px, axis=1)
        count += int((apart_px < most_px).sum())
    return count


def see_again(model: Any, matches: Matches, frames: Frames, config: BehindMasksConfig) -> int:
    """Give the points of a model the features inside masks that show them; how many.

    A feature shows a point that must appear there and looked like it when it was seen last.
    """
    if matches.descriptors is None:
        return 0
    ids = sorted(model.point3D_ids())
    number = {point_id: n for n, point_id in enumerate(ids)}
    points = np.array([model.point3D(i).xyz for i in ids]).reshape(-1, 3)
    often = np.array(
        [model.point3D(i).track.length() >= config.again_seen for i in ids], dtype=bool
    )
    images = dict(frames.rows_of(model))
    seen = {row: _seen_features(image, number) for row, image in sorted(images.items())}
    looks = np.zeros((len(ids), 128), dtype=np.float32)
    # Backwards first: a point that was not seen yet looks as it will.
    for row, (features, of) in reversed(seen.items()):
        looks[of] = _looks(matches.descriptors[row][features])
    added = 0
    for row, (features, of) in seen.items():
        looks_here, n_free = _looks(matches.descriptors[row]), matches.n_free[row]
        looks[of] = looks_here[features]
        hidden = np.setdiff1d(np.flatnonzero(often), of)
        idle = np.setdiff1d(np.arange(n_free, len(looks_here)), features)
        hidden_px = project_into(images[row], points[hidden])
        near, feature = _near(hidden_px, matches.keypoints_px[row][idle], config.again_px)
        for n, at in _alike(hidden[near], idle[feature], looks, looks_here, config.again_likeness):
            model.add_observation(ids[n], pycolmap.TrackElement(images[row].image_id, at))
            looks[n] = looks_here[at]
            added += 1
    return added


def _seen_features(image: Any, number: dict[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Features (N,) of an image that show points, and the numbers (N,) of these."""
    features, ids = observations_of(image).T
    return features, np.array([number[point] for point in ids.tolist()], dtype=np.int64)


def _near(from_px: np.ndarray, to_px: np.ndarray, most_px: float) -> tuple[np.ndarray, np.ndarray]:
    """The pairs (M,), (M,) of rows of image points (N, 2), (K, 2) that are so near, in order."""
    known = np.flatnonzero(np.isfinite(from_px).all(axis=1))
    balls = KDTree(to_px).query_ball_point(from_px[known], most_px, return_sorted=True)
    near = [np.zeros(0, np.int64), *(np.array(ball, np.int64) for ball in balls if ball)]
    return np.repeat(known, [len(ball) for ball in balls]), np.concatenate(near)


def _looks(descriptors: np.ndarray) -> np.ndarray:
    """Descriptors (N, 128) of length 1."""
    floats = descriptors.astype(np.float32)
    return floats / np.maximum(np.linalg.norm(floats, axis=1, keepdims=True), 1)


def _alike(
    point: np.ndarray, feature: np.ndarray, looks: np.ndarray, looks_here: np.ndarray, least: float
) -> list[tuple[int, int]]:
    """Those of M pairs of a point and a feature whose cosine is `least`, each the other's most
    alike; the first of those that are equally alike."""
    likeness = np.einsum("nd,nd->n", looks[point], looks_here[feature])
    best = likeness >= least
    for own, count in ((point, len(looks)), (feature, len(looks_here))):
        most = np.zeros(count, dtype=np.float32)
        np.maximum.at(most, own, likeness)
        best &= likeness == most[own]
    alike = np.flatnonzero(best)
    # One feature may have shown two points, which then look the same to the last bit.
    for own in (point, feature):
        alike = alike[np.sort(np.unique(own[alike], return_index=True)[1])]
    return list(zip(point[alike].tolist(), feature[alike].tolist(), strict=True))
