"""A world motion in AMASS's layout of SMPL+H, for code that reads AMASS."""

from pathlib import Path

import numpy as np

from gmrdata.values.body import HANDS, SMPL, SMPL_LEG_M, SMPL_REST_PELVIS_M, BodyModel, leg_length_m
from gmrdata.values.files import write_npz
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import rotvecs_from_rotmats

SMPLH_VALUES = 156
N_BETAS, N_DMPLS = 16, 8


def write_amass(path: Path, motion: Motion, body: BodyModel) -> None:
    """Write `poses` (T, 156), `trans`, `betas`, `gender`, `dmpls` and `mocap_framerate`.

    SMPL's two hand joints become the first index joints, as `gmrdata.motion.amass` reads them; all
    other fingers are straight.  The world is z-up.

    A motion of one of SMPL's bodies has that body's betas and gender, and `trans` is the pelvis
    less J0.  The shape of any other body means nothing there: such a motion is written for SMPL's
    neutral mean shape, with zero betas and a path that its legs walk.
    """
    rotvecs = rotvecs_from_rotmats(motion.rotmats)
    poses = np.zeros((motion.n_frames, SMPLH_VALUES // 3, 3))
    poses[:, :22] = rotvecs[:, :22]
    poses[:, list(HANDS[SMPLH_VALUES])] = rotvecs[:, 22:]
    is_smpl = body.name.startswith(SMPL)
    shape = motion.shape if is_smpl else np.zeros(N_BETAS)
    rest_pelvis_m = body.rest_pelvis_m(shape) if is_smpl else np.array(SMPL_REST_PELVIS_M)
    write_npz(
        path,
        {
            "poses": poses.reshape(motion.n_frames, SMPLH_VALUES),
            "trans": motion.pelvis_m * smpl_legs(motion, body) - rest_pelvis_m,
            "betas": np.pad(shape, (0, max(0, N_BETAS - len(shape)))),
            "dmpls": np.zeros((motion.n_frames, N_DMPLS)),
            "gender": motion.gender if is_smpl else "neutral",
            "mocap_framerate": motion.fps_hz,
        },
    )


def smpl_legs(motion: Motion, body: BodyModel) -> float:
    """Legs of SMPL's neutral mean shape over the person's, by which a path is scaled; 1 on SMPL."""
    if body.name.startswith(SMPL):
        return 1.0
    return SMPL_LEG_M / leg_length_m(body.rest_joints_m(motion.shape))
