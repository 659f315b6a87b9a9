"""Training windows: from clips to batches that depend on the seed and the step alone."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from gmrdata.gmr import rotations
from gmrdata.gmr.augmentation import (
    is_turned,
    mirror_local,
    mirror_points_m,
    mirror_rotmats,
    turned,
)
from gmrdata.gmr.config import ExtraInput, ModelConfig, Representation, WindowConfig
from gmrdata.gmr.flat_runs import FlatRuns, PackRecord, TrainingRun, in_files, in_memory
from gmrdata.gmr.losses import Motions
from gmrdata.gmr.model import input_rotmats, network_input
from gmrdata.gmr.runs import Mix, no_runs, runs_at
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadManifest
from gmrdata.values.motion import deltas
from gmrdata.values.shapes import Float, Int


def sample_run(runs: FlatRuns, weights: Sequence[float] | None, rng: np.random.Generator) -> int:
    """Sample a run by its share of the frames: of all, or of those of a part, by weight."""
    start, stop = 0, int(runs.ends[-1])
    if weights is not None:
        upto = np.cumsum(weights)
        part = int(np.searchsorted(upto[:-1], rng.random() * upto[-1], side="right"))
        first, after = np.searchsorted(runs.parts, [part, part + 1])
        start = int(runs.ends[first - 1]) if first else 0
        stop = int(runs.ends[after - 1])
    frame = start + int(rng.integers(stop - start))
    return int(np.searchsorted(runs.ends, frame, side="right"))


@dataclass(frozen=True, eq=False)
class TrainingSet:
    """All runs end to end, in memory or in mapped files."""

    frames: FlatRuns
    representation: Representation  # of `poses`
    extra_inputs: tuple[ExtraInput, ...] = ()  # what a batch's network input has beside them
    weights: tuple[float, ...] | None = None  # of each part; None: runs by their frames

    def window(self, run: int, rows: slice) -> TrainingRun:
        """Some frames of a run, as arrays of their own."""
        frames, of_run = self.frames, self.frames.rows(run)
        return TrainingRun(
            np.array(frames.poses[of_run][rows]),
            np.array(frames.root_rotmats[of_run][rows]),
            np.array(frames.pelvis_m[of_run][rows]),
            frames.shapes[run],
            body=int(frames.bodies[run]),
        )


@dataclass(frozen=True, eq=False)
class Batch:
    """B windows of T frames as tensors."""

    poses: Tensor  # (B, T, D) network input; zero in padding
    lengths: Tensor  # (B,) int64 on the CPU: real frames
    mask: Tensor  # (B, T-1) bool: motions between real frames
    motions: Motions  # true ones; the identity in padding
    local_rotmats: Tensor  # (B, T, 23, 3, 3); those of the last real frame in padding
    shape: Tensor  # (B, S)
    bodies: Tensor  # (B,) int64 on the CPU: which of several bodies the person has


def make_training_set(
    clips: Iterable[Clip],
    model: ModelConfig,
    config: WindowConfig,
    *,
    mix: Mix | None = None,
    bodies: Sequence[str] = (),
    pack_dir: Path | None = None,
) -> TrainingSet:
    """Cut clips into runs at a network's frame rate, and compute its inputs once.

    The clips are gone through once and not kept, so they may come from disk one by one.  `bodies`
    are the names of those that they may have, in the order of their numbers; none for one body.
    With `pack_dir`, the runs' arrays are files in that folder, mapped and not kept in memory.
    """
    rows = _run_rows(clips, model.input, config, mix, list(bodies))
    about = PackRecord(input=model.input, fps_hz=config.fps_hz)
    frames = in_memory(rows) if pack_dir is None else in_files(rows, pack_dir, about)
    if mix is None:
        return TrainingSet(frames, model.input, model.extra_inputs)
    n_frames = np.bincount(frames.parts, np.diff(frames.ends, prepend=0), len(mix.sizes))
    return TrainingSet(frames, model.input, model.extra_inputs, mix.shares(n_frames))


def make_batch(
    training_set: TrainingSet, config: WindowConfig, batch_size: int, seed: int, step: int
) -> Batch:
    """The windows of one step: the same for the same seed and step, whatever was sampled before.

    A window that is played backwards has its motions computed anew: reversal does not just change
    signs, since dT is seen from the frame in which the motion begins.  The network's input is
    computed once per run and cut with it, unless windows are mirrored or noisy or there are extra
    inputs: then it is computed from the batch's local rotations.
    """
    rng = np.random.default_rng([seed, step])
    windows = [sample_window(training_set, config, rng) for _ in range(batch_size)]
    poses, lengths, motions = stacked(windows, config.frames)
    poses = _signed(poses, training_set.representation)
    local_rotmats = input_rotmats(torch.from_numpy(poses), training_set.representation).numpy()
    # What looks at the next frame sees no motion in padding.
    local_rotmats = _padded(local_rotmats, lengths)
    mirrored = np.array([window.mirrored for window in windows])
    local_rotmats[mirrored] = mirror_local(local_rotmats[mirrored])
    is_changed = config.mirror_probability > 0 or is_turned(config)
    if is_changed or training_set.extra_inputs:
        poses = _input_of(local_rotmats, lengths, training_set, config, rng)
    return batch_of(windows, poses, lengths, motions, local_rotmats)


def batch_of(
    windows: Sequence[TrainingRun],
    poses: Float[np.ndarray, "batch frames numbers"],
    lengths: Int[np.ndarray, " batch"],
    motions: Motions,
    local_rotmats: Float[np.ndarray, "batch frames 23 3 3"],
) -> Batch:
    """The tensors of windows: shapes and bodies from these, the mask from the real frames."""
    return Batch(
        poses=torch.from_numpy(poses),
        lengths=torch.from_numpy(lengths),
        mask=torch.from_numpy(np.arange(1, poses.shape[1]) < lengths[:, None]),
        motions=motions,
        local_rotmats=torch.from_numpy(local_rotmats),
        shape=torch.from_numpy(np.stack([window.shape for window in windows])),
        bodies=torch.tensor([window.body for window in windows]),
    )


def sample_window(
    training_set: TrainingSet, config: WindowConfig, rng: np.random.Generator
) -> TrainingRun:
    """A window of a run that is chosen by its share of the frames, maybe backwards or mirrored."""
    run = sample_run(training_set.frames, training_set.weights, rng)
    of_run = training_set.frames.rows(run)
    start = int(rng.integers(max(1, of_run.stop - of_run.start - config.frames + 1)))
    backwards = rng.random() < config.reverse_probability
    mirrored = config.mirror_probability > 0 and rng.random() < config.mirror_probability
    window = training_set.window(run, slice(start, start + config.frames))
    if backwards:
        window = reverse(window)
    if mirrored:
        window = replace(
            window,
            root_rotmats=mirror_rotmats(window.root_rotmats),
            pelvis_m=mirror_points_m(window.pelvis_m),
            mirrored=True,
        )
    return window


def reverse(run: TrainingRun) -> TrainingRun:
    backwards = {name: getattr(run, name)[::-1] for name in ("poses", "root_rotmats", "pelvis_m")}
    return replace(run, **backwards)


def stacked(
    windows: Sequence[TrainingRun], frames: int
) -> tuple[Float[np.ndarray, "batch frames numbers"], Int[np.ndarray, " batch"], Motions]:
    """Windows padded with zeros, how many frames of each are real, and the motions between them."""
    size = len(windows)
    lengths = np.array([len(window.poses) for window in windows])
    rows = np.zeros((size, frames, windows[0].poses.shape[1]), np.float32)
    delta_rotmats = np.tile(np.eye(3, dtype=np.float32), (size, frames - 1, 1, 1))
    delta_m = np.zeros((size, frames - 1, 3), np.float32)
    for row, (n, window) in enumerate(zip(lengths, windows, strict=True)):
        rows[row, :n] = window.poses
        motions = deltas(window.root_rotmats, window.pelvis_m)
        delta_rotmats[row, : n - 1], delta_m[row, : n - 1] = motions
    return rows, lengths, Motions(torch.from_numpy(delta_rotmats), torch.from_numpy(delta_m))


def _padded(values: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Rows (B, T, ...) whose padding repeats the last real frame."""
    last = np.minimum(np.arange(values.shape[1]), lengths[:, None] - 1)
    return values[np.arange(len(values))[:, None], last]


