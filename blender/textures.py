# SPDX-License-Identifier: GPL-3.0-or-later
"""Picture textures, drawn with numpy from a seed: detail at every scale, and none of it repeats.

All are (H, W, 3) float32 sRGB in 0..1, with row 0 at the top.
"""

import cv2
import numpy as np

Colour = tuple[float, float, float]

PLASTERS: tuple[Colour, ...] = (
    (0.84, 0.68, 0.45), (0.76, 0.46, 0.34), (0.86, 0.80, 0.68), (0.55, 0.64, 0.66),
    (0.66, 0.68, 0.52), (0.80, 0.58, 0.50), (0.62, 0.57, 0.52),
)  # fmt: skip
POSTERS: tuple[Colour, ...] = (
    (0.82, 0.22, 0.16), (0.95, 0.78, 0.20), (0.14, 0.40, 0.60), (0.92, 0.90, 0.84),
    (0.16, 0.48, 0.36), (0.10, 0.10, 0.12), (0.90, 0.52, 0.18),
)  # fmt: skip
WOODS: tuple[Colour, ...] = ((0.62, 0.45, 0.27), (0.52, 0.34, 0.20), (0.70, 0.56, 0.38))
SHUTTERS: tuple[Colour, ...] = (
    (0.18, 0.36, 0.32), (0.20, 0.28, 0.42), (0.42, 0.18, 0.14), (0.86, 0.84, 0.80),
)  # fmt: skip


def pick(rng: np.random.Generator, colours: tuple[Colour, ...]) -> np.ndarray:
    """One of the colours, slightly off."""
    colour = np.array(colours[int(rng.integers(len(colours)))])
    return np.clip(colour + rng.normal(0, 0.02, 3), 0.02, 0.98).astype(np.float32)


def noise(
    height: int, width: int, rng: np.random.Generator, coarsest: int, octaves: int, fall: float
) -> np.ndarray:
    """(H, W) smooth noise of about unit variance: grids of random numbers, each twice as fine.

    Args:
        height: Rows.
        width: Columns.
        rng: Where the numbers come from.
        coarsest: Pixels per cell of the coarsest grid.
        octaves: Number of grids.
        fall: Amplitude of each grid relative to the coarser one before.
    """
    total, power = np.zeros((height, width), np.float32), 0.0
    for octave in range(octaves):
        cell = max(coarsest / 2**octave, 1.0)
        grid = rng.standard_normal((int(height / cell) + 4, int(width / cell) + 4))
        size = (int(grid.shape[1] * cell), int(grid.shape[0] * cell))
        layer = cv2.resize(grid.astype(np.float32), size, interpolation=cv2.INTER_CUBIC)
        total += fall**octave * layer[:height, :width]
        power += fall ** (2 * octave)
    return total / np.float32(np.sqrt(power))


