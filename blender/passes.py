# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth, normals, flow and instances: a second, short render with one ray per pixel centre.

The picture's rays are spread over a pixel, so what is averaged from them belongs to no known point.
Cycles' first ray goes through the centre of the pixel (seen in Blender 5.0.1); the filter is
narrowed besides, so that nothing depends on that.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from blender.engine import kept, new_compositor, traced, write_to_file
from blender.objects import CUT_OUT, mark
from blender.people.actors import Actor
from gmrdata.film.render import RenderConfig
from gmrdata.film.render_outputs import write_depth, write_flow, write_instances, write_normals
from gmrdata.values.camera import CameraPath, project_cam
from gmrdata.values.errors import RenderFailed
from gmrdata.values.transforms import apply, invert

STEP = "step"
"""Name of the mesh attribute and of the pass: how far the surface moves until the next frame."""
INSTANCE = "instance"
"""Name of the pass that numbers what moves: 1 for the first actor, 0 for all that stands still."""
NARROWEST_FILTER_PX = 0.01
_PASSES = {
    "depth": ("Depth", "FLOAT"),
    "normals": ("Normal", "VECTOR"),
    STEP: (STEP, "RGBA"),
    INSTANCE: (INSTANCE, "FLOAT"),
}
"""Socket of what Blender writes, and its type, by the base name of the file."""


@dataclass(frozen=True)
class Surface:
    """What the ray through each pixel's centre meets first; arrays are (H, W, ...)."""

    depth_m: np.ndarray
    """Depth along the optical axis [m]; infinite where there is only sky."""
    normals_world: np.ndarray
    """Unit normals, world frame; zeros without such a pass."""
    step_m: np.ndarray
    """How far the surface point moves until the next frame, world frame [m]."""
    instances: np.ndarray
    """(H, W) number of the actor, 0 for none."""


def wants_surface(config: RenderConfig) -> bool:
    """Whether a recipe asks for anything that the second render gives."""
    return config.depth or config.normals or config.flow or config.instances


def add_surface_output(
    scene: Any, actors: Sequence[Actor], work_dir: Path, config: RenderConfig
) -> Any:
    """Make the compositor tree, for `render_surface`, that writes a recipe's passes as EXR files.

    The actors, all that moves, get the attribute that flow needs, and are numbered from 1.
    """
    layer = scene.view_layers[0]
    layer.use_pass_z, layer.use_pass_normal = True, config.normals
    if config.flow:
        aov = layer.aovs.add()
        aov.name, aov.type = STEP, "COLOR"
        for actor in actors:
            actor.mesh.attributes.new(STEP, "FLOAT_VECTOR", "POINT")
        for material in {material for actor in actors for material in actor.mesh.materials}:
            _mark_step(material.node_tree)
    if config.instances:
        aov = layer.aovs.add()
        aov.name, aov.type = INSTANCE, "VALUE"
        for number, actor in enumerate(actors, start=1):
            for material in actor.mesh.materials:  # no two actors share one
                _mark_instance(material.node_tree, number)
    tree, layers = new_compositor("surface")
    for name in _wanted(config):
        socket, kind = _PASSES[name]
        form = ("OPEN_EXR", "RGB", "32")
        write_to_file(tree, layers.outputs[socket], kind, work_dir / name, form)
    return tree


def _wanted(config: RenderConfig) -> list[str]:
    """Base names of the files that Blender writes; each of the passes needs the depth."""
    asked = {"normals": config.normals, STEP: config.flow, INSTANCE: config.instances}
    return ["depth", *(name for name, is_asked in asked.items() if is_asked)]


def set_step(actor: Actor, row: int) -> None:
    """Tell the actor's mesh how far each vertex moves from frame `row` to the next."""
    step_m = actor.vertices_m[row + 1] - actor.vertices_m[row]
    values = np.ascontiguousarray(step_m, dtype=np.float32).ravel()
    actor.mesh.attributes[STEP].data.foreach_set("vector", values)
    actor.mesh.update()


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

    The scene is posed for the frame, and the camera is as Blender uses it.

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
    if "instances" in files:
        write_instances(files["instances"], surface.instances)


def render_surface(scene: Any, tree: Any, work_dir: Path, config: RenderConfig) -> Surface:
    """Render the scene as it stands, once more, with one ray per pixel centre.

    Raises:
        RenderFailed: Blender wrote a pass not at all, or in another size.
    """
    cycles = scene.cycles
    with (
        kept(cycles, "samples", "pixel_filter_type", "filter_width"),
        kept(scene.render, "use_motion_blur"),
        kept(scene, "compositing_node_group"),
        traced(scene),
    ):
        cycles.samples, cycles.pixel_filter_type = 1, "BLACKMAN_HARRIS"
        cycles.filter_width = NARROWEST_FILTER_PX
        scene.render.use_motion_blur = False  # the passes are of one moment
        scene.compositing_node_group = tree
        bpy.ops.render.render(write_still=False)
    size_px = scene.render.resolution_x, scene.render.resolution_y
    passes = {name: _take(work_dir, name, size_px) for name in _wanted(config)}
    depth_m = passes["depth"][..., 0].astype(np.float64)
    depth_m[depth_m > scene.camera.data.clip_end * 1.01] = np.inf
    nothing = np.zeros((*depth_m.shape, 3))
    normals, step_m, instances = (passes.get(name, nothing) for name in ("normals", STEP, INSTANCE))
    return Surface(depth_m, normals, step_m, np.rint(instances[..., 0]))


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
    step = attribute.outputs["Vector"]
    if CUT_OUT in tree.nodes:
        there = tree.nodes.new("ShaderNodeVectorMath")
        there.operation = "SCALE"
        tree.links.new(step, there.inputs[0])
        tree.links.new(tree.nodes[CUT_OUT].outputs[0], there.inputs["Scale"])
        step = there.outputs["Vector"]
    tree.links.new(step, mark(tree, STEP).inputs["Color"])


def _mark_instance(tree: Any, number: int) -> None:
    """Let a material hand its actor's number to the pass, and 0 where it has a hole."""
    marked = mark(tree, INSTANCE, number)
    if CUT_OUT in tree.nodes:
        there = tree.nodes.new("ShaderNodeMath")
        there.operation = "MULTIPLY"
        there.inputs[1].default_value = number
        tree.links.new(tree.nodes[CUT_OUT].outputs[0], there.inputs[0])
        tree.links.new(there.outputs[0], marked.inputs["Value"])


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
