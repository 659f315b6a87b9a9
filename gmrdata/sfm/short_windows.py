"""Scale from a data set's own metric camera path, which drifts but is right at short times."""

import numpy as np

from gmrdata.geometry.camera import CameraPath
from gmrdata.sfm.cues import CueEstimate, ScaleConfig

FEWEST_WINDOWS = 5


def short_windows_scale(
    camera_path: CameraPath, tracked: np.ndarray, fps_hz: float, config: ScaleConfig
) -> CueEstimate | None:
    """Scale at which both cameras travel equally far in equal short times.

    Each window's displacement is taken in the axes of its first camera, so neither path needs the
    other's world.  The slow drift of the data set's path is an error that windows within
    `drift_time_s` share.

    Args:
        camera_path: T cameras up to scale; NaN where unknown.
        tracked: (T, 4, 4) metric world_from_cam of the same frames; NaN where unknown.
        fps_hz: Frame rate [Hz].
        config: The recipe.

    Returns:
        None where fewer than five windows are known, or the camera doesn't travel.
    """
    step = max(1, round(config.window_s * fps_hz))
    if camera_path.n_frames - step < FEWEST_WINDOWS:
        return None
    moves, moves_m = _moves(camera_path.world_from_cam, step), _moves(tracked, step)
    known = np.isfinite(moves).all(axis=1) & np.isfinite(moves_m).all(axis=1)
    moves, moves_m = moves[known], moves_m[known]
    power = float((moves**2).sum())
    if len(moves) < FEWEST_WINDOWS or power <= 0:
        return None
    scale = float((moves * moves_m).sum()) / power
    if scale <= 0:
        return None
    residual_m = float(np.sqrt(np.mean((moves_m - scale * moves) ** 2)))
    independent = max(1.0, known.sum() / fps_hz / config.drift_time_s)
    # One axis of the residual points along the way, on average over the windows.
    length = np.sqrt(power / len(moves))
    along = config.drift_m_per_s * step / fps_hz / length
    sigma = float(np.hypot(residual_m / length / np.sqrt(independent), along))
    return CueEstimate("short_windows", scale, sigma, len(moves), residual_m)


def _moves(world_from_cam: np.ndarray, step: int) -> np.ndarray:
    """Displacements (T - step, 3) over `step` frames, in the axes of the first camera of each."""
    centres = world_from_cam[:, :3, 3]
    return np.einsum("tji,tj->ti", world_from_cam[:-step, :3, :3], centres[step:] - centres[:-step])
