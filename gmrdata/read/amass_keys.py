"""The keys of AMASS's files and of those like them, as the arrays of one motion."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.values.errors import BadMotionFile

RATE_KEYS = ("mocap_framerate", "mocap_frame_rate")
"""SMPL+H's and SMPL-X's name of the frame rate [Hz]."""
FORMS = "(T, 66) without hands, (T, 72) of SMPL, (T, 156) of SMPL+H and (T, 165) of SMPL-X"
SPLIT_KEYS = {
    "root": ("root_orient", "global_orient"),
    "body": ("pose_body", "body_pose"),
    "hands": ("pose_hand",),
    "left hand": ("left_hand_pose",),
    "right hand": ("right_hand_pose",),
    "path": ("trans", "transl"),
}
"""Names of the parts of `poses`, and of `trans`, in files that have these: AMASS's and smplx's."""


def joined_poses(arrays: dict[str, np.ndarray], path: Path) -> dict[str, np.ndarray]:
    """The same with `poses` (T, n), of one array or of the parts that SMPL-X's files split it into.

    Hands that are not there are straight.  21 joints of a body are SMPL-X's, 23 are SMPL's.
    BadMotionFile for HuMoR's `stage3_results.npz`, which has these keys, but no world.
    """
    if "floor_plane" in arrays:
        what = "HuMoR's motion before the camera, which leans as the camera did"
        raise BadMotionFile(f"{path}: {what}. Give the stage3_results_prior.npz beside it")
    if "poses" in arrays:
        poses = arrays["poses"]
        if poses.ndim == 3 and poses.shape[2] == 3:  # by joint
            poses = poses.reshape(len(poses), 3 * poses.shape[1])
        if poses.shape[1:] != (66,):
            return arrays | {"poses": poses}
        arrays = arrays | {"root_orient": poses[:, :3], "pose_body": poses[:, 3:]}  # no hands
    key_of = {part: next((k for k in keys if k in arrays), "") for part, keys in SPLIT_KEYS.items()}
    parts = {part: arrays[key] for part, key in key_of.items() if key}
    parts = {part: array for part, array in parts.items() if array.dtype.kind in "fiu"}
    if not {"root", "body"} <= parts.keys() or parts.get("path", np.empty((0, 3))).ndim != 2:
        return arrays
    n = max([1, *parts["root"].shape[:1]])
    # Of one frame a part may be a row; a part by another order of axes is none.
    parts = {part: one.reshape(n, -1) for part, one in parts.items() if n in (1, *one.shape[:1])}
    body = parts.get("body", np.empty((n, 0)))
    hands = [parts.get(f"{side} hand", np.empty((n, 0))) for side in ("left", "right")]
    hands_rad = parts.get("hands", np.concatenate(hands, axis=1))
    if hands_rad.shape[1] != 90:  # none, or coefficients of SMPL-X's own
        hands_rad = np.zeros((n, 90))
    face = [] if "smplh" in str(arrays.get("surface_model_type", "")) else [np.zeros((n, 9))]
    more = [*face, hands_rad] if body.shape[1] == 63 else []
    poses = np.concatenate([parts.get("root", body), body, *more], axis=1)
    return arrays | {"poses": poses} | ({"trans": parts["path"]} if "path" in parts else {})


def gender_word(arrays: Mapping[str, Any]) -> str:
    """The file's gender, which releases write as str, bytes, or a 0-d array of either."""
    value = np.asarray(arrays.get("gender", "neutral")).ravel()
    word = value[0] if value.size else "neutral"
    text = (word.decode("ascii", "replace") if isinstance(word, bytes) else str(word)).lower()
    text = re.sub(r"^b(['\"])(.*)\1$", r"\2", text).strip()  # as str() writes bytes
    return {"f": "female", "m": "male", "n": "neutral"}.get(text, text)
