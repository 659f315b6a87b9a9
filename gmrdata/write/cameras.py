"""Cameras and trajectories as other programs open them: COLMAP, TUM, KITTI and GEM-X.

A COLMAP model is `sparse/0` in binary, as its window and Gaussian splatting open it, and `text/`
(https://colmap.github.io/format.html).  COLMAP's pixels and camera axes are this project's, so
nothing is converted.  Images are numbered from 1 in the order of their rows.

TUM (https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats): a line
`time[s] tx ty tz qx qy qz qw` per pose.  KITTI (http://www.cvlibs.net/datasets/kitti/eval_odometry):
a line per frame, the upper 3x4 of its transform row by row, without times.  Both map coordinates of
the moving thing to the world.  GEM-X (https://github.com/NVlabs/GEM-X, `scripts/demo`) reads
`preprocess/camera.pt`: one tensor (L, 4, 4) for the L frames of the video, cam_from_world in
OpenCV's axes; it takes the first camera as the origin itself.
"""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from errno import EIO
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.stage.progress import remark
from gmrdata.stage.workers import give_sigterm_back
from gmrdata.values import transforms
from gmrdata.values.camera import CameraPath
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.files import write_bytes, write_text
from gmrdata.values.transforms import invert

BINARY_FOLDER, TEXT_FOLDER = "sparse/0", "text"
CAMERA_ID = 1


@dataclass(frozen=True, eq=False)
class ColmapPoints:
    """Background points, and M observations of them."""

    world_m: np.ndarray  # (N, 3) in the cameras' world
    rows: np.ndarray  # (M,) row of the image of each observation
    points: np.ndarray  # (M,) row in `world_m` of each
    image_px: np.ndarray  # (M, 2) where it is seen [px]

    @cached_property
    def order(self) -> np.ndarray:
        """(M,) the observations image by image, those of one in the order that they have here."""
        return np.argsort(self.rows, kind="stable")


NO_POINTS = ColmapPoints(
    np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2))
)


def write_colmap(
    folder: Path,
    camera: CameraPath,
    image_names: Sequence[str | None],
    points: ColmapPoints = NO_POINTS,
    *,
    radial: tuple[float, float] | None = None,
    images_dir: Path | None = None,
) -> None:
    """Write a model: every frame that has a camera and an image.

    Args:
        folder: Gets `sparse/0` (binary) and `text`.
        camera: Of T frames.
        image_names: (T,) file names; None for a frame without an image.
        points: Those that no image of the model sees are left out, as they have no error; where
            there are no observations at all, all of them are kept.
        radial: k1 and k2 of a lens: a point at r, in units of the focal length, is seen at
            r + k1 r^3 + k2 r^5.
        images_dir: Where the images are, to give the points their colours.

    BadMotionFile where no frame has both a camera and an image, OSError where a file is cut off.
    """
    known = zip(image_names, camera.has_camera, strict=True)
    names = {row: name for row, (name, there) in enumerate(known) if name and there}
    if not names:
        raise BadMotionFile(f"{folder}: no frame has both a camera and an image")
    model = _with_cameras(camera, radial)
    _add_images(model, camera, names, points)
    _add_points(model, points, list(names))
    if images_dir is not None and len(points.world_m):
        model.extract_colors_for_all_images(str(images_dir))
    model.update_point_3d_errors()
    writers = {BINARY_FOLDER: model.write_binary, TEXT_FOLDER: model.write_text}
    if spaced := next((one for one in names.values() if any(map(str.isspace, one))), None):
        remark(f"{spaced}: no COLMAP model as text, where a name ends at the first space")
        del writers[TEXT_FOLDER]
    for name, write in writers.items():
        (folder / name).mkdir(parents=True)
        write(str(folder / name))
        _require_whole(folder / name, model)


def _require_whole(folder: Path, model: Any) -> None:
    """OSError where a file is cut off, as on a full disk: pycolmap does not look at that."""
    images, points = model.images.values(), model.points3D.values()
    names = [len(image.name.encode()) for image in images]
    n_bytes = {  # by COLMAP's format: a count, then each one's own numbers
        "images.bin": 8 + 73 * len(names) + sum(names) + 24 * sum(i.num_points2D() for i in images),
        "points3D.bin": 8 + 51 * len(points) + 8 * sum(p.track.length() for p in points),
    }
    n_lines = {"images.txt": 2 * len(images), "points3D.txt": len(points)}
    for path in sorted(folder.iterdir()):
        whole = path.stat().st_size == n_bytes.get(path.name, path.stat().st_size)
        if path.name in n_lines:
            count, line = 0, b""
            with path.open("rb") as lines:
                for line in lines:
                    count += not line.startswith(b"#")
            whole = count == n_lines[path.name] and line.endswith(b"\n")
        if not whole:
            raise OSError(EIO, "cut off; is the disk full?", str(path))


