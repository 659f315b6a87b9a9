"""Motion: one person over time."""

from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np


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
    whole = round(ratio)
    return whole if whole >= 1 and abs(ratio - whole) <= 1e-6 * ratio else None
