# SPDX-License-Identifier: GPL-3.0-or-later
"""House fronts.

Posters: bold shapes and lines of writing.
"""

import cv2
import numpy as np

from blender.textures.base import PLASTERS, POSTERS, SHUTTERS, noise, pick, weather


def poster(patch: np.ndarray, rng: np.random.Generator) -> None:
    """Fill a view of an image with a poster: a picture of bold shapes and lines of writing."""
    height, width = patch.shape[:2]
    if height < 8 or width < 8:
        return
    picture = np.full((height, width, 3), pick(rng, POSTERS), np.float32)
    for _ in range(int(rng.integers(3, 8))):
        colour = tuple(float(c) for c in pick(rng, POSTERS))
        at = rng.uniform(0, 1, 2) * (width, 0.7 * height)
        corners = at + rng.normal(0, 0.28 * width, (int(rng.integers(3, 6)), 2))
        if rng.random() < 0.5:
            radius = max(int(rng.uniform(0.08, 0.3) * width), 1)
            cv2.circle(picture, tuple(int(v) for v in at), radius, colour, -1, cv2.LINE_AA)
        else:
            cv2.fillConvexPoly(
                picture, cv2.convexHull(corners.astype(np.int32)), colour, cv2.LINE_AA
            )
    ink = pick(rng, POSTERS)
    for y in np.arange(0.72, 0.95, 0.055) * height:
        x = 0.08 * width
        while x < 0.9 * width:
            word = rng.uniform(0.05, 0.22) * width
            line = slice(int(y), int(y + max(0.028 * height, 1)))
            picture[line, int(x) : int(min(x + word, 0.92 * width))] = ink
            x += word + 0.035 * width
    patch[:] = picture


def posters(width_px: int, height_px: int, rng: np.random.Generator) -> np.ndarray:
    """An advertising pillar: posters side by side, pasted over one another."""
    image = np.full((height_px, width_px, 3), pick(rng, PLASTERS), np.float32)
    for _ in range(40):
        height, width = (
            int(height_px * rng.uniform(0.2, 0.4)),
            int(width_px * rng.uniform(0.12, 0.22)),
        )
        y, x = int(rng.uniform(0, height_px - height)), int(rng.uniform(0, width_px - width))
        poster(image[y : y + height, x : x + width], rng)
    return weather(image, rng, 0.06)


MORTAR = (0.66, 0.62, 0.56)


def facade(
    width_m: float, height_m: float, px_per_m: float, rng: np.random.Generator
) -> np.ndarray:
    """A house front: plaster or brick, windows with shutters, a door, posters, and a dirty foot."""
    height, width = int(height_m * px_per_m), int(width_m * px_per_m)
    image = np.full((height, width, 3), pick(rng, PLASTERS), np.float32)
    image = weather(image, rng, 0.07)
    if rng.random() < 0.45:
        _bricks(image, px_per_m, rng)
    else:
        # Where plaster has come off, the bricks show.
        bricks = np.empty_like(image)
        _bricks(bricks, px_per_m, rng)
        bare = noise(height, width, rng, max(int(1.2 * px_per_m), 8), 6, 0.6) > 1.1
        image[bare] = bricks[bare]
    _windows(image, width_m, height_m, px_per_m, rng)
    for _ in range(int(rng.integers(3, 7))):
        size = rng.uniform((0.35, 0.5), (0.75, 1.05)) * px_per_m
        x = int(rng.uniform(0, max(width - size[0], 1)))
        y = int(height - rng.uniform(1.1, 2.3) * px_per_m)
        poster(image[y : y + int(size[1]), x : x + int(size[0])], rng)
    above_m = (height - np.arange(height)) / px_per_m
    image *= (1 - 0.45 * np.exp(-above_m / 0.35))[:, None, None].astype(np.float32)
    return weather(image, rng, 0.05)


