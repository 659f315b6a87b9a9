"""Models of one sequence: joined where they share frames, and given the frames that they lack.

COLMAP's incremental mapper starts a new model where it can't go on, and lets it grow back into
frames that it has already.  What both models see there fixes the similarity between them.
"""

from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np

from gmrdata.cameras.colmap import matrix_of, project_into, pycolmap, seen_by
from gmrdata.cameras.files import ModelRecord
from gmrdata.cameras.map.solution import SeenPoints
from gmrdata.cameras.match.features import pinhole_params
from gmrdata.cameras.match.matches import Matches
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values import transforms

MIN_PNP_INLIERS = 20  # points that a frame must agree with to be placed by them


def place_frames(
    rows: Iterable[int],
    world_from_cam: np.ndarray,
    observations: np.ndarray,
    seen: SeenPoints,
    matches: Matches,
    intrinsics_px: np.ndarray,
) -> int:
    """Place frames by the points that their matched neighbours see; how many it could.
    Cameras (T, 4, 4), numbers of points (T,) and `seen` are filled in place."""
    width_px, height_px = (round(2 * middle_px) for middle_px in intrinsics_px[:2, 2])
    params = pinhole_params(intrinsics_px)
    camera = pycolmap.Camera(model="PINHOLE", width=width_px, height=height_px, params=params)
    placed = 0
    for row, points in _points_of(set(rows), seen, matches).items():
        if len(points) < MIN_PNP_INLIERS:
            continue
        answer = pycolmap.estimate_and_refine_absolute_pose(
            matches.keypoints_px[row][list(points)], np.array(list(points.values())), camera
        )
        if answer is not None and answer["num_inliers"] >= MIN_PNP_INLIERS:
            world_from_cam[row] = transforms.invert(matrix_of(answer["cam_from_world"]))
            observations[row] = answer["num_inliers"]
            agree = zip(points.items(), answer["inlier_mask"], strict=True)
            seen[row] = {feature: point for (feature, point), inlier in agree if inlier}
            placed += 1
    return placed


def _points_of(rows: set[int], seen: SeenPoints, matches: Matches) -> SeenPoints:
    """Points behind the features of each row, through its matches with frames that see them."""
    found: SeenPoints = {row: {} for row in sorted(rows)}
    for pair in matches.pairs:
        for mine, other, column in ((pair.first, pair.second, 0), (pair.second, pair.first, 1)):
            if mine not in rows or other not in seen:
                continue
            for own, theirs in pair.features[:, [column, 1 - column]].tolist():
                if theirs in seen[other]:
                    found[mine][own] = seen[other][theirs]
    return found


def join_models(models: list[Any], config: SfmConfig) -> tuple[Any, tuple[ModelRecord, ...]]:
    """The largest model with all that share enough with it; what became of each, largest first."""
    ranked = sorted(models, key=lambda model: (-model.num_reg_images(), -model.num_points3D()))
    whole, waiting = pycolmap.Reconstruction(ranked[0]), dict(enumerate(ranked[1:], start=1))
    records = {0: ModelRecord(whole.num_reg_images(), True, "the largest")}
    grown = True
    # A model may share frames only with one that is joined later.
    while waiting and grown:
        grown = False
        for i, model in list(waiting.items()):
            whole_from_model, said = _similarity(whole, model, config)
            records[i] = ModelRecord(model.num_reg_images(), whole_from_model is not None, said)
            if whole_from_model is not None:
                moved = pycolmap.Reconstruction(model)
                moved.transform(whole_from_model)
                _take_over(whole, moved)
                del waiting[i]
                grown = True
    return whole, tuple(records[i] for i in range(len(ranked)))


