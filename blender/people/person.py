# SPDX-License-Identifier: GPL-3.0-or-later
"""The person of a clip as a bpy mesh, dressed."""

from typing import Any

import numpy as np

from blender.light import Light
from blender.objects import bpy_mesh, moving_picture_material
from blender.people.atlas import lay_out
from blender.people.clothes import paint
from blender.people.outfit import sample_outfit
from blender.places.layout import Mesh
from gmrdata.film.character import TextureConfig, phenotypes_of
from gmrdata.read.body_file import read_picture, read_uv
from gmrdata.values.body import BodyModel, gender_of


def person_mesh(
    name: str,
    body: BodyModel,
    shape: np.ndarray,
    vertices_m: np.ndarray,
    light: Light,
    rng: np.random.Generator,
    *,
    surroundings: np.ndarray | None = None,
    texture: TextureConfig | None = None,
) -> Any:
    """The body, dressed, in the pose of (V, 3) vertices [m]; gives a bpy mesh of that name.

    Args:
        name: Of the mesh, its material and its picture.
        body: The body.
        shape: (S,) its shape.
        vertices_m: (V, 3) [m].
        light: What falls on it.
        rng: Chooses skin, hair and clothes.
        surroundings: (N, 3) sRGB colours that the clothes should differ from.
        texture: A picture to wear instead.

    Raises:
        BadBodyFile: the texture's files can't be read, or don't fit the body.
    """
    if texture is None:
        uv, picture = dressed(body, shape, rng, surroundings)
    else:
        uv, picture = read_uv(texture.uv, body.faces), read_picture(texture.image)
    material = moving_picture_material(name, picture, light)
    return bpy_mesh(name, Mesh(vertices_m, body.faces, uv, smooth=True), [material])


def dressed(
    body: BodyModel,
    shape: np.ndarray,
    rng: np.random.Generator,
    surroundings: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Picture coordinates per corner (F, 3, 2) and the picture (H, W, 3), sRGB, of someone."""
    female = {"female": 1.0, "male": 0.0, "neutral": 0.5}[gender_of(body)]
    phenotypes = phenotypes_of(body, shape) or {"gender": female, "age": 0.75}
    outfit = sample_outfit(
        rng, female=phenotypes["gender"], age=phenotypes["age"], surroundings=surroundings
    )
    atlas = lay_out(body.template_m, body.faces)
    return atlas.uv, paint(body, shape, outfit, atlas)


def joint_of_face(body: BodyModel) -> np.ndarray:
    """(F,) joint with the largest share in each face of the body."""
    return np.asarray(body.skin_weights[body.faces].sum(axis=1).argmax(axis=1))
