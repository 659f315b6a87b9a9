"""How far away a camera must be to have its subject in frame."""

from collections.abc import Callable

import numpy as np

from gmrdata.errors import BadRecipe
from gmrdata.geometry.camera import CameraPath
from gmrdata.geometry.framing import in_frame_share, person_box

FRAME_MARGIN_SHARE = 0.03
"""Border that is kept free, as a share of the image's height."""
DISTANCES_M = np.arange(2.0, 25.01, 0.25)
"""Distances that are tried, nearest first, until the subject stays in frame."""


def nearest_in_frame(
    at: Callable[[float], CameraPath], pelvis_m: np.ndarray, kind: str
) -> CameraPath:
    """The nearest camera that has the whole subject in frame all the time.

    Args:
        at: The camera at a distance [m].
        pelvis_m: (T, 3) the subject's pelvis, world [m].
        kind: What kind of camera it is, for the message.

    Raises:
        BadRecipe: no distance keeps the subject in frame.
    """
    box = person_box(pelvis_m)
    for distance_m in DISTANCES_M:
        camera = at(float(distance_m))
        if in_frame_share(camera, box, FRAME_MARGIN_SHARE) == 1.0:
            return camera
    raise BadRecipe(
        f"a {kind} camera can't keep the subject in frame from any distance up to "
        f"{DISTANCES_M[-1]:.0f} m; widen hfov_deg, shorten the clip, or give distance_m"
    )