def _with_cameras(camera: CameraPath, radial: tuple[float, float] | None) -> Any:
    """An empty model with the one camera."""
    # OpenCV first: with pycolmap loaded before it, writing a PNG aborts the process.
    import cv2  # noqa: F401
    import pycolmap

    give_sigterm_back()
    pycolmap.logging.minloglevel = 3  # only what is fatal
    matrix = camera.intrinsics_px
    params = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(
            camera_id=CAMERA_ID,
            model="PINHOLE" if radial is None else "OPENCV",
            width=camera.width_px,
            height=camera.height_px,
            params=params if radial is None else [*params, *radial, 0.0, 0.0],
        )
    )
    return model


def _add_images(
    model: Any, camera: CameraPath, names: Mapping[int, str], points: ColmapPoints
) -> None:
    import pycolmap

    cam_from_world = transforms.invert(camera.world_from_cam)
    rows, of_row = points.rows[points.order], list(names)
    starts, stops = (np.searchsorted(rows, of_row, side) for side in ("left", "right"))
    for (row, name), start, stop in zip(names.items(), starts, stops, strict=True):
        seen_px = points.image_px[points.order[start:stop]]
        image = pycolmap.Image(name, seen_px, CAMERA_ID, row + 1)
        pose = pycolmap.Rigid3d(np.ascontiguousarray(cam_from_world[row, :3]))
        model.add_image_with_trivial_frame(image, pose)


def _add_points(model: Any, points: ColmapPoints, rows: Sequence[int]) -> None:
    """Points with their tracks; an image point's number is its place among those of its image."""
    import pycolmap

    in_order = points.rows[points.order]
    number = np.empty_like(points.rows)
    number[points.order] = np.arange(len(in_order)) - np.searchsorted(in_order, in_order)
    tracks: list[list[Any]] = [[] for _ in points.world_m]
    used = np.isin(points.rows, rows)
    seen = zip(points.points[used], points.rows[used], number[used], strict=True)
    for point, row, at in seen:
        tracks[point].append(pycolmap.TrackElement(int(row) + 1, int(at)))
    for place_m, track in zip(points.world_m, tracks, strict=True):
        if track or not len(points.rows):
            model.add_point3D(place_m, pycolmap.Track(track))


DIGITS = 12  # significant; evo reads them as float64


def write_tum(path: Path, world_from_body: np.ndarray, times_s: np.ndarray) -> None:
    """Write poses (N, 4, 4) [m] at times (N,) [s]; BadMotionFile where one is not finite."""
    _require_poses(path, world_from_body)
    quats = Rotation.from_matrix(world_from_body[:, :3, :3]).as_quat()
    rows = np.concatenate([times_s[:, None], world_from_body[:, :3, 3], quats], axis=1)
    write_text(path, "# time[s] tx ty tz qx qy qz qw\n" + _lines(rows))


def write_kitti(path: Path, world_from_body: np.ndarray) -> None:
    """Write poses (N, 4, 4) [m], one for each frame; BadMotionFile where one is not finite."""
    _require_poses(path, world_from_body)
    write_text(path, _lines(world_from_body[:, :3].reshape(-1, 12)))


def write_gem_x(path: Path, world_from_cam: np.ndarray) -> None:
    """Write `camera.pt` of cameras (L, 4, 4) [m], as float32; opens with `weights_only`."""
    import torch

    _require_poses(path, world_from_cam)
    archive = io.BytesIO()
    torch.save(torch.from_numpy(invert(world_from_cam).astype(np.float32)), archive)
    write_bytes(path, archive.getbuffer())


def _require_poses(path: Path, world_from_body: np.ndarray) -> None:
    if not len(world_from_body):
        raise BadMotionFile(f"{path}: no poses to write")
    if bad := np.flatnonzero(~np.isfinite(world_from_body).all(axis=(1, 2))).tolist():
        raise BadMotionFile(f"{path}: pose {bad[0]} is not finite")


def _lines(rows: np.ndarray) -> str:
    return "".join(" ".join(f"{x:.{DIGITS}g}" for x in row) + "\n" for row in rows.tolist())
