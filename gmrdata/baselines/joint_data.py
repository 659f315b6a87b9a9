"""Training windows of the non-sequential model: image features beside the true motion.

Image features: one vector per frame, from whatever network looks at images.

`<folder>/<clip id>.npz` holds `features` (T, D), row t for row t of the manifest's clip; rows that
are not valid in the clip may hold NaN.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from gmrdata.baselines.joint_config import JointConfig
from gmrdata.gmr.losses import Motions
from gmrdata.gmr.runs import MIN_FRAMES, check_finite
from gmrdata.motion.resample import valid_runs
from gmrdata.values.body import N_LOCAL
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadFeatures, BadManifest, BadMotionFile, MissingInput
from gmrdata.values.files import read_npz
from gmrdata.values.motion_deltas import deltas

KEY = "features"


def features_path(folder: Path, clip_id: str) -> Path:
    """Where the features of a clip lie."""
    return folder / f"{clip_id}.npz"


def load_features(folder: Path, clip: Clip) -> np.ndarray:
    """The features of a clip's rows: (T, D) float32.

    Raises:
        MissingInput: there is no such file.
        BadMotionFile: not readable as an .npz of plain arrays.
        BadFeatures: no array of that name and shape, or NaN in a valid row.
    """
    path = features_path(folder, clip.id)
    if not path.is_file():
        raise MissingInput(f"{path}: no image features of clip {clip.id}; write `{KEY}` (T, D)")
    found = read_npz(path).get(KEY)
    n = clip.motion.n_frames
    if found is None or found.dtype.kind != "f" or found.ndim != 2 or len(found) != n:
        shape = "none" if found is None else f"{found.dtype} of shape {found.shape}"
        raise BadFeatures(f"{path}: {KEY} is {shape}, expected numbers of shape ({n}, D)")
    if not found.shape[1]:
        raise BadFeatures(f"{path}: {KEY} has no columns")
    bad = np.flatnonzero(clip.valid & ~np.isfinite(found).all(axis=1))
    if len(bad):
        raise BadFeatures(
            f"{path}: row {bad[0]} holds NaN or infinite numbers ({len(bad)} rows in all), and clip"
            f" {clip.id} has it as valid. Compute them again, or drop the rows in the manifest"
        )
    return np.asarray(found, dtype=np.float32)


@dataclass(frozen=True, eq=False)
class JointRun:
    """Consecutive valid frames of one clip at the network's rate."""

    features: np.ndarray
    """(n, D) float32."""
    local_rotmats: np.ndarray
    """(n, 23, 3, 3) float32."""
    root_rotmats: np.ndarray
    """(n, 3, 3) world_from_root."""
    pelvis_m: np.ndarray
    """(n, 3) [m]."""
    shape: np.ndarray
    """(S,) float32."""


@dataclass(frozen=True, eq=False)
class JointBatch:
    """B windows of T frames as tensors."""

    features: Tensor
    """(B, T, D); zero in padding."""
    lengths: Tensor
    """(B,) int64 on the CPU: real frames."""
    frame_mask: Tensor
    """(B, T) bool: real frames."""
    motions: Motions
    """True motions; the identity in padding."""
    local_rotmats: Tensor
    """(B, T, 23, 3, 3) true local poses; the identity in padding."""
    shape: Tensor
    """(B, S)."""


def rows_per_frame(clip: Clip, fps_hz: float) -> int:
    """How many rows of a clip there are for one frame of the network.

    Raises:
        BadMotionFile: the clip's rate is no whole multiple.
    """
    ratio = clip.motion.fps_hz / fps_hz
    step = round(ratio)
    if step < 1 or abs(ratio - step) > 1e-6 * ratio:
        raise BadMotionFile(
            f"clip {clip.id}: {clip.motion.fps_hz:g} fps is no whole multiple of {fps_hz:g} fps,"
            " and image features can't be resampled. Set fps_hz in the recipe"
        )
    return step


