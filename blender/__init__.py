# SPDX-License-Identifier: GPL-3.0-or-later
"""The Blender stage: `python -m blender job.json` renders one clip in its own process.

The only place that imports bpy.  Started by `gmrdata.film.render.render_clip`.
"""
