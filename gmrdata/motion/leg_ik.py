"""Two-bone inverse kinematics of a leg with a hinge knee, in closed form."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation


def turn(axis: str, angle_rad: np.ndarray) -> np.ndarray:
    """Rotations by (...) angles about one rest axis "x", "y" or "z": (..., 3, 3)."""
    angle_rad = np.asarray(angle_rad, dtype=np.float64)
    rotmats = Rotation.from_euler(axis, angle_rad.reshape(-1, 1)).as_matrix()
    return rotmats.reshape(*angle_rad.shape, 3, 3)


@dataclass(frozen=True, eq=False)
class Leg:
    """A leg at rest; its knee turns about the rest frame's x axis, flexion moves the heel back."""

    thigh_m: np.ndarray
    """(3,) hip to knee at rest [m]."""
    shank_m: np.ndarray
    """(3,) knee to ankle at rest [m]."""

    def _hinge(self) -> tuple[float, float, float]:
        """Terms of |thigh + Rx(b) shank|^2 = constant + amplitude * cos(b - straight)."""
        (ux, uy, uz), (vx, vy, vz) = self.thigh_m, self.shank_m
        constant = self.thigh_m @ self.thigh_m + self.shank_m @ self.shank_m + 2 * ux * vx
        along, across = uy * vy + uz * vz, uz * vy - uy * vz
        return float(constant), float(2 * np.hypot(along, across)), float(np.arctan2(across, along))

    def reach_m(self, flexion_rad: float) -> float:
        """Distance from hip to ankle with the knee bent by `flexion_rad` from straight [m]."""
        constant, amplitude, _ = self._hinge()
        return float(np.sqrt(constant + amplitude * np.cos(flexion_rad)))

    def knee_rad(self, distance_m: np.ndarray) -> np.ndarray:
        """Knee angle about x, relative to rest, for hip-to-ankle distances (...) [rad].

        Distances beyond the leg's reach give the straight leg, and ones too short the folded leg.
        """
        constant, amplitude, straight_rad = self._hinge()
        cosine = (np.square(distance_m) - constant) / amplitude
        return straight_rad + np.arccos(np.clip(cosine, -1.0, 1.0))

    def solve(self, hip_to_ankle_m: np.ndarray, left: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Thigh orientation and knee rotation that bring the ankle to where it is wanted.

        Args:
            hip_to_ankle_m: (T, 3) wanted vector [m], any frame.
            left: (T, 3) direction that the knee's axis should follow as well as it can, same frame.

        Returns:
            frame_from_thigh (T, 3, 3) and thigh_from_shank (T, 3, 3).
        """
        knee = turn("x", self.knee_rad(np.linalg.norm(hip_to_ankle_m, axis=-1)))
        at_rest_m = self.thigh_m + knee @ self.shank_m
        lateral = np.broadcast_to(np.array([1.0, 0.0, 0.0]), at_rest_m.shape)
        thigh = _frames(hip_to_ankle_m, left) @ np.swapaxes(_frames(at_rest_m, lateral), -1, -2)
        return thigh, knee


def _frames(along: np.ndarray, hint: np.ndarray) -> np.ndarray:
    """Orthonormal frames (T, 3, 3): first axis `along`, second as near to `hint` as can be."""
    first = along / np.linalg.norm(along, axis=-1, keepdims=True)
    second = hint - np.sum(hint * first, axis=-1, keepdims=True) * first
    second = second / np.linalg.norm(second, axis=-1, keepdims=True)
    return np.stack([first, second, np.cross(first, second)], axis=-1)