def joint_runs(clip: Clip, features: np.ndarray, fps_hz: float) -> list[JointRun]:
    """Runs of a clip's valid frames, all phases of a higher rate.

    Args:
        clip: The clip, in the world frame.
        features: (T, D) of its rows.
        fps_hz: The network's rate [Hz].

    Raises:
        BadMotionFile: a valid frame holds NaN, or the rate does not fit.
    """
    check_finite(clip)
    step = rows_per_frame(clip, fps_hz)
    motion = clip.motion
    runs = []
    for start, stop in valid_runs(clip.valid):
        for phase in range(step):
            rows = slice(start + phase, stop, step)
            if len(range(start + phase, stop, step)) >= MIN_FRAMES:
                runs.append(
                    JointRun(
                        features[rows],
                        motion.local_rotmats[rows].astype(np.float32),
                        motion.root_rotmats[rows],
                        motion.pelvis_m[rows],
                        motion.shape.astype(np.float32),
                    )
                )
    return runs


def training_runs(pairs: Sequence[tuple[Clip, np.ndarray]], fps_hz: float) -> list[JointRun]:
    """Runs of all training clips.

    Raises:
        BadFeatures: clips have features of different sizes.
        BadManifest: no clip has two valid frames in a row.
        BadMotionFile: as `joint_runs`.
    """
    sizes = sorted({features.shape[1] for _, features in pairs})
    if len(sizes) > 1:
        raise BadFeatures(
            f"features have {' or '.join(map(str, sizes))} numbers per frame. Compute those of all"
            " clips with one network"
        )
    runs = [run for clip, features in pairs for run in joint_runs(clip, features, fps_hz)]
    if not runs:
        raise BadManifest(
            f"none of the {len(pairs)} training clips has two valid frames in a row at"
            f" {fps_hz:g} fps. Give manifests with longer clips"
        )
    return runs


def make_joint_batch(runs: Sequence[JointRun], config: JointConfig, step: int) -> JointBatch:
    """The windows of one step: the same for the same recipe and step.

    A run is chosen by its share of all frames, then a start, both uniformly; motions of a window
    that is played backwards are computed from its reversed frames.
    """
    rng = np.random.default_rng([config.seed, step])
    ends = np.cumsum([len(run.features) for run in runs])
    windows = [_draw(runs, ends, config, rng) for _ in range(config.batch_size)]
    size, frames = config.batch_size, config.frames
    lengths = np.array([len(window.features) for window in windows])
    features = np.zeros((size, frames, windows[0].features.shape[1]), np.float32)
    local_rotmats = np.tile(np.eye(3, dtype=np.float32), (size, frames, N_LOCAL, 1, 1))
    delta_rotmats = np.tile(np.eye(3, dtype=np.float32), (size, frames - 1, 1, 1))
    delta_m = np.zeros((size, frames - 1, 3), np.float32)
    for row, (n, window) in enumerate(zip(lengths, windows, strict=True)):
        features[row, :n] = window.features
        local_rotmats[row, :n] = window.local_rotmats
        delta_rotmats[row, : n - 1], delta_m[row, : n - 1] = deltas(
            window.root_rotmats, window.pelvis_m
        )
    return JointBatch(
        features=torch.from_numpy(features),
        lengths=torch.from_numpy(lengths),
        frame_mask=torch.from_numpy(np.arange(frames) < lengths[:, None]),
        motions=Motions(torch.from_numpy(delta_rotmats), torch.from_numpy(delta_m)),
        local_rotmats=torch.from_numpy(local_rotmats),
        shape=torch.from_numpy(np.stack([window.shape for window in windows])),
    )


def _draw(
    runs: Sequence[JointRun], ends: np.ndarray, config: JointConfig, rng: np.random.Generator
) -> JointRun:
    run = runs[int(np.searchsorted(ends, rng.integers(ends[-1]), side="right"))]
    start = int(rng.integers(max(1, len(run.features) - config.frames + 1)))
    step = -1 if rng.random() < config.reverse_probability else 1
    rows = np.arange(len(run.features))[start : start + config.frames][::step]
    return replace(
        run,
        features=run.features[rows],
        local_rotmats=run.local_rotmats[rows],
        root_rotmats=run.root_rotmats[rows],
        pelvis_m=run.pelvis_m[rows],
    )
