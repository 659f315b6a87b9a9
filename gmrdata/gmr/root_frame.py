"""Joints in the root's frame, on a mean skeleton: forward kinematics of what the network sees."""

import torch
from torch import Tensor

from gmrdata.body.tree import N_JOINTS, PARENTS

REST_JOINTS_M = (
    (0.000, 0.000, 0.000), (0.112, -0.045, -0.008),
    (-0.112, -0.045, -0.008), (0.000, 0.105, 0.006),
    (0.112, -0.423, -0.008), (-0.112, -0.423, -0.008),
    (0.000, 0.208, -0.003), (0.112, -0.856, -0.008),
    (-0.112, -0.856, -0.008), (0.000, 0.328, -0.036),
    (0.112, -0.905, 0.139), (-0.112, -0.905, 0.139),
    (0.000, 0.511, 0.001), (0.062, 0.478, 0.008),
    (-0.062, 0.478, 0.008), (0.000, 0.561, 0.013),
    (0.175, 0.414, 0.012), (-0.175, 0.414, 0.012),
    (0.433, 0.414, 0.012), (-0.433, 0.414, 0.012),
    (0.663, 0.414, 0.012), (-0.663, 0.414, 0.012),
    (0.768, 0.414, 0.012), (-0.768, 0.414, 0.012),
)  # fmt: skip
"""(24, 3) joints of an average adult in SMPL's T-pose, pelvis at the origin [m]: those of the
default body, rounded to millimetres.  A person's own shape is no input of the network."""


def joints_in_root_frame(local_rotmats: Tensor) -> tuple[Tensor, Tensor]:
    """Where joints 1 to 23 are, and how they are turned, seen from the root.

    Args:
        local_rotmats: (..., 23, 3, 3) parent_from_joint.

    Returns:
        Places (..., 23, 3) [m] and root_from_joint (..., 23, 3, 3), on the mean skeleton.
    """
    rest_m = torch.tensor(REST_JOINTS_M, dtype=local_rotmats.dtype, device=local_rotmats.device)
    rotmats = [torch.eye(3).to(local_rotmats).expand(*local_rotmats.shape[:-3], 3, 3)]
    places_m = [torch.zeros_like(rotmats[0][..., 0])]
    for joint in range(1, N_JOINTS):
        parent = PARENTS[joint]
        places_m.append(places_m[parent] + rotmats[parent] @ (rest_m[joint] - rest_m[parent]))
        rotmats.append(rotmats[parent] @ local_rotmats[..., joint - 1, :, :])
    return torch.stack(places_m[1:], dim=-2), torch.stack(rotmats[1:], dim=-3)
