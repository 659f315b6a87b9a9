"""A motion's joints and vertices with numpy alone.

`gmrdata.values.skinning_torch` computes the same with torch, for learning.  Loading torch takes
longer than posing a whole clip, and the Blender process, which starts anew for each clip, needs
nothing else of it.  Loper et al. 2015, eqs. 2-10.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from gmrdata.values.body import N_JOINTS, PARENTS, BodyModel
from gmrdata.values.motion import Motion
from gmrdata.values.shapes import Float

CHUNK_BYTES = 64 << 20  # memory that the transforms of one chunk of frames may take


def global_rotmats(
    parents: Sequence[int], local_rotmats: Float[np.ndarray, "frames joints 3 3"]
) -> Float[np.ndarray, "frames joints 3 3"]:
    """world_from_joint rotations of a tree; a parent (-1 for none) comes before its children."""
    # Joints first: long motions take half the time where a joint's frames lie side by side.
    rotmats = np.array(local_rotmats.swapaxes(0, 1), dtype=np.float64, order="C")
    for joint, parent in enumerate(parents):
        if parent >= 0:
            rotmats[joint] = rotmats[parent] @ rotmats[joint]
    return np.ascontiguousarray(rotmats.swapaxes(0, 1))


def joint_positions_m(
    parents: Sequence[int],
    world_from_joint: Float[np.ndarray, "frames joints 3 3"],
    translations_m: Float[np.ndarray, "*frames joints 3"],
) -> Float[np.ndarray, "frames joints 3"]:
    """A tree's joints in the world [m], of places in parents' frames (Loper et al., eq. 4)."""
    positions_m = np.empty(world_from_joint.shape[:-1])
    steps_m = np.broadcast_to(translations_m, positions_m.shape)
    for joint, parent in enumerate(parents):
        step_m = steps_m[:, joint]
        if parent >= 0:
            step_m = (world_from_joint[:, parent] @ step_m[..., None])[..., 0]
            step_m = positions_m[:, parent] + step_m
        positions_m[:, joint] = step_m
    return positions_m


def with_ancestors(parents: Sequence[int], joints: Iterable[int]) -> tuple[list[int], list[int]]:
    """Some joints of a tree and all above them, in order, and each one's parent among them."""
    kept = {-1}
    for joint in joints:
        while joint not in kept:
            kept.add(joint)
            joint = parents[joint]
    numbers = sorted(kept)
    return numbers[1:], [numbers.index(parents[joint]) - 1 for joint in numbers[1:]]


def posed_joints_m(
    rest_joints_m: Float[np.ndarray, "joints 3"],
    rotmats: Float[np.ndarray, "frames joints 3 3"],
    pelvis_m: Float[np.ndarray, "frames 3"],
    parents: Sequence[int] = PARENTS,
) -> tuple[Float[np.ndarray, "frames joints 3"], Float[np.ndarray, "frames joints 3 3"]]:
    """Joints of a posed body [m], and frame_from_joint; `rotmats` are local, the root's first."""
    bones_m = rest_joints_m - rest_joints_m[[0, *parents[1:]]]
    bones_m = np.tile(bones_m, (len(rotmats), 1, 1))
    bones_m[:, 0] = pelvis_m
    frame_from_joint = global_rotmats(parents, rotmats)
    return joint_positions_m(parents, frame_from_joint, bones_m), frame_from_joint


def motion_joints_m(body: BodyModel, motion: Motion) -> Float[np.ndarray, "frames 24 3"]:
    """Joints of a motion [m], in the motion's frame."""
    body.require_shape(motion.shape.shape)
    joints_m, _ = posed_joints_m(body.rest_joints_m(motion.shape), motion.rotmats, motion.pelvis_m)
    return joints_m


def motion_vertices_m(
    body: BodyModel, motion: Motion, rows: np.ndarray | slice | None = None
) -> Float[np.ndarray, "n vertices 3"]:
    """Vertices of a motion, or of some of its rows, float32 [m], in the motion's frame."""
    body.require_shape(motion.shape.shape)
    rest_joints_m = body.rest_joints_m(motion.shape)
    numbers = np.arange(motion.n_frames)[slice(None) if rows is None else rows]
    # Of these rows alone: else few at a time of a long motion would take as long as all, each time.
    posed = motion.take(numbers)
    joints_m, frame_from_joint = posed_joints_m(rest_joints_m, posed.rotmats, posed.pelvis_m)
    # A joint's transform maps rest points to posed points, so its own rest place comes off first.
    # Seen from the pelvis, single precision is fine: far from the origin it would not be.
    pelvis_m = joints_m[:, :1]
    turned_m = (frame_from_joint @ (rest_joints_m - rest_joints_m[0])[..., None])[..., 0]
    offsets_m = joints_m - pelvis_m - turned_m
    transforms = np.concatenate([frame_from_joint, offsets_m[..., None]], axis=-1)
    template_m = body.rest_vertices_m(motion.shape) - rest_joints_m[0]
    weights = body.skin_weights.astype(np.float32)
    vertices_m = np.empty((len(numbers), *template_m.shape), dtype=np.float32)
    chunk = max(1, CHUNK_BYTES // (len(template_m) * 12 * 4))
    for start in range(0, len(numbers), chunk):
        here = slice(start, start + chunk)
        rest_m = _bent(body, template_m, motion, numbers[here])
        moved = transforms[here].reshape(-1, N_JOINTS, 12).astype(np.float32)
        blended = (weights @ moved).reshape(len(moved), -1, 3, 4)
        posed_m = np.einsum("tvij,tvj->tvi", blended[..., :3], rest_m) + blended[..., 3]
        vertices_m[here] = posed_m + pelvis_m[here]
    return vertices_m


def _bent(body: BodyModel, template_m: np.ndarray, motion: Motion, rows: np.ndarray) -> np.ndarray:
    """The rest shape (n or 1, V, 3) float32 with the pose's blend shapes (eq. 9)."""
    if body.pose_dirs_m is None:
        return template_m[None].astype(np.float32)
    bends = (motion.local_rotmats[rows] - np.eye(3)).reshape(len(rows), -1)
    directions = body.pose_dirs_m.reshape(-1, bends.shape[1])
    bent_m = template_m + (bends @ directions.T).reshape(len(rows), -1, 3)
    return np.asarray(bent_m, dtype=np.float32)
