"""COLMAP models of cameras and points that are drawn."""

from typing import Any

import numpy as np

from gmrdata.cameras.colmap import pycolmap
from gmrdata.cameras.match.features import pinhole_params
from gmrdata.values import transforms
from gmrdata.values.camera import project

INTRINSICS_PX = np.array([[800.0, 0, 320], [0, 800.0, 240], [0, 0, 1]])
SIZE_PX = (640, 480)


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
