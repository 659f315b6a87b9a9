"""How much of the picture a camera that only turns explains.

What stays in the picture while the camera moves (a logo, a subtitle, the hood of a car) looks like
a scene before a camera at rest.  Its matches are exact and many, but all in one part of the
picture; the rest, where the world moves past, has features and no matches that the turn explains.
"""

import numpy as np

from gmrdata.cameras.frames import Frames
from gmrdata.cameras.map.rotation_only import RotationOnly
from gmrdata.cameras.match.matches import Matches
from gmrdata.cameras.match.rays import unit_rays
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values.errors import NoReconstruction

CELLS = 8  # of the picture, along each side
FEWEST_FEATURES = 10  # of a cell that shows something


def covered_share(
    turning: RotationOnly,
    matches: Matches,
    intrinsics_px: np.ndarray,
    size_px: tuple[int, int],
    most_px: float,
) -> float:
    """The median, over pairs of neighbours, of the share of the picture's cells with features of
    which the turn explains one to `most_px`; NaN where no two neighbours match.

    Features outside of masks count, where the second frame still shows their direction.
    """
    shares = []
    for pair in matches.pairs:
        if pair.second != pair.first + 1 or not turning.has_camera[[pair.first, pair.second]].all():
            continue
        n_free = matches.n_free[pair.first] if matches.n_free else None
        free_px = matches.keypoints_px[pair.first][:n_free]
        first, second = turning.world_from_cam_rotmats[[pair.first, pair.second]]
        turn = second.T @ first
        turned_px, ahead = _turned(free_px, turn, intrinsics_px)
        in_sight = ahead & ((turned_px >= 0) & (turned_px < size_px)).all(axis=1)
        first_px, second_px = matches.ends_px(pair)
        expected_px, before = _turned(first_px, turn, intrinsics_px)
        explained = before & (np.linalg.norm(expected_px - second_px, axis=1) < most_px)
        shown = _counts(free_px[in_sight], size_px) >= FEWEST_FEATURES
        met = _counts(first_px[explained], size_px) > 0
        if shown.any():
            shares.append(np.mean(met[shown]))
    return float(np.median(shares)) if shares else np.nan


def _turned(
    image_px: np.ndarray, turn: np.ndarray, intrinsics_px: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where image points (N, 2) come to lie after a turn (3, 3) [px], and which lie ahead (N,)."""
    rays = unit_rays(image_px, intrinsics_px) @ turn.T
    seen = rays @ intrinsics_px.T
    return seen[:, :2] / np.maximum(rays[:, 2:], 1e-3), rays[:, 2] > 0


def _counts(image_px: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    """(CELLS^2,) how many image points (N, 2) lie in each cell of the picture."""
    cells = np.clip((image_px / size_px * CELLS).astype(np.int64), 0, CELLS - 1)
    return np.bincount(cells @ [1, CELLS], minlength=CELLS**2)


def require_cover(
    turning: RotationOnly, matches: Matches, frames: Frames, config: SfmConfig
) -> None:
    """Refuse a turn that explains what stays in the picture, such as a logo, and little else."""
    most_px = config.rotation_only_inlier_px
    share = covered_share(turning, matches, frames.intrinsics_px, frames.size_px, most_px)
    if share < (least := config.choice.least_covered):
        raise NoReconstruction(
            f"a camera that stays in its place explains {share:.0%} of the picture only, less "
            f"than {least:.0%}: something stays in the picture while all else moves, such "
            "as a logo, a subtitle or the hood of a car, which masks may keep out, or most of "
            "what is seen moves by itself",
            frames.images[0].parent,
        )
