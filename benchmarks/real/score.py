"""Cameras beside the true ones: errors of place and turn by evo, and whether they are right."""

from dataclasses import dataclass

import numpy as np
from evo.core.geometry import GeometryException
from evo.core.metrics import APE, RPE, PoseRelation, Unit
from evo.core.trajectory import PosePath3D
from scipy.spatial.transform import Rotation

from gmrdata.values.transforms import fit_similarity, mean_rotation

MOST_SHARE, MOST_TURN_DEG = 0.03, 1.5
"""What is right: ATE over the extent of the path, and the error of orientation."""
FEWEST = 3


@dataclass(frozen=True)
class Errors:
    """Cameras of some frames beside the true ones, after the similarity of least squares."""

    ate_mm: float
    """Root mean square of the distances."""
    rpe_mm: float | None
    """The same of the steps over one frame; None where no two frames follow each other."""
    rpe_deg: float | None
    turn_deg: float
    """Root mean square of the angles, after the best common turn."""
    extent_mm: float
    """Diagonal of the box round the true places."""
    scale_drift: float
    """Scale of the second half of the frames over that of the first, less 1."""

    @property
    def right(self) -> bool:
        """Whether cameras are right."""
        return self.ate_mm <= MOST_SHARE * self.extent_mm and self.turn_deg <= MOST_TURN_DEG


def errors(found: np.ndarray, true: np.ndarray, rows: np.ndarray) -> Errors | None:
    """Errors of world_from_cam (T, 4, 4) in some rows (N,); None where fewer than three are known.

    Cameras that are all in one place have no scale: their distances are those of the true ones
    from their middle.
    """
    rows = rows[np.isfinite(found[rows, 0, 0]) & np.isfinite(true[rows, 0, 0])]
    if len(rows) < FEWEST:
        return None
    reference, moved = PosePath3D(poses_se3=list(true[rows])), _aligned(found, true, rows)
    distance = APE(PoseRelation.translation_part)
    distance.process_data((reference, moved))
    steps = [(true[run], poses) for run, poses in _runs(moved, rows)]
    turns = found[rows, :3, :3] @ np.swapaxes(true[rows, :3, :3], 1, 2)
    left = mean_rotation(turns).T @ turns
    extent_m = np.linalg.norm(np.ptp(true[rows, :3, 3], axis=0))
    return Errors(
        ate_mm=1000 * _rms(distance.error),
        rpe_mm=_steps(steps, PoseRelation.translation_part, 1000),
        rpe_deg=_steps(steps, PoseRelation.rotation_angle_deg, 1),
        turn_deg=float(np.rad2deg(_rms(Rotation.from_matrix(left).magnitude()))),
        extent_mm=float(1000 * extent_m),
        scale_drift=_scale_drift(found, true, rows),
    )


def still_error(found: np.ndarray, distance: float | None, rows: np.ndarray) -> tuple[float, float]:
    """Of a camera that stays: extent of its places over the background's distance, and its turn
    from its mean orientation [degrees]."""
    rotmats = found[rows, :3, :3]
    left = mean_rotation(rotmats).T @ rotmats
    turn_deg = float(np.rad2deg(_rms(Rotation.from_matrix(left).magnitude())))
    extent = float(np.linalg.norm(np.ptp(found[rows, :3, 3], axis=0)))
    return (extent / distance if distance else 0.0), turn_deg


def _aligned(found: np.ndarray, true: np.ndarray, rows: np.ndarray) -> PosePath3D:
    path = PosePath3D(poses_se3=list(found[rows]))
    reference = PosePath3D(poses_se3=list(true[rows]))
    try:
        path.align(reference, correct_scale=True)
    except GeometryException:
        path = PosePath3D(poses_se3=list(_in_the_middle(found, true, rows)))
    return path


def _in_the_middle(found: np.ndarray, true: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Cameras without a way, where the true ones are on average."""
    poses = found[rows].copy()
    turn = mean_rotation(true[rows, :3, :3] @ np.swapaxes(poses[:, :3, :3], 1, 2))
    poses[:, :3, :3] = turn @ poses[:, :3, :3]
    poses[:, :3, 3] = true[rows, :3, 3].mean(axis=0)
    return poses


def _runs(moved: PosePath3D, rows: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rows that follow each other without a gap, and their cameras."""
    poses = np.array(moved.poses_se3)
    parts = np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows) > 1) + 1)
    return [(rows[part], poses[part]) for part in parts if len(part) > 1]


def _steps(
    runs: list[tuple[np.ndarray, np.ndarray]], relation: PoseRelation, factor: float
) -> float | None:
    found = []
    for true, moved in runs:
        metric = RPE(relation, delta=1, delta_unit=Unit.frames)
        metric.process_data((PosePath3D(poses_se3=list(true)), PosePath3D(poses_se3=list(moved))))
        found.append(metric.error)
    return factor * _rms(np.concatenate(found)) if found else None


def _scale_drift(found: np.ndarray, true: np.ndarray, rows: np.ndarray) -> float:
    first, second = np.array_split(rows, 2)
    scales = []
    for half in (first, second):
        centres = found[half, :3, 3]
        if np.ptp(centres, axis=0).max() < 1e-9:
            return 0.0
        scales.append(fit_similarity(true[half, :3, 3], centres, scale=True).scale)
    return scales[1] / scales[0] - 1 if min(scales) > 0 else np.inf


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
