"""Landmarks as the lifter sees them: in a camera of its own that looks at the person.

The landmark network sees a crop and nothing else, so its metres are along the crop's ray.  The
lifter's camera looks along the ray through the middle of the hips ("Perspective Crop Layers", Yu et
al., 2021), and its unit of length is the person's size in the picture; so neither place nor
distance nor lens change what it sees, and the pose it answers with is turned back to the camera.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from gmrdata.people.landmark_body import HIPS
from gmrdata.people.landmark_network import LANDMARKS
from gmrdata.values.shapes import Float

SIZED_BY = tuple(
    LANDMARKS.index(f"{side}_{part}")
    for side in ("left", "right")
    for part in ("shoulder", "hip", "knee", "ankle")
)
"""Landmarks by whose spread a person's size in the picture is taken."""
LEFT_OUT = ("eye_inner", "eye_outer", "mouth")
"""Parts of the face that say nothing new of the head's pose."""
SEEN = tuple(n for n, name in enumerate(LANDMARKS) if not any(part in name for part in LEFT_OUT))
"""Landmarks that the lifter is given."""
N_FEATURES = len(SEEN) * 6 + 5
"""Numbers for each frame of a window."""


class Views(NamedTuple):
    """What the lifter's own camera sees."""

    points: Float[Tensor, "*batch 33 2"]  # landmarks from the hips, in the person's size
    sizes: Float[Tensor, "*batch"]  # of the person, at a distance of 1
    cam_from_ray: Float[Tensor, "*batch 3 3"]


def turns_to(rays: Float[Tensor, "*batch 2"]) -> Float[Tensor, "*batch 3 3"]:
    """The smallest turns that take the z axis to rays x / z and y / z."""
    x, y = rays.unbind(-1)
    length = torch.sqrt(x**2 + y**2 + 1.0)
    x, y, z = x / length, y / length, 1.0 / length
    rows = [1 - x * x / (1 + z), -x * y / (1 + z), x, -x * y / (1 + z), 1 - y * y / (1 + z), y]
    return torch.stack([*rows, -x, -y, z], dim=-1).unflatten(-1, (3, 3))


def views_of(rays: Float[Tensor, "*batch 33 2"]) -> Views:
    """Landmarks as rays x / z and y / z of the camera, in the lifter's own camera."""
    cam_from_ray = turns_to(rays[..., HIPS, :].mean(-2))
    seen = torch.cat([rays, torch.ones_like(rays[..., :1])], -1) @ cam_from_ray
    flat = seen[..., :2] / seen[..., 2:].clamp(min=LEAST_DEPTH)
    sizes = flat[..., SIZED_BY, :].pow(2).sum(-1).mean(-1).sqrt().clamp(min=LEAST_SIZE)
    return Views(flat / sizes[..., None, None], sizes, cam_from_ray)


LEAST_DEPTH = 0.1  # of a ray's end, along the axis of the lifter's camera: 84 degrees off it
LEAST_SIZE = 1e-3  # a person of 2 px or so


def window_features(
    rays: Float[Tensor, "n frames 33 2"],
    world_m: Float[Tensor, "n frames 33 3"],
    visibility: Float[Tensor, "n frames 33"],
    known: Float[Tensor, "n frames"],
) -> tuple[Float[Tensor, "n frames features"], Float[Tensor, "n 3 3"]]:
    """The lifter's input of windows, and cam_from_ray of the window's middle frame.

    Metres of each frame are along its own ray.  Frames that are not known (0) are 0 throughout.
    """
    views = views_of(rays)
    middle = rays.shape[1] // 2
    hips = rays[..., HIPS, :].mean(-2)
    moved = (hips - hips[:, middle, None]) / views.sizes[:, middle, None, None]
    grown = torch.log(views.sizes / views.sizes[:, middle, None])[..., None]
    size = torch.log(views.sizes[:, middle, None, None]).expand_as(grown) + MEAN_LOG_SIZE
    per_landmark = torch.cat([views.points, world_m * METRES, visibility[..., None]], dim=-1)
    numbers = [per_landmark[..., SEEN, :].flatten(-2), moved, grown, size, known[..., None]]
    return torch.cat(numbers, dim=-1) * known[..., None], views.cam_from_ray[:, middle]


METRES = 2.0  # brings half a metre to about 1
MEAN_LOG_SIZE = 1.8  # a person of 0.5 m spread at 3 m


def landmark_weights(visibility: Tensor) -> Tensor:
    """How much a landmark counts where a body is laid onto it: little where it is hidden."""
    return visibility.clamp(0.05, 1.0)
