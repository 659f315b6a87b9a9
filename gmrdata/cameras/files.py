"""The files of a reconstruction: cameras up to scale, points, and the figures behind them."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, Self, cast, get_args

import numpy as np
from numpy.typing import ArrayLike
from pydantic import NonNegativeInt, PositiveInt, model_validator
from pydantic.dataclasses import dataclass as part

from gmrdata.values import records
from gmrdata.values.camera import CameraPath, Lens, Origin, bent, turning_points
from gmrdata.values.errors import BadRecord
from gmrdata.values.files import write_npz
from gmrdata.values.records import PART, Figure

CAMERAS_FILE = "cameras.npz"
POINTS_FILE = "points.npz"
QUALITY_FILE = "quality.json"

Geometry = Literal["full", "rotation_only", "static"]
"""What the camera does: six degrees of freedom up to scale; turn about a fixed centre; nothing."""
Mapper = Literal["global", "incremental", "small_parallax", "rotation_only"]
"""What found the cameras; "small_parallax" is the incremental mapper with lower thresholds."""


@part(frozen=True, config=PART)
class Evidence:
    """Figures behind the choice of a geometry, and what they say; residuals of a pure rotation."""

    verdict: Literal["rotation_only", "full", "either"]
    """"either": a pure rotation fits, but its residuals grow with the baseline."""
    reason: str
    """The verdict in words, with its figures and thresholds."""
    rotation_only_median_px: Figure
    """Of all matches [px]."""
    rotation_only_wide_median_px: Figure
    """90th percentile of the pairs' medians [px]."""
    rotation_only_near_median_px: Figure
    """10th percentile of the pairs' medians [px]."""
    rotation_only_share: Figure
    """Share of the matches that agree."""
    panoramic_pairs_share: Figure
    """Share of the pairs that COLMAP's two-view test calls panoramic."""
    pairs: int
    features_per_frame: Figure
    """Median over frames."""


@part(frozen=True, config=PART)
class ModelRecord:
    """What became of one model that a mapper returned, and why."""

    frames: int
    kept: bool
    reason: str


@part(frozen=True, config=PART)
class WeakestStep:
    """Where the cameras before and those after hold together least, at an unknown scale between."""

    after: NonNegativeInt
    """Row of the last keyframe before the step."""
    before: NonNegativeInt
    """Row of the first keyframe after it."""
    loose_share: Figure
    """Standard error of the places of one side, given the other, over the way of both."""
    moving_share: Figure
    """Share of the matches that don't move as the cameras say, in the worst tenth of the pairs."""
    distance_ratio: Figure
    """Largest ratio, at any step, of the distances of what two successive keyframes see: the least
    of those of the medians, of the near tenths, and of the means by how well each is known."""

    @property
    def loose_moving_share(self) -> float:
        """What moves as one for a while bends a model the more, the less holds it."""
        return self.loose_share * self.moving_share


@part(frozen=True, config=PART)
class Agreement:
    """How far two solutions of the same frames agree, after the best similarity between them."""

    cameras: NonNegativeInt
    """Frames of which both have a camera."""
    turn_deg: Figure
    """Root mean square of the angles between their orientations."""
    place_share: Figure
    """That of the distances between their places, as a share of the way; 0 for those that only
    turn.  A way of less than a tenth of the background's distance counts as so long."""


@part(frozen=True, config=PART)
class SmoothTurn:
    """What the prior assumed of the camera's turn, and what came of it."""

    acceleration_deg_per_frame2: Figure
    """Standard deviation of the change of the turn, per axis."""
    noise_deg: Figure
    """What the images leave open of a camera's orientation, per axis."""
    largest_change_deg: Figure
    cutoff_cycles_per_frame: Figure
    """Frequency of which half is passed; 0.5 where all is."""


@part(frozen=True, config=PART)
class SmoothPlace:
    """The same of the camera's place, as shares of the background's median distance."""

    acceleration_share_per_frame2: Figure
    noise_share: Figure
    largest_change_share: Figure
    cutoff_cycles_per_frame: Figure


@part(frozen=True, config=PART)
class Smoothing:
    """How all frames were refined together."""

    turn: SmoothTurn | None
    """None for a static camera, and where too few frames follow each other."""
    place: SmoothPlace | None
    """None but for six degrees of freedom."""


NOT_SMOOTHED = Smoothing(None, None)


