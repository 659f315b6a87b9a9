"""Training windows: from clips to batches that depend on the seed and the step alone."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from gmrdata.body.tree import N_LOCAL
from gmrdata.clip import Clip
from gmrdata.errors import BadManifest
from gmrdata.gmr import rotations
from gmrdata.gmr.config import Representation, WindowConfig
from gmrdata.gmr.flat_runs import FlatRuns, RunRows, in_files, in_memory
from gmrdata.gmr.losses import Motions
from gmrdata.gmr.mixing import Mix, check_mix, draw_run
from gmrdata.gmr.model import network_input
from gmrdata.gmr.motion_deltas import deltas
from gmrdata.gmr.runs import Run, runs_at


@dataclass(frozen=True, eq=False)
class TrainingRun:
    """A run of frames, ready to be cut."""

    poses: np.ndarray
    """(n, D) float32 network input."""
    local_rotmats: np.ndarray
    """(n, 23, 3, 3) float32."""
    root_rotmats: np.ndarray
    """(n, 3, 3) frame_from_root."""
    pelvis_m: np.ndarray
    """(n, 3) [m]."""
    shape: np.ndarray
    """(S,) float32."""


@dataclass(frozen=True, eq=False)
class TrainingSet:
    """All runs, in memory or in mapped files."""

    frames: FlatRuns
    """The runs, end to end."""
    representation: Representation
    """Of `poses`."""
    weights: tuple[float, ...] | None = None
    """Weight of each manifest; None where a run is drawn by its share of all frames."""

    @property
    def runs(self) -> tuple[TrainingRun, ...]:
        """Every run as a whole."""
        return tuple(self.window(run, slice(None)) for run in range(len(self.frames.ends)))

    def n_frames(self, run: int) -> int:
        """Frames of a run."""
        rows = self.frames.rows(run)
        return rows.stop - rows.start

    def window(self, run: int, rows: slice) -> TrainingRun:
        """Some frames of a run, as arrays of their own; local rotations are those of `poses`."""
        frames, of_run = self.frames, self.frames.rows(run)
        poses = np.array(frames.poses[of_run][rows])
        values = torch.from_numpy(poses).unflatten(-1, (N_LOCAL, -1))
        return TrainingRun(
            poses=poses,
            local_rotmats=rotations.to_rotmats(values, self.representation).numpy(),
            root_rotmats=np.array(frames.root_rotmats[of_run][rows]),
            pelvis_m=np.array(frames.pelvis_m[of_run][rows]),
            shape=frames.shapes[run],
        )


@dataclass(frozen=True, eq=False)
class Batch:
    """B windows of T frames as tensors."""

    poses: Tensor
    """(B, T, D) network input; zero in padding."""
    lengths: Tensor
    """(B,) int64 on the CPU: real frames."""
    mask: Tensor
    """(B, T-1) bool: motions between real frames."""
    motions: Motions
    """True motions; the identity in padding."""
    local_rotmats: Tensor
    """(B, T, 23, 3, 3); the identity in padding."""
    shape: Tensor
    """(B, S)."""


def make_training_set(
    clips: Iterable[Clip],
    representation: Representation,
    config: WindowConfig,
    *,
    mix: Mix | None = None,
    pack_dir: Path | None = None,
) -> TrainingSet:
    """Cut clips into runs at the network's frame rate, all phases, and compute their inputs once.

    Args:
        clips: Gone through once and not kept, so they may come from disk one by one.
        representation: Of the network's input.
        config: The frame rate.
        mix: Which clips come from which manifest, and how often windows come from each; None to
            draw by frames.
        pack_dir: Folder for the runs' arrays, which are then mapped and not kept in memory; if it
            is there, it is used as it is.

    Raises:
        BadManifest: no clip has two valid frames in a row, a manifest with a weight has none, or
            the clips are of different bodies.
        BadMotionFile: a clip has NaN in a valid frame, or too low a frame rate.
    """
    rows = _run_rows(clips, representation, config, mix)
    if pack_dir is None:
        frames = in_memory(rows)
    else:
        about = {"input": representation, "fps_hz": config.fps_hz}
        frames = in_files(rows, pack_dir, about)
    if mix is not None:
        check_mix(frames, mix)
    return TrainingSet(frames, representation, None if mix is None else mix.weights)


def make_batch(
    training_set: TrainingSet, config: WindowConfig, batch_size: int, seed: int, step: int
) -> Batch:
    """The windows of one step: the same for the same seed and step, whatever was drawn before.

    A run is chosen by its share of all frames, then a start, both uniformly.  A window that is to
    be played backwards has its poses reversed and its motions computed from them anew: reversal
    does not just change signs, since dT is seen from the frame in which the motion begins.
    """
    rng = np.random.default_rng([seed, step])
    windows = [_draw(training_set, config, rng) for _ in range(batch_size)]
    frames = config.frames
    lengths = np.array([len(window.poses) for window in windows])
    poses = np.zeros((batch_size, frames, windows[0].poses.shape[1]), np.float32)
    local_rotmats = np.tile(np.eye(3, dtype=np.float32), (batch_size, frames, N_LOCAL, 1, 1))
    delta_rotmats = np.tile(np.eye(3, dtype=np.float32), (batch_size, frames - 1, 1, 1))
    delta_m = np.zeros((batch_size, frames - 1, 3), np.float32)
    for row, window in enumerate(windows):
        n = lengths[row]
        poses[row, :n] = window.poses
        local_rotmats[row, :n] = window.local_rotmats
        delta_rotmats[row, : n - 1], delta_m[row, : n - 1] = deltas(
            window.root_rotmats, window.pelvis_m
        )
    return Batch(
        poses=torch.from_numpy(poses),
        lengths=torch.from_numpy(lengths),
        mask=torch.from_numpy(np.arange(frames - 1) < lengths[:, None] - 1),
        motions=Motions(torch.from_numpy(delta_rotmats), torch.from_numpy(delta_m)),
        local_rotmats=torch.from_numpy(local_rotmats),
        shape=torch.from_numpy(np.stack([window.shape for window in windows])),
    )


def reverse(run: TrainingRun, representation: Representation) -> TrainingRun:
    """The same frames in the opposite order."""
    rows = slice(None, None, -1)
    return _signed(
        TrainingRun(
            run.poses[rows],
            run.local_rotmats[rows],
            run.root_rotmats[rows],
            run.pelvis_m[rows],
            run.shape,
        ),
        representation,
    )


def _draw(training_set: TrainingSet, config: WindowConfig, rng: np.random.Generator) -> TrainingRun:
    run = draw_run(training_set.frames, training_set.weights, rng)
    start = int(rng.integers(max(1, training_set.n_frames(run) - config.frames + 1)))
    backwards = rng.random() < config.reverse_probability
    window = training_set.window(run, slice(start, start + config.frames))
    if backwards:
        return reverse(window, training_set.representation)
    return _signed(window, training_set.representation)


def _signed(window: TrainingRun, representation: Representation) -> TrainingRun:
    """Quaternions with w >= 0 in the window's first frame, as inference gives them."""
    if representation != "quaternion":
        return window
    size = rotations.SIZE["quaternion"]
    signs = np.where(window.poses[0, ::size] < 0, np.float32(-1), np.float32(1))
    return TrainingRun(
        window.poses * np.repeat(signs, size),
        window.local_rotmats,
        window.root_rotmats,
        window.pelvis_m,
        window.shape,
    )


