"""Both mappers, frames that they leave out, and models of two scales, made on purpose."""

import shutil
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from gmrdata.cameras.colmap import pycolmap
from gmrdata.cameras.files import Mapper, WeakestStep
from gmrdata.cameras.frames import Frames, linked
from gmrdata.cameras.map import mapping
from gmrdata.cameras.map.covered import without_seen_again
from gmrdata.cameras.map.mapping import map_frames
from gmrdata.cameras.map.models import (
    _held,
    _running_medians,
    parts_among,
    parts_of,
    weakest_step,
    with_anchors,
    zoom_spread,
)
from gmrdata.cameras.map.rotation_only import solve_rotation_only
from gmrdata.cameras.map.solution import Placed, Solution
from gmrdata.cameras.match.matches import (
    DATABASE_FILE,
    Matches,
    PairMatches,
    match_features,
    match_frames,
    read_matches,
)
from gmrdata.cameras.recipe import CamerasVerdictConfig, MappingConfig, SfmConfig
from gmrdata.cameras.reconstruct import explains_better
from gmrdata.read.frames import list_images
from gmrdata.values.camera import project
from gmrdata.values.errors import BadFrames
from gmrdata.values.transforms import fit_similarity, rigid
from tests.filming import Filmed, film_cameras, look_at, turn_errors_deg

SMALL = SfmConfig(max_features=400, first_octave=-1)


def in_parts(part_frames: int, part_overlap: int, **more: int) -> SfmConfig:
    """The same with parts of so many keyframes."""
    parts = {"part_frames": part_frames, "part_overlap": part_overlap} | more
    return SMALL.model_copy(update={"mapping": SMALL.mapping.model_copy(update=parts)})


@pytest.fixture(scope="module")
def arc(film, tmp_path_factory) -> Any:
    """Filmed frames, their matches and the folder with COLMAP's database."""
    filmed = film("arc", 10)
    work_dir = tmp_path_factory.mktemp("arc_work")
    frames = filmed.frames
    return filmed, frames, match_frames(frames, work_dir, SMALL), work_dir


@pytest.fixture
def arc_alone(arc, tmp_path) -> Any:
    """The same with the database in a folder that no other test maps in."""
    filmed, frames, matches, work_dir = arc
    shutil.copy(work_dir / DATABASE_FILE, tmp_path)
    return filmed, frames, matches


def test_both_mappers_find_the_same_cameras(arc):
    filmed, frames, matches, work_dir = arc
    mappers: tuple[Mapper, ...] = ("global", "incremental")
    parts = parts_among(np.arange(len(frames.images)), matches, SMALL.mapping)
    for name in mappers:
        models = mapping._run(name, frames, parts, work_dir, SMALL)
        mapped = mapping._finish(models, name, frames, matches, work_dir, SMALL)
        assert mapped.has_camera.all()
        assert turn_errors_deg(mapped.world_from_cam, filmed.world_from_cam).max() < 0.15
        assert mapped.errors_px.max() < 3.0 and np.median(mapped.errors_px) < 0.5


def test_many_keyframes_are_placed_by_their_longest_tracks_and_see_all_points(
    arc_alone, monkeypatch, tmp_path
):
    filmed, frames, matches = arc_alone
    long = SMALL.mapping.model_copy(update={"long_frames": len(frames.images)})
    config = SMALL.model_copy(update={"mapping": long})
    monkeypatch.setattr(mapping, "TRACKS_PER_FRAME", 60)
    tracks = mapping._global_options(len(frames.images), config).mapper
    assert tracks.track_required_tracks_per_view == 60
    tracks = mapping._global_options(len(frames.images) - 1, config).mapper
    assert tracks.track_required_tracks_per_view > 1e6
    mapped = mapping.map_frames(frames, matches, tmp_path, config)
    assert mapped is not None and mapped.mapper == "global" and mapped.has_camera.all()
    assert turn_errors_deg(mapped.world_from_cam, filmed.world_from_cam).max() < 0.15
    assert np.median(mapped.errors_px) < 0.5 and mapped.inliers.min() > 60


