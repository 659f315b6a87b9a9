"""What a network sees of motion at the rate of the poses that it is given.

The network runs at its own rate, mostly 10 Hz, over poses of 30.  Begun one pose later it sees the
same motion in another phase; from pose to pose the mean of all phases is taken.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.gmr.predict import TrainedGmr, predict_world_motion
from gmrdata.motion.resample import resample
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.motion import Motion, without_root
from gmrdata.values.motion_deltas import deltas


def deltas_at_source_rate(gmr: TrainedGmr, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """dR (T-1, 3, 3) and dT (T-1, 3) [m] between all T poses, from the local ones alone.

    A last pose beyond the network's last moment goes on as the one before it did.  BadMotionFile
    where the poses are fewer than two at the network's rate.
    """
    n = motion.n_frames
    poses = without_root(motion)
    turns, steps_m, counts = np.zeros((n - 1, 3)), np.zeros((n - 1, 3)), np.zeros((n - 1, 1))
    for phase in range(max(1, int(motion.fps_hz / gmr.fps_hz + 1e-6))):
        if (n - 1 - phase) / motion.fps_hz < 1 / gmr.fps_hz - 1e-6:
            break
        seen = predict_world_motion(gmr, poses.take(slice(phase, None)))
        back = resample(replace(seen, local_rotmats=seen.local_rotmats[:, :0]), motion.fps_hz)
        found, found_m = deltas(back.root_rotmats, back.pelvis_m)
        rows = slice(phase, min(phase + len(found), n - 1))
        count = rows.stop - phase
        turns[rows] += Rotation.from_matrix(found[:count]).as_rotvec()
        steps_m[rows] += found_m[:count]
        counts[rows] += 1
    if not counts.any():
        raise BadMotionFile(
            f"{motion.source}: {n} frames at {motion.fps_hz:g} fps are less than two frames at"
            f" {gmr.fps_hz:g} fps. Give a longer motion"
        )
    nearest = np.maximum.accumulate(np.where(counts[:, 0] > 0, np.arange(n - 1), 0))
    turns, steps_m, counts = turns[nearest], steps_m[nearest], counts[nearest]
    return Rotation.from_rotvec(turns / counts).as_matrix(), steps_m / counts
