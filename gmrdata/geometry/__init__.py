"""Transforms, rotations, the pinhole camera, and camera programmes."""
