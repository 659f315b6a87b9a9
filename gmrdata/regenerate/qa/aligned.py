"""The data set's own camera path in the world that was made, and how far the two are apart."""

from dataclasses import dataclass

import numpy as np

from gmrdata.evaluate.alignment import mean_rotation
from gmrdata.evaluate.metrics import angles_rad
from gmrdata.geometry import transforms


@dataclass(frozen=True, eq=False)
class Aligned:
    """The data set's cameras, moved rigidly."""

    world_from_cam: np.ndarray
    """(T, 4, 4) in the made world [m]; NaN where unknown."""
    n_frames: int
    """Frames that they were laid over each other by."""
    rms_m: float
    """Root mean square distance between the two places, over these frames [m]."""
    rms_deg: float
    """The same of the orientations [degrees]."""


def align_tracked(
    world_from_cam: np.ndarray, tracked: np.ndarray, kept: np.ndarray
) -> Aligned | None:
    """Lay the data set's path over ours; None if no kept frame has both.

    The rotation is the mean difference in orientation over the kept frames, so it is fixed for a
    camera that stays in place too; then the paths' middles are laid on each other.  Both are
    metric, so nothing is scaled.

    Args:
        world_from_cam: (T, 4, 4) our cameras [m]; NaN where unknown.
        tracked: (T, 4, 4) the data set's [m]; NaN where unknown.
        kept: (T,) bool: frames to go by.
    """
    both = kept & np.isfinite(world_from_cam).all(axis=(1, 2)) & np.isfinite(tracked).all((1, 2))
    if not both.any():
        return None
    ours, theirs = world_from_cam[both], tracked[both]
    turns = ours[:, :3, :3] @ theirs[:, :3, :3].swapaxes(1, 2)
    rotmat = mean_rotation(turns)
    shift_m = (ours[:, :3, 3] - theirs[:, :3, 3] @ rotmat.T).mean(axis=0)
    moved = transforms.rigid(rotmat, shift_m) @ tracked
    apart_m = np.linalg.norm(moved[both, :3, 3] - ours[:, :3, 3], axis=1)
    apart_rad = angles_rad(rotmat.T @ turns)
    return Aligned(
        world_from_cam=moved,
        n_frames=int(both.sum()),
        rms_m=float(np.sqrt(np.mean(apart_m**2))),
        rms_deg=float(np.rad2deg(np.sqrt(np.mean(apart_rad**2)))),
    )
