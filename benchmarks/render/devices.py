"""Runs in its own process, without gmrdata: print the graphics processors that Cycles finds."""

import json
import sys

import bpy  # noqa: F401 - it holds Cycles

import _cycles  # isort: skip

found = []
for interface in ("OPTIX", "CUDA", "HIP", "ONEAPI", "METAL"):
    try:
        devices = _cycles.available_devices(interface)
    except ValueError:
        continue  # this Blender was built without it
    found += [f"{interface} {name}" for name, kind, *_ in devices if kind == interface]
sys.stdout.write("\nDEVICES " + json.dumps(found) + "\n")
