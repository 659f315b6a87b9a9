"""Augmentations: left and right exchanged, random turns of the joints; four ways.

A motion is reflected in a vertical plane of the world, x -> -x, and each joint takes over from its
counterpart on the other side.  In the body's frame, x to its left, that is the same reflection
M = diag(-1, 1, 1): a local rotation R becomes M R M, and of the motion between frames dR becomes
M dR M and dT becomes M dT.  The mirrored body is exactly the body's mirror image where its two
sides are alike.

A network that is trained on windows with left and right exchanged and on windows played backwards
should answer alike to a sequence, its mirror image, its reverse, and both.  Where it doesn't, the
mean of its four answers, each turned back, is nearer to the truth than one of them.
"""

import numpy as np
import torch
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation
from torch import Tensor

from gmrdata.gmr import rotations
from gmrdata.gmr.config import WindowConfig
from gmrdata.gmr.rotations import Answer, Lengths
from gmrdata.values.body import MIRROR, MIRRORED
from gmrdata.values.shapes import Float, Int

COUNTERPARTS = [joint - 1 for joint in MIRRORED[1:]]
"""Row of each joint's counterpart among the 23 local rotations."""
SIGNS = np.outer(MIRROR, MIRROR)
"""M R M multiplies each entry of R by one of these."""


def four_ways(
    local_rotmats: Float[Tensor, "batch frames 23 3 3"], lengths: Lengths
) -> list[Float[Tensor, "batch frames 23 3 3"]]:
    """As given, mirrored, reversed, and both.  `lengths` frames are real; None: all.

    Behind its end a sequence holds its last pose.
    """
    at, last = _at_and_last(local_rotmats, lengths)
    ways = []
    for frames in (torch.minimum(at, last), (last - at).clamp(min=0)):
        played = _frames_of(local_rotmats, frames)
        ways += [played, played[:, :, COUNTERPARTS] * played.new_tensor(SIGNS)]
    return ways


def turned_back(motions: list[Answer], lengths: Lengths) -> list[Answer]:
    """Motions that belong to `four_ways`, as motions of the sequence that was given.

    dR of frames i to i+1 is the transpose of the one back, dR', and dT = -dR dT'.  What leads out
    of a sequence, its last motion, has no meaning.
    """
    at, last = _at_and_last(motions[0][1], lengths)
    back = (last - 1 - at).clamp(min=0)
    answers = []
    for way, (turns, moves_m) in enumerate(motions):
        if way % 2:
            turns, moves_m = turns * turns.new_tensor(SIGNS), moves_m * moves_m.new_tensor(MIRROR)
        if way >= 2:
            turns, moves_m = _frames_of(turns.transpose(-1, -2), back), _frames_of(moves_m, back)
            moves_m = -(turns @ moves_m[..., None])[..., 0]
        answers.append((turns, moves_m))
    return answers


def mean_motion(motions: list[Answer]) -> Answer:
    """Mean of dR and dT.

    Rotations are averaged as unit quaternions on the first one's side: the chordal mean on SO(3)
    (Hartley et al. 2013, section 5.3), which does not depend on their order.
    """
    if len(motions) == 1:
        return motions[0]
    delta_m = torch.stack([moves_m for _, moves_m in motions]).mean(0)
    turns = torch.stack([rotations.from_rotmats(rotmats, "quaternion") for rotmats, _ in motions])
    sides = torch.where((turns * turns[0]).sum(-1, keepdim=True) < 0, -turns, turns)
    return rotations.to_rotmats(sides.mean(0), "quaternion"), delta_m


def _at_and_last(values: Tensor, lengths: Lengths) -> tuple[Tensor, Tensor]:
    """Numbers of the frames (1, frames), and of each sequence's last one (batch or 1, 1)."""
    at = torch.arange(values.shape[1], device=values.device)[None]
    return at, at[:, -1:] if lengths is None else lengths.to(values.device)[:, None] - 1


def _frames_of(values: Tensor, frames: Int[Tensor, "batch frames"]) -> Tensor:
    """Each sequence's values (batch, frames, ...) in another order of its frames."""
    rows = torch.arange(values.shape[0], device=values.device)[:, None]
    return values[rows, frames]


def mirror_local(
    local_rotmats: Float[np.ndarray, "*batch 23 3 3"],
) -> Float[np.ndarray, "*batch 23 3 3"]:
    return mirror_rotmats(local_rotmats[..., COUNTERPARTS, :, :])


def mirror_rotmats(rotmats: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """M R M, for a root or a motion between frames."""
    return rotmats * SIGNS.astype(rotmats.dtype)


def mirror_points_m(points_m: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """M p, for a pelvis or a motion between frames [m]."""
    return points_m * np.array(MIRROR, points_m.dtype)


def is_turned(config: WindowConfig) -> bool:
    """Whether `turned` does anything."""
    return max(config.pose_noise_deg, config.jitter_deg) > 0


def turned(
    local_rotmats: Float[np.ndarray, "*batch frames 23 3 3"],
    config: WindowConfig,
    rng: np.random.Generator,
) -> Float[np.ndarray, "*batch frames 23 3 3"]:
    """Local rotations with each joint turned by `pose_noise_deg` and `jitter_deg`: R exp(n), with
    axis-angle vectors n of normal distribution."""
    rotvecs_rad = np.zeros(local_rotmats.shape[:-1])
    if config.pose_noise_deg > 0:
        noise = rng.normal(size=rotvecs_rad.shape)
        if config.pose_noise_time_s > 0:
            noise = _smoothed(noise, config.pose_noise_time_s * config.fps_hz)
        rotvecs_rad += _per_axis_rad(config.pose_noise_deg) * noise
    if config.jitter_deg > 0:
        most = _per_axis_rad(config.jitter_deg)
        share = rng.random((*rotvecs_rad.shape[:-3], 1, 1, 1))
        rotvecs_rad += most * share * rng.normal(size=rotvecs_rad.shape)
    turns = Rotation.from_rotvec(rotvecs_rad.reshape(-1, 3)).as_matrix()
    return local_rotmats @ turns.reshape(local_rotmats.shape).astype(local_rotmats.dtype)


def _per_axis_rad(deg: float) -> float:
    """Three numbers of variance 1 make a vector of mean square length 3."""
    return float(np.deg2rad(deg) / np.sqrt(3))


def _smoothed(noise: np.ndarray, sigma_frames: float) -> np.ndarray:
    """Noise (..., T, 23, 3) smoothed in time, of the variance that it had.

    The window's end is followed by its beginning, so that all frames have the same variance: the
    sum of the squared weights, which is what a single 1 becomes.
    """
    weights = gaussian_filter1d(np.eye(1, noise.shape[-3])[0], sigma_frames, mode="wrap")
    smooth = gaussian_filter1d(noise, sigma_frames, axis=-3, mode="wrap")
    return np.asarray(smooth / np.sqrt((weights**2).sum()))