@part(frozen=True, config=PART)
class Distortion:
    """Radial distortion that was taken out of image points: one at r, in units of the focal length,
    is seen at r + k1 r^3 + k2 r^5."""

    k1: Figure
    k2: Figure
    explains: Figure
    """Share of the cost of the bundle adjustment without it that it takes away; 0 where it was
    known, of what was found beside it."""


def bent_points(points_cam: np.ndarray, lens: Distortion | None) -> np.ndarray:
    """Points (N, 3) in the camera that a pinhole shows where a lens shows the given ones; NaN for
    those that lie so far out that the lens's terms do not hold."""
    if lens is None:
        return points_cam
    depths, (edge, _) = points_cam[:, 2:], turning_points(lens.k1, lens.k2)
    with np.errstate(divide="ignore", invalid="ignore"):
        rays = points_cam[:, :2] / depths
        within = np.linalg.norm(rays, axis=1, keepdims=True) < edge
        seen = np.where(within, bent(rays, lens.k1, lens.k2), np.nan)
        return np.concatenate([seen * depths, depths], axis=1)


class CamerasQuality(records.Record):
    """`quality.json`: figures about the cameras that were found, without those interpolated."""

    format: Literal["gmrdata-cameras-quality/1"] = "gmrdata-cameras-quality/1"
    geometry: Geometry
    mapper: Mapper
    evidence: Evidence
    travel_set_aside: Figure | None
    """How far the camera travels in a model of six degrees of freedom that was not trusted, as a
    share of the background's distance; null where none was set aside."""
    frames: PositiveInt
    frames_with_camera: NonNegativeInt
    registered_share: Figure
    mean_reprojection_px: Figure
    """Mean error of what holds the cameras [px]: of the points that the bundle adjustment had, each
    the mean over its frames, as COLMAP has it; of the matches under a pure rotation."""
    median_reprojection_px: Figure
    inliers_per_frame: tuple[NonNegativeInt, ...]
    """Points or matches that hold each camera."""
    interpolated: tuple[NonNegativeInt, ...]
    keyframes: tuple[NonNegativeInt, ...]
    cuts_after_frames: tuple[NonNegativeInt, ...]
    """Rows after which the picture changes to another place."""
    featureless: tuple[NonNegativeInt, ...]
    """Rows that show nothing of the background."""
    models: tuple[ModelRecord, ...]
    """The largest first; none for a pure rotation."""
    resected_frames: NonNegativeInt
    """Keyframes that the mapper left out, or that show what others show, placed against its
    points."""
    focal_factor: Figure | None
    """Focal length that the background asks for, over the given one; null where it holds none."""
    focal_sigma: Figure | None
    """Its standard error."""
    radial_k1: Figure | None
    """Distortion that the background shows at the given focal length, by one term: a point at r, in
    units of the focal length, is seen at r + k1 r^3; null for a pure rotation, and where nothing
    holds it."""
    radial_k1_sigma: Figure | None
    """Its standard error."""
    lens: Distortion | None
    """Null where none was known, for a pure rotation, and where image points fit hardly better with
    it; they are then taken as they are.  Frames and intrinsics stay as they are in either case."""
    weakest_step: WeakestStep | None
    """Null but for six degrees of freedom."""
    second_share: Figure | None
    """Share of the keyframes of a second solution, of those that have a camera here, that have one
    there.  It is of every second keyframe, or of two in three, and by another seed; 0 where less
    than four have both, null where they are too few to be solved."""
    agreement: Agreement | None
    """With that second solution; null where the share is 0 or null."""
    smoothing: Smoothing
    points: NonNegativeInt | None
    """Of the background; null for a pure rotation, which has none."""
    median_track_length: Figure | None
    """Number of keyframes that see a point; null likewise."""
    largest_turn_deg: Figure | None
    """Largest angle from the mean orientation; null for six degrees of freedom."""
    worked_on_px: tuple[PositiveInt, PositiveInt]
    """Width and height of the frames that cameras were sought in."""

    def lens_of(self, lens: Lens) -> Lens:
        """The lens with the distortion that was taken out of the image points."""
        if self.lens is None or not self.lens.explains:  # nothing was found beside what is known
            return lens
        origin = Origin("self_calibrated", self.radial_k1_sigma)
        return replace(lens, radial=(self.lens.k1, self.lens.k2), radial_from=origin)

    @property
    def lens_in_words(self) -> list[tuple[str, str]]:
        """What the background asks of the lens: names and figures, as far as it says."""
        focal = "Focal length that the background asks for, over the given one"
        k1 = "Radial distortion k1 that the background shows"
        rows = (
            (focal, self.focal_factor, self.focal_sigma),
            (k1, self.radial_k1, self.radial_k1_sigma),
        )
        said = [(name, f"{at:.4g} ± {sigma:.2g}") for name, at, sigma in rows if sigma is not None]
        if self.lens is None:
            return said
        terms = f"k1 {self.lens.k1:.4g}, k2 {self.lens.k2:.4g}"
        return [*said, ("Radial distortion that was taken out of the image points", terms)]

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        if (n := len(self.inliers_per_frame)) != self.frames:
            raise ValueError(f"{n} inliers_per_frame, but {self.frames} frames")
        if (self.focal_factor is None) != (self.focal_sigma is None):
            raise ValueError("of focal_factor and focal_sigma only one is null")
        if (self.radial_k1 is None) != (self.radial_k1_sigma is None):
            raise ValueError("of radial_k1 and radial_k1_sigma only one is null")
        return self