def test_the_global_mapper_adjusts_as_finely_as_colmap_does():
    """Ended at a ten times larger share of the cost, 50 pictures round a fox gave 19 mm, not 6."""
    usual = pycolmap.GlobalPipelineOptions().mapper.bundle_adjustment
    ours = mapping._global_options(50, SfmConfig()).mapper.bundle_adjustment
    tolerance = usual.ceres.solver_options.function_tolerance
    assert ours.ceres.solver_options.function_tolerance <= tolerance


@pytest.mark.parametrize(
    ("n_frames", "parts"),
    [(3, [(0, 3)]), (100, [(0, 100)]), (196, [(0, 82), (57, 139), (114, 196)])],
)
def test_many_keyframes_are_mapped_in_parts_that_overlap(n_frames, parts):
    assert parts_of(n_frames, MappingConfig()) == parts


def test_a_part_reaches_further_than_it_overlaps():
    with pytest.raises(ValidationError, match="part_overlap must be less than part_frames"):
        MappingConfig(part_frames=25)


def test_parts_become_one_model_as_good_as_that_of_all(arc_alone, tmp_path):
    filmed, frames, matches = arc_alone
    config = in_parts(7, 4)
    mapped = mapping.map_frames(frames, matches, tmp_path, config)
    assert mapped is not None and mapped.mapper == "global" and mapped.has_camera.all()
    assert [(one.frames, one.kept) for one in mapped.models] == [(7, True), (7, True)]
    assert turn_errors_deg(mapped.world_from_cam, filmed.world_from_cam).max() < 0.15
    assert np.median(mapped.errors_px) < 0.5
    rows = np.delete(np.arange(len(frames.images)), 1)
    again = config.reseeded(1)
    second, error_px = mapping.map_again(mapped, rows, frames, matches, tmp_path, again)
    assert np.isfinite(second[rows]).all() and np.isnan(second[1]).all() and error_px < 1.0
    assert turn_errors_deg(second[rows], filmed.world_from_cam[rows]).max() < 0.25


def test_what_comes_after_frames_that_were_left_out_is_held_by_what_it_matches():
    config = MappingConfig(part_frames=5, part_overlap=3)
    one = np.zeros((4, 2), np.int32)
    rows = [*((row, row + 1) for row in (0, 1, 2, 3, 5, 6, 7)), (1, 5), (2, 5), (2, 6), (0, 8)]
    matches = Matches([], [PairMatches(*pair, one, "") for pair in rows]).n_of_pair
    assert with_anchors(np.arange(5), matches, config).tolist() == [0, 1, 2, 3, 4]
    assert with_anchors(np.arange(5, 9), matches, config).tolist() == [5, 6, 7, 8]
    # 8 is not among the first three after the break.
    assert with_anchors(np.arange(3, 9), matches, config).tolist() == [1, 2, 3, 4, 5, 6, 7, 8]


def test_a_camera_that_comes_back_and_goes_on_is_one_path(film, tmp_path):
    """What it sees again is placed, and what is new is mapped with what it matches."""
    filmed = film("dolly", 14)
    order = [*range(9), *range(7, -1, -1), *range(1, 14)]
    source = [filmed.frames.images[row] for row in order]
    images, _ = linked({f"{n:05d}": path for n, path in enumerate(source)}, None, tmp_path)
    frames = replace(filmed.frames, images=images, masks_dir=None)
    config = in_parts(6, 3, near_overlap=2)
    matches = match_frames(frames, tmp_path, config)
    mapped = without_seen_again(matches, config.mapping)
    missing = np.setdiff1d(np.arange(30), mapped)
    assert set(missing) >= set(range(13, 24)) and missing.min() > 8 and missing.max() < 26
    of_mapped = matches.some(mapped)
    assert {26, 27, 28, 29} <= set(mapped) and len(of_mapped.pairs) < len(matches.pairs)
    found = mapping.map_frames(frames.some(mapped), of_mapped, tmp_path, config)
    assert found is not None and found.has_camera.all()
    placed = mapping.place_between(found, mapped, missing, matches, frames.intrinsics_px)
    assert placed.has_camera.all() and placed.n_resected >= len(missing)
    true = filmed.world_from_cam[order]
    assert turn_errors_deg(placed.world_from_cam, true).max() < 0.15
    fit = fit_similarity(true[:, :3, 3], placed.world_from_cam[:, :3, 3], scale=True)
    there = fit.scale * placed.world_from_cam[:, :3, 3] @ fit.rotmat.T + fit.translation_m
    assert np.linalg.norm(there - true[:, :3, 3], axis=1).max() < 0.02


