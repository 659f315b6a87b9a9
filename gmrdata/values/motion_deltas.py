"""Motion between frames and its accumulation (the paper's eqs. 2-4), in numpy and torch."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

import numpy as np

if TYPE_CHECKING:
    import torch

Array = TypeVar("Array", np.ndarray, "torch.Tensor")


def deltas(root_rotmats: Array, pelvis_m: Array) -> tuple[Array, Array]:
    """Motion from each frame to the next, seen from the body.

    dR = R_i^T R_{i+1} and dT = R_i^T (T_{i+1} - T_i), which is eqs. 2-4 solved for the motion.  It
    is the same in every frame of reference that doesn't move.  frame_from_root (..., T, 3, 3) and
    pelvis positions (..., T, 3) [m] give dR (..., T-1, 3, 3) and dT (..., T-1, 3) [m].
    """
    root_from_frame = root_rotmats[..., :-1, :, :].swapaxes(-1, -2)
    steps_m = pelvis_m[..., 1:, :] - pelvis_m[..., :-1, :]
    delta_m = (root_from_frame @ steps_m[..., None])[..., 0]
    return root_from_frame @ root_rotmats[..., 1:, :, :], delta_m


def accumulate(
    delta_rotmats: Array, delta_m: Array, first_root_rotmat: Array, first_pelvis_m: Array
) -> tuple[Array, Array]:
    """Poses from a first pose and the motions after it (eqs. 3-4).

    R_{i+1} = R_i dR_i and T_{i+1} = R_i dT_i + T_i, from a first R (..., 3, 3) and T (..., 3) [m],
    which are the identity and the origin in the paper.  Gives frame_from_root (..., T, 3, 3) and
    pelvis positions (..., T, 3) [m].
    """
    rotmats, places_m = [first_root_rotmat], [first_pelvis_m]
    for i in range(delta_m.shape[-2]):
        step_m = (rotmats[-1] @ delta_m[..., i, :, None])[..., 0]
        places_m.append(places_m[-1] + step_m)
        rotmats.append(rotmats[-1] @ delta_rotmats[..., i, :, :])
    return _stack(rotmats, -3), _stack(places_m, -2)


def _stack(arrays: list[Array], axis: int) -> Array:
    if isinstance(arrays[0], np.ndarray):
        return np.stack(arrays, axis=axis)
    import torch

    return torch.stack(arrays, dim=axis)