@dataclass(frozen=True, eq=False)
class SfmCameras:
    """Cameras that structure from motion found."""

    path: CameraPath  # Translations are in an arbitrary unit; all zero but for "full"
    geometry: Geometry
    image_numbers: np.ndarray  # (T,) int: number in the image's file name for each row
    interpolated: np.ndarray
    """(T,) bool: rows whose camera was not found in the image but between its neighbours'."""


CAMERAS_FORMAT = "gmrdata-cameras/1"
_CAMERA_SHAPES: records.ArrayShapes = {
    "camera_intrinsics_px": ("f", (3, 3)),
    "camera_size_px": ("iu", (2,)),
    "world_from_cam": ("f", ("T", 4, 4)),
    "has_camera": ("b", ("T",)),
    "geometry": ("U", ()),
    "image_numbers": ("iu", ("T",)),
    "interpolated": ("b", ("T",)),
}
POINTS_FORMAT = "gmrdata-points/1"
_POINT_SHAPES: records.ArrayShapes = {"xyz": ("f", ("N", 3)), "track_lengths": ("iu", ("N",))}


def save_cameras(path: Path, cameras: SfmCameras) -> None:
    """Write `cameras.npz`."""
    arrays: dict[str, ArrayLike] = {
        "format": CAMERAS_FORMAT,
        "camera_intrinsics_px": cameras.path.intrinsics_px,
        "camera_size_px": np.array([cameras.path.width_px, cameras.path.height_px]),
        "world_from_cam": cameras.path.world_from_cam,
        "has_camera": cameras.path.has_camera,
        "geometry": cameras.geometry,
        "image_numbers": cameras.image_numbers,
        "interpolated": cameras.interpolated,
    }
    write_npz(path, arrays)


def load_cameras(sfm_dir: Path) -> SfmCameras:
    """Read `cameras.npz` of a reconstruction's folder."""
    path = sfm_dir / CAMERAS_FILE
    arrays = records.read_arrays(path, CAMERAS_FORMAT, _CAMERA_SHAPES)
    geometry = str(arrays["geometry"])
    if geometry not in get_args(Geometry):
        raise BadRecord(f"{path}: unknown geometry {geometry!r}; {records.MAKE_AGAIN}")
    width_px, height_px = map(int, arrays["camera_size_px"])
    intrinsics_px, poses = arrays["camera_intrinsics_px"], arrays["world_from_cam"]
    camera_path = CameraPath(intrinsics_px, width_px, height_px, poses, arrays["has_camera"])
    numbers, interpolated = arrays["image_numbers"], arrays["interpolated"]
    return SfmCameras(camera_path, cast("Geometry", geometry), numbers, interpolated)


def load_quality(sfm_dir: Path) -> CamerasQuality:
    """The figures in a reconstruction's folder."""
    return CamerasQuality.read(sfm_dir / QUALITY_FILE)


def save_points(path: Path, points: np.ndarray, track_lengths: np.ndarray) -> None:
    """Write background points (N, 3), in the cameras' unit, and the frames that see each (N,)."""
    write_npz(path, {"format": POINTS_FORMAT, "xyz": points, "track_lengths": track_lengths})


def load_points(sfm_dir: Path) -> np.ndarray:
    """Background points (N, 3) of a reconstruction's folder, in the cameras' unit."""
    return records.read_arrays(sfm_dir / POINTS_FILE, POINTS_FORMAT, _POINT_SHAPES)["xyz"]
