"""The lifter: from a second of landmarks to the pose in its middle.

A small network, ours, trained on motions that virtual cameras film (benchmarks/training).  A window
of 27 frames at 24 Hz goes through one layer for each frame and three convolutions of three frames,
as in Pavllo et al., "3D human pose estimation in video" (2019); out come the 24 rotations (6D, Zhou
et al. 2019) and the length of the legs.  The window is read from a track at any frame rate.

The landmark network sees a crop and nothing else, so its metres are along the crop's ray.  The
lifter sees landmarks in a camera of its own, which looks along the ray through the middle of the
hips ("Perspective Crop Layers", Yu et al., 2021), and whose unit of length is the person's size in
the picture; so neither place nor distance nor lens change what it sees, and the pose it answers
with is turned back to the camera.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from pydantic import Field
from torch import Tensor, nn

from gmrdata.people.landmark_network import HIPS, LANDMARKS, LEG_M
from gmrdata.values.body import N_JOINTS
from gmrdata.values.errors import BadCheckpoint
from gmrdata.values.records import Config
from gmrdata.values.shapes import Float

WEIGHTS_FILE = Path(__file__).with_name("lifter.safetensors")
RATE_HZ = 24.0
WINDOW = 27
LONGEST_GAP_S = 0.5
"""Nothing is known within longer gaps of a track [s]."""
BATCH = 256  # windows at a time
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
LEAST_DEPTH = 0.1  # of a ray's end, along the axis of the lifter's camera: 84 degrees off it
LEAST_SIZE = 1e-3  # a person of 2 px or so
METRES = 2.0  # brings half a metre to about 1
MEAN_LOG_SIZE = 1.8  # a person of 0.5 m spread at 3 m


class LifterConfig(Config):
    """Size of the network."""

    hidden: int = Field(default=256, ge=8, le=2048)
    blocks: int = Field(default=2, ge=0, le=8)
    """Layers after the convolutions."""
    dropout: float = Field(default=0.1, ge=0, lt=1)


class Lifter(nn.Module):
    """Windows (n, 27, features) to rotations (n, 24, 3, 3), root first, and legs (n,) [m]."""

    def __init__(self, config: LifterConfig) -> None:
        super().__init__()
        hidden = config.hidden
        self.frame = nn.Linear(N_FEATURES, hidden)
        self.reaches = nn.ModuleList(nn.Linear(3 * hidden, hidden) for _ in range(3))
        self.mixes = nn.ModuleList(nn.Linear(hidden, hidden) for _ in range(3))
        self.norms = nn.ModuleList(nn.LayerNorm(hidden) for _ in range(3))
        self.blocks = nn.ModuleList(
            nn.Sequential(
                nn.LayerNorm(hidden),
                nn.Linear(hidden, hidden),
                nn.GELU(),
                nn.Dropout(config.dropout),
                nn.Linear(hidden, hidden),
            )
            for _ in range(config.blocks)
        )
        self.dropout = nn.Dropout(config.dropout)
        self.last = nn.Linear(hidden, 6 * N_JOINTS + 1)
        nn.init.normal_(self.last.weight, std=0.01)
        with torch.no_grad():
            self.last.bias.copy_(torch.tensor([1.0, 0, 0, 0, 1, 0] * N_JOINTS + [0.0]))

    def forward(self, windows: Tensor) -> tuple[Tensor, Tensor]:
        import roma

        x = nn.functional.gelu(self.frame(windows))
        for reach, mix, norm in zip(self.reaches, self.mixes, self.norms, strict=True):
            middle = x[:, 1::3]
            x = nn.functional.gelu(reach(norm(x).unflatten(1, (-1, 3)).flatten(-2)))
            x = middle + mix(self.dropout(x))
        x = x[:, 0]
        for block in self.blocks:
            x = x + block(x)
        out = self.last(x)
        columns = out[:, :-1].unflatten(-1, (N_JOINTS, 2, 3)).transpose(-1, -2)
        return roma.special_gramschmidt(columns, epsilon=1e-6), LEG_M * torch.exp(out[:, -1])


@cache
def shipped_lifter() -> Lifter:
    """The network that travels with the package, ready to be used."""
    return load_lifter(WEIGHTS_FILE)


def load_lifter(path: Path) -> Lifter:
    """A network of `save_lifter`; BadCheckpoint where the file is no such network."""
    from safetensors import SafetensorError, safe_open

    remedy = "Give a lifter that gmrdata made, or install gmrdata anew"
    try:
        with safe_open(path, framework="pt") as file:
            config = LifterConfig.model_validate_json((file.metadata() or {})["config"])
            weights = {key: file.get_tensor(key).float() for key in file.keys()}  # noqa: SIM118
        lifter = Lifter(config)
        lifter.load_state_dict(weights)
    except (SafetensorError, OSError, KeyError, ValueError, RuntimeError) as error:
        raise BadCheckpoint(f"{path}: not a lifter ({error}). {remedy}") from None
    return lifter.eval()


def save_lifter(path: Path, lifter: Lifter, config: LifterConfig) -> None:
    """Write the weights in half precision, which costs no accuracy that can be measured."""
    from safetensors.torch import save

    from gmrdata.values.files import write_bytes

    halves = {key: value.half().contiguous() for key, value in lifter.state_dict().items()}
    write_bytes(path, save(halves, metadata={"config": config.model_dump_json()}))


@dataclass(frozen=True, eq=False)
class SeenLandmarks:
    """One person's landmarks over T frames, without the lens's distortion."""

    times_s: np.ndarray  # (T,) rising
    rays: np.ndarray  # (T, 33, 2) x / z and y / z in the camera's axes
    world_m: np.ndarray  # (T, 33, 3) along each frame's ray
    visibility: np.ndarray  # (T, 33)


@dataclass(frozen=True, eq=False)
class LiftedPose:
    """The pose at each frame."""

    rotmats: np.ndarray  # (T, 24, 3, 3), the root's in the camera's axes
    leg_m: np.ndarray  # (T,) hip to ankle


def lift(seen: SeenLandmarks, lifter: Lifter | None = None) -> LiftedPose:
    """Poses at a track's own times."""
    network = shipped_lifter() if lifter is None else lifter
    rotmats, legs_m = [], []
    for start in range(0, len(seen.times_s), BATCH):
        windows = _windows(seen, np.arange(start, min(start + BATCH, len(seen.times_s))))
        with torch.inference_mode():
            features, cam_from_ray = window_features(*windows)
            found, leg_m = network(features)
            found[:, 0] = cam_from_ray @ found[:, 0]
        rotmats.append(found.double().numpy())
        legs_m.append(leg_m.double().numpy())
    return LiftedPose(np.concatenate(rotmats), np.concatenate(legs_m))


