"""Metres per unit of a reconstruction, with an error bar, from independent cues.

The person is metric, so their planted feet stand still (`planted_feet`) and on the triangulated
ground (`ground_contact`) at the true scale only.  A data set's own metric camera path tells its
length over short times, where it hardly drifts (`short_windows`).
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.geometry.camera import CameraPath
from gmrdata.motion.motion import Motion
from gmrdata.sfm.cameras import Geometry
from gmrdata.sfm.cues import CueEstimate, ScaleConfig
from gmrdata.sfm.feet import foot_points_m
from gmrdata.sfm.ground_contact import ground_contact_scale
from gmrdata.sfm.planted_feet import planted_feet_scale
from gmrdata.sfm.short_windows import short_windows_scale


@dataclass(frozen=True)
class ScaleEstimate:
    """Fused metric scale."""

    scale: float | None
    """Metres per unit of the reconstruction; None where scale doesn't enter."""
    sigma: float | None
    """Standard error of `scale`; widened where the cues disagree."""
    cues: tuple[CueEstimate, ...]
    """Each source of evidence by itself."""

    @property
    def disagreement(self) -> float | None:
        """Largest difference of two cues, in its standard errors; None for one cue."""
        apart = [
            abs(a.scale - b.scale) / float(np.hypot(a.sigma, b.sigma))
            for a, b in combinations(self.cues, 2)
        ]
        return max(apart, default=None)


def estimate_scale(
    camera_path: CameraPath,
    camera_motion: Motion,
    body: BodyModel,
    geometry: Geometry,
    config: ScaleConfig,
    *,
    points: np.ndarray | None = None,
    tracked: np.ndarray | None = None,
) -> ScaleEstimate:
    """Metric scale of a camera path from the person who walks in front of it.

    Args:
        camera_path: T cameras up to scale.
        camera_motion: The person in those cameras' frames, T frames.
        body: The person's body.
        geometry: Only "full" has a scale to be found.
        config: The recipe.
        points: (N, 3) background points in the cameras' unit, for the cue of the ground.
        tracked: (T, 4, 4) metric world_from_cam of the data set, right over short times; NaN where
            unknown.

    Raises:
        NoReconstruction: no foot stands still at any scale, or the camera hardly moves.
    """
    if geometry != "full":
        return ScaleEstimate(None, None, ())
    feet_cam_m = foot_points_m(body, camera_motion)
    fps_hz = camera_motion.fps_hz
    feet = planted_feet_scale(camera_path, feet_cam_m, fps_hz, config)
    cues = [feet]
    if points is not None:
        up_cam = camera_motion.root_rotmats[:, :, 1]
        found = ground_contact_scale(
            camera_path, points, feet_cam_m, up_cam, fps_hz, feet.scale, config
        )
        cues += [] if found is None else [found]
    if tracked is not None:
        found = short_windows_scale(camera_path, tracked, fps_hz, config)
        cues += [] if found is None else [found]
    return fuse(tuple(cues))


def fuse(cues: tuple[CueEstimate, ...]) -> ScaleEstimate:
    """Mean of the cues, weighted by their inverse variances.

    Where they scatter more than their errors allow, the error of the mean is widened by the square
    root of chi-square per degree of freedom (Birge 1932).
    """
    scales, weights = (
        np.array([cue.scale for cue in cues]),
        np.array([cue.sigma**-2 for cue in cues]),
    )
    scale = float(weights @ scales / weights.sum())
    chi_square = float(weights @ (scales - scale) ** 2)
    widened = max(1.0, chi_square / max(1, len(cues) - 1)) ** 0.5
    return ScaleEstimate(scale, float(weights.sum() ** -0.5) * widened, cues)
