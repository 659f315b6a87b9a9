# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's renderers, set up so that nothing differs from run to run that needn't."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy

from gmrdata.film.render import RenderConfig, RenderJob
from gmrdata.values.errors import EngineMissing

ENGINES = {"cycles": "CYCLES", "eevee": "BLENDER_EEVEE", "workbench": "BLENDER_WORKBENCH"}
"""Blender's names."""
GPU_KINDS = ("OPTIX", "CUDA", "HIP", "METAL", "ONEAPI")
"""Kinds of devices that Cycles can compute on, the fastest of a vendor's first."""


def set_up_render(scene: Any, job: RenderJob) -> None:
    """Let a scene be rendered as the recipe says.

    Raises:
        EngineMissing: the recipe wants a GPU, and Cycles finds none.
    """
    config, render = job.config, scene.render
    render.engine = ENGINES[config.engine]
    set_up_cycles(scene, config)  # for the passes too, whatever makes the picture
    if config.engine == "eevee":
        _set_up_eevee(scene, config)
    render.use_persistent_data = True
    if (open_share := config.shutter + config.readout) > 0:
        render.use_motion_blur = True
        render.motion_blur_position, render.motion_blur_shutter = "CENTER", open_share
    if config.readout > 0:  # each row takes its part of the time in which any row is exposed
        scene.cycles.rolling_shutter_type = "TOP"
        scene.cycles.rolling_shutter_duration = config.shutter / open_share
    set_up_output(scene, job.threads)
    if config.scene.backdrop is None:
        scene.view_settings.view_transform = "Standard"


def as_output(path: Path) -> str:
    """A path to write to, as Blender takes it: it would fill in what stands in braces."""
    return str(path).replace("{", "{{").replace("}", "}}")


def new_compositor(name: str) -> tuple[Any, Any]:
    """A compositor tree that leaves the picture as it is, and the node of what is rendered."""
    tree = bpy.data.node_groups.new(name, "CompositorNodeTree")
    layers = tree.nodes.new("CompositorNodeRLayers")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    tree.links.new(layers.outputs["Image"], tree.nodes.new("NodeGroupOutput").inputs[0])
    return tree, layers


def write_to_file(
    tree: Any, socket: Any, kind: str, path: Path, form: tuple[str, str, str]
) -> None:
    """Let a compositor tree write a socket of the render to a file, without its suffix given.

    `kind` is Blender's name of what the socket holds, `form` its names of the file's format, its
    channels and its bits.
    """
    files = tree.nodes.new("CompositorNodeOutputFile")
    files.directory, files.file_name = as_output(path.parent), ""
    files.file_output_items.new(kind, path.name)
    files.save_as_render = False
    files.format.media_type = "IMAGE"
    files.format.file_format, files.format.color_mode, files.format.color_depth = form
    tree.links.new(socket, files.inputs[0])


def set_up_output(scene: Any, threads: int) -> None:
    """Pictures as they come, with a fixed number of threads."""
    render = scene.render
    render.threads_mode = "FIXED"
    render.threads = threads
    render.use_compositing = True
    render.use_sequencer = False
    # Uncompressed, since it is read back at once.
    render.image_settings.file_format = "BMP"
    render.image_settings.color_mode = "RGB"


def set_up_cycles(scene: Any, config: RenderConfig) -> None:
    """Cycles, without anything that differs from run to run.

    Raises:
        EngineMissing: the recipe wants a GPU, and Cycles finds none.
    """
    cycles, backdrop = scene.cycles, config.scene.backdrop
    cycles.device = "CPU"
    if config.device == "gpu":
        use_gpus()
        cycles.device = "GPU"
    cycles.samples = config.samples
    cycles.pixel_filter_type = "BOX"  # all of a pixel's rays go through that pixel
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.use_light_tree = backdrop is not None  # our own places have one lamp
    # The sky's light is in our own places' materials; a file's light goes from wall to wall.
    cycles.max_bounces = 0 if backdrop is None else backdrop.max_bounces


@contextmanager
def kept(owner: Any, *names: str) -> Iterator[None]:
    """Let some settings be after the block as they are before it."""
    settings = {name: getattr(owner, name) for name in names}
    try:
        yield
    finally:
        for name, value in settings.items():
            setattr(owner, name, value)


@contextmanager
def traced(scene: Any) -> Iterator[None]:
    """Let Cycles render what is rendered in the block, whatever makes the pictures."""
    with kept(scene.render, "engine"):
        scene.render.engine = ENGINES["cycles"]
        yield


def use_gpus() -> str:
    """Let Cycles compute on all GPUs of the first kind that is here; gives their names.

    Raises:
        EngineMissing: there is none.
    """
    preferences = bpy.context.preferences.addons["cycles"].preferences
    known = {kind for kind, *_ in preferences.get_device_types(bpy.context)}
    preferences.refresh_devices()
    for kind in GPU_KINDS:
        gpus = [device for device in preferences.devices if device.type == kind]
        if kind in known and gpus:
            preferences.compute_device_type = kind
            for device in preferences.devices:
                device.use = device.type == kind
            return f"{kind}: {', '.join(sorted(device.name for device in gpus))}"
    devices = ", ".join(f"{device.name} ({device.type})" for device in preferences.devices)
    raise EngineMissing(
        f"device: gpu: Cycles finds no GPU here, only {devices or 'no device at all'}. Take "
        "`device: cpu`, or install the GPU's driver (CUDA, OptiX, HIP, Metal or oneAPI)"
    )


def _set_up_eevee(scene: Any, config: RenderConfig) -> None:
    scene.eevee.taa_render_samples = config.samples
    if config.scene.backdrop is None and scene.world is not None:
        _hide_sky_from_surfaces(scene.world.node_tree)


def _hide_sky_from_surfaces(tree: Any) -> None:
    """The sky's light is in our materials already; EEVEE has no switch for it as Cycles has."""
    for background in [node for node in tree.nodes if node.type == "BACKGROUND"]:
        path = tree.nodes.new("ShaderNodeLightPath")
        tree.links.new(path.outputs["Is Camera Ray"], background.inputs["Strength"])
