"""How much of a rendered clip has the whole person in frame."""

from dataclasses import replace

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.body.skin import motion_vertices_m
from gmrdata.clip import Clip, camera_of
from gmrdata.geometry.framing import in_frame

IN_FRAME = "in_frame_share"
"""The manifest's figure: share of a clip's frames with the whole person in frame."""
CHUNK_FRAMES = 64


def whole_person_share(clip: Clip, body: BodyModel) -> float:
    """Share of a clip's frames (0 to 1) in which every vertex of the body is inside the image.

    Raises:
        BadMotionFile: the clip has no camera.
    """
    camera = camera_of(clip)
    seen = [
        in_frame(
            replace(
                camera,
                world_from_cam=camera.world_from_cam[rows],
                has_camera=camera.has_camera[rows],
            ),
            motion_vertices_m(body, clip.motion, rows=rows),
        )
        for rows in np.array_split(
            np.arange(clip.motion.n_frames), -(-clip.motion.n_frames // CHUNK_FRAMES)
        )
    ]
    return float(np.concatenate(seen).mean())
