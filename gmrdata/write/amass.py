"""A world motion in AMASS's layout of SMPL+H, for code that reads AMASS."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.values.body import HANDS, BodyModel
from gmrdata.values.files import write_npz
from gmrdata.values.motion import Motion

SMPLH_VALUES = 156
N_BETAS, N_DMPLS = 16, 8


def write_amass(path: Path, motion: Motion, body: BodyModel) -> None:
    """Write `poses` (T, 156), `trans`, `betas`, `gender`, `dmpls` and `mocap_framerate`.

    SMPL's two hand joints become the first index joints, as `gmrdata.motion.amass` reads them; all
    other fingers are straight.  `trans` is the pelvis less J0 of the body.  `betas` are the
    motion's on SMPL's bodies; on any other they would mean something else, and are zero.  The world
    is z-up.
    """
    rotvecs = Rotation.from_matrix(motion.rotmats.reshape(-1, 3, 3)).as_rotvec()
    rotvecs = rotvecs.reshape(motion.n_frames, -1, 3)
    poses = np.zeros((motion.n_frames, SMPLH_VALUES // 3, 3))
    poses[:, :22] = rotvecs[:, :22]
    poses[:, list(HANDS[SMPLH_VALUES])] = rotvecs[:, 22:]
    betas = np.zeros(N_BETAS)
    if body.name.startswith("smpl-"):
        n_common = min(N_BETAS, len(motion.shape))
        betas[:n_common] = motion.shape[:n_common]
    write_npz(
        path,
        {
            "poses": poses.reshape(motion.n_frames, SMPLH_VALUES),
            "trans": motion.pelvis_m - body.rest_pelvis_m(motion.shape),
            "betas": betas,
            "dmpls": np.zeros((motion.n_frames, N_DMPLS)),
            "gender": motion.gender,
            "mocap_framerate": motion.fps_hz,
        },
    )
