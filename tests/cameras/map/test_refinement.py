"""Refinement of what a mapper left, and paths that are short beside what they see."""

from contextlib import closing
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from gmrdata.cameras.colmap import LEAST_NOISE_PX, LOSS_PX, bundle_adjuster, pycolmap
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.map import refinement
from gmrdata.cameras.map.refinement import (
    background_distance,
    forget_astray,
    has_weak,
    is_short,
    refined_model,
    sharpen,
    triangulate_again,
)
from gmrdata.cameras.match.matches import DATABASE_FILE, Matches, PairMatches
from gmrdata.cameras.recipe import MappingConfig, SfmConfig
from gmrdata.values import transforms
from gmrdata.values.transforms import fit_similarity
from tests.cameras.drawn_models import (
    INTRINSICS_PX,
    SIZE_PX,
    drawn_camera,
    drawn_points,
    model_of,
    places_of,
    seen_px,
)

N_FRAMES, N_POINTS, WEAK = 8, 200, 4
CONFIG = SfmConfig()
IMAGES = [Path(f"{i:04d}.png") for i in range(1, N_FRAMES + 1)]
FRAMES = Frames(IMAGES, None, INTRINSICS_PX, SIZE_PX)


class Scene:
    """Cameras on a way of 2 units, what they see with 0.2 px of noise, and all of its matches."""

    def __init__(self) -> None:
        rng = np.random.default_rng(0)
        self.places = np.linspace(0, 2.0, N_FRAMES)[:, None] * [1, 0, 0.2]
        self.places += rng.normal(0, 0.05, (N_FRAMES, 3))
        self.cameras = transforms.rigid(np.tile(np.eye(3), (N_FRAMES, 1, 1)), self.places)
        self.points = drawn_points(N_POINTS, rng)
        noise_px = rng.normal(0, 0.2, (N_FRAMES, N_POINTS, 2))
        self.image_px = seen_px(self.cameras, self.points) + noise_px
        same = np.tile(np.arange(N_POINTS)[:, None], (1, 2))
        pairs = [PairMatches(*two, same, "CALIBRATED") for two in combinations(range(N_FRAMES), 2)]
        self.matches = Matches(list(self.image_px), pairs)

    def model(self, held: int) -> Any:
        """Of which one keyframe is astray and has so many points, the farthest."""
        cameras = self.cameras.copy()
        cameras[WEAK, :3, 3] += [0.1, 0.1, 0.1]
        model = model_of(cameras, self.points, self.image_px)
        for point in np.argsort(-self.points[:, 2])[held:]:
            model.delete_observation(WEAK + 1, int(point))
        return model

    def write_database(self, path: Path) -> None:
        with closing(pycolmap.Database.open(path)) as database:
            camera_id = database.write_camera(drawn_camera())
            for image, image_px in zip(FRAMES.images, self.image_px, strict=True):
                image_id = database.write_image(pycolmap.Image(image.name, [], camera_id))
                database.write_keypoints(image_id, image_px.astype(np.float32))
            for pair in self.matches.pairs:
                geometry = pycolmap.TwoViewGeometry()
                geometry.config = int(pycolmap.TwoViewGeometryConfiguration.CALIBRATED)
                geometry.inlier_matches = pair.features.astype(np.uint32)
                database.write_two_view_geometry(pair.first + 1, pair.second + 1, geometry)

    def error(self, model: Any) -> float:
        """How far the keyframe is from its place."""
        found = places_of(model)
        fit = fit_similarity(self.places, found, scale=True)
        return float(np.linalg.norm(fit.apply(found)[WEAK] - self.places[WEAK]))


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> tuple[Scene, Path]:
    """The scene, and the folder of its database."""
    drawn, folder = Scene(), tmp_path_factory.mktemp("drawn")
    drawn.write_database(folder / DATABASE_FILE)
    return drawn, folder


def test_a_keyframe_is_weak_below_a_share_of_its_matched_points(scene):
    drawn, _ = scene
    least = round(CONFIG.mapping.least_held * N_POINTS)
    assert not has_weak(drawn.model(N_POINTS), drawn.matches, FRAMES, CONFIG)
    assert not has_weak(drawn.model(least), drawn.matches, FRAMES, CONFIG)
    assert has_weak(drawn.model(least - 1), drawn.matches, FRAMES, CONFIG)


def test_points_are_found_again_and_bring_a_weak_keyframe_back(scene):
    """A keyframe of photos round a fox kept 53 points of far background, and was 134 mm off."""
    drawn, folder = scene
    core, _ = refined_model([drawn.model(20)], FRAMES, drawn.matches, folder, CONFIG)
    model = core.model
    assert model.image(WEAK + 1).num_points3D > 0.95 * N_POINTS
    once = CONFIG.model_copy(update={"mapping": MappingConfig(triangulated_again=0)})
    left, _ = refined_model([drawn.model(20)], FRAMES, drawn.matches, folder, once)
    assert left.model.image(WEAK + 1).num_points3D <= 20
    assert drawn.error(model) < 0.005 and drawn.error(model) < drawn.error(left.model) / 3


