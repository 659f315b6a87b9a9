"""Points of a body's feet whose sliding is measured."""

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.body.tree import JOINT

SMPL_VERTICES = 6890
SMPL_FEET = (3216, 3387, 6617, 6787)
"""Two points on each foot of SMPL, left and right: yohanshin/WHAM, lib/eval/eval_utils.py."""
SOLE_M = 0.03
"""Vertices of a foot up to this high above its lowest one are its sole [m]."""


def foot_vertices(body: BodyModel) -> tuple[int, ...]:
    """Vertices at the toes and heels, left foot first.

    SMPL's own four for a body of its mesh.  Of another mesh the front-most and the rear-most vertex
    of each sole in the rest pose.
    """
    if len(body.template_m) == SMPL_VERTICES and body.name.startswith("smpl"):
        return SMPL_FEET
    found = []
    for side in ("left", "right"):
        joints = [JOINT[f"{side}_ankle"], JOINT[f"{side}_foot"]]
        foot = np.flatnonzero(body.skin_weights[:, joints].sum(axis=1) > 0.5)
        heights_m = body.template_m[foot, 1]
        sole = foot[heights_m < heights_m.min() + SOLE_M]
        depths_m = body.template_m[sole, 2]
        found += [int(sole[depths_m.argmax()]), int(sole[depths_m.argmin()])]
    return tuple(found)
