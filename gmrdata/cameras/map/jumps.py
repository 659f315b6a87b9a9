"""Keyframes that jump out of their path, begun again between their neighbours.

A keyframe that sees little but far points can turn where it should travel.  Bundle adjustment does
not lead it back: its own points have gone with it.
"""

from operator import itemgetter
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from gmrdata.cameras.colmap import (
    bundle_adjuster,
    camera_adjuster,
    camera_of,
    project_into,
    pycolmap,
    seen_by,
)
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values import transforms

FEWEST = 6  # keyframes that tell what is usual
MOST_ITERATIONS = 100


def mend_jumps(model: Any, frames: Frames, config: SfmConfig) -> Any:
    """The model, or a better one in which keyframes that jump begin again from the middle: one of
    less cost that explains as many image points.

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
