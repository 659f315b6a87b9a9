# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth, normals and flow of a frame: a second, short render with one ray per pixel centre.

The picture's rays are spread over a pixel and its neighbours, so what is averaged from them belongs
to no known point.  Cycles' first ray goes through the centre of the pixel (seen in Blender 5.0.1);
the filter is narrowed besides, so that nothing depends on that.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from gmrdata.errors import RenderFailed
from gmrdata.geometry.camera import CameraPath, project_cam
from gmrdata.geometry.transforms import apply, invert
from gmrdata.passes import write_depth, write_flow, write_normals
from gmrdata.render import RenderConfig

STEP = "step"
"""Name of the mesh attribute and of the pass: how far the surface moves until the next frame."""
NARROWEST_FILTER_PX = 0.01
_FILES = {"depth": "FLOAT", "normals": "VECTOR", STEP: "RGBA"}
"""Base name and socket type of what Blender writes."""
_SOCKETS = {"depth": "Depth", "normals": "Normal", STEP: STEP}


@dataclass(frozen=True)
class Surface:
    """What the ray through each pixel's centre meets first; arrays are (H, W, ...)."""

    depth_m: np.ndarray
    """Depth along the optical axis [m]; infinite where there is only sky."""
    normals_world: np.ndarray
    """Unit normals, world frame; zeros without such a pass."""
    step_m: np.ndarray
    """How far the surface point moves until the next frame, world frame [m]."""


def wants_surface(config: RenderConfig) -> bool:
    """Whether a recipe asks for anything that the second render gives."""
    return config.depth or config.normals or config.flow


def add_surface_output(scene: Any, person: Any, work_dir: Path, config: RenderConfig) -> Any:
    """Make the compositor tree that writes the passes of a recipe as EXR files.

    Args:
        scene: The bpy scene.
        person: The person's bpy mesh; gets the attribute that flow needs.
        work_dir: Folder for the files.
        config: The recipe.

    Returns:
        The tree, for `render_surface`.
    """
    layer = scene.view_layers[0]
    layer.use_pass_z, layer.use_pass_normal = True, config.normals
    if config.flow:
        aov = layer.aovs.add()
        aov.name, aov.type = STEP, "COLOR"
        person.attributes.new(STEP, "FLOAT_VECTOR", "POINT")
        _mark_step(person.materials[0].node_tree)
    tree = bpy.data.node_groups.new("surface", "CompositorNodeTree")
    layers = tree.nodes.new("CompositorNodeRLayers")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    tree.links.new(layers.outputs["Image"], tree.nodes.new("NodeGroupOutput").inputs[0])
    for name in ("depth", *(["normals"] if config.normals else []), *([STEP] * config.flow)):
        files = tree.nodes.new("CompositorNodeOutputFile")
        files.directory, files.file_name = str(work_dir), ""
        files.file_output_items.new(_FILES[name], name)
        files.save_as_render = False
        files.format.media_type = "IMAGE"
        files.format.file_format = "OPEN_EXR"
        files.format.color_mode, files.format.color_depth = "RGB", "32"
        tree.links.new(layers.outputs[_SOCKETS[name]], files.inputs[0])
    return tree


def set_step(person: Any, step_m: np.ndarray) -> None:
    """Tell the mesh how far each vertex moves until the next frame: (V, 3) [m], world frame."""
    values = np.ascontiguousarray(step_m, dtype=np.float32).ravel()
    person.attributes[STEP].data.foreach_set("vector", values)
    person.update()


def write_surface(
    scene: Any,
    tree: Any,
    work_dir: Path,
    config: RenderConfig,
    files: Mapping[str, Path],
    camera: CameraPath,
    row: int,
) -> None:
    """Render the passes of a frame and write those of its files that come from them.

    Args:
        scene: The bpy scene, posed for the frame.
        tree: From `add_surface_output`.
        work_dir: Folder for Blender's files.
        config: The recipe.
        files: The frame's files, from `frame_files`.
        camera: The camera as Blender uses it.
        row: The frame.

    Raises:
        RenderFailed: Blender wrote a pass not at all, or in another size.
    """
    surface = render_surface(scene, tree, work_dir, config)
    world_from_cam = camera.world_from_cam
    if "depth" in files:
        write_depth(files["depth"], surface.depth_m)
    if "normals" in files:
        write_normals(files["normals"], normals_in_camera(surface, world_from_cam[row]))
    if "flow" in files:
        flow_px = flow_to_next(
            surface, camera.intrinsics_px, world_from_cam[row], world_from_cam[row + 1]
        )
        write_flow(files["flow"], flow_px)


