"""What may be wrong with pictures: small, coarse, blurred, dark, cropped, or full of what moves."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

DARK_GAIN, DARK_NOISE = 0.06, 1.5
"""Share of the light that is left, and the sensor's noise on it [grey levels]."""


@dataclass(frozen=True)
class Film:
    """Frames in memory, with their calibration."""

    images: list[np.ndarray]
    """T pictures (h, w, 3) uint8, BGR."""
    intrinsics_px: np.ndarray
    """(3, 3) [px]."""
    rng: np.random.Generator
    """Source of noise and places."""


def half_size(film: Film) -> Film:
    """Half the size, and JPEG at quality 30."""
    images = []
    for image in film.images:
        small = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        _, encoded = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 30])
        images.append(np.asarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR)))
    return replace(film, images=images, intrinsics_px=np.diag([0.5, 0.5, 1]) @ film.intrinsics_px)


def mean_of(count: int) -> Callable[[Film], Film]:
    """Each frame the mean of so many neighbours, fewer at the ends: blur by motion."""

    def blur(film: Film) -> Film:
        stack = np.array(film.images)
        n, reach = len(stack), count // 2
        means = [stack[max(0, t - reach) : t + reach + 1].mean(axis=0) for t in range(n)]
        return replace(film, images=[np.round(mean).astype(np.uint8) for mean in means])

    return blur


def centre_crop(share: float) -> Callable[[Film], Film]:
    """The middle of each picture, so that who stands there fills more of it."""

    def crop(film: Film) -> Film:
        height, width = film.images[0].shape[:2]
        left, top = round(width * (1 - share) / 2), round(height * (1 - share) / 2)
        images = [image[top : height - top, left : width - left] for image in film.images]
        moved = film.intrinsics_px - [[0, 0, left], [0, 0, top], [0, 0, 0]]
        return replace(film, images=images, intrinsics_px=moved)

    return crop


def darkness(film: Film) -> Film:
    """Little light, and a sensor's noise."""
    shape = film.images[0].shape
    images = [
        (DARK_GAIN * image + film.rng.normal(0, DARK_NOISE, shape)).clip(0, 255).astype(np.uint8)
        for image in film.images
    ]
    return replace(film, images=images)


def watermark(film: Film) -> Film:
    """A watermark that stays where it is: a sharp logo over a fifth of the picture."""
    height, width = film.images[0].shape[:2]
    squares = film.rng.integers(0, 256, (height // 48, width // 24))
    logo = np.kron(squares, np.ones((10, 10))).astype(np.uint8)[..., None]
    images = []
    for image in film.images:
        marked = image.copy()
        marked[: logo.shape[0], : logo.shape[1]] = logo
        images.append(marked)
    return replace(film, images=images)


def sea(film: Film) -> Film:
    """Water over the lower 60 %: patterned waves that travel to one side at their own speeds."""
    height, width = film.images[0].shape[:2]
    top = round(0.4 * height)
    texture = film.rng.normal(0, 1, (height - top, 3 * width)).astype(np.float32)
    layers = [(cv2.GaussianBlur(texture, (0, 0), sigma), sigma) for sigma in (1.5, 4, 12)]
    images = []
    for t, image in enumerate(film.images):
        water = np.zeros((height - top, width), np.float32)
        for (layer, sigma), speed in zip(layers, (1.0, 2.2, 3.5), strict=True):
            shift = int(speed * t) % (2 * width)
            sway = round(6 * np.sin(t / 7 + sigma))
            water += sigma * np.roll(layer, sway, axis=0)[:, shift : shift + width]
        covered = image.copy()
        covered[top:] = np.clip(110 + 60 * water, 0, 255)[..., None].astype(np.uint8)
        images.append(covered)
    return replace(film, images=images)


CROWD = 14
CROWD_PX = 0.22
"""Height of one of them, over the picture's."""


def crowd(film: Film) -> Film:
    """Many who walk past: upright pieces of the last picture that drift sideways in front of it."""
    height, width = film.images[0].shape[:2]
    tall, wide = round(CROWD_PX * height * 1.6), round(CROWD_PX * height * 0.7)
    shape = np.zeros((tall, wide), np.uint8)
    cv2.ellipse(shape, (wide // 2, tall // 2), (wide // 2, tall // 2), 0, 0, 360, (255,), -1)
    corners = np.c_[film.rng.integers(0, height - tall, CROWD), film.rng.integers(0, width, CROWD)]
    pieces = [
        film.images[-1][y : y + tall, x : x + wide]
        for y, x in np.c_[
            film.rng.integers(0, height - tall, CROWD), film.rng.integers(0, width - wide, CROWD)
        ]
    ]
    speeds_px = film.rng.choice([-1, 1], CROWD) * film.rng.uniform(1, 5, CROWD) * width / 720
    images = []
    for t, image in enumerate(film.images):
        filled = np.pad(image, ((0, 0), (wide, wide), (0, 0)))
        for piece, (y, x), speed in zip(pieces, corners, speeds_px, strict=True):
            bob = round(0.01 * height * np.sin(0.4 * t + x))
            left = int(x + speed * t) % (width + wide)
            at = (slice(max(0, y + bob), max(0, y + bob) + tall), slice(left, left + wide))
            where = filled[at]
            inside = shape[: where.shape[0]] > 0
            where[inside] = piece[: where.shape[0]][inside]
        images.append(filled[:, wide:-wide])
    return replace(film, images=images)
