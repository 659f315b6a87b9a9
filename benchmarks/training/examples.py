"""What the lifter learns from: windows of motions before virtual cameras, wrongly seen.

Nothing is rendered.  A window has a motion at 0.7 to 1.4 times its speed, a person of some size, a
camera that stands, follows or passes by, and a run of measured errors (`noise`).  Some windows have
frames, or a limb, that nobody saw, and some have left and right exchanged.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from pydantic import Field
from torch import Tensor
from training.noise import LandmarkNoise, NoiseSampler

from gmrdata.motion.resample import resample
from gmrdata.people.landmark_network import (
    LANDMARKS,
    MIRRORED_LANDMARKS,
    landmark_offsets_m,
    landmarks_on,
    tree_joints,
)
from gmrdata.people.lifter import RATE_HZ, WINDOW, window_features
from gmrdata.values.body import MIRRORED, BodyModel, leg_length_m
from gmrdata.values.motion import Motion
from gmrdata.values.records import Config


class SpoilConfig(Config):
    """What goes wrong beside the measured errors."""

    swap_share: float = Field(default=0.03, ge=0, le=1)
    """Windows in which some frames have left and right exchanged."""
    gap_share: float = Field(default=0.15, ge=0, le=1)
    """Windows in which some frames have nobody."""
    limb_share: float = Field(default=0.1, ge=0, le=1)
    """Windows in which a limb is hidden."""


@dataclass(frozen=True, eq=False)
class MotionBank:
    """Motions at the lifter's rate, one after the other: N frames."""

    rotmats: Tensor  # (N, 24, 3, 3) float32, the root's in a z-up world
    pelvis_m: Tensor  # (N, 3) float32
    first_rows: np.ndarray  # (M,) of each motion
    n_rows: np.ndarray  # (M,)


def bank_of(motions: Iterable[Motion]) -> MotionBank:
    """Motions that are long enough for a window."""
    sampled = (resample(one, RATE_HZ) for one in motions)
    kept = [one for one in sampled if one.n_frames >= LEAST_ROWS]
    counts = np.array([one.n_frames for one in kept])
    return MotionBank(
        torch.as_tensor(np.concatenate([one.rotmats for one in kept]), dtype=torch.float32),
        torch.as_tensor(np.concatenate([one.pelvis_m for one in kept]), dtype=torch.float32),
        np.concatenate([[0], np.cumsum(counts)[:-1]]),
        counts,
    )


SPEEDS = (0.7, 1.4)
LEAST_ROWS = int(WINDOW * SPEEDS[0]) + 1


class Example(NamedTuple):
    """Windows, and the truth in their middle."""

    features: Tensor  # (n, 27, features)
    rotmats: Tensor  # (n, 24, 3, 3), the root's as the ray has it
    rest_joints_m: Tensor  # (n, 24, 3)
    leg_m: Tensor  # (n,)


