# SPDX-License-Identifier: GPL-3.0-or-later
"""Skin and clothes painted onto a body, by where in the rest pose each texel is.

Face and hair, painted by where on the head a texel is.
"""

from dataclasses import dataclass

import numpy as np

from blender.people.atlas import Atlas
from blender.people.outfit import Cloth, Outfit, colours_at, waves
from gmrdata.values.body import JOINT, BodyModel

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


_HEAD = ("neck", "head")
_ARMS = tuple(f"{s}_{j}" for s in ("left", "right") for j in ("shoulder", "elbow", "wrist", "hand"))
_LEGS = tuple(f"{s}_{j}" for s in ("left", "right") for j in ("hip", "knee", "ankle", "foot"))

TORSO_RADIUS_M, ARM_RADIUS_M, LEG_RADIUS_M = 0.15, 0.05, 0.08
"""By which an angle round a limb becomes a length on its cloth."""


@dataclass(frozen=True, eq=False)
class Places:
    """Where M texels are on a body in the T-pose, metres from its landmarks."""

    rest_m: np.ndarray
    """(M, 3) x to the left, y up, z to the front."""
    on_head: np.ndarray
    """(M,) share of neck and head in the skin, 0 to 1."""
    on_arms: np.ndarray
    """(M,) share of the arms."""
    joints_m: np.ndarray
    """(24, 3) rest joints."""

    def joint(self, name: str) -> np.ndarray:
        """(3,) a rest joint [m]."""
        return np.asarray(self.joints_m[JOINT[name]])

    @property
    def is_arm(self) -> np.ndarray:
        """(M,) bool."""
        return self.on_arms > 0.5

    @property
    def is_leg(self) -> np.ndarray:
        """(M,) bool: below the hips."""
        return np.asarray(self.rest_m[:, 1] < self.joint("left_hip")[1])


def paint(body: BodyModel, shape: np.ndarray, outfit: Outfit, atlas: Atlas) -> np.ndarray:
    """(H, W, 3) sRGB picture of a dressed body.

    Args:
        body: Its weights say which skin belongs to which limb.
        shape: (S,) shape coefficients.
        outfit: What to paint.
        atlas: The atlas of the body's faces.
    """
    rest_m = body.rest_vertices_m(shape)
    shares = [
        body.skin_weights[:, [JOINT[joint] for joint in joints]].sum(axis=1)
        for joints in (_HEAD, _ARMS)
    ]
    at = atlas.spread(body.faces, np.column_stack([rest_m, *shares]))
    places = Places(at[:, :3], at[:, 3], at[:, 4], body.rest_joints_m(shape))
    colours = np.tile(outfit.skin.astype(np.float32), (len(at), 1))
    colours *= 1 + 0.015 * waves(places.rest_m, 25.0, outfit.seed)[:, None]
    _paint_feet(colours, places, outfit)
    _paint_legs(colours, places, outfit)
    _paint_top(colours, places, outfit)
    head = body.skin_weights[:, JOINT["head"]] > 0.5
    if head.any():
        box_m = np.stack([rest_m[head].min(axis=0), rest_m[head].max(axis=0)])
        paint_head(colours, places.rest_m, places.on_head, box_m, places.joint("neck"), outfit)
    return atlas.picture(np.clip(colours, 0, 1))


def _paint_feet(colours: np.ndarray, places: Places, outfit: Outfit) -> None:
    height_m = places.rest_m[:, 1]
    ankle_m, floor_m = places.joint("left_ankle")[1], height_m.min()
    shoe_top_m = ankle_m + outfit.boot_m + 0.005
    colours[height_m < shoe_top_m + outfit.sock_m] = outfit.socks
    colours[height_m < shoe_top_m] = outfit.shoes
    # A lighter tongue and laces, and a sole that shows.
    ahead_m = places.rest_m[:, 2] - places.joint("left_ankle")[2]
    aside_m = np.abs(np.abs(places.rest_m[:, 0]) - places.joint("left_foot")[0])
    laces = (ahead_m > 0.02) & (ahead_m < 0.10) & (aside_m < 0.018)
    colours[laces & (height_m < shoe_top_m) & (height_m > floor_m + 0.045)] = outfit.soles
    colours[height_m < floor_m + 0.012] = outfit.soles


