# SPDX-License-Identifier: GPL-3.0-or-later
"""Face and hair, painted by where on the head a texel is."""

import numpy as np

from blender.outfit import Outfit
from blender.patterns import waves

EYE_UP, EYE_SIDE_M = 0.50, 0.032
"""Height of the eyes, from the lowest point of the head to its crown, and half their distance."""
EAR_SIDE_M = 0.078
"""Ears are farther than this from the head's middle."""


def paint_head(
    colours: np.ndarray,
    rest_m: np.ndarray,
    on_head: np.ndarray,
    box_m: np.ndarray,
    neck_m: np.ndarray,
    outfit: Outfit,
) -> None:
    """Paint hair, eyes, brows, mouth and cap onto a body's texels, in place.

    Args:
        colours: (M, 3) sRGB.
        rest_m: (M, 3) where the texels are in the T-pose: x left, y up, z front [m].
        on_head: (M,) share of neck and head in the skin.
        box_m: (2, 3) lowest and highest coordinates of the head [m].
        neck_m: (3,) joint of the neck [m].
        outfit: The colours.
    """
    size_m = np.maximum(box_m[1] - box_m[0], 1e-6)
    near = (rest_m[:, 1] > neck_m[1] - 0.25) & (np.abs(rest_m[:, 0]) < size_m[0])
    place_m, colour, head = rest_m[near], colours[near], on_head[near] > 0.5
    up, front = ((place_m[:, k] - box_m[0, k]) / size_m[k] for k in (1, 2))
    _paint_face(colour, place_m, up, front, size_m[1], outfit, head)
    strands = 1 + 0.09 * waves(place_m * (1.0, 0.3, 0.6), 300.0, outfit.seed)[:, None]
    hair = _hair(place_m, up, front, neck_m, head, outfit)
    colour[hair] = (outfit.hair * strands)[hair]
    if outfit.hair_kind == "cap":
        cap = head & (up > 0.70 - 0.06 * front)
        colour[cap] = outfit.cap
        colour[cap & (up < 0.74 - 0.06 * front)] = 0.8 * outfit.cap
    colours[near] = colour


def _hair(
    place_m: np.ndarray,
    up: np.ndarray,
    front: np.ndarray,
    neck_m: np.ndarray,
    head: np.ndarray,
    outfit: Outfit,
) -> np.ndarray:
    """(N,) bool: where hair is."""
    if outfit.hair_kind == "bald":
        # A wreath above the ears and round the back.
        return head & (up > 0.42) & (up < 0.62) & (front < 0.36)
    # A slanting hairline: the forehead is bare to four fifths of the height, the neck to a third.
    slant = np.clip((front - 0.3) / 0.55, 0, 1)
    low = {"short": 0.36, "cropped": 0.46, "long": 0.10, "tied": 0.34, "cap": 0.40}
    lowest = low[outfit.hair_kind]
    line = lowest + (0.84 - lowest) * slant**0.8
    ear = (np.abs(place_m[:, 0]) > EAR_SIDE_M) & (up > 0.25) & (up < 0.6)
    hair = head & (up > line) & ~ear
    if outfit.hair_kind == "long":
        behind = place_m[:, 2] < neck_m[2] + 0.015
        reach = (place_m[:, 1] > neck_m[1] - 0.13) & (np.abs(place_m[:, 0]) < 0.12)
        hair |= behind & reach
    if outfit.hair_kind == "tied":
        tail = (place_m[:, 2] < neck_m[2]) & (np.abs(place_m[:, 0]) < 0.03)
        hair |= tail & (place_m[:, 1] > neck_m[1] - 0.16)
    return hair


def _paint_face(
    colour: np.ndarray,
    place_m: np.ndarray,
    up: np.ndarray,
    front: np.ndarray,
    height_m: float,
    outfit: Outfit,
    head: np.ndarray,
) -> None:
    face = head & (front > 0.6)
    aside_m = np.abs(place_m[:, 0])
    above_eye_m = (up - EYE_UP) * height_m
    if outfit.beard:
        jaw = head & (front > 0.42) & (up < 0.30)
        jaw |= face & (up < 0.34) & (aside_m > 0.028)
        colour[jaw] = 0.35 * colour[jaw] + 0.65 * outfit.hair
    lips = face & (np.hypot(aside_m / 0.024, (up - 0.218) * height_m / 0.008) < 1)
    colour[lips] *= (0.90, 0.70, 0.69)
    eye = np.hypot((aside_m - EYE_SIDE_M) / 0.015, above_eye_m / 0.0058)
    iris = np.hypot(aside_m - EYE_SIDE_M, above_eye_m)
    colour[face & (eye < 1.35)] *= 0.72
    colour[face & (eye < 1)] = (0.80, 0.78, 0.75)
    colour[face & (eye < 1) & (iris < 0.0065)] = (0.16, 0.11, 0.08)
    brow_m = above_eye_m - 0.019 + 0.12 * np.abs(aside_m - EYE_SIDE_M)
    brow = face & (np.abs(brow_m) < 0.004) & (np.abs(aside_m - EYE_SIDE_M) < 0.020)
    colour[brow] = 0.3 * colour[brow] + 0.7 * np.minimum(outfit.hair, 0.45)