class ExampleSampler:
    """Windows of people before virtual cameras."""

    def __init__(
        self, bank: MotionBank, body: BodyModel, noise: LandmarkNoise, config: SpoilConfig
    ) -> None:
        shapes = np.zeros((1, body.n_shape)) if body.adult_shapes is None else body.adult_shapes
        rest_m = np.stack([body.rest_joints_m(shape) for shape in shapes])
        self._rest_joints_m = torch.as_tensor(rest_m, dtype=torch.float32)
        self._legs_m = torch.tensor([leg_length_m(one) for one in rest_m])
        self._offsets_m = torch.as_tensor(landmark_offsets_m(), dtype=torch.float32)
        self._noise = NoiseSampler(noise, WINDOW, RATE_HZ)
        self._bank, self._config = bank, config

    def sample(self, n: int, rng: np.random.Generator) -> Example:
        rotmats, pelvis_m = self._motions(n, rng)
        people = torch.as_tensor(rng.integers(len(self._legs_m), size=n))
        growth = torch.as_tensor(rng.normal(1.0, 0.03, n), dtype=torch.float32)
        rest_joints_m = self._rest_joints_m[people] * growth[:, None, None]
        leg_m = self._legs_m[people].float() * growth
        # The motions' places are of the mean person's legs.
        grown = (leg_m / self._legs_m.float().mean())[:, None, None]
        ground_m = pelvis_m * grown
        cam_from_world = _cameras(ground_m, rng)
        rotmats[:, :, 0] = cam_from_world[0] @ rotmats[:, :, 0]
        pelvis_m = (cam_from_world[0] @ ground_m[..., None])[..., 0] + cam_from_world[1]
        joints_m, turned = tree_joints(rest_joints_m[:, None], rotmats)
        legs_m = leg_m[:, None].expand(n, WINDOW)
        true_m = landmarks_on(joints_m, turned, legs_m, self._offsets_m) + pelvis_m[:, :, None]
        seen = self._noise.add(true_m, rotmats[:, :, 0, :, 2], rng)
        arrays, known = _spoilt(list(seen), self._config, rng)
        features, cam_from_ray = window_features(arrays[0], arrays[1], arrays[2], known)
        middle = rotmats[:, WINDOW // 2].clone()
        middle[:, 0] = cam_from_ray.transpose(-1, -2) @ middle[:, 0]
        return Example(features, middle, rest_joints_m, leg_m)

    def _motions(self, n: int, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        """Windows of rotations (n, 27, 24, 3, 3) and places (n, 27, 3), half of them mirrored."""
        bank = self._bank
        shares = bank.n_rows / bank.n_rows.sum()
        which = rng.choice(len(shares), size=n, p=shares)
        speeds = rng.uniform(*SPEEDS, n)
        speeds = np.minimum(speeds, (bank.n_rows[which] - 1) / (WINDOW - 1))
        spare = bank.n_rows[which] - 1 - speeds * (WINDOW - 1)
        at = (rng.random(n) * spare)[:, None] + np.arange(WINDOW) * speeds[:, None]
        rows = torch.as_tensor(bank.first_rows[which][:, None] + np.rint(at).astype(np.int64))
        rotmats, pelvis_m = bank.rotmats[rows], bank.pelvis_m[rows]
        mirror = torch.as_tensor(rng.random(n) < 0.5)
        # The body's left is x in its rest axes; the world is mirrored in x likewise.
        flip = torch.tensor([-1.0, 1.0, 1.0])
        swapped = rotmats[mirror][:, :, MIRRORED]
        rotmats[mirror] = swapped * flip[:, None] * flip
        pelvis_m[mirror] = pelvis_m[mirror] * flip
        return rotmats, pelvis_m


def _cameras(pelvis_m: Tensor, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """Rotations (n, 27, 3, 3) and translations (n, 27, 3) cam_from_world of cameras that look at
    about where a person is, (n, 27, 3) in a z-up world [m]."""
    n, frames = pelvis_m.shape[:2]

    def uniform(low: float, high: float, *size: int) -> Tensor:
        return torch.as_tensor(rng.uniform(low, high, size or (n,)), dtype=torch.float32)

    times_s = (torch.arange(frames) - frames // 2) / RATE_HZ
    distance_m = torch.exp(uniform(np.log(1.8), np.log(9.0)))
    azimuth = uniform(-np.pi, np.pi)
    middle_m = pelvis_m[:, frames // 2]
    height_m = torch.where(uniform(0, 1) < 0.8, uniform(-0.6, 0.9), uniform(0.9, 2.5))
    from_m = middle_m + torch.stack(
        [distance_m * torch.cos(azimuth), distance_m * torch.sin(azimuth), height_m], -1
    )
    moves = (uniform(0, 1) < 0.7).float()[:, None]
    velocity = moves * uniform(-1.2, 1.2, n, 3) * torch.tensor([1.0, 1.0, 0.2])
    centres_m = from_m[:, None] + times_s[:, None] * velocity[:, None]
    follows = uniform(0, 1)[:, None, None]
    target_m = middle_m[:, None] + follows * (pelvis_m - middle_m[:, None])
    off_m = distance_m[:, None] * uniform(-0.45, 0.45, n, 3) * torch.tensor([1.0, 1.0, 0.5])
    forward = torch.nn.functional.normalize(target_m + off_m[:, None] - centres_m, dim=-1)
    roll = uniform(-0.12, 0.12)
    up = torch.stack([torch.zeros(n), torch.zeros(n), torch.ones(n)], -1)[:, None].expand_as(
        forward
    )
    right = torch.nn.functional.normalize(torch.cross(forward, up, dim=-1), dim=-1)
    down = torch.cross(forward, right, dim=-1)
    cos, sin = torch.cos(roll)[:, None, None], torch.sin(roll)[:, None, None]
    right, down = cos * right + sin * down, cos * down - sin * right
    rotmats = torch.stack([right, down, forward], dim=-2)
    return rotmats, -(rotmats @ centres_m[..., None])[..., 0]


LIMBS = tuple(
    tuple(n for n, name in enumerate(LANDMARKS) if name.startswith(side) and name.endswith(ends))
    for side in ("left", "right")
    for ends in (
        ("elbow", "wrist", "pinky", "index", "thumb"),
        ("knee", "ankle", "heel", "foot_index"),
        ("ankle", "heel", "foot_index"),
    )
)


def _spoilt(
    arrays: list[Tensor], config: SpoilConfig, rng: np.random.Generator
) -> tuple[list[Tensor], Tensor]:
    """Rays, metres and visibilities with exchanged sides and hidden limbs; known frames."""
    rays, world_m, visibility = arrays
    n, frames = rays.shape[:2]
    known = torch.ones(n, frames)
    for row in np.flatnonzero(rng.random(n) < config.swap_share):
        run = _run(frames, rng)
        for array in arrays:
            array[row, run] = array[row, run][:, MIRRORED_LANDMARKS]
    spreads = rays.std(dim=2).mean(dim=(1, 2))
    for row in np.flatnonzero(rng.random(n) < config.limb_share):
        run, limb = _run(frames, rng), list(LIMBS[int(rng.integers(len(LIMBS)))])
        shift = torch.as_tensor(rng.normal(0, 0.15, (len(limb), 3)), dtype=torch.float32)
        # An index of a list of numbers copies, so what is changed is put back.
        rays[row, run, limb] = rays[row, run, limb] + shift[:, :2] * spreads[row] * 2
        world_m[row, run, limb] = world_m[row, run, limb] + shift
        visibility[row, run, limb] = visibility[row, run, limb] * float(rng.uniform(0, 0.4))
    for row in np.flatnonzero(rng.random(n) < config.gap_share):
        # At the ends of a track, or a hole within it.
        run = _run(frames, rng) if rng.random() < 0.3 else _end(frames, rng)
        known[row, run] = 0
    known[:, frames // 2] = 1
    return [rays, world_m, visibility], known


def _run(frames: int, rng: np.random.Generator) -> slice:
    first = int(rng.integers(frames))
    return slice(first, min(frames, first + 1 + int(rng.integers(frames // 2))))


def _end(frames: int, rng: np.random.Generator) -> slice:
    n = 1 + int(rng.integers(frames // 2))
    return slice(0, n) if rng.random() < 0.5 else slice(frames - n, frames)
