"""Depth, normals, flow and instances of a frame as PNG, which every image library reads as it is.

`cv2.imread(path, cv2.IMREAD_UNCHANGED)` gives the stored numbers, colours in the order blue, green,
red.  The flow's form is that of KITTI's 2015 benchmark (http://www.cvlibs.net/datasets/kitti).
"""

from pathlib import Path

import numpy as np

from gmrdata.errors import BadFrames
from gmrdata.store import atomic_path

MM_PER_M = 1000.0
FARTHEST_M = 65.535
FLOW_STEPS_PER_PX = 64.0
FLOW_ZERO = 2**15
_MOST = 65535


def write_depth(path: Path, depth_m: np.ndarray) -> None:
    """Write (H, W) depths along the optical axis [m] in whole millimetres.

    0 stands for no surface (NaN, infinite) and for one farther than 65.535 m.
    """
    near = np.nan_to_num(depth_m, nan=np.inf) < FARTHEST_M
    depth_mm = np.where(near, np.where(near, depth_m, 0.0) * MM_PER_M, 0.0)
    _write(path, np.rint(depth_mm))


def read_depth(path: Path) -> np.ndarray:
    """(H, W) float64 depths [m] of a file by `write_depth`; infinite where it has none.

    Raises:
        BadFrames: not there, or no such file.
    """
    stored = _read(path, 2)
    return np.where(stored > 0, stored / MM_PER_M, np.inf)


def write_normals(path: Path, normals: np.ndarray) -> None:
    """Write (H, W, 3) unit normals: red, green, blue are x, y, z, with -1 -> 0 and 1 -> 65535.

    Pixels without a normal (zeros) become 0, 0, 0.
    """
    there = (normals != 0).any(axis=-1, keepdims=True)
    stored = np.where(there, (np.clip(normals, -1, 1) + 1) / 2 * _MOST, 0.0)
    _write(path, np.rint(stored)[..., ::-1])


def read_normals(path: Path) -> np.ndarray:
    """(H, W, 3) float64 normals of a file by `write_normals`; zeros where it has none.

    Raises:
        BadFrames: not there, or no such file.
    """
    stored = _read(path, 3)[..., ::-1]
    return np.where((stored > 0).any(axis=-1, keepdims=True), stored / _MOST * 2 - 1, 0.0)


def write_flow(path: Path, flow_px: np.ndarray) -> None:
    """Write (H, W, 2) flow [px]: red and green are 64 u + 2^15 and 64 v + 2^15, blue is 1 if known.

    Pixels with NaN, and with a flow of 512 px or more, are not known: 0, 0, 0.
    """
    stored = np.rint(flow_px * FLOW_STEPS_PER_PX + FLOW_ZERO)
    known = ((stored >= 0) & (stored <= _MOST)).all(axis=-1)  # False for NaN
    u, v = stored[..., 0], stored[..., 1]
    pixels = np.stack([np.ones_like(u), v, u], axis=-1)
    pixels[~known] = 0
    _write(path, pixels)


def read_flow(path: Path) -> np.ndarray:
    """(H, W, 2) float64 flow [px] of a file by `write_flow`; NaN where it has none.

    Raises:
        BadFrames: not there, or no such file.
    """
    stored = _read(path, 3)
    flow_px = (stored[..., :0:-1] - FLOW_ZERO) / FLOW_STEPS_PER_PX
    return np.where(stored[..., :1] > 0, flow_px, np.nan)


def write_instances(path: Path, instances: np.ndarray) -> None:
    """Write (H, W) numbers of what is seen, 0 for the background: 8 bit."""
    _write(path, instances, np.uint8)


def read_instances(path: Path) -> np.ndarray:
    """(H, W) uint8 numbers of a file by `write_instances`.

    Raises:
        BadFrames: not there, or no such file.
    """
    import cv2

    stored = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if path.is_file() else None
    if stored is None or stored.dtype != np.uint8 or stored.ndim != 2:
        raise BadFrames(f"{path}: missing, or not such an 8-bit PNG; render this frame again")
    return stored


def _write(path: Path, pixels: np.ndarray, kind: type[np.integer] = np.uint16) -> None:
    import cv2

    _, encoded = cv2.imencode(".png", pixels.astype(kind))
    with atomic_path(path) as temporary:
        temporary.write_bytes(encoded.tobytes())


def _read(path: Path, n_dimensions: int) -> np.ndarray:
    import cv2

    stored = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if path.is_file() else None
    if stored is None or stored.dtype != np.uint16 or stored.ndim != n_dimensions:
        raise BadFrames(f"{path}: missing, or not such a 16-bit PNG; render this frame again")
    return stored.astype(np.float64)
