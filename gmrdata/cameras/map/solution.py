"""The cameras of all frames in one geometry, short gaps filled, and the figures behind them."""

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import krogh_interpolate

from gmrdata.cameras import files
from gmrdata.cameras.colmap import LOSS_PX
from gmrdata.cameras.frames import Timeline
from gmrdata.cameras.map.focal import FreedFocal
from gmrdata.cameras.map.rotation_only import RotationOnly
from gmrdata.cameras.match.keyframes import Keyframes
from gmrdata.cameras.match.tracks import Tracks
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values import transforms
from gmrdata.values.camera import fill_gaps

SeenPoints = dict[int, np.ndarray]
"""By frame: (N, 2) int32, its features that show points, and the rows of these points."""


@dataclass(frozen=True, eq=False)
class Placed:
    """Cameras of T frames and the points that hold them; filled frame by frame."""

    world_from_cam: np.ndarray  # (T, 4, 4); NaN where there is no camera
    inliers: np.ndarray  # (T,) points that hold each camera
    points: np.ndarray  # (N, 3)
    seen: SeenPoints


@dataclass(frozen=True, eq=False)
class Solution:
    """Cameras of T frames up to a similarity, in one geometry, and what holds them."""

    geometry: files.Geometry
    mapper: files.Mapper
    world_from_cam: np.ndarray  # (T, 4, 4); NaN where there is no camera
    errors_px: np.ndarray  # (M,) reprojection error of each observation or agreeing match [px]
    inliers: np.ndarray  # (T,) points or matches that hold each camera
    focal: FreedFocal | None  # What the background would choose; None where it doesn't say
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    """(N, 3) background points [unit of length of the cameras]; none but for "full"."""
    track_lengths: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """(N,) frames of the adjustment that see each point."""
    models: tuple[files.ModelRecord, ...] = ()
    n_resected: int = 0
    """Frames that the mapper left out, or that show what others show, which its points placed."""
    seen: SeenPoints = field(default_factory=dict)
    adjusted: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """(T,) frames that the bundle adjustment had; none but for "full"."""
    tracks: Tracks | None = None  # In the pixels of the frames; None but for "full"
    mean_error_px: float | None = None  # COLMAP's mean of `errors_px`; None but for "full"
    weakest_step: files.WeakestStep | None = None  # None but for "full"
    second_share: float | None = None
    """Share of the keyframes of a second solution, of a part of them alone, that have a camera here
    and there; None where they are too few for one."""
    agreement: files.Agreement | None = None  # With that solution; None where there is none
    loss_px: float = LOSS_PX  # Scale of the loss of its bundle adjustment
    lens: files.Distortion | None = (
        None  # Taken out of the image points; None where there was hardly any
    )
    largest_turn_deg: float | None = None  # Largest turn from the mean orientation; None for "full"
    smoothing: files.Smoothing = files.NOT_SMOOTHED

    @property
    def has_camera(self) -> np.ndarray:
        """(T,) bool: frames with a camera."""
        return np.isfinite(self.world_from_cam[:, 0, 0])

    def is_confirmed_by(self, share: float) -> bool:
        """Whether a second solution has a camera for so many of its keyframes, so that it tells."""
        return (self.second_share or 0.0) >= share


def turning_solution(
    turning: RotationOnly,
    smoothing: files.Smoothing,
    focal: FreedFocal | None,
    focal_px: float,
    config: SfmConfig,
) -> Solution:
    """A camera at the origin that only turns, or does not move at all."""
    known, n_frames = turning.world_from_cam_rotmats[turning.has_camera], len(turning.has_camera)
    turn_rad = float(transforms.turns_about_mean_rad(known).max())
    static = focal_px * turn_rad <= config.static_px
    world_from_cam = turning.world_from_cam
    if static:
        world_from_cam[turning.has_camera] = np.eye(4)
    agree = turning.residuals_px < config.rotation_only_inlier_px
    rows = turning.pairs_rows[turning.pair_of_residual[agree]]
    return Solution(
        geometry="static" if static else "rotation_only",
        mapper="rotation_only",
        world_from_cam=world_from_cam,
        errors_px=turning.residuals_px[agree],
        inliers=np.bincount(rows.ravel(), minlength=n_frames),
        focal=focal,
        largest_turn_deg=float(np.rad2deg(turn_rad)),
        smoothing=files.NOT_SMOOTHED if static else smoothing,
    )


