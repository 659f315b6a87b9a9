"""Patches that are followed as they shift, turn and grow from one frame to the next.

Where a camera goes ahead, what is near grows by a tenth from keyframe to keyframe.  A patch that
may only shift then goes with the stronger half of its texture, in one match of ten by 0.8 px too
far.  So a patch has the four degrees of freedom of a similarity here, and Gauss and Newton's steps
find them by the slopes of the first frame (the inverse compositional way of Baker and Matthews
2004).  Points and offsets are complex numbers, which a similarity multiplies.
"""

import cv2
import numpy as np

HALF_PX = 7  # half of a patch's side
GROWTH = 0.2  # standard deviation of a patch's growth, and of its turn [rad], before a look
NOISE_GREY = 3.0  # standard deviation of a grey value [of 255]
STEPS = 6
STILL_PX = 0.05  # a patch whose last step is longer is not found
CENTRE = 0.5 + 0.5j  # our (0, 0) is the corner of the first pixel, OpenCV's its centre


def follow_patches(
    before: np.ndarray, after: np.ndarray, points_px: np.ndarray, guess_px: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where patches round points (N, 2) of a frame (H, W) are in another one, near what is guessed
    (N, 2) [px]; and which of them (N,) bool come to rest."""
    if not len(points_px):
        return np.zeros((0, 2)), np.zeros(0, dtype=bool)
    side = np.arange(-HALF_PX, HALF_PX + 1)
    offsets = (side[None] + 1j * side[:, None]).ravel()
    slopes, patches = _seen_before(before, _complex(points_px), offsets)
    known = np.diag([0.0, 0.0, *2 * [(NOISE_GREY / (GROWTH * HALF_PX)) ** 2]])
    stiffness = np.swapaxes(slopes, 1, 2) @ slopes + known + 1e-3 * np.eye(4)
    there, shape = _complex(guess_px), np.ones(len(points_px), np.complex128)
    shift = np.full_like(there, np.inf)
    for _ in range(STEPS):
        lacking = _without_mean(_sample(after, there[:, None] + shape[:, None] * offsets)) - patches
        pull = np.swapaxes(slopes, 1, 2) @ lacking[..., None]
        step = np.linalg.solve(stiffness, pull.astype(np.float64))[..., 0]
        shape = shape / (1 + _complex(step[:, 2:]) / HALF_PX)
        shift = shape * _complex(step[:, :2])
        there = there - shift
    there_px = np.stack([there.real, there.imag], axis=-1)
    return there_px, np.abs(shift) < STILL_PX


def _seen_before(
    image: np.ndarray, points: np.ndarray, offsets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Slopes (N, P, 4) of patches of P pixels as they shift, grow and turn; patches (N, P)."""
    across, down = (
        _sample(cv2.Scharr(image, cv2.CV_32F, *axis) / 32, points[:, None] + offsets)
        for axis in ((1, 0), (0, 1))
    )
    u, v = offsets.real / HALF_PX, offsets.imag / HALF_PX
    slopes = np.stack([across, down, across * u + down * v, down * u - across * v], axis=-1)
    slopes -= slopes.mean(axis=1, keepdims=True)
    return slopes.astype(np.float32), _without_mean(_sample(image, points[:, None] + offsets))


def _sample(image: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Values (N, P) float32 of an image (H, W) at places (N, P), by bilinear interpolation."""
    places = (places - CENTRE).astype(np.complex64)
    columns, rows = places.real.copy(), places.imag.copy()
    edge = cv2.BORDER_REPLICATE
    source = image.astype(np.float32)
    return np.asarray(cv2.remap(source, columns, rows, cv2.INTER_LINEAR, borderMode=edge))


def _without_mean(values: np.ndarray) -> np.ndarray:
    return np.asarray(values - values.mean(axis=1, keepdims=True))


def _complex(pairs: np.ndarray) -> np.ndarray:
    return np.asarray(pairs[:, 0] + 1j * pairs[:, 1])
