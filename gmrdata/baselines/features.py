"""Image features: one vector per frame, from whatever network looks at images.

`<folder>/<clip id>.npz` holds `features` (T, D), row t for row t of the manifest's clip; rows that
are not valid in the clip may hold NaN.
"""

from pathlib import Path

import numpy as np

from gmrdata.clip import Clip, read_npz
from gmrdata.errors import BadFeatures, MissingInput

KEY = "features"


def features_path(folder: Path, clip_id: str) -> Path:
    """Where the features of a clip lie."""
    return folder / f"{clip_id}.npz"


def load_features(folder: Path, clip: Clip) -> np.ndarray:
    """The features of a clip's rows: (T, D) float32.

    Raises:
        MissingInput: there is no such file.
        BadMotionFile: not readable as an .npz of plain arrays.
        BadFeatures: no array of that name and shape, or NaN in a valid row.
    """
    path = features_path(folder, clip.id)
    if not path.is_file():
        raise MissingInput(f"{path}: no image features of clip {clip.id}; write `{KEY}` (T, D)")
    found = read_npz(path).get(KEY)
    n = clip.motion.n_frames
    if found is None or found.dtype.kind != "f" or found.ndim != 2 or len(found) != n:
        shape = "none" if found is None else f"{found.dtype} of shape {found.shape}"
        raise BadFeatures(f"{path}: {KEY} is {shape}, expected numbers of shape ({n}, D)")
    if not found.shape[1]:
        raise BadFeatures(f"{path}: {KEY} has no columns")
    bad = np.flatnonzero(clip.valid & ~np.isfinite(found).all(axis=1))
    if len(bad):
        raise BadFeatures(
            f"{path}: row {bad[0]} holds NaN or infinite numbers ({len(bad)} rows in all), and clip"
            f" {clip.id} has it as valid. Compute them again, or drop the rows in the manifest"
        )
    return np.asarray(found, dtype=np.float32)
