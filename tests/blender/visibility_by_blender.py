"""Runs in its own process: which joints Blender's rays reach, printed as JSON.

Usage: visibility_by_blender.py case.npz body.npz, with arrays vertices_m (T, V, 3), joints_m
(T, 24, 3), centres_m (T, 3), and wall_m (4, 3): the corners of the only other thing in the scene.
"""

import json
import sys
from pathlib import Path

import bpy
import numpy as np

from blender.light import Light
from blender.person import add_person
from blender.scene import add_object
from blender.visibility import visible_joints
from gmrdata.body.file import read_body

arrays = np.load(sys.argv[1])
body = read_body(Path(sys.argv[2]))
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
person = add_person(
    scene,
    body,
    np.zeros(body.n_shape),
    arrays["vertices_m"][0],
    Light("sun", 0.0),
    np.random.default_rng(0),
)
wall = bpy.data.meshes.new("wall")
wall.from_pydata(arrays["wall_m"].tolist(), [], [(0, 1, 2, 3)])
add_object(scene, "wall", wall)
visible = visible_joints(
    scene, person, body, arrays["vertices_m"], arrays["joints_m"], arrays["centres_m"]
)
sys.stdout.write("\nANSWER " + json.dumps(visible.tolist()) + "\n")
