"""The landmark network's measured errors, and true landmarks made as wrong as it makes them.

Errors are measured on rendered people, whose landmarks are known, in the lifter's own camera
(`views`).  Metres have a systematic part, which follows the pose (a linear map for each landmark);
what is left of them, the errors in the picture and the visibilities are kept as runs of frames.
Training adds such runs to other motions seen from a similar side, so slow and fast parts, rare
leaps, and what fails together stay as they were measured.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
import torch
from torch import Tensor

from gmrdata.people.landmark_network import MIRRORED_LANDMARKS, N_LANDMARKS, from_hips
from gmrdata.people.lifter import views_of
from gmrdata.values.files import write_npz
from gmrdata.values.records import ArrayShapes, check_shapes, read_arrays

NOISE_FILE = Path(__file__).with_name("landmark_noise.npz")
NOISE_FORMAT = "gmrdata-landmark-noise/1"
N_CUES = 6  # of a landmark's systematic error: its place, 1, and where the person looks
RIDGE = 1.0


@dataclass(frozen=True, eq=False)
class LandmarkNoise:
    """Errors of the landmark network over N frames of several clips, at one frame rate."""

    rate_hz: np.ndarray  # () frames per second
    runs: np.ndarray  # (N,) int, rising: frames of one run follow each other
    facing: np.ndarray  # (N, 2) where the person looks, in x and z of the ray's axes
    image: np.ndarray  # (N, 33, 2) errors in the person's size
    world_m: np.ndarray  # (N, 33, 3) errors after the systematic part, in the ray's axes [m]
    visibility: np.ndarray  # (N, 33) from 0 to 1
    world_maps: np.ndarray  # (33, 3, 6) systematic part: from `_cues` to the network's metres

    def write(self, path: Path) -> None:
        arrays = {key: getattr(self, key) for key in _SHAPES}
        check_shapes(path, arrays, _SHAPES)
        write_npz(path, {"format": NOISE_FORMAT} | arrays, compressed=True)

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read measured errors; BadRecord names what is wrong with the file."""
        return cls(**read_arrays(path, NOISE_FORMAT, _SHAPES))


_SHAPES: ArrayShapes = {
    "rate_hz": ("f", ()),
    "runs": ("iu", ("N",)),
    "facing": ("f", ("N", 2)),
    "image": ("f", ("N", N_LANDMARKS, 2)),
    "world_m": ("f", ("N", N_LANDMARKS, 3)),
    "visibility": ("f", ("N", N_LANDMARKS)),
    "world_maps": ("f", (N_LANDMARKS, 3, N_CUES)),
}


class SeenTruth(NamedTuple):
    """What the network saw of people whose landmarks are known, over N frames."""

    runs: np.ndarray  # (N,) int, rising: frames of one run follow each other
    true_m: np.ndarray  # (N, 33, 3) landmarks in the camera's axes [m]
    facing: np.ndarray  # (N, 3) where the pelvis looks, in the camera's axes
    rays: np.ndarray  # (N, 33, 2) of the landmarks that it saw
    world_m: np.ndarray  # (N, 33, 3) of the network [m]
    visibility: np.ndarray  # (N, 33)


def measure_noise(seen: SeenTruth, rate_hz: float) -> LandmarkNoise:
    """The network's errors; both sides of the body count alike in the systematic part."""
    true_m = torch.as_tensor(seen.true_m, dtype=torch.float64)
    view = views_of(true_m[..., :2] / true_m[..., 2:])
    from_cam = view.cam_from_ray.transpose(-1, -2)
    facing = _level((from_cam @ torch.as_tensor(seen.facing)[..., None])[..., 0])
    cues = _cues(from_hips(true_m @ view.cam_from_ray), facing).numpy()
    maps = _maps(cues, seen.world_m)
    rays = torch.as_tensor(seen.rays)
    points = torch.cat([rays, torch.ones_like(rays[..., :1])], -1) @ view.cam_from_ray
    image = points[..., :2] / points[..., 2:] / view.sizes[..., None, None] - view.points
    return LandmarkNoise(
        rate_hz=np.array(rate_hz, dtype=np.float64),
        runs=seen.runs,
        facing=facing.numpy().astype(np.float32),
        image=image.numpy().astype(np.float32),
        world_m=(seen.world_m - _apply(maps, cues)).astype(np.float32),
        visibility=seen.visibility.astype(np.float32),
        world_maps=maps,
    )


def _level(facing: Tensor) -> Tensor:
    """(N, 2) x and z of directions, of length 1."""
    return torch.nn.functional.normalize(facing[..., [0, 2]], dim=-1)


def _cues(true_m: Tensor, facing: Tensor) -> Tensor:
    """(N, 33, 6) for each landmark its place from the hips, 1, and where the person looks."""
    ones = torch.ones_like(true_m[..., :1])
    looks = facing[..., None, :].expand(*true_m.shape[:-1], 2)
    return torch.cat([true_m, ones, looks], dim=-1)


def _maps(cues: np.ndarray, world_m: np.ndarray) -> np.ndarray:
    """(33, 3, 6) of least squares over all frames and their mirror images."""
    swap, flip = list(MIRRORED_LANDMARKS), np.array([-1.0, 1.0, 1.0])
    both = np.concatenate([cues, cues[:, swap] * [-1, 1, 1, 1, -1, 1]])
    targets = np.concatenate([world_m, world_m[:, swap] * flip])
    maps = []
    for n in range(N_LANDMARKS):
        normal = both[:, n].T @ both[:, n] + RIDGE * np.eye(N_CUES)
        # Drawn to what is right: metres as they are.
        prior = np.eye(N_CUES)[:3]
        maps.append(np.linalg.solve(normal, both[:, n].T @ targets[:, n] + RIDGE * prior.T).T)
    return np.array(maps)


