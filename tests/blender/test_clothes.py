"""Clothes go where the limbs are."""

import numpy as np

from blender.clothes import vertex_colours
from gmrdata.body.model import BodyModel
from gmrdata.body.tree import JOINT


def test_each_region_has_its_colour(small_body: BodyModel) -> None:
    shape = np.zeros(small_body.n_shape)
    colours = vertex_colours(small_body, shape, np.random.default_rng(1))
    assert colours.shape == (len(small_body.template_m), 3) and colours.dtype == np.float32
    owner = small_body.skin_weights.argmax(axis=1)

    def main_colour(joint: str) -> tuple[float, ...]:
        kinds, counts = np.unique(colours[owner == JOINT[joint]], axis=0, return_counts=True)
        return tuple(kinds[counts.argmax()].tolist())

    shirt, trousers = main_colour("spine3"), main_colour("left_knee")
    skin = main_colour("left_wrist")
    assert len({shirt, trousers, skin, main_colour("left_foot")}) == 4
    assert main_colour("right_knee") == trousers and main_colour("right_wrist") == skin
    head = colours[owner == JOINT["head"]]
    assert len(np.unique(head, axis=0)) == 2  # skin and hair
    again = vertex_colours(small_body, shape, np.random.default_rng(1))
    assert again.tobytes() == colours.tobytes()
