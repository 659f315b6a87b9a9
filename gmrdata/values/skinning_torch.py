"""The forward pass of a BodyModel: linear blend skinning after Loper et al. 2015, eqs. 2-10.

The root is left at identity with the pelvis at the origin, so a vertex of the placed body is
`R v + T` with T the pelvis position; `place` does that.  SMPL's own placement, which turns the body
about the pelvis and then adds `trans`, is the same with T = trans + J0.
"""

from weakref import WeakKeyDictionary

import torch
from torch import Tensor

from gmrdata.values.body import N_JOINTS, N_LOCAL, PARENTS, BodyModel
from gmrdata.values.shapes import Float

Tensors = dict[str, Tensor]  # a body's arrays of one dtype on one device, by BodyModel's names
_TENSORS: WeakKeyDictionary[BodyModel, dict[tuple[torch.dtype, torch.device], Tensors]] = (
    WeakKeyDictionary()
)  # tensors of the bodies that are still alive, so that calling the forward pass again is cheap
_FLAT = ("template_m", "shape_dirs_m", "pose_dirs_m")
"""Those with the vertices' coordinates in one dimension: (V*3,), (V*3, S) and (V*3, 207)."""
_WHOLE = ("joints_template_m", "joint_shape_dirs_m", "skin_weights")


def posed_vertices(
    body: BodyModel, shape: Tensor, local_rotmats: Tensor
) -> Float[Tensor, "*batch vertices 3"]:
    """Vertices of a posed body with the root at identity and the pelvis at the origin [m].

    Batch dimensions of the shape (..., S) broadcast against those of the pose, (..., 23, 3, 3)
    parent_from_joint of joints 1..23, whose dtype and device are those of the result.
    """
    transforms = joint_transforms(body, shape, local_rotmats).flatten(-2)
    tensors = _tensors(body, local_rotmats)
    shape = shape.to(local_rotmats)
    blended = (tensors["skin_weights"] @ transforms).unflatten(-1, (3, 4))
    rest_m = _rest_vertices(tensors, shape, local_rotmats)
    rest_m = rest_m - _rest_joints(tensors, shape)[..., :1, :]
    return _rotate(blended[..., :3], rest_m) + blended[..., 3]


def joint_transforms(
    body: BodyModel, shape: Tensor, local_rotmats: Tensor
) -> Float[Tensor, "*batch 24 3 4"]:
    """root_from_rest: where joints take points bound to them [m], both seen from the pelvis."""
    body.require_shape(tuple(shape.shape[-1:]))
    if local_rotmats.shape[-3:] != (N_LOCAL, 3, 3):
        what = f"a pose is (..., {N_LOCAL}, 3, 3) rotations"
        raise ValueError(f"{what}, got {tuple(local_rotmats.shape)}")
    rest_joints_m = _rest_joints(_tensors(body, local_rotmats), shape.to(local_rotmats))
    joints_m, root_from_joint = forward_kinematics(rest_joints_m, local_rotmats)
    rest_from_pelvis_m = rest_joints_m - rest_joints_m[..., :1, :]
    # A joint's transform maps rest points to posed points, so its own rest place comes off first.
    offsets_m = joints_m - _rotate(root_from_joint, rest_from_pelvis_m)
    return torch.cat([root_from_joint, offsets_m[..., None]], dim=-1)


def place(
    root_rotmats: Float[Tensor, "*batch 3 3"],
    pelvis_m: Float[Tensor, "*batch 3"],
    points: Float[Tensor, "*batch n 3"],
) -> Float[Tensor, "*batch n 3"]:
    """Points of the root's frame in the frame of the root's pose: R p + T [m]."""
    return points @ root_rotmats.transpose(-1, -2) + pelvis_m[..., None, :]


def forward_kinematics(
    rest_joints_m: Float[Tensor, "*rest 24 3"], local_rotmats: Float[Tensor, "*poses 23 3 3"]
) -> tuple[Float[Tensor, "*batch 24 3"], Float[Tensor, "*batch 24 3 3"]]:
    """Joints [m] and root_from_joint, root at identity in the origin (Loper et al. 2015, eq. 4)."""
    batch = torch.broadcast_shapes(rest_joints_m.shape[:-2], local_rotmats.shape[:-3])
    rest_joints_m = rest_joints_m.expand(*batch, N_JOINTS, 3)
    local_rotmats = local_rotmats.expand(*batch, N_LOCAL, 3, 3)
    rotations = [torch.eye(3).to(local_rotmats).expand(*batch, 3, 3)]
    for parent, local in zip(PARENTS[1:], local_rotmats.unbind(-3), strict=True):
        rotations.append(rotations[parent] @ local)
    root_from_joint = torch.stack(rotations, dim=-3)
    bones_m = rest_joints_m[..., 1:, :] - rest_joints_m[..., PARENTS[1:], :]
    bones_m = _rotate(root_from_joint[..., PARENTS[1:], :, :], bones_m)
    places_m = [torch.zeros_like(rest_joints_m[..., 0, :])]
    for parent, bone_m in zip(PARENTS[1:], bones_m.unbind(-2), strict=True):
        places_m.append(places_m[parent] + bone_m)
    return torch.stack(places_m, dim=-2), root_from_joint


def _rest_joints(tensors: Tensors, shape: Tensor) -> Tensor:
    offsets_m = torch.einsum("jcs,...s->...jc", tensors["joint_shape_dirs_m"], shape)
    return tensors["joints_template_m"] + offsets_m


def _rest_vertices(tensors: Tensors, shape: Tensor, local_rotmats: Tensor) -> Tensor:
    """Template, shape blend shapes and pose blend shapes (Loper et al. 2015, eqs. 6, 8, 9)."""
    rest_m = tensors["template_m"] + shape @ tensors["shape_dirs_m"].T
    if "pose_dirs_m" in tensors:
        bends = local_rotmats - torch.eye(3).to(local_rotmats)
        rest_m = rest_m + bends.flatten(-3) @ tensors["pose_dirs_m"].T
    return rest_m.unflatten(-1, (-1, 3))


def _rotate(rotmats: Tensor, points: Tensor) -> Tensor:
    return (rotmats @ points[..., None])[..., 0]


def _tensors(body: BodyModel, like: Tensor) -> Tensors:
    made = _TENSORS.setdefault(body, {})
    key = (like.dtype, like.device)
    if key not in made:
        arrays = {name: getattr(body, name) for name in (*_FLAT, *_WHOLE)}
        made[key] = {
            name: torch.tensor(array, dtype=like.dtype, device=like.device)
            for name, array in arrays.items()
            if array is not None
        }
        made[key] |= {name: made[key][name].flatten(0, 1) for name in _FLAT if name in made[key]}
    return made[key]