def test_frames_of_many_are_matched_with_those_that_look_alike(arc_alone, tmp_path):
    _, frames, _ = arc_alone
    config = in_parts(5, 3, near_overlap=2, alike=1)
    with closing(pycolmap.Database.open(tmp_path / DATABASE_FILE)) as database:
        database.clear_matches()
        database.clear_two_view_geometries()
    match_features(tmp_path / DATABASE_FILE, config)
    pairs = read_matches(tmp_path / DATABASE_FILE, frames.images).pairs
    steps = np.array([pair.second - pair.first for pair in pairs])
    assert {1, 2} <= set(steps) and (steps > 2).any()
    further = [pair.second for pair in pairs if pair.second - pair.first > 2]
    # Each with the one that it looks like the most.
    assert len(further) == len(set(further)) and min(further) > 2


def test_the_incremental_mapper_steps_in_where_the_global_one_leaves_frames_out(
    arc_alone, monkeypatch, tmp_path
):
    _, frames, matches = arc_alone
    run = mapping._run
    monkeypatch.setattr(
        mapping,
        "_run",
        lambda mapper, *rest, **known: [] if mapper == "global" else run(mapper, *rest, **known),
    )
    mapped = mapping.map_frames(frames, matches, tmp_path, SMALL)
    assert mapped is not None and mapped.mapper == "incremental" and mapped.has_camera.all()


def test_of_many_frames_the_incremental_mapper_is_asked_for_the_parts_that_lack_some(
    arc_alone, monkeypatch, tmp_path
):
    """Of 7,635 keyframes the global mapper left few out, and all were mapped a second time."""
    filmed, frames, matches = arc_alone
    config = in_parts(7, 4)
    run_part, asked = mapping._run_part, []

    def of_part(mapper: Mapper, files: Any, names: list[str], config: SfmConfig) -> list[Any]:
        asked.append((mapper, names[0]))
        models = run_part(mapper, files, names, config)
        return [] if asked[-1] == ("global", "00003.jpg") else models

    monkeypatch.setattr(mapping, "_run_part", of_part)
    place = mapping.place_frames
    monkeypatch.setattr(
        mapping, "place_frames", lambda rows, *rest: place([row for row in rows if row < 7], *rest)
    )
    mapped = mapping.map_frames(frames, matches, tmp_path, config)
    wanted = [("global", "00000.jpg"), ("global", "00003.jpg"), ("incremental", "00003.jpg")]
    assert asked == wanted
    # By which a second solution is sought.
    assert mapped is not None and mapped.mapper == "global" and mapped.has_camera.all()
    assert turn_errors_deg(mapped.world_from_cam, filmed.world_from_cam).max() < 0.15


def test_an_arc_is_better_explained_by_six_degrees_of_freedom(arc_alone, tmp_path):
    filmed, frames, matches = arc_alone
    turning = solve_rotation_only(matches, filmed.intrinsics_px, 2.0, np.random.default_rng(0))
    mapped = mapping.map_frames(frames, matches, tmp_path, SMALL)
    assert mapped is not None and mapped.mapper == "global"
    assert explains_better(mapped, turning, SMALL)
    assert not explains_better(None, turning, SMALL)
    mapped.world_from_cam[9] = np.nan
    assert not explains_better(mapped, turning, SMALL)


SWAYING = SfmConfig(max_features=600)


Swaying = tuple[Filmed, Matches, Solution | None, Path]


