"""What mappers leave: frames between placed ones, keyframes that jump, models that share frames."""

import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmrdata.cameras.colmap import bundle_adjuster, incremental_options, pycolmap
from gmrdata.cameras.files import load_cameras, load_quality
from gmrdata.cameras.frames import Frames, Timeline
from gmrdata.cameras.map import mapping, models
from gmrdata.cameras.map import refinement as jumps_module
from gmrdata.cameras.map.models import _by_cameras, join_models, place_frames
from gmrdata.cameras.map.refinement import FEWEST, jumps, mend_jumps
from gmrdata.cameras.map.solution import Placed, fill_short_gaps
from gmrdata.cameras.match.matches import Matches, PairMatches, match_frames
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.values import transforms
from gmrdata.values.camera import project
from tests.cameras.drawn_models import (
    INTRINSICS_PX,
    SIZE_PX,
    drawn_points,
    model_of,
    places_of,
    seen_px,
)
from tests.filming import solve_keyframes_once

NO_CUTS = np.zeros(0, dtype=np.int64)


def cubic_path(numbers: np.ndarray) -> np.ndarray:
    """Cameras that turn steadily about one axis, on a cubic."""
    rotmats = Rotation.from_rotvec(0.02 * numbers[:, None] * [0.6, 0.0, 0.8]).as_matrix()
    t = numbers / 10.0
    centres = np.stack([t**3 - t, 2.0 * t**2, 1.0 - t], axis=1)
    return transforms.rigid(rotmats, centres)


