"""Motion: one person over time; its motion from frame to frame (the paper's eqs. 2-4)."""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, Self, TypeVar

import numpy as np

from gmrdata.values.transforms import rotmats_from_rotvecs, rotvecs_from_rotmats


@dataclass(frozen=True, eq=False)
class Motion:
    """A person's pose over T frames, on the 24-joint SMPL tree.

    The local pose does not depend on the frame of reference; the root and the pelvis do.
    """

    local_rotmats: np.ndarray
    """(T, 23, 3, 3) parent_from_joint rotation of joints 1..23, relative to SMPL's T-pose."""
    root_rotmats: np.ndarray  # (T, 3, 3) frame_from_root: R of the paper's eqs. 2-8
    pelvis_m: np.ndarray  # (T, 3) in `frame` [m]: T of the paper's eqs. 2-8, not SMPL's `trans`
    shape: np.ndarray  # (S,) shape coefficients of `body`
    fps_hz: float  # frame rate [Hz]
    body: str  # name of the BodyModel that `shape` belongs to
    gender: str  # "neutral", "female" or "male"
    frame: Literal["world", "camera"]  # fixed z-up world, or each row's own OpenCV camera frame
    source: str  # where the motion came from, for a person to read: a file and what was done to it

    @property
    def n_frames(self) -> int:
        """Number of frames T."""
        return int(self.root_rotmats.shape[0])

    def take(self, rows: slice | np.ndarray, fps_hz: float | None = None) -> Self:
        """Some frames, as they are; `fps_hz` is the rate that they then have [Hz], if another."""
        return replace(
            self,
            local_rotmats=self.local_rotmats[rows],
            root_rotmats=self.root_rotmats[rows],
            pelvis_m=self.pelvis_m[rows],
            fps_hz=self.fps_hz if fps_hz is None else fps_hz,
        )

    @property
    def rotmats(self) -> np.ndarray:
        """(T, 24, 3, 3) the root's rotation, then the local ones."""
        return np.concatenate([self.root_rotmats[:, None], self.local_rotmats], axis=1)


def without_root(motion: Motion) -> Motion:
    """The same local poses, with the root at the identity and the pelvis at the origin."""
    n = motion.n_frames
    return replace(motion, root_rotmats=np.tile(np.eye(3), (n, 1, 1)), pelvis_m=np.zeros((n, 3)))


def whole_ratio(higher_hz: float, lower_hz: float) -> int | None:
    """Frames of the higher rate for one of the lower; None where that is no whole number."""
    ratio = higher_hz / lower_hz
    whole = 0 if ratio == math.inf else round(ratio)
    return whole if whole >= 1 and abs(ratio - whole) <= 1e-6 * ratio else None


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


def bent(
    rotmats: np.ndarray, pelvis_m: np.ndarray, last_rotmat: np.ndarray, last_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A path, R (T, 3, 3) and T (T, 3) [m], turned and moved evenly so that it ends elsewhere."""
    shares = np.linspace(0.0, 1.0, len(rotmats))[:, None]
    turned = rotmats_from_rotvecs(shares * rotvecs_from_rotmats(last_rotmat @ rotmats[-1].T))
    from_first_m = (turned @ (pelvis_m - pelvis_m[0])[..., None])[..., 0]
    path_m = pelvis_m[0] + from_first_m
    return turned @ rotmats, path_m + shares * (last_m - path_m[-1])


def _stack(arrays: list[Array], axis: int) -> Array:
    if isinstance(arrays[0], np.ndarray):
        return np.stack(arrays, axis=axis)
    import torch

    return torch.stack(arrays, dim=axis)
