"""Clothes go where the limbs are, and every texel belongs to one triangle."""

from dataclasses import replace

import numpy as np
import pytest

from blender.people.atlas import Atlas, lay_out
from blender.people.clothes import paint
from blender.people.outfit import (
    KINDS,
    LEAST_CONTRAST,
    Cloth,
    Outfit,
    colours_at,
    contrasts,
    sample_outfit,
)
from gmrdata.film.character import sample_person
from gmrdata.values.body import JOINT, BodyModel

UV_TOLERANCE_PX = 1e-6


@pytest.fixture(scope="module")
def atlas(anny) -> Atlas:
    return lay_out(anny.template_m, anny.faces)


def look_up(picture: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Colours (N, C) at picture coordinates (N, 2), interpolated as a renderer does."""
    height, width = picture.shape[:2]
    x, y = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    left, top = np.floor(x + UV_TOLERANCE_PX).astype(int), np.floor(y + UV_TOLERANCE_PX).astype(int)
    right_share, low_share = (x - left)[:, None], (y - top)[:, None]
    right, low = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    upper = picture[top, left] * (1 - right_share) + picture[top, right] * right_share
    lower = picture[low, left] * (1 - right_share) + picture[low, right] * right_share
    return np.asarray(upper * (1 - low_share) + lower * low_share)


def test_a_picture_of_places_gives_each_point_of_the_skin_its_place(anny, atlas):
    """Interpolating between texels anywhere in a triangle never takes another triangle's."""
    assert len(np.unique(atlas.texels)) == len(atlas.texels)
    picture = atlas.picture(atlas.spread(anny.faces, anny.template_m))
    shares = np.random.default_rng(0).dirichlet([0.3, 0.3, 0.3], len(anny.faces))
    uv = np.einsum("fk,fkc->fc", shares, atlas.uv)
    places_m = np.einsum("fk,fkc->fc", shares, anny.template_m[anny.faces])
    np.testing.assert_allclose(look_up(picture, uv), places_m, atol=1e-5)
    corners = look_up(picture, atlas.uv.reshape(-1, 2))
    np.testing.assert_allclose(corners, anny.template_m[anny.faces].reshape(-1, 3), atol=1e-5)


def vertex_colours(body: BodyModel, atlas: Atlas, picture: np.ndarray) -> np.ndarray:
    """(V, 3) colour of each vertex."""
    colours = np.zeros((len(body.template_m), 3))
    colours[body.faces.ravel()] = look_up(picture, atlas.uv.reshape(-1, 2))
    return colours


def dressed(body: BodyModel, atlas: Atlas, outfit: Outfit) -> np.ndarray:
    return vertex_colours(body, atlas, paint(body, np.zeros(body.n_shape), outfit, atlas))


def plain_outfit(**said: object) -> Outfit:
    """Everything in its own colour, without patterns."""
    grey = np.full(3, 0.5)
    outfit = sample_outfit(np.random.default_rng(0))
    plain = {
        "skin": np.array([0.9, 0.7, 0.6]),
        "hair": np.array([0.1, 0.1, 0.1]),
        "hair_kind": "short",
        "beard": False,
        "top": Cloth("plain", np.array([0.9, 0.1, 0.1]), grey, 0.1, 0),
        "sleeve": 0.6,
        "neckline_m": 0.0,
        "hem": 0.0,
        "jacket": None,
        "print_colour": None,
        "legs": Cloth("plain", np.array([0.1, 0.1, 0.9]), grey, 0.1, 0),
        "leg_end": 1.95,
        "skirt": False,
        "belt": None,
        "side_stripe": None,
        "shoes": np.array([0.1, 0.9, 0.1]),
        "soles": np.array([0.1, 0.9, 0.1]),
    }
    return replace(outfit, **(plain | said))


def nearest_name(colours: np.ndarray) -> np.ndarray:
    """What plain colours belong to."""
    names = np.array(["skin", "hair", "top", "legs", "shoes"])
    known = np.array(
        [[0.9, 0.7, 0.6], [0.1, 0.1, 0.1], [0.9, 0.1, 0.1], [0.1, 0.1, 0.9], [0.1, 0.9, 0.1]]
    )
    return names[np.linalg.norm(colours[:, None] - known, axis=-1).argmin(axis=1)]


def at_joint(body: BodyModel, names: np.ndarray, joint: str, within_m: float = 0.09) -> set[str]:
    """What is worn near a joint."""
    apart_m = np.linalg.norm(body.template_m - body.joints_template_m[JOINT[joint]], axis=1)
    return set(names[apart_m < within_m].tolist())


def test_each_region_has_its_garment(anny, atlas):
    names = nearest_name(dressed(anny, atlas, plain_outfit()))
    for side in ("left", "right"):
        assert at_joint(anny, names, f"{side}_elbow") == {"skin"}
        assert at_joint(anny, names, f"{side}_hand", 0.05) == {"skin"}
        assert at_joint(anny, names, f"{side}_shoulder", 0.07) == {"top"}
        assert at_joint(anny, names, f"{side}_knee") == {"legs"}
        assert at_joint(anny, names, f"{side}_foot", 0.04) == {"shoes"}
    assert at_joint(anny, names, "spine3", 0.12) == {"top"}
    crown = names[anny.template_m[:, 1] > anny.template_m[:, 1].max() - 0.02]
    assert set(crown.tolist()) == {"hair"}


def test_sleeves_and_trousers_end_where_they_are_told(anny, atlas):
    names = nearest_name(dressed(anny, atlas, plain_outfit(sleeve=1.96, leg_end=0.5)))
    assert at_joint(anny, names, "left_elbow") == {"top"}
    assert at_joint(anny, names, "left_knee") == {"skin"}
    bare = nearest_name(dressed(anny, atlas, plain_outfit(sleeve=0.0, hair_kind="bald")))
    assert at_joint(anny, bare, "left_elbow") == {"skin"}
    crown = bare[anny.template_m[:, 1] > anny.template_m[:, 1].max() - 0.05]
    assert set(crown.tolist()) == {"skin"}


def test_people_differ_and_the_same_seed_gives_the_same_picture(anny, atlas):
    shape = sample_person(anny, np.random.default_rng(0))
    pictures = [
        paint(anny, shape, sample_outfit(np.random.default_rng(seed)), atlas) for seed in (1, 1, 2)
    ]
    assert pictures[0].shape == (*atlas.size_px, 3) and pictures[0].dtype == np.float32
    assert pictures[0].min() >= 0 and pictures[0].max() <= 1
    assert pictures[0].tobytes() == pictures[1].tobytes()
    assert np.abs(pictures[0] - pictures[2]).mean() > 0.05


def test_the_distribution_is_the_stated_one():
    men = [sample_outfit(np.random.default_rng(seed), female=0.0) for seed in range(600)]
    women = [sample_outfit(np.random.default_rng(seed), female=1.0) for seed in range(600)]
    everyone = men + women
    assert {outfit.top.kind for outfit in everyone} == set(KINDS)
    assert np.mean([o.top.kind == "plain" for o in everyone]) == pytest.approx(1 / 3, abs=0.05)
    assert np.mean([o.jacket is not None for o in everyone]) == pytest.approx(0.2, abs=0.04)
    assert np.mean([o.skirt for o in women]) == pytest.approx(0.1, abs=0.04)
    assert not any(o.skirt for o in men) and not any(o.beard for o in women)
    assert np.mean([o.beard for o in men]) == pytest.approx(1 / 3, abs=0.06)
    assert {o.hair_kind for o in everyone} == {"short", "cropped", "long", "tied", "bald", "cap"}
    lightness = np.array([o.skin.mean() for o in everyone])
    assert lightness.min() < 0.3 and lightness.max() > 0.78
    assert (np.diff(np.sort(lightness)) < 0.03).all()  # a continuum


def test_clothes_differ_from_skin_and_surroundings():
    walls = np.array([[0.76, 0.13, 0.13], [0.12, 0.26, 0.62], [0.95, 0.75, 0.16]])
    alike = 0
    for seed in range(200):
        outfit = sample_outfit(np.random.default_rng(seed), surroundings=walls)
        avoid = np.concatenate([walls, outfit.skin[None]])
        alike += contrasts(outfit.top.first[None], avoid)[0] <= LEAST_CONTRAST
        between = contrasts(outfit.top.first[None], outfit.top.second[None])[0]
        assert between > LEAST_CONTRAST / 2
    assert alike <= 4


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "plain"])
def test_patterns_show_both_colours(kind):
    cloth = Cloth(kind, np.array([0.8, 0.1, 0.1]), np.array([0.1, 0.1, 0.8]), 0.08, 3)  # type: ignore[arg-type]
    across_m, along_m = (axis.ravel() for axis in np.meshgrid(*[np.linspace(-0.3, 0.3, 200)] * 2))
    colours = colours_at(cloth, across_m, along_m)
    assert (colours[:, 0] > 0.5).mean() > 0.15 and (colours[:, 2] > 0.5).mean() > 0.15