def test_a_model_of_a_part_of_the_images_finds_points_again(scene):
    """COLMAP ended with the matches of an image that a model doesn't have."""
    drawn, folder = scene
    n = N_FRAMES - 1
    model = model_of(drawn.cameras[:n], drawn.points[:20], drawn.image_px[:n])
    triangulate_again(model, folder / DATABASE_FILE, CONFIG)
    assert model.num_reg_images() == n
    assert all(model.image(i).num_points3D > 0.9 * N_POINTS for i in model.reg_image_ids())


def test_where_an_image_matches_no_other_of_the_model_all_keep_their_points(tmp_path):
    """Of 10,000 frames a keyframe that stayed matched none that did, and COLMAP ended."""
    drawn, alone = Scene(), N_FRAMES - 1
    pairs = [pair for pair in drawn.matches.pairs if pair.second != alone]
    drawn.matches = replace(drawn.matches, pairs=pairs)
    drawn.write_database(tmp_path / DATABASE_FILE)
    model = model_of(drawn.cameras, drawn.points[:20], drawn.image_px)
    triangulate_again(model, tmp_path / DATABASE_FILE, CONFIG)
    assert {model.image(row + 1).num_points3D for row in range(N_FRAMES)} == {20}


def test_points_that_were_led_behind_a_camera_or_far_off_are_forgotten(scene):
    """One of them made the mean error of a right path 100,010,000 px."""
    drawn, _ = scene
    model = model_of(drawn.cameras, drawn.points, drawn.image_px)
    assert forget_astray(model, CONFIG) == 0
    behind, beside = 3, 5
    model.point3D(behind).xyz = model.point3D(behind).xyz * [1, 1, -1]
    model.point3D(beside).xyz = np.add(model.point3D(beside).xyz, [0.5, 0, 0])
    # The last image point of a point goes with it.
    assert forget_astray(model, CONFIG) == 2 * N_FRAMES - 1
    assert set(model.point3D_ids()) == set(range(1, N_POINTS + 1)) - {behind, beside}
    assert model.compute_mean_reprojection_error() < 0.5


NOISE_PX, FAR_PX = 0.08, 0.8
N_SHORT_FRAMES, N_SHORT_POINTS = 15, 300


def filmed(extent: float, seed: int) -> tuple[Any, np.ndarray]:
    """A model of a hand-held camera and its true places (T, 3).  A tenth of the image points is off
    by tenfold, all of them to one side, as edges are that slide."""
    rng = np.random.default_rng(seed)
    when = np.linspace(0, 2 * np.pi, N_SHORT_FRAMES)
    places = extent * np.stack([np.sin(when), np.cos(2 * when), 0.5 * np.sin(3 * when)], -1) / 2
    cameras = transforms.rigid(np.tile(np.eye(3), (N_SHORT_FRAMES, 1, 1)), places)
    points = drawn_points(N_SHORT_POINTS, rng)
    image_px = seen_px(cameras, points)
    image_px += rng.normal(0, NOISE_PX, image_px.shape)
    far = rng.random((N_SHORT_FRAMES, N_SHORT_POINTS)) < 0.1
    image_px[far] += FAR_PX * np.sign(places[:, None, :2]).repeat(N_SHORT_POINTS, 1)[far]
    model = model_of(cameras, points, image_px)
    bundle_adjuster(model).solve()
    return model, places


def error(model: Any, places: np.ndarray) -> float:
    """Root mean square of what a similarity leaves of the cameras' places."""
    found = places_of(model)
    apart = fit_similarity(places, found, scale=True).apply(found) - places
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_short_path_does_not_follow_what_is_far_off(seed):
    model, places = filmed(0.06, seed)
    before = error(model, places)
    loss_px = sharpen(model, SfmConfig())
    assert LEAST_NOISE_PX < loss_px < 3 * NOISE_PX
    assert error(model, places) < 0.6 * before


def test_a_long_path_stays_as_it_is():
    model, places = filmed(4.0, 0)
    before = error(model, places)
    assert sharpen(model, SfmConfig()) == LOSS_PX
    assert error(model, places) == before


def test_an_empty_model_is_no_error():
    assert sharpen(pycolmap.Reconstruction(), SfmConfig()) == LOSS_PX


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("flat", [[1, 1, 1], [1, 0.01, 0], [0, 0, 0]])
def test_a_path_is_short_by_its_two_furthest_centres(flat, seed, monkeypatch):
    rng = np.random.default_rng(seed)
    centres, points = flat * rng.normal(size=(40, 3)), rng.normal([0, 0, 30], 1, (200, 3))
    diameter, away = pdist(centres).max(), background_distance(centres, points)
    shares = np.array([0.5, 0.9, 0.999, 1.001, 1.2, 2.0]) * (diameter or 1.0) / away
    short = [is_short(centres, points, share) for share in shares]
    assert short == [bool(share * away > diameter) for share in shares]
    # One that is far longer or shorter is known without all distances.
    monkeypatch.setattr(refinement, "pdist", lambda _: pytest.fail("was asked"))
    assert is_short(centres, points, shares[-1]) and not is_short(centres, points, 0.0)