def _windows(seen: SeenLandmarks, rows: np.ndarray) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The track round each of its rows, read between its frames; what is not known is held."""
    times_s = seen.times_s
    at_s = times_s[rows, None] + (np.arange(WINDOW) - WINDOW // 2) / RATE_HZ
    after = np.searchsorted(times_s, at_s).clip(1, len(times_s) - 1) if len(times_s) > 1 else 0
    after = np.broadcast_to(after, at_s.shape)
    before = np.maximum(after - 1, 0)
    gap_s = np.maximum(times_s[after] - times_s[before], 1e-9)
    share = ((at_s - times_s[before]) / gap_s).clip(0, 1)
    off_s = np.minimum(np.abs(at_s - times_s[before]), np.abs(at_s - times_s[after]))
    inside = (at_s >= times_s[0] - 1e-6) & (at_s <= times_s[-1] + 1e-6)
    is_gap = gap_s > LONGEST_GAP_S
    share = np.where(is_gap, np.rint(share), share)
    known = inside & (~is_gap | (off_s <= 0.5 / RATE_HZ))

    def between(values: np.ndarray) -> Tensor:
        shares = share.reshape(*share.shape, *[1] * (values.ndim - 1))
        mixed = (1 - shares) * values[before] + shares * values[after]
        return torch.as_tensor(mixed, dtype=torch.float32)

    arrays = (seen.rays, seen.world_m, seen.visibility)
    return (*map(between, arrays), torch.as_tensor(known, dtype=torch.float32))  # type: ignore[return-value]


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


def landmark_weights(visibility: Tensor) -> Tensor:
    """How much a landmark counts where a body is laid onto it: little where it is hidden."""
    return visibility.clamp(0.05, 1.0)