@pytest.fixture(scope="module")
def swaying(tmp_path_factory) -> Callable[[float], Swaying]:
    """What 14 cameras film that sway so far about one place, the frames' matches, their map, and
    the folder that it was made in."""

    @cache
    def made(reach_m: float) -> Swaying:
        along, folder = np.linspace(0, 1, 14), tmp_path_factory.mktemp("swaying")
        sway = np.stack([np.sin(5 * along), np.cos(7 * along), np.sin(9 * along + 1)], axis=1) / 2
        person_m = np.stack([-1.0 + 2 * along, 0 * along + 0.4, 0 * along], axis=1)
        centres_m = np.array([0.0, -3.0, 1.5]) + reach_m * sway
        targets_m = person_m + np.array([0.0, 0.0, 1.0])
        cameras = np.array([look_at(c, t) for c, t in zip(centres_m, targets_m, strict=True)])
        filmed = film_cameras(folder / "film", cameras, person_m)
        matches = match_frames(filmed.frames, folder, SWAYING)
        mapped = mapping.map_frames(filmed.frames, matches, folder, SWAYING)
        return filmed, matches, mapped, folder

    return made


@pytest.mark.slow
@pytest.mark.parametrize("reach_m", [0.08, 0.07, 0.0])
def test_a_camera_that_hardly_leaves_its_place_is_mapped_and_a_pan_is_not(reach_m, swaying):
    filmed, _, mapped, _ = swaying(reach_m)
    if reach_m == 0:
        assert mapped is None or not mapped.has_camera.all()
        return
    assert mapped is not None and mapped.mapper == "small_parallax" and mapped.has_camera.all()
    assert filmed.centre_errors_m(mapped.world_from_cam[:, :3, 3]).max() < 0.25 * reach_m


@pytest.mark.slow
def test_a_second_solution_of_a_camera_that_hardly_travels_is_not_given_up_with_one_mapper(swaying):
    """Of a pan in a street the global mapper found all keyframes and of two in three none: a right
    path was rejected, since nothing confirmed it."""
    filmed, matches, first, work_dir = swaying(0.07)
    assert first is not None
    frames = filmed.frames
    rows = np.flatnonzero(np.arange(14) % 3 != 1)
    otherwise = replace(first, mapper="incremental")
    second, error_px = mapping.map_again(otherwise, rows, frames, matches, work_dir, SWAYING)
    assert np.isfinite(second[rows]).all() and error_px < 1.0
    # A camera that travels has the mapper of its first solution alone.
    far = replace(otherwise, points=first.points / 100)
    again = SWAYING.model_copy(update={"seed": 1})
    none, _ = mapping.map_again(far, rows, frames, matches, work_dir, again)
    assert np.isnan(none).all()
    # Two frames have no model; that mapper is not asked twice.
    nothing, _ = mapping.map_again(first, rows[:2], frames, matches, work_dir, again)
    assert first.mapper == "small_parallax" and np.isnan(nothing).all()


def test_cameras_that_few_points_hold_are_forgotten():
    nothing = {row: np.zeros((0, 2), np.int32) for row in range(3)}
    cameras = np.tile(np.eye(4), (3, 1, 1))
    placed = Placed(cameras, np.array([40, 14, 15]), np.zeros((0, 3)), nothing)
    mapping._forget_weak(placed, 15)
    assert np.isnan(cameras[1]).all() and sorted(placed.seen) == [0, 2]
    assert np.isfinite(cameras[[0, 2]]).all() and placed.inliers.tolist() == [40, 0, 15]


def test_a_frame_whose_inside_is_broken_is_named(dolly, tmp_path):
    folder = tmp_path / "frames"
    folder.mkdir()
    for image in list_images(dolly.images_dir)[:3]:
        (folder / image.name).write_bytes(image.read_bytes())
    content = (folder / "00001.jpg").read_bytes()
    # Header and end mark stay, the tables between them go.
    start = content.index(b"\xff\xdb")
    (folder / "00001.jpg").write_bytes(content[:start] + content[content.index(b"\xff\xc0") :])
    with pytest.raises(BadFrames, match=r"00001\.jpg: cannot be decoded"):
        frames = Frames(list_images(folder), None, dolly.intrinsics_px, (320, 180))
        match_frames(frames, tmp_path, SMALL)


K_PX = np.array([[500.0, 0, 320], [0, 500.0, 180], [0, 0, 1]])
MOST, FIRM = CamerasVerdictConfig().max_loose_share, 0.0006
N, POINTS = 20, 300


