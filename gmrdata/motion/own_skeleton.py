"""Whether a file's skeleton is the body's own: its zero pose is the body's rest pose in some shape.

Whoever wrote such a file, its rotations are the body's own.  So nothing is corrected: what
retargeting would find out about the feet from the motion is in them already.
"""

from collections.abc import Mapping

import numpy as np

from gmrdata.motion.rest_pose import source_from_rest_axes
from gmrdata.motion.standing import zero_pose_m
from gmrdata.read.source_motion import SourceMotion
from gmrdata.values.body import N_JOINTS, PARENTS, BodyModel

SAME_M = 1e-4
"""How far a joint of the zero pose may be from the body's."""
MOST_COEFFICIENTS = 16
"""Of a shape that is looked for: 69 numbers of a skeleton must not be free to fit any other."""


def own_shape(
    source: SourceMotion,
    joints: Mapping[int, int],
    body: BodyModel,
    shape: np.ndarray | None = None,
) -> np.ndarray | None:
    """(S,) the shape in which the body's rest pose is the source's zero pose; None for another's.

    It is `shape` or none where that is given.  Else least squares find it, since rest joints are
    linear in it; coefficients that move no joint are zero.
    """
    if len(joints) < N_JOINTS or not _is_same_tree(source, joints):
        return None
    zero_m = zero_pose_m(source, joints)
    found_m = _from_pelvis(zero_m @ source_from_rest_axes(zero_m))
    for tried in (np.zeros(body.n_shape), _fitted(body, found_m)) if shape is None else (shape,):
        offsets_m = found_m - _from_pelvis(body.rest_joints_m(tried))
        if np.abs(offsets_m).max() <= SAME_M:
            return tried
    return None


def _fitted(body: BodyModel, found_m: np.ndarray) -> np.ndarray:
    """The shape (S,) whose rest joints (24, 3) are nearest, all seen from the pelvis."""
    shape = np.zeros(body.n_shape)
    directions_m = _from_pelvis(body.joint_shape_dirs_m[..., :MOST_COEFFICIENTS])
    offsets_m = found_m - _from_pelvis(body.joints_template_m)
    columns_m = directions_m.reshape(offsets_m.size, -1)
    fitted = np.linalg.lstsq(columns_m, offsets_m.ravel(), rcond=1e-6)[0]
    shape[: len(fitted)] = fitted
    return shape


def _is_same_tree(source: SourceMotion, joints: Mapping[int, int]) -> bool:
    """Whether joints hang on each other as the body's do, and none moves but by turning."""
    below = range(1, N_JOINTS)
    if any(source.parents[joints[joint]] != joints[PARENTS[joint]] for joint in below):
        return False
    rows = [joints[joint] for joint in below]
    moves_m = source.translations_m[:, rows] - source.offsets_m[rows]
    return bool(np.abs(moves_m).max() <= SAME_M)


def _from_pelvis(joints_m: np.ndarray) -> np.ndarray:
    return np.asarray(joints_m - joints_m[:1])
