"""Runs in its own process: which joints Blender's rays reach, printed as JSON.

Usage: visibility_by_blender.py case.npz body.npz, with arrays vertices_m (T, V, 3), joints_m
(T, 24, 3), centres_m (T, 3), wall_m (4, 3): the corners of the only thing that stands in the scene,
and passer_by_m (T, V, 3): vertices of someone else.
"""

import json
import sys
from pathlib import Path

import bpy
import numpy as np

from blender.light import Light
from blender.objects import add_object
from blender.people.actors import add_actor
from blender.people.person import joint_of_face, person_mesh
from blender.visibility import visible_joints
from gmrdata.read.body_file import read_body

arrays = np.load(sys.argv[1])
body = read_body(Path(sys.argv[2]))
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
bpy.data.objects.new("person", None)  # a backdrop may have a thing of this name
vertices_m = arrays["vertices_m"]
mesh = person_mesh(
    "person",
    body,
    np.zeros(body.n_shape),
    vertices_m[0],
    Light("sun", 0.0),
    np.random.default_rng(0),
)
cache_path = Path(sys.argv[1]).with_name("person.pc2")
person = add_actor(scene, mesh, vertices_m, cache_path, joint_of_face=joint_of_face(body))
passer_by_m = arrays["passer_by_m"]
other = person_mesh(
    "passer_by_1",
    body,
    np.zeros(body.n_shape),
    passer_by_m[0],
    Light("sun", 0.0),
    np.random.default_rng(1),
)
add_actor(scene, other, passer_by_m, Path(sys.argv[1]).with_name("passer_by_1.pc2"))
wall = bpy.data.meshes.new("wall")
wall.from_pydata(arrays["wall_m"].tolist(), [], [(0, 1, 2, 3)])
add_object(scene, "wall", wall)
visible = visible_joints(scene, person, arrays["joints_m"], arrays["centres_m"])
sys.stdout.write("\nANSWER " + json.dumps(visible.tolist()) + "\n")