def solved(centres: np.ndarray, sees: np.ndarray) -> tuple[Solution, Matches]:
    """Cameras (T, 3) that look ahead, and which of the points (T, POINTS) each sees; 0.1 px off."""
    rng = np.random.default_rng(0)
    points = rng.uniform([-3, -2, 3], [4, 2, 8], (POINTS, 3))
    cameras = rigid(np.tile(np.eye(3), (len(centres), 1, 1)), centres)
    seen_px = [project(cam, points, K_PX) + rng.normal(0, 0.1, (POINTS, 2)) for cam in cameras]
    seen = {row: np.tile(np.flatnonzero(of), (2, 1)).T for row, of in enumerate(sees)}
    mapped = Solution(
        geometry="full",
        mapper="global",
        world_from_cam=cameras,
        errors_px=np.zeros(0),
        inliers=sees.sum(axis=1),
        focal=None,
        points=points,
        seen=seen,
    )
    return mapped, Matches(seen_px, [])


def found(mapped: Solution, matches: Matches) -> WeakestStep:
    step = weakest_step(mapped, matches, 3 * np.arange(len(matches.keypoints_px)), K_PX, 2.0)
    assert step is not None
    return step


def along(start: float, stop: float) -> np.ndarray:
    """Every point is seen by the frames of its third of the way, and by those beside it."""
    places = np.linspace(start, stop, N)[:, None]
    return np.abs(places - np.linspace(start, stop, POINTS)) < (stop - start) / 3


STRAIGHT = np.linspace(0, 1, N)[:, None] * [1.0, 0.1, 0.2]


def test_points_hold_two_sides_as_the_sum_of_their_variances_says():
    rng = np.random.default_rng(0)
    left, right = (a @ np.swapaxes(a, 1, 2) for a in rng.normal(size=(2, 5, 3, 4)))
    expected = np.linalg.inv(np.linalg.inv(left) + np.linalg.inv(right))
    np.testing.assert_allclose(_held(left, left + right), expected, rtol=1e-6)


def test_a_model_of_one_scale_passes():
    step = found(*solved(STRAIGHT, along(0, 1)))
    assert step.before == step.after + 3 and 0.00005 < step.loose_share < FIRM


@pytest.mark.parametrize(("second", "after", "open_share"), [(9, {24}, 1), (10, {24, 27}, 0.05)])
def test_halves_that_share_no_point_or_one_frame_have_no_common_scale(second, after, open_share):
    """The shared frame 9 sees the points of both, but nothing that is seen on both sides of it."""
    sees = along(0, 1)
    sees[:9, 150:], sees[second:, :150] = False, False
    step = found(*solved(STRAIGHT, sees))
    assert step.after in after and step.before == step.after + 3
    assert step.loose_share > open_share


def test_a_camera_that_rests_at_first_is_held_by_what_it_sees():
    resting = np.concatenate([np.zeros((9, 3)), STRAIGHT[:11]])
    assert found(*solved(resting, np.ones((N, POINTS), dtype=bool))).loose_share < FIRM


def test_a_step_from_rest_that_nothing_holds_is_found():
    """17 frames at rest and then 5.8 m in one step."""
    centres = np.concatenate([np.zeros((17, 3)), [5.8, 0, 0] + 0.1 * STRAIGHT[:3]])
    sees = np.ones((N, POINTS), dtype=bool)
    sees[:17, 150:], sees[17:, :150] = False, False
    # A few false points on both sides hold a direction, but no length.
    sees[16:18, :4] = True
    step = found(*solved(centres, sees))
    assert (step.after, step.before) == (48, 51) and step.loose_share > 0.05


@pytest.mark.parametrize("away_m", [1e3, 1e4, 1e5, 1e6])
def test_cameras_that_a_broken_model_puts_far_away_are_found(away_m):
    """Rounding once made variances negative there, and the stage ended with another error."""
    mapped, matches = solved(STRAIGHT, along(0, 1))
    cameras = mapped.world_from_cam.copy()
    cameras[-2:, 2, 3] -= away_m
    rng = np.random.default_rng(0)
    there = cameras[-1, :3, 3] + rng.uniform([-1, -1, 3], [1, 1, 6], (40, 3))
    points = np.concatenate([mapped.points, there])
    seen, seen_px = dict(mapped.seen), list(matches.keypoints_px)
    for row in (N - 2, N - 1):
        # Twenty points that the others see as well, and what is there.
        shown = np.concatenate([mapped.seen[row][:20, 1], POINTS + np.arange(40)])
        seen[row] = np.stack([np.arange(60), shown], axis=1)
        seen_px[row] = project(cameras[row], points[shown], K_PX) + rng.normal(0, 0.1, (60, 2))
    broken = replace(mapped, world_from_cam=cameras, seen=seen, points=points)
    step = found(broken, Matches(seen_px, []))
    assert (step.after, step.before) == (51, 54) and step.loose_share > 1


