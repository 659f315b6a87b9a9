"""What a rolling shutter would make of the lens that was found.

A phone reads its picture line after line.  While it turns, the last lines see something else than
the first, so that the picture is stretched or sheared; bundle adjustment takes some of this for
another focal length.  Neither its covariance nor parts of the video tell.  So the image points are
moved as far as the lines of a usual phone would move them, and the lens is adjusted again.
"""

from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.cameras.colmap import project_into, pycolmap, seen_by
from gmrdata.read.frames import image_number

AXES = (0, 1)  # x and y, along which lines may be read
READOUT_S = 0.01
"""From the first line to the last: phones take 5 to 20 ms, a global shutter none."""


def with_rolled_lines(model: Any, axis: int, readout: float) -> Any:
    """A copy of a COLMAP model whose image points lie where a rolling shutter would have them; its
    lines are read along x (0) or y (1), in a `readout` of the time from one number of an image to
    the next.

    How fast a point moves in the picture is taken from the frames before and after of the model.
    """
    rolled = pycolmap.Reconstruction(model)
    (camera,) = rolled.cameras.values()
    side_px = (camera.width, camera.height)[axis]
    images = sorted(map(rolled.image, rolled.reg_image_ids()), key=lambda image: str(image.name))
    numbers = [image_number(Path(image.name)) for image in images]
    for row, image in enumerate(images):
        before, after = max(0, row - 1), min(len(images) - 1, row + 1)
        features, at_px, points = seen_by(model, image)
        moved_px = project_into(images[after], points) - project_into(images[before], points)
        late = readout * (at_px[:, axis] / side_px - 0.5) / max(1, numbers[after] - numbers[before])
        for feature, shift_px in zip(features, late[:, None] * moved_px, strict=True):
            if np.isfinite(shift_px).all():
                image.point2D(feature).xy += shift_px
    return rolled
