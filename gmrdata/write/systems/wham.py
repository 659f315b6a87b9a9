"""Writing people as WHAM writes them; `gmrdata.read.systems.wham` says what the file holds.

`verts`, which follow from the rest, are left out.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gmrdata.values.camera import CameraPath
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.files import write_bytes
from gmrdata.values.transforms import invert
from gmrdata.write.pickles import python3_pickle
from gmrdata.write.systems.tracked import (
    N_BETAS,
    TrackedPerson,
    placed,
    require_finite,
    y_up_from_world,
)


def write_wham(
    path: Path, people: Sequence[TrackedPerson | None], camera: CameraPath | None
) -> None:
    """Write `wham_output.pkl`: each person's frames that may be used, numbered from person 0.

    A person who is None is left out; the others keep their numbers.

    The shape coefficients are those of the person's own body, whose name is in `body`, a key more
    than WHAM has.  Without a camera there is no `pose` and no `trans`.

    Raises:
        BadMotionFile: a person has no frame that may be used, or one that is not finite.
    """
    content = {n: _wham_person(one, camera) for n, one in enumerate(people) if one is not None}
    write_bytes(path, python3_pickle(content))


def _wham_person(person: TrackedPerson, camera: CameraPath | None) -> dict[str, object]:
    rows = person.rows if camera is None else person.rows & camera.has_camera
    if not rows.any():
        raise BadMotionFile("a person has no frame that may be used; give a clip with one")
    motion = person.motion.take(rows)
    require_finite(motion, np.flatnonzero(rows))
    y_up = y_up_from_world(motion.n_frames)
    shape = np.pad(motion.shape, (0, max(0, N_BETAS - len(motion.shape))))
    content: dict[str, object] = {}
    if camera is not None:
        cam_from_world = invert(camera.world_from_cam[rows])
        content |= _named(placed(motion, cam_from_world, person.rest_pelvis_m), "pose", "trans")
    world = placed(motion, y_up, person.rest_pelvis_m)
    content |= _named(world, "pose_world", "trans_world")
    content["betas"] = np.tile(shape, (motion.n_frames, 1)).astype(np.float32)
    content["frame_ids"] = person.frame_numbers[rows].astype(np.int64)
    content["body"] = motion.body
    return content


def _named(arrays: tuple[np.ndarray, np.ndarray], *keys: str) -> dict[str, object]:
    return dict(zip(keys, (values.astype(np.float32) for values in arrays), strict=True))
