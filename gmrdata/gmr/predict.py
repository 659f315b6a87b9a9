"""Inference: a trained network, and the world motion that it sees in a local pose sequence."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from gmrdata.gmr.bundled import BUNDLE_FILE, read_bundle
from gmrdata.gmr.checkpoint import read_model, read_state, trained_checkpoint
from gmrdata.gmr.config import Which
from gmrdata.gmr.model import Gmr, MeanGmr, network_input
from gmrdata.gmr.runs import runs_at
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadCheckpoint, BadMotionFile
from gmrdata.values.motion import Motion, without_root
from gmrdata.values.motion_deltas import accumulate
from gmrdata.values.shapes import Float


@dataclass(frozen=True, eq=False)
class TrainedGmr:
    """A network in evaluation mode, with what it takes to use it."""

    model: Gmr | MeanGmr
    fps_hz: float  # frame rate that it was trained at
    name: str  # of the run's folder, or the bundle's own
    step: int  # training steps behind the weights


def load_gmr(run_dir: Path | str, which: Which = "latest") -> TrainedGmr:
    """The latest checkpoint of a training run, or what scored best on its held-out clips.

    Or a folder of weights alone, as `gmrdata.gmr.bundled` has one, which has no other weights.
    MissingInput where there is none, BadCheckpoint where it is broken or has no best weights.
    """
    run_dir = Path(run_dir)
    if (run_dir / BUNDLE_FILE).is_file():
        return _load_bundle(run_dir, which)
    folder = trained_checkpoint(run_dir)
    state = read_state(folder)
    model = read_model(folder, which).eval()
    step = state.best.step if which == "best" and state.best is not None else state.step
    return TrainedGmr(model, state.fps_hz, run_dir.name, step)


def _load_bundle(folder: Path, which: Which) -> TrainedGmr:
    if which == "best":
        raise BadCheckpoint(f"{folder}: has the latest weights alone. Use those")
    bundle, model = read_bundle(folder)
    return TrainedGmr(model.eval(), bundle.fps_hz, bundle.name, bundle.step)


def predict_deltas(
    gmr: TrainedGmr, local_rotmats: Float[np.ndarray, "frames 23 3 3"]
) -> tuple[Float[np.ndarray, "frames-1 3 3"], Float[np.ndarray, "frames-1 3"]]:
    """dR, orthonormal to float64, and dT [m] between local poses at the network's frame rate."""
    poses = network_input(
        torch.as_tensor(np.ascontiguousarray(local_rotmats), dtype=torch.float64),
        gmr.model.config.input,
        gmr.model.config.extra_inputs,
    )
    device = next(gmr.model.parameters()).device
    with torch.no_grad():
        delta_rotmats, delta_m = gmr.model(poses.float()[None].to(device))
    # Rounding errors of float32 would grow over thousands of accumulated frames.
    orthonormal = Rotation.from_matrix(delta_rotmats[0, :-1].cpu().double().numpy()).as_matrix()
    return orthonormal, delta_m[0, :-1].cpu().double().numpy()


def predict_world_motion(
    gmr: TrainedGmr,
    motion: Motion,
    *,
    first_root_rotmat: Float[np.ndarray, "3 3"] | None = None,
    first_pelvis_m: Float[np.ndarray, "3"] | None = None,
) -> Motion:
    """World motion of a person from the local pose alone, by eqs. 3-4 (paper, section 3.6).

    The motion's own root is not looked at.  With the paper's first pose, the identity, the world is
    the body's own frame at the first moment (x to its left, y up, z to its front); give the first
    pose to have another world.

    Args:
        motion: Two or more local poses, at the network's frame rate or above, to be resampled.
        first_root_rotmat: R_1, world_from_root; the identity if None.
        first_pelvis_m: T_1 [m]; the origin if None.
    """
    local = _at_network_rate(gmr, motion)
    delta_rotmats, delta_m = predict_deltas(gmr, local.local_rotmats)
    root_rotmats, pelvis_m = accumulate(
        delta_rotmats,
        delta_m,
        np.eye(3) if first_root_rotmat is None else np.asarray(first_root_rotmat, np.float64),
        np.zeros(3) if first_pelvis_m is None else np.asarray(first_pelvis_m, np.float64),
    )
    source = f"world motion predicted by GMR {gmr.name} (step {gmr.step}) from: {motion.source}"
    if abs(motion.fps_hz - gmr.fps_hz) > 1e-6 * gmr.fps_hz:
        source += f", resampled from {motion.fps_hz:g} to {gmr.fps_hz:g} fps"
    return replace(
        local, root_rotmats=root_rotmats, pelvis_m=pelvis_m, frame="world", source=source
    )


def _at_network_rate(gmr: TrainedGmr, motion: Motion) -> Motion:
    """The motion at the network's rate, without its roots, which may be absent."""
    n = motion.n_frames
    clip = Clip(motion.source, without_root(motion), np.ones(n, bool), np.full(n, -1), None)
    runs = runs_at(clip, gmr.fps_hz, all_phases=False)
    if not runs:
        raise BadMotionFile(
            f"{motion.source}: {n} frames at {motion.fps_hz:g} fps are less than two frames at"
            f" {gmr.fps_hz:g} fps. Give a longer motion"
        )
    return runs[0]
