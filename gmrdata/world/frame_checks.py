"""Why single frames must not be used: each check compares one figure with one threshold."""

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.cameras.files import CamerasQuality
from gmrdata.values import transforms
from gmrdata.values.clip import Clip, camera_of
from gmrdata.world.recipe import VerdictConfig


def relative_moves(world_from_cam: np.ndarray, step: int) -> np.ndarray:
    """(T - step, 4, 4) motion over `step` frames, in the axes of the first camera of each."""
    return np.asarray(transforms.invert(world_from_cam[:-step]) @ world_from_cam[step:])


def angles_deg(moves: np.ndarray) -> np.ndarray:
    """(N,) rotation angles of transforms (N, 4, 4) [degrees]; NaN where unknown."""
    known = np.isfinite(moves).all(axis=(1, 2))
    angles = np.full(len(moves), np.nan)
    if known.any():
        angles[known] = Rotation.from_matrix(moves[known, :3, :3]).magnitude()
    return np.rad2deg(angles)


def window_differences(
    world_from_cam: np.ndarray, dataset_camera: np.ndarray, step: int
) -> tuple[np.ndarray, np.ndarray]:
    """How differently two cameras (T, 4, 4) move over `step` frames.

    Returns:
        Difference of the rotations (T - step,) [degrees], and of the displacements (T - step,) [m];
        NaN where either camera is unknown.
    """
    ours, theirs = relative_moves(world_from_cam, step), relative_moves(dataset_camera, step)
    apart_m = np.linalg.norm(ours[:, :3, 3] - theirs[:, :3, 3], axis=1)
    return angles_deg(transforms.invert(ours) @ theirs), apart_m


ANOTHER_PLACE = "no camera was found: the picture shows another place, beyond a cut"
NOTHING_SEEN = "no camera was found: the picture is black or even, or all of it is masked"


def frame_reasons(
    clip: Clip,
    quality: CamerasQuality,
    sfm_rows: np.ndarray,
    config: VerdictConfig,
    *,
    unusable: Sequence[str] | None,
    dataset_camera: np.ndarray | None,
) -> list[str]:
    """Why each of the T frames must not be used; empty where it may.  Arguments as in `judge`."""
    camera, fps_hz = camera_of(clip), clip.motion.fps_hz
    n = camera.n_frames
    reasons = list(unusable) if unusable is not None else [""] * n
    _mark(reasons, sfm_rows < 0, "it has no image")
    _mark(reasons, _behind_cut(quality, sfm_rows, camera.has_camera), ANOTHER_PLACE)
    featureless = np.isin(sfm_rows, quality.featureless)
    _mark(reasons, ~camera.has_camera & featureless, NOTHING_SEEN)
    _mark(reasons, ~camera.has_camera, "no camera was found")
    _mark(reasons, ~clip.valid, "the body is not known")
    inliers = np.array(quality.inliers_per_frame)[sfm_rows]
    # An interpolated camera has none of its own; it is marked, and held by its neighbours.
    few = (inliers < config.min_inliers) & ~np.isin(sfm_rows, quality.interpolated)
    _mark(reasons, few, f"fewer than {config.min_inliers} inliers")
    _mark(reasons, _both_sides(jumps(clip, config), 1, n), "the camera jumps")
    if dataset_camera is not None:
        step = max(1, round(config.window_s * fps_hz))
        off = _disagrees(camera.world_from_cam, dataset_camera, step, config)
        _mark(reasons, _both_sides(off, step, n), "the camera moves otherwise than the data set's")
    return reasons


def jumps(clip: Clip, config: VerdictConfig) -> np.ndarray:
    """(T - 1,) bool: steps between frames that are too far for a camera that somebody holds."""
    steps = relative_moves(camera_of(clip).world_from_cam, 1)
    metres_per_s = np.linalg.norm(steps[:, :3, 3], axis=1) * clip.motion.fps_hz
    degrees_per_s = angles_deg(steps) * clip.motion.fps_hz
    # A comparison with NaN is False: an unknown step is no jump.
    return (metres_per_s > config.max_speed_m_per_s) | (degrees_per_s > config.max_turn_deg_per_s)


def _behind_cut(
    quality: CamerasQuality, sfm_rows: np.ndarray, has_camera: np.ndarray
) -> np.ndarray:
    """(T,) bool: frames of a stretch between two cuts in which no frame has a camera."""
    cuts = np.array(quality.cuts_after_frames, dtype=int)
    stretch = np.searchsorted(cuts, sfm_rows)
    placed = np.unique(stretch[has_camera])
    return ~np.isin(stretch, placed) & (len(cuts) > 0)


def _disagrees(
    world_from_cam: np.ndarray, dataset_camera: np.ndarray, step: int, config: VerdictConfig
) -> np.ndarray:
    """(T - step,) bool: windows in which the two cameras move differently."""
    apart_deg, apart_m = window_differences(world_from_cam, dataset_camera, step)
    # A comparison with NaN is False: what is unknown doesn't disagree.
    return (apart_deg > config.max_window_deg) | (apart_m > config.max_window_m)


def _both_sides(steps: np.ndarray, step: int, n: int) -> np.ndarray:
    """(n,) bool: frames at either end of a marked step."""
    first, last = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    first[: n - step], last[step:] = steps, steps
    return first | last


def _mark(reasons: list[str], bad: np.ndarray, reason: str) -> None:
    for row in np.flatnonzero(bad):
        reasons[row] = reasons[row] or reason


def without_short_runs(reasons: list[str], min_run: int) -> list[str]:
    """The reasons, with one more for runs of fewer usable frames than `min_run`."""
    result: list[str] = []
    for kept, group in groupby(reasons, key=lambda reason: not reason):
        run = list(group)
        short = kept and len(run) < min_run and len(run) < len(reasons)
        result += [f"only {len(run)} usable frames in a row"] * len(run) if short else run
    return result
