"""Frames, masks and intrinsics to cameras up to scale: the COLMAP stage."""
