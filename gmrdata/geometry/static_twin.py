"""The same take with the camera's motion off (Table 6 of the paper)."""

from dataclasses import replace

import numpy as np

from gmrdata.errors import BadRecipe
from gmrdata.geometry.camera import CameraPath
from gmrdata.geometry.distance import DISTANCES_M, FRAME_MARGIN_SHARE
from gmrdata.geometry.framing import in_frame_share, person_box
from gmrdata.geometry.look_at import look_at
from gmrdata.geometry.transforms import rigid

STEP_M = 0.25
"""How far the camera steps back before it is tried again."""


def static_twin(camera: CameraPath, pelvis_world_m: np.ndarray) -> CameraPath:
    """A static camera where a moving one stands at the middle of the clip.

    It looks at the middle of the subject's path.  Where that doesn't keep the subject in frame for
    the whole clip, it steps back on the same side, at the same height, as far as it must.

    Args:
        camera: The moving camera, known at its middle frame.
        pelvis_world_m: (T, 3) pelvis path of the subject, z-up world [m].

    Returns:
        CameraPath of the same lens and length.

    Raises:
        BadRecipe: the middle frame has no camera, or no place keeps the subject in frame.
    """
    place_m = camera.centres_world_m[camera.n_frames // 2]
    if not np.isfinite(place_m).all():
        raise BadRecipe("a clip whose middle frame has no camera has no twin with its motion off")
    target_m = (pelvis_world_m.min(axis=0) + pelvis_world_m.max(axis=0)) / 2
    across_m = place_m[:2] - target_m[:2]
    near_m = float(np.linalg.norm(across_m))
    if near_m == 0:
        raise BadRecipe("the camera is straight above its subject; give it another place")
    box = person_box(pelvis_world_m)
    for distance_m in np.arange(near_m, max(near_m, DISTANCES_M[-1]) + STEP_M, STEP_M):
        ground_m = target_m[:2] + across_m / near_m * distance_m
        twin = _resting(camera, np.array([*ground_m, place_m[2]]), target_m)
        if in_frame_share(twin, box, FRAME_MARGIN_SHARE) == 1.0:
            return twin
    raise BadRecipe(
        f"a static camera can't keep the subject in frame from any distance up to "
        f"{DISTANCES_M[-1]:.0f} m; widen hfov_deg, shorten the clip, or leave camera_off out"
    )


def _resting(camera: CameraPath, place_m: np.ndarray, target_m: np.ndarray) -> CameraPath:
    pose = rigid(look_at(place_m, target_m), place_m)
    return replace(
        camera,
        world_from_cam=np.tile(pose, (camera.n_frames, 1, 1)),
        has_camera=np.ones(camera.n_frames, dtype=bool),
    )
