"""The truth of the extras on disk: a clip for each person, transforms for each car."""

from pathlib import Path

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip, read_npz, save_clip
from gmrdata.errors import BadMotionFile
from gmrdata.extras.cast import Cast
from gmrdata.extras.drive import CAR_SIZE_M
from gmrdata.motion.resample import slice_motion
from gmrdata.store import write_npz


def save_extras(
    folder: Path, names: tuple[str, ...], cast: Cast, filmed: Clip, body: BodyModel
) -> None:
    """Write `<name>.npz` for each extra into a folder, which is made if there are any.

    A person's file is a clip, with the filmed clip's camera, that `gmrdata.clip.load_clip` reads.

    Args:
        folder: Where to.
        names: `Extras.names`.
        cast: The extras.
        filmed: The rendered clip; the extras' first rows are its.
        body: The people's body.
    """
    if names:
        folder.mkdir(exist_ok=True)
    n_frames = filmed.motion.n_frames
    for name, motion in zip(names, cast.walkers, strict=False):
        walk = slice_motion(motion, 0, n_frames)
        everywhere = np.ones(n_frames, dtype=bool)
        clip = Clip(f"{filmed.id}_{name}", walk, everywhere, filmed.image_numbers, filmed.camera)
        save_clip(folder / f"{name}.npz", clip, body.rest_pelvis_m(walk.shape))
    for name, car in zip(names[len(cast.walkers) :], cast.cars, strict=True):
        arrays = {"world_from_car": car.world_from_car[:n_frames], "size_m": CAR_SIZE_M}
        write_npz(folder / f"{name}.npz", arrays)


def load_car(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Transforms `world_from_car` (T, 4, 4) and size (3,) [m] of a car's file.

    Raises:
        MissingInput: there is no such file.
        BadMotionFile: it holds something else.
    """
    arrays = read_npz(path)
    world_from_car, size_m = arrays.get("world_from_car"), arrays.get("size_m")
    if (
        world_from_car is None
        or size_m is None
        or world_from_car.shape[1:] != (4, 4)
        or size_m.shape != (3,)
    ):
        raise BadMotionFile(f"{path}: not a car's file; render the clip again")
    return world_from_car, size_m
