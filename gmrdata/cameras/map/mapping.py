"""Cameras with six degrees of freedom: COLMAP's mappers, then a robust bundle adjustment."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.cameras.colmap import (
    MIN_PARALLAX_DEG,
    TRACKS_PER_FRAME,
    camera_of,
    global_options,
    incremental_options,
    matrix_of,
    pycolmap,
    seen_by,
)
from gmrdata.cameras.files import Mapper
from gmrdata.cameras.frames import Frames, Timeline
from gmrdata.cameras.map.covered import Core
from gmrdata.cameras.map.focal import freed_focal, with_lens
from gmrdata.cameras.map.models import Part, parts_among, place_frames
from gmrdata.cameras.map.refinement import (
    adjust,
    background_distance,
    forget_astray,
    is_short,
    joined_core,
    mend_jumps,
    refined_model,
    sharpen,
)
from gmrdata.cameras.map.smoothing import camera_information, smooth_cameras
from gmrdata.cameras.map.solution import Placed, SeenPoints, Solution
from gmrdata.cameras.match.matches import DATABASE_FILE, Matches, matched_points
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values import transforms


def map_frames(
    frames: Frames, matches: Matches, work_dir: Path, config: SfmConfig
) -> Solution | None:
    """Map all frames; None if neither mapper finds a model.

    The global mapper goes first.  The incremental one is tried where the global one leaves frames
    out, in those parts of many frames alone, and is taken if it registers more of them, or as many
    with more observations.  Where neither finds a model that explains the matches, or the camera
    hardly leaves its place by it, the incremental one is run with lower thresholds for parallax.  A
    pan has no model even then.
    """
    solutions: list[Solution] = []
    mappers: tuple[Mapper, ...] = ("global", "incremental", "small_parallax")
    n_matched = matched_points(matches)
    parts = parts_among(np.arange(len(frames.images)), matches, config.mapping)

    def good(one: Solution) -> bool:
        return explains(one, n_matched, config) and not hardly_travels(
            one, config.small_travel_share
        )

    for mapper in mappers:
        if mapper == "small_parallax" and any(good(one) for one in solutions):
            break
        has_camera = solutions[-1].has_camera if solutions and good(solutions[-1]) else None
        if models := _run(mapper, frames, parts, work_dir, config, has_camera):
            by: Mapper = "global" if has_camera is not None and len(parts) > 1 else mapper
            solutions.append(_finish(models, by, frames, matches, work_dir, config))
            if solutions[-1].has_camera.all() and good(solutions[-1]):
                break
    if solutions and all(hardly_travels(one, config.small_travel_share) for one in solutions):
        return max(solutions, key=_well_held)
    return max(solutions, key=lambda m: (m.has_camera.sum(), m.inliers.sum()), default=None)


def hardly_travels(mapped: Solution, share: float) -> bool:
    """Whether a model's cameras are less apart than a share of the distance to what they see.

    The global mapper's are not to be trusted then.
    """
    return is_short(mapped.world_from_cam[mapped.has_camera, :3, 3], mapped.points, share)


def travel_share(mapped: Solution) -> float:
    """How far a model's cameras are apart, as a share of the distance to what they see: the
    diagonal of the box round them."""
    centres = mapped.world_from_cam[mapped.has_camera, :3, 3]
    extent = float(np.linalg.norm(np.ptp(centres, axis=0)))
    return extent / background_distance(centres, mapped.points)


def explains(mapped: Solution, n_matched: np.ndarray, config: SfmConfig) -> bool:
    """Whether a model has enough of the matched points (T,) of the frames that it has."""
    n_there = n_matched[mapped.has_camera].sum()
    least = config.mapping.least_explained * n_there
    return bool(n_there > 0 and mapped.inliers.sum() >= least)


def map_again(
    first: Solution,
    rows: np.ndarray,
    frames: Frames,
    matches: Matches,
    work_dir: Path,
    config: SfmConfig,
) -> tuple[np.ndarray, float]:
    """Cameras (T, 4, 4) of a second solution by the same mapper, of some rows (N,) of the frames
    alone, and their mean error [px]; NaN for the others, and where there is none.

    Where the camera hardly travels, the global mapper may find a model of all frames and none of
    some.  Lower thresholds for parallax are tried then, as in the first solution.
    """
    world_from_cam = np.full((len(frames.images), 4, 4), np.nan)
    parts = parts_among(rows, matches, config.mapping)
    models = _run(first.mapper, frames, parts, work_dir, config)
    short = hardly_travels(first, config.small_travel_share)
    if not models and short and first.mapper != "small_parallax":
        models = _run("small_parallax", frames, parts, work_dir, config)
    if not models:
        return world_from_cam, np.inf
    core, _ = joined_core(models, frames, len(rows), matches, work_dir, config)
    adjust(core.model, config)
    model = mend_jumps(core.model, frames, config)
    model.update_point_3d_errors()
    error_px = float(model.compute_mean_reprojection_error())
    model, lens = with_lens(model, config.distortion)
    sharpen(model, config)
    forget_astray(model, config)
    matches = matches.without(lens, frames.intrinsics_px)
    placed, _ = _read_out(model, frames, matches)
    known = _known_by(core, np.array(sorted(model.point3D_ids()), np.int64))
    place_frames(known, placed, replace(matches, pairs=[]), frames.intrinsics_px, known)
    return placed.world_from_cam, error_px


def map_otherwise(
    first: Solution, frames: Frames, matches: Matches, work_dir: Path, config: SfmConfig
) -> Solution:
    """The better of a solution and one that the same mapper begins elsewhere, by another seed."""
    parts = parts_among(np.arange(len(frames.images)), matches, config.mapping)
    models = _run(first.mapper, frames, parts, work_dir, config)
    if not models:
        return first
    other = _finish(models, first.mapper, frames, matches, work_dir, config)
    return max(first, other, key=_well_held)


def _well_held(one: Solution) -> tuple[int, float]:
    """What the better of two has more of, where inliers say little: hardly any parallax is outside
    their threshold."""
    return int(one.has_camera.sum()), -float(np.median(one.errors_px))


def place_between(
    keys: Solution,
    key_rows: np.ndarray,
    others: np.ndarray,
    matches: Matches,
    intrinsics_px: np.ndarray,
) -> Solution:
    """A reconstruction of K keyframes, with the rest placed against its points: first other
    keyframes (N,), which match those or each other, then the frames between."""
    n = len(matches.keypoints_px)
    world_from_cam, inliers = np.full((n, 4, 4), np.nan), np.zeros(n, dtype=np.int64)
    world_from_cam[key_rows], inliers[key_rows] = keys.world_from_cam, keys.inliers
    adjusted = np.zeros(n, dtype=bool)
    adjusted[key_rows] = keys.adjusted
    seen = {int(key_rows[key]): points for key, points in keys.seen.items()}
    between = set(range(n)) - set(key_rows.tolist()) - set(others.tolist())
    placed = Placed(world_from_cam, inliers, keys.points, seen)
    left, n_resected = set(others.tolist()), keys.n_resected
    # Some match but such as are placed themselves.
    while n_more := place_frames(left, placed, matches, intrinsics_px):
        left, n_resected = left - set(placed.seen), n_resected + n_more
    place_frames(between, placed, matches, intrinsics_px)
    return replace(
        keys,
        world_from_cam=world_from_cam,
        inliers=inliers,
        seen=seen,
        adjusted=adjusted,
        n_resected=n_resected,
    )


def refine_mapped(
    mapped: Solution,
    matches: Matches,
    intrinsics_px: np.ndarray,
    timeline: Timeline,
    config: SfmConfig,
) -> Solution:
    """Cameras with six degrees of freedom, smoothed as far as their points let them be."""
    cameras, points, rows = mapped.world_from_cam, mapped.points, sorted(mapped.seen.items())
    sights = (
        (row, matches.keypoints_px[row][seen[:, 0]], points[seen[:, 1]]) for row, seen in rows
    )
    information, slope = camera_information(cameras, sights, intrinsics_px, mapped.loss_px)
    arms = (points[seen[:, 1]] - cameras[row, :3, 3] for row, seen in rows)
    unit = float(np.median([np.median(np.linalg.norm(arm, axis=1)) for arm in arms]))
    refined, smoothing = smooth_cameras(cameras, information, slope, timeline, unit, config)
    return replace(mapped, world_from_cam=refined, smoothing=smoothing)


def _run(
    mapper: Mapper,
    frames: Frames,
    parts: Sequence[Part],
    work_dir: Path,
    config: SfmConfig,
    has_camera: np.ndarray | None = None,
) -> list[Any]:
    """The models that a mapper finds, part by part, as a mapper takes three times as long for twice
    as many frames.  The global mapper's models stay of parts in which all frames have a camera
    (T,)."""
    models = []
    for part in parts:
        which = f"{part.name}_by_{config.seed}"
        if has_camera is not None and has_camera[part.own].all():
            kept = sorted((work_dir / f"global_{which}").iterdir())
            models += [pycolmap.Reconstruction(folder) for folder in kept]
            continue
        out_dir = work_dir / f"{mapper}_{which}"
        out_dir.mkdir()
        files = work_dir / DATABASE_FILE, frames.images[0].parent, out_dir
        names = [frames.images[row].name for row in part.rows]
        models += _run_part(mapper, files, names, config)
    return models


def _run_part(
    mapper: Mapper, files: tuple[Path, Path, Path], names: Sequence[str], config: SfmConfig
) -> list[Any]:
    """The models that a mapper finds of the named frames."""
    if mapper == "global":
        options = _global_options(len(names), config)
        options.image_names = list(names)
        return list(pycolmap.global_mapping(*files, options).values())
    options = incremental_options(config, free_lens=False)
    options.min_model_size = config.min_frames_registered
    options.image_names = list(names)
    if mapper == "small_parallax":
        options.mapper.init_min_tri_angle = config.mapping.small_start_deg
        options.mapper.filter_min_tri_angle = options.triangulation.min_angle = MIN_PARALLAX_DEG
        # Half of what else is asked for: small frames between masks have no more.
        options.mapper.init_min_num_inliers = 50
    return list(pycolmap.incremental_mapping(*files, options).values())


def _global_options(n_frames: int, config: SfmConfig) -> Any:
    options = global_options(config, free_lens=False)
    if n_frames >= config.mapping.long_frames:
        options.mapper.track_required_tracks_per_view = TRACKS_PER_FRAME
    return options


def _finish(
    models: list[Any],
    mapper: Mapper,
    frames: Frames,
    matches: Matches,
    work_dir: Path,
    config: SfmConfig,
) -> Solution:
    """Join and refine models, place the frames that they lack, and read the result out."""
    core, records = refined_model(models, frames, matches, work_dir, config)
    model = core.model
    focal = freed_focal(model)
    model, lens = with_lens(model, config.distortion)
    loss_px = sharpen(model, config)
    forget_astray(model, config)
    intrinsics_px = frames.intrinsics_px
    matches = matches.without(lens, intrinsics_px)
    placed, errors_px = _read_out(model, frames, matches)
    _forget_weak(placed, config.min_frame_points)
    rows = range(len(frames.images))
    adjusted = np.isin(rows, list(placed.seen))
    ids = np.array(sorted(model.point3D_ids()), np.int64)
    known = _known_by(core, ids)
    missing = set(rows) - set(placed.seen)
    n_resected = place_frames(missing, placed, matches, intrinsics_px, known)
    return Solution(
        geometry="full",
        mapper=mapper,
        world_from_cam=placed.world_from_cam,
        errors_px=errors_px,
        inliers=placed.inliers,
        focal=focal,
        points=placed.points,
        track_lengths=np.array([model.point3D(i).track.length() for i in ids], np.int64),
        models=records,
        n_resected=n_resected,
        seen=placed.seen,
        adjusted=adjusted,
        loss_px=loss_px,
        lens=lens,
    )


def _read_out(model: Any, frames: Frames, matches: Matches) -> tuple[Placed, np.ndarray]:
    """A model's cameras with the points that they see, and the errors of these [px]."""
    number = {point: n for n, point in enumerate(sorted(model.point3D_ids()))}
    points = np.array([model.point3D(i).xyz for i in number]).reshape(-1, 3)
    n_frames = len(frames.images)
    placed = Placed(
        np.full((n_frames, 4, 4), np.nan), np.zeros(n_frames, dtype=np.int64), points, {}
    )
    errors_px = [np.zeros(0)]
    for row, image in frames.rows_of(model):
        features, _, seen = seen_by(model, image)
        if features:
            points_cam = transforms.apply(matrix_of(image.cam_from_world()), seen)
            image_px = (points_cam / points_cam[:, 2:]) @ frames.intrinsics_px.T
            apart_px = image_px[:, :2] - matches.keypoints_px[row][features]
            errors_px.append(np.linalg.norm(apart_px, axis=1))
        placed.world_from_cam[row], placed.inliers[row] = camera_of(image), len(features)
        of = [number[image.point2D(feature).point3D_id] for feature in features]
        placed.seen[row] = np.array([features, of], np.int32).T
    return placed, np.concatenate(errors_px)


def _known_by(core: Core, ids: np.ndarray) -> SeenPoints:
    """What covered keyframes saw of the points that there still are, whose ids (P,) ascend."""
    known = {}
    for row, table in core.covered.items():
        there = table[np.isin(table[:, 1], ids)]
        numbers = np.searchsorted(ids, there[:, 1])
        known[row] = np.stack([there[:, 0], numbers], axis=1).astype(np.int32)
    return known


def _forget_weak(placed: Placed, min_points: int) -> None:
    """Take away cameras that too few points hold in place."""
    for row in list(placed.seen):
        if placed.inliers[row] < min_points:
            placed.world_from_cam[row], placed.inliers[row] = np.nan, 0
            del placed.seen[row]
