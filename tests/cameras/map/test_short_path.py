"""A path that is short beside what it sees is adjusted by a loss as narrow as most errors are."""

from typing import Any

import numpy as np
import pytest

from gmrdata.cameras.colmap import LEAST_NOISE_PX, LOSS_PX, bundle_adjuster, pycolmap
from gmrdata.cameras.map.refinement import sharpen
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values import transforms
from gmrdata.values.transforms import fit_similarity
from tests.cameras.drawn_models import drawn_points, model_of, places_of, seen_px

NOISE_PX, FAR_PX = 0.08, 0.8
N_FRAMES, N_POINTS = 15, 300


def filmed(extent: float, seed: int) -> tuple[Any, np.ndarray]:
    """A model of a hand-held camera and its true places (T, 3).  A tenth of the image points is off
    by tenfold, all of them to one side, as edges are that slide."""
    rng = np.random.default_rng(seed)
    when = np.linspace(0, 2 * np.pi, N_FRAMES)
    places = extent * np.stack([np.sin(when), np.cos(2 * when), 0.5 * np.sin(3 * when)], -1) / 2
    cameras = transforms.rigid(np.tile(np.eye(3), (N_FRAMES, 1, 1)), places)
    points = drawn_points(N_POINTS, rng)
    image_px = seen_px(cameras, points)
    image_px += rng.normal(0, NOISE_PX, image_px.shape)
    far = rng.random((N_FRAMES, N_POINTS)) < 0.1
    image_px[far] += FAR_PX * np.sign(places[:, None, :2]).repeat(N_POINTS, 1)[far]
    model = model_of(cameras, points, image_px)
    bundle_adjuster(model).solve()
    return model, places


def error(model: Any, places: np.ndarray) -> float:
    """Root mean square of what a similarity leaves of the cameras' places."""
    found = places_of(model)
    apart = fit_similarity(places, found, scale=True).apply(found) - places
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_short_path_does_not_follow_what_is_far_off(seed: int) -> None:
    model, places = filmed(0.06, seed)
    before = error(model, places)
    loss_px = sharpen(model, SfmConfig())
    assert LEAST_NOISE_PX < loss_px < 3 * NOISE_PX
    assert error(model, places) < 0.6 * before


def test_a_long_path_stays_as_it_is() -> None:
    model, places = filmed(4.0, 0)
    before = error(model, places)
    assert sharpen(model, SfmConfig()) == LOSS_PX
    assert error(model, places) == before


def test_an_empty_model_is_no_error() -> None:
    assert sharpen(pycolmap.Reconstruction(), SfmConfig()) == LOSS_PX
