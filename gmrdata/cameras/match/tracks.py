"""Tracks: which frame saw which point where, so that anyone can work out the error of the cameras.

The mean error is COLMAP's: over the points, of each one's mean over the frames that see it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from gmrdata.cameras.files import Distortion
from gmrdata.values import records, transforms
from gmrdata.values.camera import bent
from gmrdata.values.errors import BadRecord, MissingInput
from gmrdata.values.files import write_npz

TRACKS_FILE = "tracks.npz"
TRACKS_FORMAT = "gmrdata-tracks/1"
_SHAPES: records.ArrayShapes = {
    "row": ("iu", ("M",)),
    "point": ("iu", ("M",)),
    "image_px": ("f", ("M", 2)),
    "adjusted": ("b", ("T",)),
    "image_names": ("U", ("T",)),
}
AT_ONCE = 100_000  # observations, whose cameras take 13 MB
STEPS_PER_PX = 256.0
"""Image points are kept to 1/256 px, far finer than they are: zipped, 6 bytes an observation."""


@dataclass(frozen=True, eq=False)
class Tracks:
    """M observations of the background points of a reconstruction, in T frames."""

    rows: np.ndarray  # (M,) int: the frame of each; ascending
    points: np.ndarray  # (M,) int: the point of each, as its row in `points.npz`
    image_px: np.ndarray  # (M, 2) where it is seen in the image [px], distorted as the image is
    adjusted: np.ndarray
    """(T,) bool: frames that the bundle adjustment had; the others were placed by its points."""
    image_names: tuple[str, ...]  # (T,) file names of the images

    def of_adjusted(self) -> "Tracks":
        """The observations that the bundle adjustment had."""
        keep = self.adjusted[self.rows]
        seen = {"rows": self.rows, "points": self.points, "image_px": self.image_px}
        return replace(self, **{name: values[keep] for name, values in seen.items()})

    def fits(self, n_frames: int, n_points: int) -> bool:
        """Whether they may be of a reconstruction of so many frames and points."""
        of = (self.rows, n_frames), (self.points, n_points)
        inside = all(not len(at) or 0 <= at.min() <= at.max() < n for at, n in of)
        return inside and len(self.adjusted) == n_frames


def tracks_of(
    seen: Mapping[int, np.ndarray],
    keypoints_px: Sequence[np.ndarray],
    adjusted: np.ndarray,
    image_names: Sequence[str],
) -> Tracks:
    """Tracks of what frames see: by row (N, 2) features and numbers of points."""
    rows, numbers = [np.zeros(0, np.int32)], [np.zeros(0, np.int32)]
    image_px = [np.zeros((0, 2))]
    for row, table in sorted(seen.items()):
        # Two features of a keyframe may show one point.
        once, first = np.unique(table[:, 1], return_index=True)
        rows.append(np.full(len(once), row, np.int32))
        numbers.append(once)
        image_px.append(keypoints_px[row][table[first, 0]])
    seen_rows, seen_points = np.concatenate(rows), np.concatenate(numbers)
    seen_px = np.concatenate(image_px)
    return Tracks(seen_rows, seen_points, seen_px, adjusted, tuple(image_names))


def errors_px(
    tracks: Tracks,
    points: np.ndarray,
    world_from_cam: np.ndarray,
    intrinsics_px: np.ndarray,
    lens: Distortion | None,
) -> np.ndarray:
    """(M,) distance of each observation from its point (N, 3) in its camera (T, 4, 4) [px]."""
    k1, k2 = (0.0, 0.0) if lens is None else (lens.k1, lens.k2)
    cam_from_world, errors = transforms.invert(world_from_cam), np.zeros(len(tracks.rows))
    for start in range(0, len(errors), AT_ONCE):
        some = slice(start, start + AT_ONCE)
        points_world = points[tracks.points[some]][:, None]
        points_cam = transforms.apply(cam_from_world[tracks.rows[some]], points_world)[:, 0]
        rays = points_cam[:, :2] / points_cam[:, 2:]
        image_px = bent(rays, k1, k2) * intrinsics_px[[0, 1], [0, 1]] + intrinsics_px[:2, 2]
        errors[some] = np.linalg.norm(image_px - tracks.image_px[some], axis=1)
    return errors


def mean_over_points(errors: np.ndarray, points: np.ndarray) -> float:
    """The mean over points of the mean error of each one's observations (M,), as COLMAP has it."""
    counts = np.bincount(points)
    there = counts > 0
    return float((np.bincount(points, weights=errors)[there] / counts[there]).mean())


def save_tracks(path: Path, tracks: Tracks) -> None:
    """Write `tracks.npz`: 2 to 3 kB a frame."""
    arrays: dict[str, ArrayLike] = {
        "format": TRACKS_FORMAT,
        "row": tracks.rows.astype(np.uint32),
        "point": tracks.points.astype(np.uint32),
        "image_px": (np.rint(tracks.image_px * STEPS_PER_PX) / STEPS_PER_PX).astype(np.float32),
        "adjusted": tracks.adjusted,
        "image_names": np.array(tracks.image_names, dtype=np.str_),
    }
    write_npz(path, arrays, compressed=True)


def load_tracks(sfm_dir: Path) -> Tracks:
    """Read `tracks.npz` of a folder; MissingInput where an older version made it, BadRecord where
    an image's name leads out of the folder of images."""
    path = sfm_dir / TRACKS_FILE
    if not path.is_file():
        remedy = f"Delete {sfm_dir} and run the same command again, which makes the same cameras"
        raise MissingInput(f"{path}: an older gmrdata kept no tracks. {remedy}")
    arrays = records.read_arrays(path, TRACKS_FORMAT, _SHAPES)
    rows, points = arrays["row"].astype(np.int64), arrays["point"].astype(np.int64)
    adjusted, names = arrays["adjusted"], tuple(map(str, arrays["image_names"]))
    if odd := [name for name in names if not name or Path(name).name != name]:
        raise BadRecord(f"{path}: {odd[0]!r} is no image's name; {records.MAKE_AGAIN}")
    return Tracks(rows, points, arrays["image_px"].astype(np.float64), adjusted, names)
