"""The pose prior: how hips, knees and spine turn together in people whom markers measured.

Landmarks of hips lie near to each other and in the body, so a frame hardly tells how the pelvis
turns and leans.  But who has the left leg before him turns the pelvis with it, and shoulders
against it.  `pose_prior.npz` has mean and covariance of these turns (`benchmarks/training`), in
which both hips, or both knees, may bend alike as they like: few of those people sit or squat.
"""

from functools import cache
from pathlib import Path

import numpy as np

from gmrdata.values.body import JOINT
from gmrdata.values.records import ArrayShapes, read_arrays
from gmrdata.values.shapes import Float
from gmrdata.values.transforms import cross_matrices, rotvecs_from_rotmats

PRIOR_FILE = Path(__file__).with_name("pose_prior.npz")
TAG = "gmrdata-pose-prior/1"
PRIOR_JOINTS = tuple(
    JOINT[name]
    for name in (
        "left_hip", "right_hip", "left_knee", "right_knee", "spine1", "spine2", "spine3",
    )
)  # fmt: skip
N_PRIOR = 3 * len(PRIOR_JOINTS)
SHAPES: ArrayShapes = {"mean_rad": ("f", (N_PRIOR,)), "covariance_rad2": ("f", (N_PRIOR, N_PRIOR))}
SMALL_RAD = 1e-3


@cache
def _prior() -> tuple[np.ndarray, np.ndarray]:
    """Mean (21,), and what makes distances from it usual ones (21, 21)."""
    arrays = read_arrays(PRIOR_FILE, TAG, SHAPES)
    usual = np.linalg.cholesky(np.linalg.inv(arrays["covariance_rad2"])).T
    return arrays["mean_rad"], usual


def prior_errors(rotmats: Float[np.ndarray, "frames 24 3 3"]) -> Float[np.ndarray, "frames 21"]:
    """How far poses are from usual ones: the sum of squares is Mahalanobis's distance squared."""
    mean_rad, usual = _prior()
    return np.asarray((_turns_rad(rotmats).reshape(len(rotmats), -1) - mean_rad) @ usual.T)


def prior_by_turn(
    rotmats: Float[np.ndarray, "frames 24 3 3"],
) -> Float[np.ndarray, "frames 21 7 3"]:
    """Derivatives of these by small turns of `PRIOR_JOINTS` about their own axes."""
    _, usual = _prior()
    turns_rad = _turns_rad(rotmats)
    angle = np.linalg.norm(turns_rad, axis=-1)[..., None, None].clip(SMALL_RAD)
    crossed = cross_matrices(turns_rad.reshape(-1, 3)).reshape(*turns_rad.shape, 3)
    # The logarithm of R exp(w): the inverse of SO(3)'s right Jacobian.
    bend = (1 - angle / 2 / np.tan(angle / 2)) / angle**2
    by_own = np.eye(3) + crossed / 2 + bend * (crossed @ crossed)
    return np.einsum("ejk,tjkl->tejl", usual.reshape(N_PRIOR, -1, 3), by_own)


def _turns_rad(rotmats: np.ndarray) -> np.ndarray:
    """(T, 7, 3) rotation vectors of `PRIOR_JOINTS`."""
    return rotvecs_from_rotmats(rotmats[:, PRIOR_JOINTS])
