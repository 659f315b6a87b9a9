# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversion between gmrdata's cameras (OpenCV axes, K in pixels) and Blender's."""

from typing import Any

import numpy as np

from gmrdata.values.camera import CameraPath, Lens
from gmrdata.values.errors import BadRecipe
from gmrdata.values.transforms import quaternions_from_rotmats

SENSOR_WIDTH_MM = 36.0
FARTHEST_M = 1e6
"""What is farther is not drawn: a recipe's camera may be 10 km away, a file's mountains farther."""
OPENCV_FROM_BLENDER_AXES = np.diag([1.0, -1.0, -1.0, 1.0])
"""Blender's camera looks along -z with y up; OpenCV's along +z with y down.  Its own inverse."""


def swap_axes(world_from_cam: np.ndarray) -> np.ndarray:
    """Camera transforms (..., 4, 4) with OpenCV axes from ones with Blender's axes, or back."""
    return np.asarray(world_from_cam, dtype=np.float64) @ OPENCV_FROM_BLENDER_AXES


def make_camera(scene: Any, camera_path: CameraPath) -> Any:
    """Add a camera object with the path's intrinsics and picture size to a bpy scene.

    Raises:
        BadRecipe: pixels are not square, or K has skew: Blender has no such camera here.
    """
    import bpy

    (fx, skew, cx), (_, fy, cy) = camera_path.intrinsics_px[:2]
    if abs(fx - fy) > 1e-6 * fx or abs(skew) > 1e-6:
        raise BadRecipe(
            f"Blender's camera needs square pixels and no skew, not fx {fx} and fy {fy}"
        )
    width_px, height_px = camera_path.width_px, camera_path.height_px
    data = bpy.data.cameras.new("camera")
    data.sensor_fit = "HORIZONTAL"
    data.sensor_width = SENSOR_WIDTH_MM
    data.lens = fx * SENSOR_WIDTH_MM / width_px
    # Shifts are in units of the sensor's fitted side, here the width; positive moves the view.
    data.shift_x = (width_px / 2 - cx) / width_px
    data.shift_y = (cy - height_px / 2) / width_px
    data.clip_start, data.clip_end = 0.05, FARTHEST_M
    scene.render.resolution_x, scene.render.resolution_y = width_px, height_px
    scene.render.resolution_percentage = 100
    scene.render.pixel_aspect_x = scene.render.pixel_aspect_y = 1.0
    camera = bpy.data.objects.new("camera", data)
    scene.collection.objects.link(camera)
    scene.camera = camera
    return camera


def animate_camera(camera: Any, world_from_cam: np.ndarray) -> None:
    """Let the Blender camera be at transform t of (T, 4, 4), with OpenCV axes, in frame t.

    Between frames it goes straight and turns evenly, and beyond the ends it goes on, which only
    matters while a shutter is open.
    """
    import bpy
    from bpy_extras.anim_utils import action_ensure_channelbag_for_slot

    transforms = swap_axes(world_from_cam)
    camera.rotation_mode = "QUATERNION"
    camera.animation_data_create().action = action = bpy.data.actions.new("camera")
    camera.animation_data.action_slot = slot = action.slots.new("OBJECT", "camera")
    bag = action_ensure_channelbag_for_slot(action, slot)
    places = {"location": transforms[:, :3, 3], "rotation_quaternion": _quaternions(transforms)}
    frames = np.arange(len(transforms))
    for channel, values in places.items():
        for index, value in enumerate(values.T):
            curve = bag.fcurves.new(channel, index=index)
            curve.keyframe_points.add(len(frames))
            curve.keyframe_points.foreach_set("co", np.c_[frames, value].ravel())
            for key in curve.keyframe_points:
                key.interpolation = "LINEAR"
            curve.extrapolation = "LINEAR"
            curve.update()


def _quaternions(transforms: np.ndarray) -> np.ndarray:
    """Unit quaternions (T, 4), real part first, without a jump of sign from frame to frame."""
    quaternions = quaternions_from_rotmats(transforms[:, :3, :3])
    turns = (quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0
    signs = np.where(np.r_[False, np.cumsum(turns) % 2 == 1], -1.0, 1.0)
    return signs[:, None] * quaternions


def read_back(scene: Any, camera: Any, wanted: CameraPath) -> CameraPath:
    """The animated camera as Blender uses it (single precision), in every frame."""
    world_from_cam = np.empty_like(wanted.world_from_cam)
    for row in range(len(world_from_cam)):
        scene.frame_set(row)
        world_from_cam[row] = swap_axes(np.array(camera.matrix_world))
    render, data = scene.render, camera.data
    width_px, height_px = int(render.resolution_x), int(render.resolution_y)
    focal_px = data.lens / data.sensor_width * width_px
    centre_px = width_px / 2 - data.shift_x * width_px, height_px / 2 + data.shift_y * width_px
    lens = Lens((focal_px, focal_px), centre_px, (width_px, height_px))
    everywhere = np.ones(len(world_from_cam), dtype=bool)
    return CameraPath(lens.matrix_px, *lens.size_px, world_from_cam, everywhere)
