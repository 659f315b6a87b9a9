"""The lifter: from a second of landmarks to the pose in its middle.

A small network, ours, trained on motions that virtual cameras film (`training`).  A window of 27
frames at 24 Hz goes through one layer for each frame and three convolutions of three frames, as in
Pavllo et al., "3D human pose estimation in video" (2019); out come the 24 rotations (6D, Zhou et
al. 2019) and the length of the legs.  The window is read from a track at any frame rate.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import torch
from pydantic import Field
from torch import Tensor, nn

from gmrdata.people.landmark_body import LEG_M
from gmrdata.people.views import N_FEATURES, window_features
from gmrdata.values.body import N_JOINTS
from gmrdata.values.errors import BadCheckpoint
from gmrdata.values.records import Config

WEIGHTS_FILE = Path(__file__).with_name("lifter.safetensors")
RATE_HZ = 24.0
WINDOW = 27
LONGEST_GAP_S = 0.5
"""Nothing is known within longer gaps of a track [s]."""
BATCH = 256  # windows at a time


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
