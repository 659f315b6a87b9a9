"""How far two solutions of the same frames agree: a right path does not depend on chance."""

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.cameras.files import Agreement

FEWEST_CAMERAS = 4  # with fewer common ones two paths always agree


def agreement(first: np.ndarray, second: np.ndarray, least_extent: float) -> Agreement | None:
    """How two paths (T, 4, 4), NaN where unknown, differ after the best similarity between them.

    Their worlds are turned into each other by the cameras' orientations, since places along a line
    leave a turn open.  Places are compared with the first path's extent, the diagonal of its box,
    which counts as `least_extent` at least: a camera that hardly leaves its place need not have a
    path.  None where they have fewer than four cameras in common.
    """
    both = np.isfinite(first[:, 0, 0]) & np.isfinite(second[:, 0, 0])
    if both.sum() < FEWEST_CAMERAS:
        return None
    ours, theirs = first[both], second[both]
    turns = Rotation.from_matrix(ours[:, :3, :3] @ np.swapaxes(theirs[:, :3, :3], 1, 2))
    first_from_second = turns.mean()
    turn_deg = np.rad2deg((first_from_second.inv() * turns).magnitude())
    way = ours[:, :3, 3] - ours[:, :3, 3].mean(axis=0)
    other = first_from_second.apply(theirs[:, :3, 3] - theirs[:, :3, 3].mean(axis=0))
    power = float((other**2).sum())
    # Not with a mirror: a path that runs the other way is another one.
    scale = max(0.0, float((way * other).sum()) / power) if power > 0 else 0.0
    apart = np.sqrt(((way - scale * other) ** 2).sum(axis=1).mean())
    extent = max(float(np.linalg.norm(np.ptp(way, axis=0))), least_extent)
    return Agreement(
        cameras=int(both.sum()),
        turn_deg=float(np.sqrt((turn_deg**2).mean())),
        place_share=float(apart) / extent if extent > 0 else 0.0,
    )


def least_extent(world_from_cam: np.ndarray, points: np.ndarray, share: float) -> float:
    """A share of the median distance of points (N, 3) from cameras (T, 4, 4); 0 without points."""
    known = np.isfinite(world_from_cam[:, 0, 0])
    if not len(points) or not known.any():
        return 0.0
    middle = world_from_cam[known, :3, 3].mean(axis=0)
    return share * float(np.median(np.linalg.norm(points - middle, axis=1)))
