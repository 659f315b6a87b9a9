"""Training windows of the non-sequential model: image features beside the true motion.

Features are one vector per frame, from whatever network looks at images.  `<folder>/<clip id>.npz`
holds `features` (T, D), row t for row t of the manifest's clip; rows that are not valid in the clip
may hold NaN.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from gmrdata.gmr.flat_runs import TrainingRun, in_memory
from gmrdata.gmr.runs import MIN_FRAMES, check_finite, no_runs
from gmrdata.gmr.windows import Batch, TrainingSet, sample_window, stacked
from gmrdata.motion.resample import valid_runs
from gmrdata.paper.joint_config import JointConfig
from gmrdata.values.body import N_LOCAL
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadFeatures, BadMotionFile, MissingInput
from gmrdata.values.files import read_npz
from gmrdata.values.motion import whole_ratio

KEY = "features"
N_LOCAL_VALUES = N_LOCAL * 9  # numbers of the local rotations of a frame


def load_features(folder: Path, clip: Clip) -> np.ndarray:
    """The features of a clip's rows: (T, D) float32."""
    path = folder / f"{clip.id}.npz"
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


def rows_per_frame(clip: Clip, fps_hz: float) -> int:
    """How many rows of a clip there are for one frame of the network."""
    step = whole_ratio(clip.motion.fps_hz, fps_hz)
    if step is None:
        raise BadMotionFile(
            f"clip {clip.id}: {clip.motion.fps_hz:g} fps is no whole multiple of {fps_hz:g} fps,"
            " and image features can't be resampled. Set fps_hz in the recipe"
        )
    return step


def joint_runs(clip: Clip, features: np.ndarray, fps_hz: float, body: int = 0) -> list[TrainingRun]:
    """Runs of valid frames, all phases: rows of features (T, D), then the local rotations."""
    check_finite(clip)
    step = rows_per_frame(clip, fps_hz)
    motion = clip.motion
    local = motion.local_rotmats.reshape(motion.n_frames, -1)
    rows = np.concatenate([features, local.astype(np.float32)], axis=1)
    return [
        TrainingRun(
            rows[now], motion.root_rotmats[now], motion.pelvis_m[now], motion.shape, body=body
        )
        for start, stop in valid_runs(clip.valid)
        for now in (slice(start + phase, stop, step) for phase in range(step))
        if stop - now.start > (MIN_FRAMES - 1) * step
    ]


def split_rows(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Features (..., D) and local rotations (..., 23, 3, 3) of a run's rows (..., D + 207)."""
    features, local = rows[..., :-N_LOCAL_VALUES], rows[..., -N_LOCAL_VALUES:]
    return np.ascontiguousarray(features), local.reshape(*rows.shape[:-1], N_LOCAL, 3, 3)


def training_runs(
    pairs: Sequence[tuple[Clip, np.ndarray]], fps_hz: float, bodies: Sequence[str] = ()
) -> TrainingSet:
    """Runs of all training clips, with features of one size, each of a body of those names."""
    sizes = sorted({features.shape[1] for _, features in pairs})
    if len(sizes) > 1:
        raise BadFeatures(
            f"features have {' or '.join(map(str, sizes))} numbers per frame. Compute those of all"
            " clips with one network"
        )
    runs = [
        run
        for clip, features in pairs
        for run in joint_runs(
            clip, features, fps_hz, bodies.index(clip.motion.body) if bodies else 0
        )
    ]
    if not runs:
        raise no_runs(len(pairs), "training", fps_hz, "Give manifests with longer clips")
    return TrainingSet(in_memory(runs), "6d")


def make_joint_batch(training_set: TrainingSet, config: JointConfig, step: int) -> Batch:
    """The windows of one step, features as input; local rotations are the identity in padding."""
    rng = np.random.default_rng([config.seed, step])
    windows = [sample_window(training_set, config.windows, rng) for _ in range(config.batch_size)]
    rows, lengths, motions = stacked(windows, config.frames)
    features, local_rotmats = split_rows(rows)
    is_real = np.arange(config.frames) < lengths[:, None]
    local_rotmats[~is_real] = np.eye(3)
    return Batch(
        poses=torch.from_numpy(features),
        lengths=torch.from_numpy(lengths),
        mask=torch.from_numpy(is_real[:, 1:]),
        motions=motions,
        local_rotmats=torch.from_numpy(local_rotmats),
        shape=torch.from_numpy(np.stack([window.shape for window in windows])),
        bodies=torch.tensor([window.body for window in windows]),
    )