def _weather(image: np.ndarray, rng: np.random.Generator, amount: float) -> np.ndarray:
    """Stains, grain and a dirty foot."""
    height, width = image.shape[:2]
    stains = noise(height, width, rng, max(height // 3, 8), 7, 0.75)
    return np.clip(image * (1 + amount * stains[..., None]), 0.02, 0.95).astype(np.float32)


def paving(size_px: int, metres: float, rng: np.random.Generator) -> np.ndarray:
    """Flagstones in rows of changing width, with leaves, stains and painted marks."""
    px_per_m = size_px / metres
    image = np.empty((size_px, size_px, 3), np.float32)
    image[:] = (0.22, 0.20, 0.18)
    y = 0.0
    joint = max(0.014 * px_per_m, 1)
    while y < size_px:
        row = rng.uniform(0.32, 0.62) * px_per_m
        x = -rng.uniform(0, 0.8) * px_per_m
        while x < size_px:
            stone = rng.uniform(0.35, 1.05) * px_per_m
            shade = rng.normal(0.52, 0.085) * np.array([1.0, 0.95, 0.87]) + rng.normal(0, 0.012, 3)
            rows = slice(int(y + joint), int(min(y + row, size_px)))
            image[rows, int(max(x + joint, 0)) : int(max(min(x + stone, size_px), 0))] = shade
            x += stone
        y += row
    _marks(image, px_per_m, rng)
    image = _weather(image, rng, 0.10)
    _leaves(image, px_per_m, rng, count=int(4.5 * metres**2))
    return image


def _marks(image: np.ndarray, px_per_m: float, rng: np.random.Generator) -> None:
    """Drain covers and chalk drawings."""
    size = len(image)
    for _ in range(int(size / px_per_m / 2)):
        at = tuple(int(v) for v in rng.uniform(0, size, 2))
        radius = int(rng.uniform(0.22, 0.4) * px_per_m)
        cv2.circle(image, at, radius, (0.26, 0.25, 0.25), -1, cv2.LINE_AA)
        for ring in range(2, radius, max(radius // 4, 2)):
            cv2.circle(image, at, ring, (0.45, 0.44, 0.42), 1, cv2.LINE_AA)
    for _ in range(int(size / px_per_m * 2)):
        corner = rng.uniform(0, size, 2)
        points = corner + rng.normal(0, 0.45 * px_per_m, (int(rng.integers(3, 9)), 2))
        colour = tuple(float(c) for c in 0.25 + 0.7 * pick(rng, POSTERS))
        cv2.polylines(image, [points.astype(np.int32)], False, colour, 2, cv2.LINE_AA)


def _leaves(image: np.ndarray, px_per_m: float, rng: np.random.Generator, count: int) -> None:
    colours = np.array(
        [(0.72, 0.38, 0.12), (0.80, 0.62, 0.16), (0.46, 0.50, 0.18), (0.42, 0.2, 0.1)]
    )
    for _ in range(count):
        at = tuple(int(v) for v in rng.uniform(0, len(image), 2))
        axes = tuple(max(int(v * px_per_m), 1) for v in rng.uniform((0.025, 0.015), (0.07, 0.035)))
        colour = np.clip(colours[int(rng.integers(4))] * rng.uniform(0.7, 1.2), 0, 0.95)
        angle = float(rng.uniform(0, 360))
        cv2.ellipse(image, at, axes, angle, 0, 360, tuple(map(float, colour)), -1, cv2.LINE_AA)


def facade(
    width_m: float, height_m: float, px_per_m: float, rng: np.random.Generator
) -> np.ndarray:
    """A house front: plaster or brick, windows with shutters, a door, posters, and a dirty foot."""
    height, width = int(height_m * px_per_m), int(width_m * px_per_m)
    image = np.empty((height, width, 3), np.float32)
    image[:] = pick(rng, PLASTERS)
    image = _weather(image, rng, 0.07)
    if rng.random() < 0.45:
        _bricks(image, 0, height, px_per_m, rng)
    else:
        # Where plaster has come off, the bricks show.
        bricks = image.copy()
        _bricks(bricks, 0, height, px_per_m, rng)
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
    return _weather(image, rng, 0.05)


def _bricks(
    image: np.ndarray, top: int, bottom: int, px_per_m: float, rng: np.random.Generator
) -> None:
    width, joint = image.shape[1], max(int(0.012 * px_per_m), 1)
    base = np.array([0.55, 0.30, 0.22]) * rng.uniform(0.8, 1.2)
    image[top:bottom] = (0.66, 0.62, 0.56)
    row_px, brick_px = 0.085 * px_per_m, 0.25 * px_per_m
    for row in range(int((bottom - top) / row_px) + 1):
        y0, y1 = int(top + row * row_px), min(int(top + (row + 1) * row_px) - joint, bottom)
        for x in np.arange(-brick_px / 2 * (row % 2), width, brick_px):
            x0, x1 = max(int(x), 0), max(int(x + brick_px) - joint, 0)
            image[y0:y1, x0:x1] = np.clip(
                base * rng.normal(1, 0.17) + rng.normal(0, 0.02, 3), 0.05, 0.9
            )


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


def poster(patch: np.ndarray, rng: np.random.Generator) -> None:
    """Fill a view of an image with a poster: a picture of bold shapes and lines of writing."""
    height, width = patch.shape[:2]
    if height < 8 or width < 8:
        return
    picture = np.empty((height, width, 3), np.float32)
    picture[:] = pick(rng, POSTERS)
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
    image = np.empty((height_px, width_px, 3), np.float32)
    image[:] = pick(rng, PLASTERS)
    for _ in range(40):
        height, width = (
            int(height_px * rng.uniform(0.2, 0.4)),
            int(width_px * rng.uniform(0.12, 0.22)),
        )
        y, x = int(rng.uniform(0, height_px - height)), int(rng.uniform(0, width_px - width))
        poster(image[y : y + height, x : x + width], rng)
    return _weather(image, rng, 0.06)


def planks(width_px: int, height_px: int, rng: np.random.Generator) -> np.ndarray:
    """A crate's side: boards with grain, nails, a frame and a stencil."""
    image = np.empty((height_px, width_px, 3), np.float32)
    wood, boards = pick(rng, WOODS), int(rng.integers(4, 7))
    for board in range(boards):
        rows = slice(board * height_px // boards, (board + 1) * height_px // boards - 2)
        count = rows.stop - rows.start
        grain = cv2.resize(
            rng.standard_normal((count, max(width_px // 24, 2))).astype(np.float32),
            (width_px, count),
        )
        image[rows] = wood * (rng.uniform(0.7, 1.2) + 0.13 * grain[..., None])
        image[rows.stop : rows.stop + 2] = wood * 0.2
    edge = width_px // 10
    for columns in (slice(0, edge), slice(width_px - edge, width_px)):
        image[:, columns] = wood * 0.8
        image[:, columns] *= (
            1
            + 0.15
            * noise(height_px, edge, rng, 24, 4, 0.8)[..., None][:, : columns.stop - columns.start]
        )
    for x in (edge // 2, width_px - edge // 2):
        for y in range(height_px // 12, height_px, height_px // 6):
            cv2.circle(image, (x, y), max(edge // 6, 1), (0.12, 0.11, 0.1), -1, cv2.LINE_AA)
    size = width_px // 3
    x, y = (int(v) for v in rng.uniform(edge, 0.55 * width_px, 2))
    poster(image[y : y + size, x : x + size], rng)
    return _weather(image, rng, 0.08)


def foliage(size_px: int, rng: np.random.Generator) -> np.ndarray:
    """Leaves over leaves, lighter on top, with some blossoms."""
    image = np.empty((size_px, size_px, 3), np.float32)
    image[:] = (0.06, 0.10, 0.04)
    blossom = pick(rng, POSTERS)
    for i in range(1500):
        at = tuple(int(v) for v in rng.uniform(0, size_px, 2))
        axes = (int(rng.uniform(0.012, 0.03) * size_px), int(rng.uniform(0.006, 0.012) * size_px))
        green = np.array([0.28, 0.46, 0.14]) * (0.45 + 0.9 * i / 1500) * rng.uniform(0.7, 1.3)
        colour = blossom if rng.random() < 0.04 else green
        angle = float(rng.uniform(0, 360))
        shade = tuple(float(c) for c in np.clip(colour, 0, 0.9))
        cv2.ellipse(image, at, axes, angle, 0, 360, shade, -1, cv2.LINE_AA)
    return image


def barrel(width_px: int, height_px: int, rng: np.random.Generator) -> np.ndarray:
    """A painted drum: hoops, rust and a label."""
    image = np.empty((height_px, width_px, 3), np.float32)
    image[:] = pick(rng, POSTERS)
    rust = noise(height_px, width_px, rng, height_px // 3, 7, 0.7) > rng.uniform(0.5, 1.2)
    image[rust] = (0.40, 0.22, 0.12)
    for y in (0, height_px // 3, 2 * height_px // 3, height_px - height_px // 20):
        image[y : y + height_px // 24] *= 0.55
    for x in range(0, width_px - width_px // 6, width_px // 3):
        size = height_px // 4
        poster(image[height_px // 2 - size // 2 : height_px // 2 + size // 2, x : x + size], rng)
    return _weather(image, rng, 0.10)


def sky(width_px: int, height_px: int, rng: np.random.Generator) -> np.ndarray:
    """An equirectangular sky with clouds, row 0 at the zenith and the last row at the nadir."""
    up = np.linspace(1, -1, height_px)[:, None, None]
    blue = np.array([0.30, 0.52, 0.82]) * np.clip(up, 0, 1) ** 0.5
    haze = np.array([0.80, 0.86, 0.92]) * (1 - np.clip(up, 0, 1) ** 0.5)
    half = noise(height_px, width_px // 2, rng, height_px // 5, 7, 0.6)
    clouds = np.clip(np.concatenate([half, half[:, ::-1]], axis=1) * 0.5 - 0.1, 0, 0.85)[..., None]
    return np.asarray((blue + haze) * (1 - clouds) + 0.95 * clouds, dtype=np.float32)