def test_points_that_a_model_does_not_explain_hold_nothing():
    mapped, matches = solved(STRAIGHT, along(0, 1))
    first, last = np.arange(POINTS) < 150, np.arange(POINTS) >= 150
    off_px = [
        points_px + 5.0 * (last if row < 9 else first)[:, None]
        for row, points_px in enumerate(matches.keypoints_px)
    ]
    step = found(mapped, Matches(off_px, []))
    assert (step.after, step.before) == (24, 27) and step.loose_share > 1


def test_a_piece_of_another_scale_sees_everything_at_another_distance():
    """Frames 0-8 are 9.7 times as large, and false points hold them firmly to the others."""
    mapped, matches = solved(STRAIGHT, np.ones((N, POINTS), dtype=bool))
    assert 1 <= found(mapped, matches).distance_ratio < 1.2
    cameras, centre = mapped.world_from_cam.copy(), mapped.world_from_cam[8, :3, 3]
    cameras[:9, :3, 3] = centre + 9.7 * (cameras[:9, :3, 3] - centre)
    points = np.concatenate([mapped.points, centre + 9.7 * (mapped.points - centre)])
    seen = {row: of + np.array([0, POINTS * (row < 9)]) for row, of in mapped.seen.items()}
    step = found(replace(mapped, world_from_cam=cameras, seen=seen, points=points), matches)
    assert step.distance_ratio == pytest.approx(9.7, rel=0.1)


@pytest.mark.parametrize("n_near", [40, 6])
def test_the_view_through_a_window_is_no_piece_of_another_scale(n_near):
    """Nine tenths of what a dancer's room shows at one place is a town, 80 times as far away; in a
    wide picture all but six points of 108."""
    every = np.ones((N, POINTS), dtype=bool)
    mapped, _ = solved(STRAIGHT, every)
    near, town = np.arange(POINTS) < 60, np.arange(POINTS) >= 60
    points = np.where(town[:, None], 80 * mapped.points, mapped.points)
    shown = every.copy()
    shown[:10, town], shown[10:, n_near:60] = False, False
    seen = {row: np.stack([np.flatnonzero(of)] * 2, axis=1) for row, of in enumerate(shown)}
    seen_px = [project(cam, points, K_PX) for cam in mapped.world_from_cam]
    step = found(replace(mapped, points=points, seen=seen), Matches(seen_px, []))
    medians = [np.median(points[of][:, 2]) for of in (near, shown[10])]
    assert medians[1] > 20 * medians[0] and step.distance_ratio < 2


def test_the_share_of_matches_that_move_otherwise_is_that_of_the_worst_tenth_of_pairs():
    mapped, matches = solved(STRAIGHT, np.ones((N, POINTS), dtype=bool))
    every = np.tile(np.arange(POINTS)[:, None], 2)
    pairs = [PairMatches(row, row + 1, every, "CALIBRATED") for row in range(N - 1)]
    assert found(mapped, Matches(matches.keypoints_px, pairs)).moving_share == 0
    # A fifth of what frames 17 to 19 see has moved by 9 px across the camera's way.
    for row in (17, 18, 19):
        matches.keypoints_px[row][:60, 1] += 9 * (row - 16)
    step = found(mapped, Matches(matches.keypoints_px, pairs))
    assert step.moving_share == pytest.approx(0.2, abs=0.01)
    # What has no camera says nothing.
    lost = mapped.world_from_cam.copy()
    lost[17:] = np.nan
    kept = replace(mapped, world_from_cam=lost, seen={row: mapped.seen[row] for row in range(17)})
    assert found(kept, Matches(matches.keypoints_px, pairs)).moving_share == 0