def lost(true: np.ndarray, rows: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """The path without some rows, and which are left."""
    world_from_cam, has_camera = true.copy(), np.ones(len(true), dtype=bool)
    world_from_cam[rows], has_camera[rows] = np.nan, False
    return world_from_cam, has_camera


def test_a_cubic_path_is_met_and_what_was_filled_is_told():
    true = cubic_path(np.arange(20.0))
    world_from_cam, has_camera = lost(true, [5, 6, 7, 12])
    filled, interpolated = fill_short_gaps(world_from_cam, Timeline(np.arange(20), NO_CUTS), 3)
    assert np.flatnonzero(interpolated).tolist() == [5, 6, 7, 12]
    assert filled == pytest.approx(true, abs=1e-9)
    assert np.array_equal(filled[has_camera], world_from_cam[has_camera])


def test_long_gaps_ends_and_cuts_stay_open():
    true = cubic_path(np.arange(20.0))
    rows = [0, 1, 4, 8, 9, 10, 11, 15, 19]
    world_from_cam, _ = lost(true, rows)
    for after in (14, 15):
        timeline = Timeline(np.arange(20), np.array([after]))
        filled, interpolated = fill_short_gaps(world_from_cam, timeline, 3)
        assert np.flatnonzero(interpolated).tolist() == [4]
        assert np.isnan(filled[[0, 8, 15, 19]]).all()
    # A cut beside a gap isn't in it, but nothing beyond it counts.
    filled, interpolated = fill_short_gaps(
        world_from_cam, Timeline(np.arange(20), np.array([13, 16])), 3
    )
    assert np.flatnonzero(interpolated).tolist() == [4, 15]
    middle = (true[14, :3, 3] + true[16, :3, 3]) / 2
    assert filled[15, :3, 3] == pytest.approx(middle, abs=1e-12)
    nothing, none = fill_short_gaps(world_from_cam, Timeline(np.arange(20), NO_CUTS), 0)
    assert not none.any() and np.array_equal(nothing, world_from_cam, equal_nan=True)


def test_left_out_images_count_in_the_gap_and_in_time():
    numbers = np.array([0, 1, 2, 3, 6, 7, 8, 9, 10])
    true = cubic_path(numbers.astype(np.float64))
    world_from_cam, _ = lost(true, [4])
    timeline = Timeline(numbers, NO_CUTS)
    assert not fill_short_gaps(world_from_cam, timeline, 2)[1].any()
    filled, interpolated = fill_short_gaps(world_from_cam, timeline, 3)
    assert np.flatnonzero(interpolated).tolist() == [4]
    assert filled == pytest.approx(true, abs=1e-9)


@given(
    st.lists(st.booleans(), min_size=0, max_size=30),
    st.sets(st.integers(0, 29), max_size=4),
    st.integers(0, 6),
)
def test_any_gaps_are_filled_with_rigid_cameras(placed, cuts, max_gap):
    has_camera = np.array(placed, dtype=bool)
    world_from_cam, _ = lost(
        cubic_path(np.arange(float(len(placed)))), np.flatnonzero(~has_camera).tolist()
    )
    timeline = Timeline(np.arange(len(placed)), np.array(sorted(cuts), dtype=np.int64))
    filled, interpolated = fill_short_gaps(world_from_cam, timeline, max_gap)
    there = has_camera | interpolated
    assert not (has_camera & interpolated).any()
    assert np.isfinite(filled[there]).all() and np.isnan(filled[~there]).all()
    rotmats = filled[there, :3, :3]
    assert np.allclose(rotmats @ np.swapaxes(rotmats, 1, 2), np.eye(3), atol=1e-9)
    for row in np.flatnonzero(interpolated):
        before = np.flatnonzero(has_camera[:row])[-1]
        after = row + np.flatnonzero(has_camera[row:])[0]
        assert after - before - 1 <= max_gap and not cuts & set(range(before, after))


def test_frames_that_cannot_be_placed_are_interpolated_and_marked(film, tmp_path, monkeypatch):
    filmed = film("dolly", 24)
    config = SfmConfig(max_features=1200, keyframe_step=0.1, min_keyframes=3)
    # No frame between keyframes sees so many points.
    monkeypatch.setattr(models, "MIN_PNP_INLIERS", 10**6)
    solve_keyframes_once(monkeypatch)
    folders = [
        filmed.solved(tmp_path / str(gap), config.model_copy(update={"max_gap_frames": gap}))
        for gap in (0, 12)
    ]
    (bare, filled), (before, after) = map(load_cameras, folders), map(load_quality, folders)
    keys = np.isin(np.arange(24), before.keyframes)
    assert 3 <= keys.sum() <= 14
    assert np.array_equal(bare.path.has_camera, keys) and not bare.interpolated.any()
    assert before.interpolated == ()
    assert filled.path.has_camera.all() and np.array_equal(filled.interpolated, ~keys)
    assert after.interpolated == tuple(np.flatnonzero(~keys))
    # The figures are about what was found.
    assert before.frames_with_camera == after.frames_with_camera == keys.sum()
    assert not np.array(after.inliers_per_frame)[~keys].any()
    assert filmed.centre_errors_m(filled.path.centres_world_m).max() < 0.015


N_FRAMES, JUMPED = 15, 6
FRAMES = Frames(
    [Path(f"{number:04d}.png") for number in range(1, N_FRAMES + 1)], None, INTRINSICS_PX, SIZE_PX
)

CONFIG = SfmConfig()
JUMP = CONFIG.mapping.jump


def walk(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Places (T, 3) of somebody who walks on with an unsteady hand, at uneven times (T,)."""
    rng = np.random.default_rng(seed)
    numbers = np.cumsum(rng.integers(1, 5, 20))
    return numbers[:, None] * [0.05, 0, 0.02] + rng.normal(0, 0.004, (20, 3)), numbers


@given(st.integers(0, 2**32 - 1), st.integers(1, 18))
def test_only_what_lies_far_from_the_path_has_jumped(seed, at):
    places, numbers = walk(seed)
    places[at] += [0, 0.2, 0]
    assert jumps(places, numbers, JUMP)[0] == at
    # Its neighbours may look as if they had: the middle between them and it is off as well.
    assert set(jumps(places, numbers, JUMP)) <= {at - 1, at, at + 1}


@given(st.integers(0, 2**32 - 1), st.floats(0, 6.0), st.floats(1e-3, 1e3))
def test_a_jump_is_one_in_any_frame_and_unit(seed, turn_rad, unit):
    places, numbers = walk(seed)
    places[9] += [0, 0.2, 0]
    turned = unit * Rotation.from_euler("y", turn_rad).apply(places)
    np.testing.assert_array_equal(jumps(turned, numbers, JUMP), jumps(places, numbers, JUMP))


def test_few_cameras_do_not_tell_what_is_usual():
    places, numbers = walk(0)
    places[2] += [0, 9, 0]
    assert not len(jumps(places[: FEWEST - 1], numbers[: FEWEST - 1], JUMP))
    assert not len(jumps(np.zeros((0, 3)), np.zeros(0), JUMP))
    assert not len(jumps(np.zeros((10, 3)), np.arange(10), JUMP))  # a camera at rest


@pytest.fixture
def stuck() -> tuple[Any, np.ndarray]:
    """A model in which one camera looks elsewhere, from elsewhere, and its true places (T, 3)."""
    rng = np.random.default_rng(0)
    places = np.linspace(0, 2.0, N_FRAMES)[:, None] * [1, 0, 0.2]
    places += rng.normal(0, 0.01, (N_FRAMES, 3))
    cameras = transforms.rigid(np.tile(np.eye(3), (N_FRAMES, 1, 1)), places)
    points = drawn_points(200, rng)
    image_px = seen_px(cameras, points) + rng.normal(0, 0.2, (N_FRAMES, 200, 2))
    cameras[JUMPED, :3, :3] = Rotation.from_euler("xyz", [0.4, 1.2, 0.9]).as_matrix()
    cameras[JUMPED, :3, 3] += [0.0, 1.0, 0.5]
    return model_of(cameras, points, image_px), places


def test_a_camera_that_adjustment_leaves_elsewhere_comes_back(stuck):
    model, places = stuck
    mended = mend_jumps(model, FRAMES, CONFIG)
    left = places_of(model)
    assert np.linalg.norm(left[JUMPED] - places[JUMPED]) > 0.5  # what adjustment alone does
    found = places_of(mended)
    fit = transforms.fit_similarity(places, found, scale=True)
    assert np.linalg.norm(fit.apply(found) - places, axis=1).max() < 0.01


def test_less_cost_is_not_enough_where_points_are_lost(stuck, monkeypatch):
    """Points behind the camera can cost less: one every tenth frame came out 383 mm off for 12."""
    model, _ = stuck
    counts = iter([200, 199, 198, 197])
    monkeypatch.setattr(jumps_module, "_explained", lambda *_: next(counts))
    assert mend_jumps(model, FRAMES, CONFIG) is model


def test_points_behind_the_camera_are_not_explained(stuck):
    model, _ = stuck
    before = jumps_module._explained(model, 2.0)
    assert before == pytest.approx((N_FRAMES - 1) * 200, rel=0.01)
    for point in model.points3D.values():
        point.xyz = -point.xyz
    assert jumps_module._explained(model, 1e9) == 0


def test_a_path_without_a_jump_stays_as_it_is(stuck):
    model, places = stuck
    jumps_module._put(model, JUMPED + 1, transforms.rigid(np.eye(3), places[JUMPED]))
    before = places_of(model)
    assert mend_jumps(model, FRAMES, CONFIG) is model
    np.testing.assert_array_equal(places_of(model), before)


def test_a_camera_that_has_lost_its_points_stays_where_it_is(stuck):
    model, _ = stuck
    for row, spot in enumerate(model.image(JUMPED + 1).points2D):
        if spot.has_point3D():
            model.delete_observation(JUMPED + 1, row)
    jumps_module._adjusted(model)
    before = places_of(model)
    assert mend_jumps(model, FRAMES, CONFIG) is model
    np.testing.assert_array_equal(places_of(model), before)


SMALL = SfmConfig(max_features=400, first_octave=-1)
N_SHARED_FRAMES = 14


@pytest.fixture(scope="module")
def filmed_parts(film, tmp_path_factory) -> Any:
    """A dolly shot, its matches, and a mapper of any of its frames."""
    filmed = film("dolly", N_SHARED_FRAMES)
    work_dir = tmp_path_factory.mktemp("parts")
    frames = filmed.frames
    matches = match_frames(frames, work_dir, SMALL)

    @cache
    def mapped(rows: range) -> Any:
        options = incremental_options(SMALL, free_lens=False)
        options.min_model_size = 3
        options.image_names = [frames.images[row].name for row in rows]
        out_dir = work_dir / "_".join(map(str, rows))
        out_dir.mkdir(exist_ok=True)
        models = pycolmap.incremental_mapping(
            work_dir / "database.db", filmed.images_dir, out_dir, options
        )
        (model,) = models.values()
        assert model.num_reg_images() == len(rows)
        return model

    def part(rows: range) -> Any:
        return pycolmap.Reconstruction(mapped(rows))

    return filmed, frames, matches, part


def centres_of(model: Any) -> tuple[list[int], np.ndarray]:
    """Rows and camera centres of a model."""
    images = sorted((model.image(i) for i in model.reg_image_ids()), key=lambda image: image.name)
    rows = [int(Path(image.name).stem) for image in images]
    return rows, np.array([image.projection_center() for image in images])


def test_two_models_that_share_frames_become_one(filmed_parts):
    filmed, *_, part = filmed_parts
    large, small = part(range(9)), part(range(6, N_SHARED_FRAMES))
    n_points = (large.num_points3D(), small.num_points3D())
    # Any similarity of the small one's world must be found.
    turn = pycolmap.Rotation3d(np.array([0.1, -0.6, 0.3, 0.7]) / np.sqrt(0.95))
    small.transform(pycolmap.Sim3d(3.7, turn, np.array([5.0, -40.0, 8.0])))
    whole, records = join_models([small, large], SMALL)
    assert [(r.frames, r.kept) for r in records] == [(9, True), (8, True)]
    assert records[0].reason == "the largest"
    assert records[1].reason.startswith("joined by 3 frames and ")
    rows, centres = centres_of(whole)
    assert rows == list(range(N_SHARED_FRAMES))
    # Depths of three frames are rough; bundle adjustment comes after.
    assert filmed.centre_errors_m(centres).max() < 0.08
    # Points of the shared frames are one point each, not two on top of each other.
    assert max(n_points) < whole.num_points3D() < sum(n_points)
    assert whole.compute_mean_reprojection_error() < 1.0
    for point_id in whole.point3D_ids():
        assert len({e.image_id for e in whole.point3D(point_id).track.elements}) >= 2
    # What was given is left alone.
    assert (large.num_reg_images(), small.num_reg_images()) == (9, 8)


def test_shared_cameras_give_the_similarity_however_far_points_are():
    rng = np.random.default_rng(0)
    cameras, points = transforms.rigid(np.eye(3), rng.normal(0, 1, (5, 3))), drawn_points(40, rng)
    whole = model_of(cameras, points, seen_px(cameras, points))
    turn = pycolmap.Rotation3d(Rotation.from_rotvec([0.1, 0.5, -0.3]).as_matrix())
    model, expected = pycolmap.Reconstruction(whole), pycolmap.Sim3d(2.5, turn, [1.0, 2, 3])
    model.transform(expected.inverse())
    (found,) = _by_cameras(whole, model, [1, 2, 4])
    assert np.asarray(found.matrix()) == pytest.approx(np.asarray(expected.matrix()), abs=1e-9)
    assert _by_cameras(whole, model, [3]) == []


@pytest.mark.parametrize(("overlap", "kept"), [(3, True), (25, False)])
def test_rough_parts_of_a_long_video_are_joined_all_the_same(filmed_parts, overlap, kept):
    """Nine of 101 seams of ten minutes were 4.1 to 5.9 px off, and four fifths were left out."""
    *_, part = filmed_parts
    large, rough = part(range(9)), part(range(6, N_SHARED_FRAMES))
    (lens,) = rough.cameras.values()
    for row, image_id in enumerate(sorted({*large.reg_image_ids()} & {*rough.reg_image_ids()})):
        turned = Rotation.from_euler("y", (-1) ** row * 7 / lens.params[0]).as_matrix()
        pose = rough.image(image_id).cam_from_world()
        moved = pycolmap.Rigid3d(pycolmap.Rotation3d(turned), np.zeros(3)) * pose
        rough.image(image_id).frame.rig_from_world = moved
    mapping = SMALL.mapping.model_copy(update={"part_overlap": overlap})
    _, records = join_models([large, rough], SMALL.model_copy(update={"mapping": mapping}))
    assert records[1].kept == kept
    assert re.search(r"[5-9]\.\d+ px off", records[1].reason)


def test_a_model_may_be_joined_through_another(filmed_parts):
    filmed, *_, part = filmed_parts
    first, middle, last = part(range(7)), part(range(4, 10)), part(range(7, N_SHARED_FRAMES))
    whole, records = join_models([last, middle, first], SMALL)
    assert [r.kept for r in records] == [True, True, True]
    assert centres_of(whole)[0] == list(range(N_SHARED_FRAMES))
    bundle_adjuster(whole).solve()
    assert filmed.centre_errors_m(centres_of(whole)[1]).max() < 0.03


def test_models_without_a_common_frame_are_dropped_with_the_reason(filmed_parts):
    *_, part = filmed_parts
    whole, records = join_models([part(range(8, N_SHARED_FRAMES)), part(range(8))], SMALL)
    assert [(r.frames, r.kept) for r in records] == [(8, True), (6, False)]
    assert records[1].reason == "shares no frame with the largest"
    assert centres_of(whole)[0] == list(range(8))


def test_a_bent_model_is_dropped_with_the_reason(filmed_parts):
    *_, part = filmed_parts
    large, bent = part(range(9)), part(range(6, N_SHARED_FRAMES))
    rng = np.random.default_rng(0)
    for point_id in sorted(bent.point3D_ids()):
        bent.point3D(point_id).xyz = rng.normal(0, 5, 3)
    _, records = join_models([large, bent], SMALL)
    assert not records[1].kept
    assert records[1].reason.startswith("no similarity fits the ")
    few = part(range(6, N_SHARED_FRAMES))
    for point_id in sorted(few.point3D_ids())[5:]:
        few.delete_point3D(point_id)
    _, records = join_models([large, few], SMALL)
    assert not records[1].kept
    assert records[1].reason.startswith("shares 3 frames but only ")


def test_the_mapper_joins_and_adjusts(filmed_parts, monkeypatch, tmp_path):
    filmed, frames, matches, part = filmed_parts
    models = {0: part(range(9)), 1: part(range(6, N_SHARED_FRAMES))}
    monkeypatch.setattr(
        mapping, "_run", lambda name, *_, **known: [] if name == "global" else list(models.values())
    )
    mapped = [
        mapping.map_frames(frames, matches, folder, SMALL)
        for folder in (tmp_path / "a", tmp_path / "b")
        if folder.mkdir() is None
    ]
    assert mapped[0] is not None and mapped[1] is not None
    assert [record.kept for record in mapped[0].models] == [True, True]
    assert mapped[0].has_camera.all() and mapped[0].n_resected == 0
    assert filmed.centre_errors_m(mapped[0].world_from_cam[:, :3, 3]).max() < 0.015
    assert np.array_equal(mapped[0].world_from_cam, mapped[1].world_from_cam)


K_PX = np.array([[300.0, 0, 160], [0, 300.0, 90], [0, 0, 1]])


def three_cameras(
    step: float, n_points: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Cameras (3, 4, 4) beside each other, points (N, 3), and where each camera sees them."""
    points = rng.uniform([-2, -1, 4], [2, 1, 7], (n_points, 3))
    cameras = np.tile(np.eye(4), (3, 1, 1))
    cameras[:, 0, 3] = step * np.arange(3)
    return cameras, points, [project(camera, points, K_PX) for camera in cameras]


def test_a_left_out_frame_is_placed_by_the_points_of_its_neighbours():
    rng = np.random.default_rng(0)
    cameras, points, keypoints = three_cameras(0.3, 80, rng)
    every = np.arange(80)
    shuffled = rng.permutation(80)
    keypoints[1] = keypoints[1][np.argsort(shuffled)]
    pair = PairMatches(0, 1, np.stack([every, shuffled], axis=1), "CALIBRATED")
    world_from_cam = cameras.copy()
    world_from_cam[[1, 2]] = np.nan
    observations = np.array([80, 0, 0])
    matches = Matches(keypoints, [pair])
    placed = Placed(world_from_cam, observations, points, {0: np.tile(every, (2, 1)).T})
    assert place_frames([1, 2], placed, matches, K_PX) == 1
    assert placed.seen[1].tolist() == np.stack([shuffled, every], axis=1).tolist()
    assert observations.tolist() == [80, 80, 0]
    assert world_from_cam[1] == pytest.approx(cameras[1], abs=1e-6)
    assert np.isnan(world_from_cam[2]).all()
    assert np.allclose(transforms.invert(world_from_cam[1]) @ cameras[1], np.eye(4), atol=1e-6)


@pytest.mark.parametrize(("n_points", "n_placed"), [(13, 0), (30, 1)])
def test_a_point_that_is_followed_from_both_sides_holds_a_frame_once(n_points, n_placed):
    cameras, points, seen = three_cameras(0.1, n_points, np.random.default_rng(0))
    first, middle, last = seen
    every = np.arange(n_points)
    same = np.stack([every, every], axis=1)
    pairs = [
        PairMatches(0, 1, same, ""),
        PairMatches(1, 2, np.stack([every + n_points, every], axis=1), ""),
    ]
    matches = Matches([first, np.concatenate([middle, middle]), last], pairs)
    world_from_cam = cameras.copy()
    world_from_cam[1] = np.nan
    inliers = np.array([n_points, 0, n_points])
    placed = Placed(world_from_cam, inliers, points, {0: same, 2: same})
    assert place_frames([1], placed, matches, K_PX) == n_placed
    assert inliers[1] == n_placed * n_points
    if n_placed:
        assert placed.seen[1].tolist() == same.tolist()
        assert world_from_cam[1] == pytest.approx(cameras[1], abs=1e-6)
