"""People written as other systems write theirs: GVHMR and WHAM.

`gmrdata.read.systems.gvhmr` and `gmrdata.read.systems.wham` say what the files hold.  GVHMR's
`net_outputs`, what its network made on its way, and WHAM's `verts`, which follow from the rest, are
left out.
"""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gmrdata.read.systems.entries import N_SMPLX_BODY, SMPLX_REST_PELVIS_M
from gmrdata.read.systems.gvhmr import GVHMR
from gmrdata.values.body import NEUTRAL, SMPL, SMPL_REST_PELVIS_M, SMPL_SHAPES, WORLD_FROM_REST
from gmrdata.values.camera import CameraPath
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import invert, rigid, rotvecs_from_rotmats
from gmrdata.write.pickles import python3_pickle
from gmrdata.write.take import finite_rows


@dataclass(frozen=True, eq=False)
class TrackedPerson:
    """One person of a sequence over T frames."""

    motion: Motion  # in the z-up world
    rest_pelvis_m: np.ndarray  # (3,) J0 of the person's shape, rest frame [m]
    rows: np.ndarray  # (T,) bool: frames that may be used
    frame_numbers: np.ndarray  # (T,) int: which frame of the video each row is, from 0
    camera: CameraPath | None = None  # over the same frames


Y_UP_FROM_WORLD = rigid(WORLD_FROM_REST.T, np.zeros(3))
"""(4, 4) to the world of WHAM and GVHMR."""


def placed(
    motion: Motion, frame_from_world: np.ndarray, rest_pelvis_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Axis-angle (T, 72) and transl (T, 3) in another frame (4, 4), or each row's own (T, 4, 4)."""
    turns = frame_from_world[..., :3, :3]
    rotmats = np.concatenate([(turns @ motion.root_rotmats)[:, None], motion.local_rotmats], axis=1)
    pelvis_m = (turns @ motion.pelvis_m[..., None])[..., 0] + frame_from_world[..., :3, 3]
    return rotvecs_from_rotmats(rotmats).reshape(-1, 72), pelvis_m - rest_pelvis_m


def require_finite(motion: Motion, rows: np.ndarray) -> None:
    if bad := rows[~finite_rows(motion)].tolist():
        raise BadMotionFile(f"frame {bad[0]} has no motion ({len(bad)} frames in all)")


if TYPE_CHECKING:
    import torch


def gvhmr_bytes(person: TrackedPerson) -> bytes:
    """`hmr4d_results.pt`: one person, with a row for every frame.

    SMPL-X has other shape coefficients than the person's body, so `betas` are zero, the mean shape;
    `transl` puts SMPL-X's pelvis where the person's is.  The two hand joints have no place in it.
    `valid` (T,), a key more than GVHMR has, says which frames may be used.  Without a camera there
    is no `smpl_params_incam` and no `K_fullimg`; in frames without a known one the first is NaN.

    Raises:
        BadMotionFile: a frame is not finite.
    """
    import torch

    motion, camera = person.motion, person.camera
    require_finite(motion, np.arange(motion.n_frames))
    valid = person.rows
    content: dict[str, object] = {GVHMR.world: _smplx_params(motion, Y_UP_FROM_WORLD)}
    if camera is not None:
        known = camera.has_camera
        cam_from_world = np.tile(np.eye(4), (motion.n_frames, 1, 1))
        cam_from_world[known] = invert(camera.world_from_cam[known])
        in_camera = _smplx_params(motion, cam_from_world)
        for key in ("global_orient", "transl"):
            in_camera[key][~torch.as_tensor(known)] = torch.nan
        intrinsics_px = torch.as_tensor(camera.intrinsics_px, dtype=torch.float32)
        content[GVHMR.camera] = in_camera
        content["K_fullimg"] = intrinsics_px.repeat(motion.n_frames, 1, 1)
        valid = valid & known
    content["valid"] = torch.as_tensor(valid)
    stream = io.BytesIO()
    torch.save(content, stream)
    return stream.getvalue()


def _smplx_params(motion: Motion, frame_from_world: np.ndarray) -> dict[str, "torch.Tensor"]:
    import torch

    poses_rad, transl_m = placed(motion, frame_from_world, SMPLX_REST_PELVIS_M)
    params = {
        "body_pose": poses_rad[:, 3 : 3 + 3 * N_SMPLX_BODY],
        "betas": np.zeros((motion.n_frames, SMPL_SHAPES)),
        "global_orient": poses_rad[:, :3],
        "transl": transl_m,
    }
    return {key: torch.tensor(values, dtype=torch.float32) for key, values in params.items()}


def wham_bytes(people: Sequence[TrackedPerson | None]) -> bytes:
    """`wham_output.pkl`: each person's frames that may be used, numbered from person 0.

    A person who is None is left out; the others keep their numbers.

    Whoever has another body than SMPL's gets its mean shape, and `trans` puts its pelvis where the
    person's is.  The body's name is in `body`, a key more than WHAM has.  Without a camera
    there is no `pose` and no `trans`.

    Raises:
        BadMotionFile: a person has no frame that may be used, or one that is not finite.
    """
    return python3_pickle({n: _wham_person(one) for n, one in enumerate(people) if one is not None})


def _wham_person(person: TrackedPerson) -> dict[str, object]:
    camera = person.camera
    rows = person.rows if camera is None else person.rows & camera.has_camera
    if not rows.any():
        raise BadMotionFile("a person has no frame that may be used; give a clip with one")
    motion = person.motion.take(rows)
    require_finite(motion, np.flatnonzero(rows))
    is_smpl = motion.body.startswith(SMPL)
    rest_pelvis_m = person.rest_pelvis_m if is_smpl else np.array(SMPL_REST_PELVIS_M)
    shape = np.trim_zeros(motion.shape, "b") if is_smpl else np.zeros(SMPL_SHAPES)
    shape = np.pad(shape, (0, max(0, SMPL_SHAPES - len(shape))))  # more only if they say something
    arrays = dict[str, np.ndarray]()
    if camera is not None:
        in_camera = placed(motion, invert(camera.world_from_cam[rows]), rest_pelvis_m)
        arrays |= zip(("pose", "trans"), in_camera, strict=True)
    in_world = placed(motion, Y_UP_FROM_WORLD, rest_pelvis_m)
    arrays |= zip(("pose_world", "trans_world"), in_world, strict=True)
    arrays["betas"] = np.tile(shape, (motion.n_frames, 1))
    content: dict[str, object] = {key: of.astype(np.float32) for key, of in arrays.items()}
    content["frame_ids"] = person.frame_numbers[rows].astype(np.int64)
    content["body"] = motion.body if is_smpl else NEUTRAL
    return content
