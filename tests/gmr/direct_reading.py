"""Eq. 13 and the network's size as they are written."""

import torch
from torch import Tensor

from gmrdata.gmr import rotations
from gmrdata.gmr.config import ModelConfig
from gmrdata.gmr.model import input_size
from gmrdata.values.body import N_JOINTS, N_LOCAL, PARENTS, BodyModel


def direct_mesh_m(
    body: BodyModel, shape: Tensor, root_rotmats: Tensor, pelvis_m: Tensor, local_rotmats: Tensor
) -> Tensor:
    """M([dA, L], beta, dT) by linear blend skinning (Loper et al. 2015, eqs. 2-10).

    Args:
        body: The body.
        shape: (B, 1, S).
        root_rotmats: (B, n, 3, 3).
        pelvis_m: (B, n, 3) [m].
        local_rotmats: (B, n, 23, 3, 3).

    Returns:
        (B, n, V, 3) [m].
    """
    arrays = {
        name: torch.as_tensor(getattr(body, name)).to(local_rotmats)
        for name in ("template_m", "shape_dirs_m", "joints_template_m", "joint_shape_dirs_m")
    }
    rest_m = arrays["template_m"] + torch.einsum("vcs,bns->bnvc", arrays["shape_dirs_m"], shape)
    joints_m = arrays["joints_template_m"] + torch.einsum(
        "jcs,bns->bnjc", arrays["joint_shape_dirs_m"], shape
    )
    if body.pose_dirs_m is not None:
        bends = (local_rotmats - torch.eye(3).to(local_rotmats)).flatten(-3)
        rest_m = rest_m + torch.einsum(
            "vcp,bnp->bnvc", torch.as_tensor(body.pose_dirs_m).to(bends), bends
        )
    rotations, places_m = [root_rotmats], [pelvis_m]
    for joint in range(1, N_JOINTS):
        parent = PARENTS[joint]
        bone_m = joints_m[:, :, joint] - joints_m[:, :, parent]
        places_m.append(places_m[parent] + (rotations[parent] @ bone_m[..., None])[..., 0])
        rotations.append(rotations[parent] @ local_rotmats[:, :, joint - 1])
    turns = torch.stack(rotations, dim=2)
    moves_m = torch.stack(places_m, dim=2) - (turns @ joints_m[..., None])[..., 0]
    transforms = torch.cat([turns, moves_m[..., None]], dim=-1).flatten(-2)
    weights = torch.as_tensor(body.skin_weights).to(local_rotmats)
    blended = (weights @ transforms).unflatten(-1, (3, 4))
    return (blended[..., :3] @ rest_m[..., None])[..., 0] + blended[..., 3]


def parameter_count(config: ModelConfig) -> int:
    """Number of trained numbers, by formula.

    A GRU direction of h units on n inputs has 3h(n + h) weights and 6h biases.
    """
    h = config.hidden
    sizes = [input_size(config)] + [2 * h] * (config.layers - 1)
    encoder = sum(2 * (3 * h * (n + h) + 6 * h) for n in sizes)
    outputs = rotations.SIZE[config.output] + 3
    n_shares = N_LOCAL + config.joints_say + 1  # with one for none
    outputs += n_shares * (config.rotation, config.translation).count("standing_joint")
    f = config.latent or h
    # 32 numbers of the features, 15 or 23 of a support, one for each of 24; two scores.
    looks = sum(32 * (f + 1 + n + 1 + 24) + 33 * 2 for n in (15, 23)) if config.joints_say else 0
    return encoder + (2 * h * f + f) + (f * outputs + outputs) + looks