def _paint_legs(colours: np.ndarray, places: Places, outfit: Outfit) -> None:
    height_m = places.rest_m[:, 1]
    hip_m, knee_m, ankle_m = (places.joint(f"left_{name}")[1] for name in ("hip", "knee", "ankle"))
    waist_m = _waist_m(places)
    end_m = np.interp(outfit.leg_end, [0, 1, 2], [hip_m - 0.08, knee_m, ankle_m])
    covered = (height_m < waist_m) & (height_m > end_m) & ~places.is_arm
    _sew(colours, places, outfit.legs, covered, around_torso=outfit.skirt)
    if outfit.side_stripe is not None and not outfit.skirt:
        outside = np.abs(places.rest_m[:, 0]) - np.abs(places.joint("left_knee")[0])
        stripe = np.abs(places.rest_m[:, 2] - places.joint("left_knee")[2]) < 0.014
        colours[covered & stripe & (outside > 0.02)] = outfit.side_stripe
    if outfit.belt is not None:
        colours[covered & (height_m > waist_m - 0.035)] = outfit.belt


def _paint_top(colours: np.ndarray, places: Places, outfit: Outfit) -> None:
    inner = _top_region(places, outfit.sleeve, outfit.hem, outfit.neckline_m)
    _sew(colours, places, outfit.top, inner)
    if outfit.print_colour is not None:
        _paint_print(colours, places, outfit, inner)
    if outfit.jacket is not None:
        open_m = 0.025 + 0.06 * np.clip(places.rest_m[:, 1] - _waist_m(places), 0, 0.4)
        is_open = (np.abs(places.rest_m[:, 0]) < open_m) & (places.rest_m[:, 2] > _axis_z(places))
        outer = _top_region(places, 1.96, outfit.hem + 0.2, 0.0) & ~is_open
        _sew(colours, places, outfit.jacket, outer)


def _top_region(places: Places, sleeve: float, hem: float, neckline_m: float) -> np.ndarray:
    """(M,) bool: what a top covers; lengths as in `Outfit`."""
    aside_m, height_m = np.abs(places.rest_m[:, 0]), places.rest_m[:, 1]
    joints = [abs(places.joint(f"left_{name}")[0]) for name in ("shoulder", "elbow", "wrist")]
    cuff_m = np.interp(sleeve, [0, 1, 2], joints)
    waist_m = _waist_m(places) - 0.01
    hem_m = np.interp(hem, [0, 1], [waist_m, places.joint("left_hip")[1] - 0.04])
    covered = (places.on_head < 0.5) & (height_m > hem_m)
    covered &= ~(places.is_arm & (aside_m > cuff_m))
    if neckline_m:
        front = places.rest_m[:, 2] > places.joint("neck")[2]
        above_m = height_m - (places.joint("neck")[1] - 0.05 - neckline_m)
        covered &= ~(front & (aside_m < 0.65 * above_m))
    return covered


def _paint_print(colours: np.ndarray, places: Places, outfit: Outfit, covered: np.ndarray) -> None:
    """Squares on the chest, the same to the left and to the right."""
    side_m, middle_m = 0.19, places.joint("spine3")[1] + 0.06
    column = np.floor((places.rest_m[:, 0] / side_m + 0.5) * 8).astype(int)
    row = np.floor(((places.rest_m[:, 1] - middle_m) / side_m + 0.5) * 8).astype(int)
    inside = covered & (places.rest_m[:, 2] > _axis_z(places) + 0.02)
    inside &= (column >= 0) & (column < 8) & (row >= 0) & (row < 8)
    inside[inside] = outfit.print_bits[row[inside], column[inside]]
    colours[inside] = outfit.print_colour


def _sew(
    colours: np.ndarray,
    places: Places,
    cloth: Cloth,
    covered: np.ndarray,
    *,
    around_torso: bool = False,
) -> None:
    """Paint a cloth where it covers the skin; it runs round torso, arms and legs."""
    arm, leg = places.is_arm[covered], places.is_leg[covered] & (not around_torso)
    x, y, z = places.rest_m[covered].T
    elbow, knee = places.joint("left_elbow"), places.joint("left_knee")
    across_m = TORSO_RADIUS_M * np.arctan2(x, z - _axis_z(places))
    along_m = y - places.joint("spine2")[1]
    across_m[arm] = ARM_RADIUS_M * np.arctan2(z[arm] - elbow[2], y[arm] - elbow[1])
    along_m[arm] = abs(places.joint("left_shoulder")[0]) - np.abs(x[arm])
    across_m[leg] = LEG_RADIUS_M * np.arctan2(np.abs(x[leg]) - abs(knee[0]), z[leg] - knee[2])
    along_m[leg] = y[leg] - knee[1]
    colours[covered] = colours_at(cloth, across_m, along_m)


def _waist_m(places: Places) -> float:
    return float(places.joint("spine1")[1]) + 0.02


def _axis_z(places: Places) -> float:
    """Middle of the trunk from back to front [m]."""
    return float(places.joint("spine2")[2]) + 0.03
