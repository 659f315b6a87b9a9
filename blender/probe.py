# SPDX-License-Identifier: GPL-3.0-or-later
"""`python -m blender.probe`: load all, and say the versions; with ENGINE DEVICE: render eight
pixels, and say on what.

A process of its own, because Blender ends the process that asks for OpenGL where there is none.
"""

import sys

import bpy

import blender.render  # noqa: F401 - whether all of it loads
from blender.__main__ import say_versions
from blender.engine import ENGINES, use_gpus
from gmrdata.film.render import RENDERER_LINE
from gmrdata.values.errors import EngineMissing


def main(engine: str = "", device: str = "") -> int:
    """Exit code 0 with what was asked on stdout, or 1 with a message on stderr."""
    if not engine:
        say_versions()
        return 0
    try:
        name = probe(engine, device)
    except EngineMissing as error:
        sys.stderr.write(f"error: {error}\n")
        return 1
    except RuntimeError as error:
        sys.stderr.write(f"error: {engine} can't render here: {error}\n")
        return 1
    sys.stdout.write(f"{RENDERER_LINE} {name}\n")
    return 0


def probe(engine: str, device: str) -> str:
    """Render an empty scene; gives the name of what did it.

    Raises:
        EngineMissing: a GPU was asked for, and there is none.
        RuntimeError: from Blender.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = ENGINES[engine]
    scene.render.resolution_x, scene.render.resolution_y = 4, 2
    scene.cycles.samples = scene.eevee.taa_render_samples = 1
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    name = ""
    if engine == "cycles" and device == "gpu":
        name, scene.cycles.device = use_gpus(), "GPU"
    bpy.ops.render.render(write_still=False)
    if engine == "cycles":
        return name or "CPU"
    import gpu

    return f"{gpu.platform.renderer_get()} ({gpu.platform.version_get()})"


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
