"""What a set draws for each clip: its person's looks and its place.

Every choice hangs on the set's seed and the clip's id, so that a clip stays as it is when others
come and go, and a clip's twin has the same person in the same place.
"""

import hashlib
from typing import Literal

import numpy as np

from gmrdata.person_config import PersonConfig
from gmrdata.render import RenderConfig
from gmrdata.scene_config import SceneConfig
from gmrdata.synthetic.recipe import SyntheticClip, SyntheticRecipe


def clip_rng(
    seed: int, clip_id: str, choice: Literal["motion", "person", "looks", "place", "faults"]
) -> np.random.Generator:
    """The generator of one kind of choice for one clip."""
    digest = hashlib.sha256(f"{clip_id}/{choice}".encode()).digest()
    words = np.frombuffer(digest[:16], dtype="<u4")
    return np.random.default_rng([seed, *words.tolist()])


def render_config(recipe: SyntheticRecipe, clip: SyntheticClip) -> RenderConfig:
    """How a clip, or its twin, is rendered: the set's recipe with the clip's place and looks."""
    config = recipe.render
    return config.model_copy(
        update={
            "scene": _scene(recipe, clip),
            "person": _person(recipe, clip, config.person),
            "character": clip.character or config.character,
        }
    )


def _scene(recipe: SyntheticRecipe, clip: SyntheticClip) -> SceneConfig:
    if clip.scene is not None:
        return clip.scene
    if not recipe.scenes:
        return recipe.render.scene
    rng = clip_rng(recipe.seed, clip.id, "place")
    scene = recipe.scenes[int(rng.integers(len(recipe.scenes)))]
    if "seed" in scene.model_fields_set:
        return scene
    return scene.model_copy(update={"seed": int(rng.integers(2**31))})


def _person(recipe: SyntheticRecipe, clip: SyntheticClip, person: PersonConfig) -> PersonConfig:
    if not recipe.people.vary or person.seed is not None:
        return person
    seed = int(clip_rng(recipe.seed, clip.id, "looks").integers(2**31))
    return person.model_copy(update={"seed": seed})
