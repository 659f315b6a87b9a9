"""Cameras of frames that nothing placed, between placed ones that are close."""

import numpy as np
from scipy.interpolate import krogh_interpolate
from scipy.spatial.transform import Rotation, Slerp

from gmrdata.geometry import transforms
from gmrdata.sfm.timeline import Timeline


def fill_short_gaps(
    world_from_cam: np.ndarray, has_camera: np.ndarray, timeline: Timeline, max_gap_frames: int
) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate cameras over short gaps; ends, longer gaps and cuts stay as they are.

    Places follow the cubic through the two placed frames on either side, or a polynomial of lower
    degree where fewer are within reach; rotations are slerped.

    Args:
        world_from_cam: (T, 4, 4); NaN where `has_camera` is False.
        has_camera: (T,) bool.
        timeline: Of the T frames.
        max_gap_frames: Frames in a gap at most, left-out images among them.

    Returns:
        World_from_cam (T, 4, 4) with the gaps filled, and which frames were filled (T,) bool.
    """
    filled, interpolated = world_from_cam.copy(), np.zeros(len(has_camera), dtype=bool)
    numbers, placed = timeline.image_numbers, np.flatnonzero(has_camera)
    near = timeline.near(placed, max_gap_frames)
    for gap in np.flatnonzero(near & (np.diff(placed) > 1)):
        between = np.arange(placed[gap] + 1, placed[gap + 1])
        first = gap - 1 if gap > 0 and near[gap - 1] else gap
        last = gap + 2 if gap + 1 < len(near) and near[gap + 1] else gap + 1
        knots, ends = placed[first : last + 1], placed[gap : gap + 2]
        centres = krogh_interpolate(numbers[knots], world_from_cam[knots, :3, 3], numbers[between])
        turn = Slerp(numbers[ends], Rotation.from_matrix(world_from_cam[ends, :3, :3]))
        filled[between] = transforms.rigid(turn(numbers[between]).as_matrix(), centres)
        interpolated[between] = True
    return filled, interpolated
