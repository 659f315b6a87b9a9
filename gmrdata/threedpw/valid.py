"""Which frames of a person can be used, by the named rules of the field, and why others can't."""

from typing import Literal, get_args

import numpy as np

from gmrdata.errors import BadRecipe
from gmrdata.row_runs import text_runs
from gmrdata.threedpw.arrays import Person
from gmrdata.threedpw.read import Sequence3DPW

ValidRule = Literal["campose_valid", "3dpw_eval", "glamr", "vibe", "slahmr"]
"""Users of 3DPW score four different sets of frames; each rule says which ones it keeps.

- `campose_valid`: the dataset aligned the camera to the person.
- `3dpw_eval`: that, and any 2D keypoint (the official evaluation, `evaluate.py`).
- `glamr`: that, and at least 6 keypoints of confidence above 0.3 (`preprocess_3dpw.py`).
- `vibe`: more than 6 keypoints of confidence above 0.3; `campose_valid` is not asked
  (`threedpw_utils.py`).
- `slahmr`: `campose_valid`, and any keypoint of confidence above 0 (`run_eval.py`).
"""

CONFIDENT = 0.3
"""Confidence above which GLAMR and VIBE count a keypoint."""
LARGEST_NUMBER = 1e6
"""No angle [rad] or position [m] of a person is larger."""
RIGID_TOLERANCE = 1e-3
"""Largest entry of R^T R - 1 of a rotation as files round it."""


def frames_by_rule(person: Person, rule: ValidRule) -> np.ndarray:
    """The frames that a rule keeps: (N,) bool.

    Args:
        person: The person.
        rule: Name of the rule.

    Raises:
        BadRecipe: there is no such rule.
    """
    confidence = person.poses2d_px[:, :, 2]
    confident = (confidence > CONFIDENT).sum(axis=1)
    match rule:
        case "campose_valid":
            return person.campose_valid
        case "3dpw_eval":
            return person.campose_valid & (np.abs(person.poses2d_px).mean(axis=(1, 2)) != 0)
        case "glamr":
            return person.campose_valid & (confident >= 6)
        case "vibe":
            return np.asarray(confident > 6)
        case "slahmr":
            return person.campose_valid & (confidence > 0).any(axis=1)
    raise BadRecipe(
        f"no rule {rule!r} for valid frames; there are {', '.join(get_args(ValidRule))}"
    )


def unusable_reasons(
    sequence: Sequence3DPW, person_index: int, rule: ValidRule = "campose_valid"
) -> list[str]:
    """Why each frame of a person can't be used: (N,) texts, empty where it can.

    Beyond the rule, a frame needs an image, finite numbers, a rigid camera and a body in front of
    it.

    Args:
        sequence: The sequence.
        person_index: Which person, from 0.
        rule: Name of the rule.
    """
    arrays = sequence.arrays
    person = arrays.people[person_index]
    finite_pose = finite_rows(person.poses_rad) & finite_rows(person.trans_m)
    tests = (
        (finite_rows(arrays.cam_from_world), "cam_poses is not finite"),
        (rigid_rows(arrays.cam_from_world), "cam_poses is no rigid transform"),
        (finite_pose, "poses or trans is not finite"),
        (_in_front(arrays.cam_from_world, person), "the body is behind the camera"),
        (frames_by_rule(person, rule), _RULE_REASONS[rule]),
    )
    reasons = list(sequence.images.faults)
    for passed, reason in tests:
        reasons = [
            old or ("" if good else reason) for old, good in zip(reasons, passed, strict=True)
        ]
    return reasons


def dropped_ranges(reasons: list[str]) -> list[tuple[int, int, str]]:
    """Runs of frames that share a reason, as (start, stop, reason); stop is one past the last."""
    return [run for run in text_runs(reasons) if run[2]]


_RULE_REASONS: dict[ValidRule, str] = {
    "campose_valid": "campose_valid is 0",
    "3dpw_eval": "campose_valid is 0, or poses2d is all 0",
    "glamr": f"campose_valid is 0, or fewer than 6 keypoints above {CONFIDENT}",
    "vibe": f"not more than 6 keypoints above {CONFIDENT}",
    "slahmr": "campose_valid is 0, or no keypoint above 0",
}


def finite_rows(values: np.ndarray) -> np.ndarray:
    """(N, ...) -> (N,) bool: all numbers of the row are finite, and none is absurd."""
    return np.asarray((np.abs(values) < LARGEST_NUMBER).reshape(len(values), -1).all(axis=1))


def rigid_rows(transforms: np.ndarray) -> np.ndarray:
    """(N, 4, 4) -> (N,) bool: a proper rotation and a translation."""
    rotmats = transforms[:, :3, :3]
    with np.errstate(all="ignore"):
        off = np.abs(np.swapaxes(rotmats, 1, 2) @ rotmats - np.eye(3)).max(axis=(1, 2))
        proper = (off < RIGID_TOLERANCE) & (np.linalg.det(rotmats) > 0)
    return np.asarray(proper & (transforms[:, 3] == (0.0, 0.0, 0.0, 1.0)).all(axis=1))


def _in_front(cam_from_world: np.ndarray, person: Person) -> np.ndarray:
    with np.errstate(all="ignore"):
        depth_m = np.einsum("nj,nj->n", cam_from_world[:, 2, :3], person.trans_m)
        return np.asarray(depth_m + cam_from_world[:, 2, 3] > 0)
