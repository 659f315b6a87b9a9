"""Runs in its own process: the clearance of paths in a yard of two boxes, printed as JSON.

Usage: clearance_by_blender.py cases.json, a mapping of names to {camera_m, pelvis_m}, (T, 3) each.
"""

import json
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from blender.clearance import GROUND, measure_clearance, require_clear
from blender.objects import add_object
from blender.places.layout import Thing, ground_mesh, mesh_of
from gmrdata.values.errors import BadBackdrop, RenderFailed


def add(name: str, vertices: np.ndarray, faces: np.ndarray) -> None:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices.tolist(), [], faces.tolist())
    add_object(bpy.context.scene, name, mesh)


bpy.ops.wm.read_factory_settings(use_empty=True)
ground = ground_mesh(np.zeros(2), 40.0)
add(GROUND, ground.vertices_m, ground.faces)
rng = np.random.default_rng(0)
picture = np.zeros((2, 2, 3), np.float32)
# A box of 2 m round (5, 0, 1), and a thin wall at y = 3 from x = -1 to 1, turned into place.
for number, (centre, size, yaw) in enumerate(
    [((5, 0, 1), (2, 2, 2), 0.0), ((0, 3, 1), (0.02, 2, 2), np.pi / 2)]
):
    thing = Thing("box", np.array(centre, float), np.array(size, float), yaw, picture, None)
    mesh = mesh_of(thing, rng)
    add(f"thing{number}", mesh.vertices_m, mesh.faces)
objects = [thing for thing in bpy.context.scene.objects if thing.type == "MESH"]
answers = {"nothing": measure_clearance(objects[:1], np.zeros((1, 3)), np.ones((1, 3)))}
for name, case in json.loads(Path(sys.argv[1]).read_text()).items():
    paths = np.array(case["camera_m"], float), np.array(case["pelvis_m"], float)
    try:
        found = measure_clearance(objects, *paths)
        answers[name] = found and found.model_dump()
    except RenderFailed as error:
        answers[name] = str(error)


def told(camera_m: Any, others_m: dict[str, Any]) -> str:
    """What is said of a clip in this yard as a backdrop, of somebody who stands at the origin."""
    joints_m = np.tile([0.0, 0.0, 1.0], (2, 24, 1))
    ways_m = {name: np.array(way_m, float) for name, way_m in others_m.items()}
    try:
        require_clear(
            bpy.context.scene, Path("a.blend"), joints_m, np.array(camera_m, float), ways_m
        )
    except BadBackdrop as error:
        return str(error)
    return ""


ASIDE = [[0, -4, 1.5]] * 2
answers["backdrop"] = {
    "clear": told(ASIDE, {"car_1": [[2, 0, 1], [3, 0, 1]]}),
    "hidden in one frame": told([[0, 4, 1.5], [3, 4, 1.5]], {}),
    "hidden": told([[0, 4, 1.5], [0.1, 4, 1.5]], {}),
    "through": told(ASIDE, {"company_1": [[2, 0, 1]] * 2, "passer_by_1": [[0, 2, 1], [0, 4, 1]]}),
}
sys.stdout.write("\nANSWER " + json.dumps(answers) + "\n")
