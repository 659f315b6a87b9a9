"""The sequence from above: the recovered camera, the data set's own, and the people."""

import numpy as np
from matplotlib.axes import Axes

from gmrdata.regenerate.qa.aligned import Aligned
from gmrdata.regenerate.qa.gather import Found
from gmrdata.report.style import COLOURS
from gmrdata.report.topview import (
    RECOVERED_WIDTH,
    TRUE_WIDTH,
    draw_camera,
    draw_path,
    extent_m,
    finish_view,
    mark_start,
)

PERSON_ROLES = ("person", "gmr", "good", "ink")
"""Colours of the people, in turn."""
DROPPED_WIDTH = 1.0


def draw_paths(axes: Axes, found: Found, aligned: Aligned | None) -> None:
    """Paths in the levelled world [m], z up: the data set's camera as a pale band under ours."""
    world_from_cam = found.world_from_cam
    if world_from_cam is None:
        return
    paths_m = [world_from_cam[:, :3, 3], *(c.motion.pelvis_m for c in found.clips.values())]
    tick_m = 0.09 * extent_m(paths_m)
    if aligned is not None:
        draw_camera(axes, aligned.world_from_cam, "camera-pale", TRUE_WIDTH, tick_m)
    draw_camera(axes, world_from_cam, "camera", RECOVERED_WIDTH, tick_m)
    people_m = np.nanmean([clip.motion.pelvis_m for clip in found.clips.values()], axis=0)
    mark_start(axes, world_from_cam[:, :3, 3], "camera", "camera", people_m)
    for person, clip in found.clips.items():
        role = PERSON_ROLES[person % len(PERSON_ROLES)]
        kept = np.array([not reason for reason in found.reasons[person]])[:, None]
        pelvis_m = clip.motion.pelvis_m
        draw_path(axes, pelvis_m, role, DROPPED_WIDTH, ":")
        draw_path(axes, np.where(kept, pelvis_m, np.nan), role, RECOVERED_WIDTH)
        mark_start(axes, pelvis_m, role, f"person {person}", None)
    cuts = found.frames_of(found.record.get("cuts_after_frames", []))
    _mark(axes, world_from_cam, cuts, "X", "ink")
    _mark(axes, world_from_cam, found.frames_of(found.record.get("interpolated", [])), "d", "bad")
    finish_view(axes)


def _mark(axes: Axes, world_from_cam: np.ndarray, rows: np.ndarray, marker: str, role: str) -> None:
    places_m = world_from_cam[rows, :2, 3]
    axes.plot(*places_m.T, marker, color=COLOURS[role], markersize=5, zorder=6)