def _bricks(image: np.ndarray, px_per_m: float, rng: np.random.Generator) -> None:
    (height, width), joint = image.shape[:2], max(int(0.012 * px_per_m), 1)
    base = np.array([0.55, 0.30, 0.22]) * rng.uniform(0.8, 1.2)
    image[:] = MORTAR
    row_px, brick_px, columns = 0.085 * px_per_m, 0.25 * px_per_m, np.arange(width)
    courses = []
    for first_px in (0.0, -brick_px / 2):
        starts = np.arange(first_px, width, brick_px)
        brick = np.searchsorted(starts.astype(int), columns, side="right") - 1
        in_brick = columns < (starts + brick_px).astype(int)[brick] - joint
        courses.append((len(starts), brick, in_brick[:, None]))
    for row in range(int(height / row_px) + 1):
        y0, y1 = int(row * row_px), min(int((row + 1) * row_px) - joint, height)
        count, brick, in_brick = courses[row % 2]
        shades = base * rng.normal(1, 0.17, (count, 1))
        shades = np.clip(shades + rng.normal(0, 0.02, (count, 3)), 0.05, 0.9)
        image[y0:y1] = np.where(in_brick, shades[brick], MORTAR)


def _windows(
    image: np.ndarray, width_m: float, height_m: float, px_per_m: float, rng: np.random.Generator
) -> None:
    columns = max(int(width_m / 1.6), 1)
    shutter, frame = pick(rng, SHUTTERS), pick(rng, ((0.88, 0.86, 0.82), (0.35, 0.26, 0.2)))
    door = int(rng.integers(columns))
    for floor in range(int((height_m - 0.6) / 2.6)):
        for column in range(columns):
            x_m = (column + 0.5) * width_m / columns + rng.uniform(-0.1, 0.1)
            is_door = floor == 0 and column == door
            sill_m = 0.0 if is_door else floor * 2.7 + rng.uniform(0.95, 1.05)
            size_m = (0.95, 2.1) if is_door else (0.72, 1.2)
            x0, x1 = ((x_m - size_m[0] / 2) * px_per_m, (x_m + size_m[0] / 2) * px_per_m)
            y0, y1 = ((height_m - sill_m - size_m[1]) * px_per_m, (height_m - sill_m) * px_per_m)
            _opening(
                image, [int(v) for v in (x0, x1, y0, y1)], px_per_m, (frame, shutter), is_door, rng
            )


def _opening(
    image: np.ndarray,
    edges: list[int],
    px_per_m: float,
    colours: tuple[np.ndarray, np.ndarray],
    is_door: bool,
    rng: np.random.Generator,
) -> None:
    x0, x1, y0, y1 = edges
    frame, shutter = colours
    border = max(int(0.07 * px_per_m), 1)
    image[max(y0 - border, 0) : y1 + border, max(x0 - border, 0) : x1 + border] = frame * 0.9
    if is_door:
        image[y0:y1, x0:x1] = shutter
        for panel in range(4):
            top = y0 + border + panel * (y1 - y0) // 4
            image[top : top + (y1 - y0) // 4 - 2 * border, x0 + border : x1 - border] = (
                shutter * 0.72
            )
        return
    glass = image[y0:y1, x0:x1]
    if glass.size:
        shine = noise(len(glass), glass.shape[1], rng, max(len(glass) // 2, 4), 4, 0.6)
        glass[:] = np.clip(0.2 + 0.09 * shine[..., None] * np.array([0.9, 1.0, 1.2]), 0.03, 0.7)
    middle, bar = (x0 + x1) // 2, max(border // 3, 1)
    image[y0:y1, middle - bar : middle + bar] = frame
    for k in (1, 2):
        y = y0 + k * (y1 - y0) // 3
        image[y - bar : y + bar, x0:x1] = frame
    wing = (x1 - x0) // 2
    for left in (x0 - wing - border, x1 + border):
        image[y0:y1, max(left, 0) : max(left + wing, 0)] = shutter
        for y in range(y0, y1, max(int(0.07 * px_per_m), 2)):
            image[y : y + max(int(0.02 * px_per_m), 1), max(left, 0) : max(left + wing, 0)] = (
                shutter * 0.6
            )