def render_surface(scene: Any, tree: Any, work_dir: Path, config: RenderConfig) -> Surface:
    """Render the scene as it stands, once more, with one ray per pixel centre.

    Raises:
        RenderFailed: Blender wrote a pass not at all, or in another size.
    """
    cycles, pictures = scene.cycles, scene.compositing_node_group
    samples, filter_px = cycles.samples, cycles.filter_width
    cycles.samples, cycles.filter_width = 1, NARROWEST_FILTER_PX
    scene.compositing_node_group = tree
    try:
        bpy.ops.render.render(write_still=False)
    finally:
        cycles.samples, cycles.filter_width = samples, filter_px
        scene.compositing_node_group = pictures
    size_px = scene.render.resolution_x, scene.render.resolution_y
    depth_m = _take(work_dir, "depth", size_px)[..., 0].astype(np.float64)
    depth_m[depth_m > scene.camera.data.clip_end * 1.01] = np.inf
    nothing = np.zeros((*depth_m.shape, 3))
    return Surface(
        depth_m,
        _take(work_dir, "normals", size_px) if config.normals else nothing,
        _take(work_dir, STEP, size_px) if config.flow else nothing,
    )


def normals_in_camera(surface: Surface, world_from_cam: np.ndarray) -> np.ndarray:
    """(H, W, 3) unit normals in the camera's OpenCV axes; zeros where there is only sky."""
    normals = surface.normals_world @ world_from_cam[:3, :3]
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    there = np.isfinite(surface.depth_m)[..., None] & (length > 0.5)
    return np.where(there, normals / np.where(there, length, 1.0), 0.0)


def flow_to_next(
    surface: Surface,
    intrinsics_px: np.ndarray,
    world_from_cam: np.ndarray,
    world_from_next_cam: np.ndarray,
) -> np.ndarray:
    """Forward flow (H, W, 2) [px]: where each surface point is in the next image, less its place.

    NaN where there is only sky, and where the point comes to lie behind the next camera.
    """
    height_px, width_px = surface.depth_m.shape
    x_px, y_px = np.meshgrid(np.arange(width_px) + 0.5, np.arange(height_px) + 0.5)
    pixels = np.stack([x_px, y_px, np.ones_like(x_px)], axis=-1)
    known = np.isfinite(surface.depth_m)[..., None]
    depth_m = np.where(known, surface.depth_m[..., None], np.nan)
    points_cam_m = pixels @ np.linalg.inv(intrinsics_px).T * depth_m
    points_m = points_cam_m @ world_from_cam[:3, :3].T + world_from_cam[:3, 3] + surface.step_m
    next_cam_m = apply(invert(world_from_next_cam), points_m.reshape(-1, 3))
    next_px = project_cam(next_cam_m, intrinsics_px).reshape(height_px, width_px, 2)
    return next_px - pixels[..., :2]


def _mark_step(tree: Any) -> None:
    """Let a material hand the attribute to the pass."""
    attribute = tree.nodes.new("ShaderNodeAttribute")
    attribute.attribute_name = STEP
    mark = tree.nodes.new("ShaderNodeOutputAOV")
    mark.aov_name = STEP
    tree.links.new(attribute.outputs["Vector"], mark.inputs["Color"])


def _take(work_dir: Path, name: str, size_px: tuple[int, int]) -> np.ndarray:
    """Read a pass, (H, W, 3) float32 with row 0 at the top, and remove its file."""
    paths = list(work_dir.glob(f"*{name}*.exr"))
    if len(paths) != 1:
        raise RenderFailed(f"Blender wrote no {name} pass to {work_dir}")
    image = bpy.data.images.load(str(paths[0]))
    image.colorspace_settings.name = "Non-Color"
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    found_px, channels = tuple(image.size), image.channels
    bpy.data.images.remove(image)
    paths[0].unlink()
    if found_px != size_px:
        raise RenderFailed(f"Blender wrote a {name} pass of {found_px} px, not {size_px}")
    return values.reshape(size_px[1], size_px[0], channels)[::-1, :, :3]
