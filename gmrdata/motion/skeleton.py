"""SourceMotion: a motion on its own skeleton, as the BVH and ASF/AMC readers give it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class SourceMotion:
    """T frames of a skeleton of J joints, in the file's own axes, in metres.

    A joint's frame is parallel to the world's in the file's zero pose, so a global rotation says
    how far the joint has turned away from the zero pose.  Both formats are brought to this form, so
    the same motion has the same rotations whichever file it came from.
    """

    names: tuple[str, ...]
    """(J,) joint names; a parent comes before its children."""
    parents: tuple[int, ...]
    """(J,) index of each joint's parent, -1 for the root."""
    offsets_m: np.ndarray
    """(J, 3) joint position relative to its parent's in the zero pose [m]."""
    tips_m: np.ndarray
    """(J, 3) end of the joint's bone relative to the joint in the zero pose [m]; NaN if unknown."""
    local_rotmats: np.ndarray
    """(T, J, 3, 3) parent_from_joint rotations; of the root: world_from_joint."""
    translations_m: np.ndarray
    """(T, J, 3) joint position in its parent's frame [m]; of the root: in the file's world."""
    fps_hz: float
    """Frame rate [Hz]."""
    notes: tuple[str, ...]
    """What the reader decided (unit, rate, dropped frame), for the record."""

    @property
    def n_frames(self) -> int:
        """Number of frames T."""
        return int(self.local_rotmats.shape[0])

    def rest_joints_m(self) -> np.ndarray:
        """Joint positions in the zero pose, root at its offset: (J, 3) [m]."""
        positions = np.array(self.offsets_m, dtype=np.float64)
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                positions[joint] += positions[parent]
        return positions


def global_rotmats(parents: Sequence[int], local_rotmats: np.ndarray) -> np.ndarray:
    """world_from_joint rotations of a tree: (T, J, 3, 3) local rotations -> (T, J, 3, 3)."""
    rotmats = np.empty(local_rotmats.shape)
    for joint, parent in enumerate(parents):
        local = local_rotmats[:, joint]
        rotmats[:, joint] = local if parent < 0 else rotmats[:, parent] @ local
    return rotmats


def joint_positions_m(
    parents: Sequence[int], world_from_joint: np.ndarray, translations_m: np.ndarray
) -> np.ndarray:
    """Forward kinematics of a tree.

    Args:
        parents: (J,) parent of each joint, -1 for the root; a parent comes before its children.
        world_from_joint: (T, J, 3, 3) global rotations.
        translations_m: (J, 3) or (T, J, 3) joint positions in their parents' frames [m].

    Returns:
        (T, J, 3) positions in the world [m].
    """
    positions = np.empty(world_from_joint.shape[:-1])
    steps = np.broadcast_to(translations_m, positions.shape)
    for joint, parent in enumerate(parents):
        step = steps[:, joint]
        positions[:, joint] = (
            step
            if parent < 0
            else positions[:, parent] + np.einsum("tij,tj->ti", world_from_joint[:, parent], step)
        )
    return positions