def _similarity(whole: Any, model: Any, config: SfmConfig) -> tuple[Any | None, str]:
    """whole_from_model, or None; and the reason in words."""
    joining = config.joining
    shared = sorted(set(whole.reg_image_ids()) & set(model.reg_image_ids()))
    if not shared:
        return None, "shares no frame with the largest"
    frames = f"{len(shared)} frame{'s' if len(shared) > 1 else ''}"
    theirs, ours = _shared_points(whole, model, joining.min_common_observations)
    if len(ours) < (least := joining.min_shared_points):
        few = f"only {len(ours)} points with the largest (threshold {least})"
        return None, f"shares {frames} but {few}"
    options = pycolmap.RANSACOptions()
    options.random_seed = config.seed
    images = [whole.image(i) for i in shared]
    arms = [seen_by(whole, image)[2] - image.projection_center() for image in images]
    distance = float(np.median(np.linalg.norm(np.concatenate(arms), axis=1)))
    options.max_error = joining.point_error_share * distance
    # Points, not centres: those of a camera that goes straight leave a turn about its way open.
    fit: Any = pycolmap.estimate_sim3d_robust(theirs, ours, options)
    if fit is None or fit["num_inliers"] < joining.min_inlier_share * len(ours):
        return None, f"no similarity fits the {len(ours)} points that it shares with the largest"
    whole_from_model = fit["tgt_from_src"]
    error_px = _shared_error_px(whole, model, whole_from_model, shared)
    if not error_px <= joining.max_shared_error_px:
        return None, (
            f"its cameras of the {frames} shared with the largest are {error_px:.1f} px off "
            f"(threshold {joining.max_shared_error_px:g} px)"
        )
    return whole_from_model, f"joined by {frames} and {len(ours)} points, {error_px:.2f} px off"


def _owners(model: Any) -> dict[tuple[int, int], int]:
    """The point behind each image point, by image and number."""
    ids = sorted(model.point3D_ids())
    return {at: point_id for point_id in ids for at in _image_points(model.point3D(point_id))}


def _image_points(point: Any) -> list[tuple[int, int]]:
    return [(element.image_id, element.point2D_idx) for element in point.track.elements]


def _shared_points(whole: Any, model: Any, least: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) of a model and those of the whole that the same image points, at `least` so
    many, belong to."""
    owners, theirs, ours = _owners(whole), [], []
    for point_id in sorted(model.point3D_ids()):
        point = model.point3D(point_id)
        votes = Counter(owners[at] for at in _image_points(point) if at in owners)
        owner, common = votes.most_common(1)[0] if votes else (0, 0)
        if common >= least:
            theirs.append(point.xyz)
            ours.append(whole.point3D(owner).xyz)
    return np.array(theirs).reshape(-1, 3), np.array(ours).reshape(-1, 3)


def _shared_error_px(whole: Any, model: Any, whole_from_model: Any, shared: list[int]) -> float:
    """Median distance at which the whole's points appear in the model's cameras and in its own."""
    back = whole_from_model.inverse()
    errors = []
    for image_id in shared:
        _, _, points = seen_by(whole, whole.image(image_id))
        moved = points @ (back.scale * back.rotation.matrix()).T + back.translation
        own_px = project_into(whole.image(image_id), points)
        errors.append(np.linalg.norm(project_into(model.image(image_id), moved) - own_px, axis=1))
    return float(np.median(np.concatenate(errors)))


def _take_over(whole: Any, model: Any) -> None:
    """Add frames and points of a model that is in the same world."""
    for image_id in sorted(set(model.reg_image_ids()) - set(whole.reg_image_ids())):
        theirs = model.image(image_id)
        points_px = np.array([point.xy for point in theirs.points2D]).reshape(-1, 2)
        image = pycolmap.Image(theirs.name, points_px, theirs.camera_id, image_id)
        whole.add_image_with_trivial_frame(image, theirs.cam_from_world())
    owners = _owners(whole)
    for point_id in sorted(model.point3D_ids()):
        point = model.point3D(point_id)
        seen = _image_points(point)
        known = sorted({owners[at] for at in seen if at in owners})
        free = [pycolmap.TrackElement(*at) for at in seen if at not in owners]
        if known:
            for element in free:
                track = whole.point3D(known[0]).track
                if all(element.image_id != other.image_id for other in track.elements):
                    whole.add_observation(known[0], element)
        elif len(free) >= 2:
            whole.add_point3D(point.xyz, pycolmap.Track(free))