def _run_rows(
    clips: Iterable[Clip], representation: Representation, config: WindowConfig, mix: Mix | None
) -> Iterator[RunRows]:
    """The runs of the clips, one after the other."""
    parts = None if mix is None else mix.part_of_each()
    body, n_clips, n_runs = "", 0, 0
    for n_clips, clip in enumerate(clips, start=1):
        body = body or clip.motion.body
        if clip.motion.body != body:
            raise BadManifest(
                f"training clips are of different bodies ({body}, {clip.motion.body}), whose"
                " shapes do not mix. Train on the clips of one body"
            )
        for run in runs_at(clip, config.fps_hz, all_phases=True):
            n_runs += 1
            yield _one_run(run, 0 if parts is None else int(parts[n_clips - 1]), representation)
    if not n_runs:
        raise BadManifest(
            f"none of the {n_clips} training clips has two valid frames in a row at"
            f" {config.fps_hz:g} fps. Give manifests with longer clips"
        )


def _one_run(run: Run, part: int, representation: Representation) -> RunRows:
    motion = run.motion
    local_rotmats = torch.as_tensor(motion.local_rotmats, dtype=torch.float64)
    return RunRows(
        part=part,
        poses=network_input(local_rotmats, representation).float().numpy(),
        root_rotmats=motion.root_rotmats,
        pelvis_m=motion.pelvis_m,
        shape=motion.shape,
    )