def _input_of(
    local_rotmats: np.ndarray,
    lengths: np.ndarray,
    training_set: TrainingSet,
    config: WindowConfig,
    rng: np.random.Generator,
) -> np.ndarray:
    """Network input of a batch's local rotations, (B, T, D) float32, zero in padding."""
    if is_turned(config):
        local_rotmats = _padded(turned(local_rotmats, config, rng), lengths)
    poses: np.ndarray = network_input(
        torch.from_numpy(local_rotmats), training_set.representation, training_set.extra_inputs
    ).numpy()
    is_real = np.arange(config.frames) < lengths[:, None]
    return poses * is_real[..., None].astype(np.float32)


def _signed(poses: np.ndarray, representation: Representation) -> np.ndarray:
    """Quaternions (B, T, D) with w >= 0 in a window's first frame, as inference gives them."""
    if representation != "quaternion":
        return poses
    size = rotations.SIZE["quaternion"]
    signs = np.where(poses[:, :1, ::size] < 0, np.float32(-1), np.float32(1))
    return poses * np.repeat(signs, size, axis=-1)


def _run_rows(
    clips: Iterable[Clip],
    representation: Representation,
    config: WindowConfig,
    mix: Mix | None,
    bodies: list[str],
) -> Iterator[TrainingRun]:
    """The runs of the clips, one after the other."""
    parts = None if mix is None else np.repeat(np.arange(len(mix.sizes)), mix.sizes)
    n_clips = n_runs = 0
    for n_clips, clip in enumerate(clips, start=1):
        bodies = bodies or [clip.motion.body]
        if clip.motion.body not in bodies:
            raise BadManifest(
                f"training clips are of different bodies ({', '.join(bodies)},"
                f" {clip.motion.body}), whose shapes do not mix. Give a folder with all of them"
            )
        body = bodies.index(clip.motion.body)
        for motion in runs_at(clip, config.fps_hz, all_phases=config.all_phases):
            n_runs += 1
            part = 0 if parts is None else int(parts[n_clips - 1])
            local_rotmats = torch.as_tensor(motion.local_rotmats, dtype=torch.float64)
            poses = network_input(local_rotmats, representation).float().numpy()
            arrays = (poses, motion.root_rotmats, motion.pelvis_m, motion.shape)
            yield TrainingRun(*arrays, part, body)
    if not n_runs:
        raise no_runs(n_clips, "training", config.fps_hz, "Give manifests with longer clips")
