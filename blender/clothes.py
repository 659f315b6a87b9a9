# SPDX-License-Identifier: GPL-3.0-or-later
"""Skin, hair and clothes as vertex colours, from the skinning weights."""

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.body.tree import JOINT, JOINT_NAMES

SKINS = ((0.87, 0.66, 0.53), (0.78, 0.56, 0.42), (0.62, 0.42, 0.30), (0.45, 0.29, 0.20))
HAIRS = ((0.10, 0.07, 0.05), (0.24, 0.15, 0.08), (0.52, 0.37, 0.18), (0.35, 0.14, 0.07))
SHIRTS = ((0.72, 0.13, 0.12), (0.10, 0.32, 0.58), (0.93, 0.88, 0.78), (0.90, 0.60, 0.10))
TROUSERS = ((0.13, 0.17, 0.30), (0.24, 0.22, 0.20), (0.42, 0.36, 0.26), (0.10, 0.10, 0.11))
SHOES = ((0.90, 0.89, 0.86), (0.22, 0.12, 0.07), (0.08, 0.08, 0.09))

_TORSO = (
    "spine1",
    "spine2",
    "spine3",
    "left_collar",
    "right_collar",
    "left_shoulder",
    "right_shoulder",
)
_LEGS = ("pelvis", "left_hip", "right_hip", "left_knee", "right_knee")
_FEET = ("left_ankle", "right_ankle", "left_foot", "right_foot")


def vertex_colours(body: BodyModel, shape: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(V, 3) linear colours: a person in a T-shirt, trousers and shoes.

    Args:
        body: Its weights say which vertex belongs to which limb.
        shape: (S,) shape coefficients.
        rng: Chooses the colours.
    """
    skin, hair, shirt, trousers, shoes = (
        np.array(colours[int(rng.integers(len(colours)))])
        for colours in (SKINS, HAIRS, SHIRTS, TROUSERS, SHOES)
    )
    rest_m = body.template_m + body.shape_dirs_m @ np.asarray(shape, dtype=np.float64)
    joints_m = body.rest_joints_m(shape)
    colours = np.tile(skin, (len(rest_m), 1))
    on = {
        name: body.skin_weights[:, [JOINT[j] for j in joints]].sum(axis=1)
        for name, joints in (("torso", _TORSO), ("legs", _LEGS), ("feet", _FEET))
    }
    is_torso = on["torso"] > 0.5
    colours[is_torso] = shirt
    waist_m = joints_m[JOINT["spine1"], 1] + 0.02
    is_legs = (on["legs"] > 0.5) | (is_torso & (rest_m[:, 1] < waist_m))
    colours[is_legs] = trousers
    ankle_m = joints_m[[JOINT["left_ankle"], JOINT["right_ankle"]], 1].mean()
    is_feet = on["feet"] > 0.5
    colours[is_feet] = np.where((rest_m[is_feet, 1] > ankle_m + 0.03)[:, None], trousers, shoes)
    colours[_hair(body, rest_m)] = hair
    return np.asarray(colours**2.2, dtype=np.float32)


def _hair(body: BodyModel, rest_m: np.ndarray) -> np.ndarray:
    """(V,) bool: the top and the back of the head."""
    owner = np.array(JOINT_NAMES)[body.skin_weights.argmax(axis=1)]
    head = owner == "head"
    if not head.any():
        return head
    low, high = rest_m[head].min(axis=0), rest_m[head].max(axis=0)
    up = (rest_m[:, 1] - low[1]) / max(high[1] - low[1], 1e-6)
    front = (rest_m[:, 2] - low[2]) / max(high[2] - low[2], 1e-6)
    # A slanting hairline: the forehead is bare to four fifths of the height, the neck to a third.
    return np.asarray(head & (up > 0.36 + 0.5 * np.clip((front - 0.3) / 0.55, 0, 1)))
