"""Writing a person as GVHMR writes one; `gmrdata.read.systems.gvhmr` says what the file holds.

`net_outputs`, what the network made on its way, are left out.
"""

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gmrdata.read.systems.entries import N_SMPLX_BODY, SMPLX_REST_PELVIS_M
from gmrdata.read.systems.gvhmr import CAMERA, WORLD
from gmrdata.values.camera import CameraPath
from gmrdata.values.files import write_bytes
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import invert
from gmrdata.write.systems.tracked import (
    N_BETAS,
    TrackedPerson,
    placed,
    require_finite,
    y_up_from_world,
)

if TYPE_CHECKING:
    import torch


def write_gvhmr(path: Path, person: TrackedPerson, camera: CameraPath | None) -> None:
    """Write `hmr4d_results.pt`: one person, with a row for every frame.

    SMPL-X has other shape coefficients than the person's body, so `betas` are zero, the mean shape;
    `transl` puts SMPL-X's pelvis where the person's is.  The two hand joints have no place in it.
    `valid` (T,), a key more than GVHMR has, says which frames may be used.  Without a camera there
    is no `smpl_params_incam` and no `K_fullimg`; in frames without a known one the first is NaN.

    Raises:
        BadMotionFile: a frame is not finite.
    """
    import torch

    motion = person.motion
    require_finite(motion, np.arange(motion.n_frames))
    y_up = y_up_from_world(motion.n_frames)
    valid = person.rows
    content: dict[str, object] = {WORLD: _smplx_params(motion, y_up)}
    if camera is not None:
        known = camera.has_camera
        cam_from_world = np.tile(np.eye(4), (motion.n_frames, 1, 1))
        cam_from_world[known] = invert(camera.world_from_cam[known])
        in_camera = _smplx_params(motion, cam_from_world)
        for key in ("global_orient", "transl"):
            in_camera[key][~torch.as_tensor(known)] = torch.nan
        intrinsics_px = torch.as_tensor(camera.intrinsics_px, dtype=torch.float32)
        content[CAMERA] = in_camera
        content["K_fullimg"] = intrinsics_px.repeat(motion.n_frames, 1, 1)
        valid = valid & known
    content["valid"] = torch.as_tensor(valid)
    stream = io.BytesIO()
    torch.save(content, stream)
    write_bytes(path, stream.getbuffer())


def _smplx_params(motion: Motion, frame_from_world: np.ndarray) -> dict[str, "torch.Tensor"]:
    import torch

    poses_rad, transl_m = placed(motion, frame_from_world, SMPLX_REST_PELVIS_M)
    params = {
        "body_pose": poses_rad[:, 3 : 3 + 3 * N_SMPLX_BODY],
        "betas": np.zeros((motion.n_frames, N_BETAS)),
        "global_orient": poses_rad[:, :3],
        "transl": transl_m,
    }
    return {key: torch.tensor(values, dtype=torch.float32) for key, values in params.items()}