def fill_short_gaps(
    world_from_cam: np.ndarray, timeline: Timeline, max_gap_frames: int
) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate cameras over short gaps; ends, longer gaps and cuts stay as they are.

    Places follow the cubic through the two placed frames on either side, or a polynomial of lower
    degree where fewer are within reach; rotations are slerped.  Returns world_from_cam (T, 4, 4),
    and which frames were filled, (T,) bool.
    """
    has_camera, numbers = np.isfinite(world_from_cam[:, 0, 0]), timeline.image_numbers
    placed, interpolated = np.flatnonzero(has_camera), np.zeros_like(has_camera)
    near = timeline.near(placed, max_gap_frames)
    filled, everywhere = world_from_cam.copy(), fill_gaps(world_from_cam, has_camera, numbers)
    for gap in np.flatnonzero(near & (np.diff(placed) > 1)):
        between = np.arange(placed[gap] + 1, placed[gap + 1])
        first = gap - 1 if gap > 0 and near[gap - 1] else gap
        last = gap + 2 if gap + 1 < len(near) and near[gap + 1] else gap + 1
        knots = placed[first : last + 1]
        filled[between] = everywhere[between]
        filled[between, :3, 3] = krogh_interpolate(
            numbers[knots], world_from_cam[knots, :3, 3], numbers[between]
        )
        interpolated[between] = True
    return filled, interpolated


def quality_of(
    solution: Solution,
    interpolated: np.ndarray,
    evidence: files.Evidence,
    keys: Keyframes,
    travel_set_aside: float | None,
    size_px: tuple[int, int],
) -> files.CamerasQuality:
    """The figures of a solution, and which of its gaps are to be filled, (T,) bool."""
    n_frames, n_found = len(solution.world_from_cam), int(solution.has_camera.sum())
    lengths, focal = solution.track_lengths, solution.focal
    mean_px = solution.mean_error_px
    if mean_px is None:
        mean_px = float(solution.errors_px.mean())
    return files.CamerasQuality(
        geometry=solution.geometry,
        mapper=solution.mapper,
        evidence=evidence,
        travel_set_aside=travel_set_aside,
        frames=n_frames,
        frames_with_camera=n_found,
        registered_share=n_found / n_frames,
        mean_reprojection_px=mean_px,
        median_reprojection_px=float(np.median(solution.errors_px)),
        inliers_per_frame=tuple(solution.inliers.tolist()),
        interpolated=tuple(np.flatnonzero(interpolated).tolist()),
        keyframes=tuple(keys.rows.tolist()),
        cuts_after_frames=tuple(keys.cuts.tolist()),
        featureless=tuple(keys.featureless.tolist()),
        models=solution.models,
        resected_frames=solution.n_resected,
        focal_factor=focal.factor if focal else None,
        focal_sigma=focal.sigma if focal else None,
        radial_k1=focal.radial_k1 if focal else None,
        radial_k1_sigma=focal.radial_k1_sigma if focal else None,
        lens=solution.lens,
        weakest_step=solution.weakest_step,
        second_share=solution.second_share,
        agreement=solution.agreement,
        smoothing=solution.smoothing,
        points=len(solution.points) if solution.geometry == "full" else None,
        median_track_length=float(np.median(lengths)) if len(lengths) else None,
        largest_turn_deg=solution.largest_turn_deg,
        worked_on_px=size_px,
    )
