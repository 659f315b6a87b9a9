"""The predicted world motion at the frame rate of the poses that it was predicted from.

The network sees the poses at its own rate.  Between two of its moments the predicted root is
interpolated as `gmrdata.motion.resample` does it everywhere: rotations on the shortest way (slerp),
positions linearly; at its moments the prediction stands as it is.  Its last moment may lie up to
one of its steps before the last pose.  For what is left the network looks at the poses a second
time, in the phase that ends with the last one, and that last predicted step is laid on the end.  So
the first and the last frame are there, and nothing is extrapolated.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.geometry import transforms
from gmrdata.motion.motion import Motion
from gmrdata.motion.resample import ON_A_SAMPLE, resample
from gmrdata.motion.retarget import WORLD_FROM_REST

if TYPE_CHECKING:
    from gmrdata.gmr.infer import TrainedGmr


def predict_at_source_rate(gmr: "TrainedGmr", motion: Motion) -> Motion:
    """World motion of a person from the local pose alone, with a row for each of the poses.

    Args:
        gmr: The network.
        motion: Local poses at the network's frame rate or above; its root is not looked at.

    Returns:
        The given local poses with predicted root and pelvis, in a world in which the pelvis stands
        upright at the origin in the first frame; `upright.stand` finds a better one.

    Raises:
        BadMotionFile: less than two frames at the network's rate, NaN poses, or a lower rate.
    """
    from gmrdata.gmr.infer import predict_world_motion

    n = motion.n_frames
    poses = replace(motion, root_rotmats=np.tile(np.eye(3), (n, 1, 1)), pelvis_m=np.zeros((n, 3)))
    seen = predict_world_motion(gmr, poses, first_root_rotmat=WORLD_FROM_REST)
    # Only the root is wanted at the source's rate, so the joints need no interpolation.
    back = resample(replace(seen, local_rotmats=seen.local_rotmats[:, :0]), motion.fps_hz)
    world_from_root = transforms.rigid(back.root_rotmats, back.pelvis_m)[:n]
    if len(world_from_root) < n:
        world_from_root = np.concatenate(
            [world_from_root, _rest_of_the_way(gmr, poses, seen, n - len(world_from_root))]
        )
    return replace(
        motion,
        root_rotmats=world_from_root[:, :3, :3],
        pelvis_m=world_from_root[:, :3, 3],
        frame="world",
        source=seen.source if seen.n_frames == n else f"{seen.source}, and back",
    )


def _rest_of_the_way(gmr: "TrainedGmr", poses: Motion, seen: Motion, n_missing: int) -> np.ndarray:
    """(n_missing, 4, 4) world_from_root of the frames after the network's last moment."""
    from gmrdata.gmr.infer import predict_world_motion

    end_s = (poses.n_frames - 1) / poses.fps_hz
    n_steps = int(end_s * gmr.fps_hz + ON_A_SAMPLE)
    late = predict_world_motion(
        gmr, resample(poses, gmr.fps_hz, start_s=max(0.0, end_s - n_steps / gmr.fps_hz))
    )
    last_step = transforms.rigid(late.root_rotmats[-2:], late.pelvis_m[-2:])
    frames = np.arange(poses.n_frames - n_missing, poses.n_frames)
    times_s = np.array([(seen.n_frames - 1) / gmr.fps_hz, *(frames / poses.fps_hz)])
    late_from_root = _between(last_step[0], last_step[1], 1.0 - (end_s - times_s) * gmr.fps_hz)
    joint = transforms.rigid(seen.root_rotmats[-1], seen.pelvis_m[-1])
    world_from_late = joint @ transforms.invert(late_from_root[0])
    return np.asarray(world_from_late @ late_from_root[1:])


def _between(start: np.ndarray, end: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Transforms (N, 4, 4) at shares (N,) of the way from one (4, 4) to another."""
    turn = Rotation.from_matrix(start[:3, :3].T @ end[:3, :3]).as_rotvec()
    rotmats = start[:3, :3] @ Rotation.from_rotvec(shares[:, None] * turn).as_matrix()
    return transforms.rigid(rotmats, start[:3, 3] + shares[:, None] * (end - start)[:3, 3])
