"""COLMAP models, and matches, of cameras and points that are drawn."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from gmrdata.cameras.colmap import pycolmap
from gmrdata.cameras.map.rotation_only import RotationOnly
from gmrdata.cameras.match.features import pinhole_params
from gmrdata.cameras.match.matches import Matches, PairMatches
from gmrdata.values import transforms
from gmrdata.values.camera import Lens, bent, project

INTRINSICS_PX = np.array([[800.0, 0, 320], [0, 800.0, 240], [0, 0, 1]])
SIZE_PX = (640, 480)
NOISE_PX = 0.4  # of the image points of what COLMAP draws


def synthetic(seed: int, n_frames: int, n_points: int, camera: Any, database: Any = None) -> Any:
    """COLMAP's own cameras all round a cloud of points, with noise in the image points; a database
    gets their matches."""
    pycolmap.set_random_seed(seed)
    options, noise = pycolmap.SyntheticDatasetOptions(), pycolmap.SyntheticNoiseOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 1, n_frames
    options.num_points3D = n_points
    options.camera_model_id, options.camera_params = camera.model, camera.params
    options.camera_width, options.camera_height = camera.width, camera.height
    model = pycolmap.synthesize_dataset(options, database)
    noise.point2D_stddev = NOISE_PX
    pycolmap.synthesize_noise(noise, model, database)
    return model


def drawn_points(n: int, rng: np.random.Generator) -> np.ndarray:
    """(N, 3) points 3 to 12 units away, in the sight of a camera at the origin."""
    rays = np.c_[rng.uniform(-0.35, 0.35, (n, 2)), np.ones(n)]
    return np.asarray(rays * rng.uniform(3, 12, (n, 1)))


def seen_px(world_from_cam: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(T, N, 2) where cameras (T, 4, 4) see points (N, 3)."""
    return np.array([project(camera, points, INTRINSICS_PX) for camera in world_from_cam])


def drawn_camera() -> Any:
    """COLMAP's camera of the intrinsics, with the id 1."""
    (width_px, height_px), params = SIZE_PX, pinhole_params(INTRINSICS_PX)
    return pycolmap.Camera(
        model="PINHOLE", width=width_px, height=height_px, params=params, camera_id=1
    )


def model_of(world_from_cam: np.ndarray, points: np.ndarray, image_px: np.ndarray) -> Any:
    """A model with cameras (T, 4, 4), named 0001.png and so on, that all see all points."""
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(drawn_camera())
    for i, cam_from_world in enumerate(transforms.invert(world_from_cam), start=1):
        rotation = pycolmap.Rotation3d(cam_from_world[:3, :3])
        rigid = pycolmap.Rigid3d(rotation, cam_from_world[:3, 3])
        image = pycolmap.Image(f"{i:04d}.png", image_px[i - 1], 1, i)
        model.add_image_with_trivial_frame(image, rigid)
    for n, point in enumerate(points):
        track = [pycolmap.TrackElement(i, n) for i in range(1, len(world_from_cam) + 1)]
        model.add_point3D(point, pycolmap.Track(track))
    return model


def places_of(model: Any) -> np.ndarray:
    """(T, 3) places of a model's cameras, in the order of their ids."""
    return np.array([model.image(i).projection_center() for i in sorted(model.reg_image_ids())])


def turning_by(
    rotmats: np.ndarray,
    residuals_px: ArrayLike = (),
    pairs_rows: Sequence[tuple[int, int]] = (),
) -> RotationOnly:
    """Turns (T, 3, 3) of a camera that is known in each frame; residuals are of the first pair."""
    n, residuals = len(rotmats), np.asarray(residuals_px, dtype=float)
    rows, of_pair = np.array(pairs_rows).reshape(-1, 2), np.zeros(len(residuals), dtype=int)
    information = csr_array((3 * n, 3 * n))
    return RotationOnly(rotmats, np.ones(n, dtype=bool), residuals, of_pair, rows, information)


def turning_matches(
    lens: Lens, turn_deg: float, noise_px: float = 0.4, seed: int = 0, drift_m: float = 0.0
) -> Matches:
    """Those of 8 frames of a camera that turns by so much about the vertical and a quarter of it
    about its side, and drifts in the hand."""
    rng = np.random.default_rng(seed)
    rays = rng.normal(size=(1000, 3))
    points_m = rays / np.linalg.norm(rays, axis=1, keepdims=True) * rng.uniform(4, 15, (1000, 1))
    seen, points_px = [], []
    for share in np.linspace(-0.5, 0.5, 8):
        angles = [share * turn_deg, 0.25 * share * turn_deg]
        world_from_cam = Rotation.from_euler("yx", angles, degrees=True).as_matrix()
        cam_m = (points_m - drift_m * rng.normal(size=3)) @ world_from_cam
        flat = cam_m[:, :2] / cam_m[:, 2:]
        there = (cam_m[:, 2] > 0.1) & (np.linalg.norm(flat, axis=1) < 1.2)
        image_px = lens.focal_px * bent(flat, *lens.radial) + lens.centre_px
        image_px += rng.normal(0, noise_px, image_px.shape)
        there &= (image_px > 0).all(axis=1) & (image_px < lens.size_px).all(axis=1)
        seen.append(np.flatnonzero(there))
        points_px.append(image_px[there])
    pairs = []
    for first in range(8):
        for second in range(first + 1, min(8, first + 4)):
            _, a, b = np.intersect1d(seen[first], seen[second], return_indices=True)
            pairs.append(PairMatches(first, second, np.c_[a, b], "UNCALIBRATED"))
    return Matches(points_px, pairs, [len(points) for points in points_px])