def _apply(maps: np.ndarray, cues: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("lij,nlj->nli", maps, cues))


class NoisyLandmarks(NamedTuple):
    """Landmarks as the network would see them."""

    rays: Tensor  # (n, frames, 33, 2)
    world_m: Tensor  # (n, frames, 33, 3)
    visibility: Tensor  # (n, frames, 33)


class NoiseSampler:
    """Runs of measured errors for windows of some frames at another rate."""

    def __init__(self, noise: LandmarkNoise, n_frames: int, rate_hz: float) -> None:
        self._rows, self._shares = _window_rows(noise, n_frames, rate_hz)
        if not len(self._rows):
            raise ValueError("no run of measured errors is as long as a window")
        middle = self._rows[:, n_frames // 2]
        self._angles = np.arctan2(*noise.facing[middle].T)
        self._image, self._world_m, self._visibility = (
            torch.as_tensor(getattr(noise, key)) for key in ("image", "world_m", "visibility")
        )
        self._maps = torch.as_tensor(noise.world_maps, dtype=torch.float32)

    def add(self, true_m: Tensor, facing: Tensor, rng: np.random.Generator) -> NoisyLandmarks:
        """True landmarks (n, frames, 33, 3) in the camera's axes [m], and where the pelvis looks
        (n, frames, 3), as the network would see them."""
        view = views_of(true_m[..., :2] / true_m[..., 2:])
        level = _level((view.cam_from_ray.transpose(-1, -2) @ facing[..., None])[..., 0])
        image, world_m, visibility = self._runs(level[:, level.shape[1] // 2].numpy(), rng)
        cues = _cues(from_hips(true_m @ view.cam_from_ray), level)
        systematic_m = (self._maps @ cues[..., None])[..., 0]
        points = (view.points + image) * view.sizes[..., None, None]
        seen = torch.cat([points, torch.ones_like(points[..., :1])], dim=-1)
        seen = seen @ view.cam_from_ray.transpose(-1, -2)
        rays = seen[..., :2] / seen[..., 2:].clamp(min=0.05)
        return NoisyLandmarks(rays, systematic_m + world_m, visibility)

    def _runs(self, facing: np.ndarray, rng: np.random.Generator) -> tuple[Tensor, Tensor, Tensor]:
        """Errors in the picture, in metres, and visibilities for windows that look so (n, 2)."""
        wanted = np.arctan2(*facing.T)
        n = len(wanted)
        first, mirrored = self._choose(wanted, rng)
        second, mirrored_second = self._choose(wanted, rng)
        one, two = self._take(first, mirrored), self._take(second, mirrored_second)
        turn = torch.as_tensor(rng.uniform(0, np.pi / 4, n), dtype=torch.float32)
        growth = torch.as_tensor(np.exp(rng.normal(0, GROWTH, n)), dtype=torch.float32)
        a, b = ((growth * f(turn))[:, None, None, None] for f in (torch.cos, torch.sin))
        return a * one[0] + b * two[0], a * one[1] + b * two[1], one[2]

    def _choose(
        self, wanted: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """A run for each angle (n,), as it was or mirrored, of the nearest of a few."""
        tries = rng.integers(len(self._rows), size=(len(wanted), TRIES))
        mirrored = rng.random((len(wanted), TRIES)) < 0.5
        angles = np.where(mirrored, -1, 1) * self._angles[tries]
        off = np.abs((angles - wanted[:, None] + np.pi) % (2 * np.pi) - np.pi)
        best = off.argmin(axis=1)[:, None]
        return (
            np.take_along_axis(tries, best, 1)[:, 0],
            np.take_along_axis(mirrored, best, 1)[:, 0],
        )

    def _take(self, runs: np.ndarray, mirrored: np.ndarray) -> tuple[Tensor, ...]:
        rows = torch.as_tensor(self._rows[runs])
        shares = torch.as_tensor(self._shares[runs], dtype=torch.float32)
        flip = torch.as_tensor(mirrored)
        taken = []
        for values in (self._image, self._world_m, self._visibility[..., None]):
            # Between two frames, as a track is read at the lifter's rate.
            s = shares[..., None, None]
            found = values[rows] * (1 - s) + values[rows + 1] * s
            swapped = found[flip][:, :, MIRRORED_LANDMARKS]
            if values.shape[-1] > 1:
                swapped[..., 0] *= -1
            found[flip] = swapped
            taken.append(found)
        return taken[0], taken[1], taken[2][..., 0]


GROWTH = 0.25  # by which noise is made larger or smaller, for other people and cameras
TRIES = 8  # windows of which the one from the most similar side is taken


def _window_rows(
    noise: LandmarkNoise, n_frames: int, rate_hz: float
) -> tuple[np.ndarray, np.ndarray]:
    """Rows (W, frames) before each frame of every window that fits into a run, and the share
    (W, frames) of the row after it."""
    step = float(noise.rate_hz) / rate_hz
    at = np.arange(n_frames) * step
    rows, shares = [np.zeros((0, n_frames), np.int64)], [np.zeros((0, n_frames))]
    for run in np.unique(noise.runs):
        first, last = np.flatnonzero(noise.runs == run)[[0, -1]]
        starts = np.arange(first, last - at[-1] - 1e-9, 0.5)[:, None] + at
        starts = starts[starts[:, -1] < last]
        rows.append(np.floor(starts).astype(np.int64))
        shares.append(starts - np.floor(starts))
    return np.concatenate(rows), np.concatenate(shares)
