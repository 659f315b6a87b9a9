"""Joints of posed bodies in torch."""

import torch
from torch import Tensor

from gmrdata.values.body import BodyModel
from gmrdata.values.skinning_torch import joint_transforms


def posed_joints(body: BodyModel, shape: Tensor, local_rotmats: Tensor) -> tuple[Tensor, Tensor]:
    """Joints [m] from the pelvis, and root_from_joint, by where the body's transforms take them."""
    root_from_rest = joint_transforms(body, shape, local_rotmats)
    dirs_m = torch.as_tensor(body.joint_shape_dirs_m).to(local_rotmats)
    offsets_m = torch.einsum("jcs,...s->...jc", dirs_m, shape.to(local_rotmats))
    rest_m = torch.as_tensor(body.joints_template_m).to(local_rotmats) + offsets_m
    rest_m = rest_m - rest_m[..., :1, :]
    rotmats = root_from_rest[..., :3]
    return (rotmats @ rest_m[..., None])[..., 0] + root_from_rest[..., 3], rotmats