def test_fewer_than_two_cameras_have_no_step():
    mapped, matches = solved(STRAIGHT, along(0, 1))
    alone = replace(mapped, seen={4: mapped.seen[4], 5: mapped.seen[5][:0]})
    assert weakest_step(alone, matches, np.arange(N), K_PX, 2.0) is None


@pytest.mark.parametrize("zoom", [1.0, 1.003, 0.996])
def test_a_zoom_is_how_far_the_focal_lengths_of_keyframes_are_apart(zoom):
    mapped, matches = solved(STRAIGHT, np.ones((N, POINTS), dtype=bool))
    mapped, middle_px = replace(mapped, adjusted=np.ones(N, dtype=bool)), K_PX[:2, 2]
    sizes = zip(np.linspace(1.0, zoom, N), matches.keypoints_px, strict=True)
    zoomed = Matches([middle_px + size * (px - middle_px) for size, px in sizes], [])
    apart = 0.8 * abs(np.log(zoom))
    assert zoom_spread(mapped, zoomed, K_PX) == pytest.approx(apart, rel=0.02, abs=1e-4)
    few = replace(mapped, adjusted=np.arange(N) < 5)
    assert zoom_spread(few, zoomed, K_PX) == 0.0
    # A wall at a right angle is as large for who zooms as for who goes there.
    wall = replace(mapped, points=mapped.points * [1, 1, 0] + [0, 0, 5])
    rng = np.random.default_rng(1)
    seen_px = [project(cam, wall.points, K_PX) for cam in mapped.world_from_cam]
    noisy = Matches([px + rng.normal(0, 0.3, px.shape) for px in seen_px], [])
    assert zoom_spread(wall, noisy, K_PX) == 0.0


@pytest.fixture(scope="module")
def dolly_model(film, tmp_path_factory) -> tuple[Solution, Matches, np.ndarray]:
    filmed, work_dir = film("dolly", 14), tmp_path_factory.mktemp("one_scale")
    matches = match_frames(filmed.frames, work_dir, SMALL)
    mapped = map_frames(filmed.frames, matches, work_dir, SMALL)
    assert mapped is not None and mapped.has_camera.all()
    return mapped, matches, filmed.intrinsics_px


def rescaled(model: tuple[Solution, Matches, np.ndarray], last: int, scale: float) -> Solution:
    """The frames up to `last`, and the points seen mostly there, at another scale about it."""
    mapped, *_ = model
    centre, cameras = mapped.world_from_cam[last, :3, 3], mapped.world_from_cam.copy()
    cameras[: last + 1, :3, 3] = centre + scale * (cameras[: last + 1, :3, 3] - centre)
    rows = np.concatenate([np.full(len(of), row) for row, of in mapped.seen.items()])
    shown = np.concatenate([of[:, 1] for of in mapped.seen.values()])
    n_points = len(mapped.points)
    n_left = np.bincount(shown, rows <= last, minlength=n_points)
    left = n_left > 0.5 * np.bincount(shown, minlength=n_points)
    moved = centre + scale * (mapped.points - centre)
    points = np.where(left[:, None], moved, mapped.points)
    return replace(mapped, world_from_cam=cameras, points=points)


@pytest.mark.parametrize("scale", [0.1, 2.5, 9.7])
def test_a_real_model_with_one_half_rescaled_is_found(dolly_model, scale):
    mapped, matches, intrinsics_px = dolly_model
    right = weakest_step(mapped, matches, np.arange(14), intrinsics_px, 2.0)
    assert right is not None and right.loose_share < FIRM
    broken = rescaled(dolly_model, 6, scale)
    step = weakest_step(broken, matches, np.arange(14), intrinsics_px, 2.0)
    assert step is not None and step.loose_share > MOST
    assert step.after in (5, 6, 7)


def test_running_medians_are_the_medians_of_all_up_to_each_group():
    values = np.random.default_rng(0).integers(0, 40, 200).astype(float)
    starts = np.array([0, 1, 2, 9, 50, 51, 199, 200])
    expected = [np.median(values[:stop]) for stop in starts[1:]]
    assert _running_medians(values, starts).tolist() == expected
