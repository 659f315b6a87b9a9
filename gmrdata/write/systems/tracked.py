"""A person whose motion is written as another system's result."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.values.body import WORLD_FROM_REST
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import rigid

N_BETAS = 10


@dataclass(frozen=True, eq=False)
class TrackedPerson:
    """One person of a sequence over T frames."""

    motion: Motion  # in the z-up world
    rest_pelvis_m: np.ndarray  # (3,) J0 of the person's shape, rest frame [m]
    rows: np.ndarray  # (T,) bool: frames that may be used
    frame_numbers: np.ndarray  # (T,) int: which frame of the video each row is, from 0


def y_up_from_world(n_frames: int) -> np.ndarray:
    """(T, 4, 4) to the world of WHAM and GVHMR, the same for all rows."""
    return np.tile(rigid(WORLD_FROM_REST.T, np.zeros(3)), (n_frames, 1, 1))


def placed(
    motion: Motion, frame_from_world: np.ndarray, rest_pelvis_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Axis-angle (T, 72) and transl (T, 3) in another frame, each row's own (T, 4, 4)."""
    turns = frame_from_world[:, :3, :3]
    rotmats = np.concatenate([(turns @ motion.root_rotmats)[:, None], motion.local_rotmats], axis=1)
    rotvecs = Rotation.from_matrix(rotmats.reshape(-1, 3, 3)).as_rotvec()
    pelvis_m = (turns @ motion.pelvis_m[..., None])[..., 0] + frame_from_world[:, :3, 3]
    return rotvecs.reshape(-1, 72), pelvis_m - rest_pelvis_m


def require_finite(motion: Motion, rows: np.ndarray) -> None:
    values = np.concatenate([motion.rotmats.reshape(len(rows), -1), motion.pelvis_m], axis=1)
    if bad := rows[~np.isfinite(values).all(axis=1)].tolist():
        raise BadMotionFile(f"frame {bad[0]} has no motion ({len(bad)} frames in all)")
