"""What Blender shall render; Blender's own side is in `blender/`."""
