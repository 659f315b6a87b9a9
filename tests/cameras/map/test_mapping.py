"""Both mappers, and frames that they leave out."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gmrdata.cameras.files import Mapper
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.map import mapping
from gmrdata.cameras.map.rotation_only import solve_rotation_only
from gmrdata.cameras.match.matches import Matches, match_frames
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.reconstruct import explains_better
from gmrdata.read.frames import list_images
from gmrdata.values.errors import BadFrames
from tests.filming import Filmed, film_cameras, look_at

SMALL = SfmConfig(max_features=400, first_octave=-1)


@pytest.fixture(scope="module")
def arc(film: Callable[[str, int], Any], tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Filmed frames, their matches and the folder with COLMAP's database."""
    filmed = film("arc", 10)
    work_dir = tmp_path_factory.mktemp("arc_work")
    frames = filmed.frames
    return filmed, frames, match_frames(frames, work_dir, SMALL), work_dir


def relative_angles_deg(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    found_rel = np.swapaxes(found[:1, :3, :3], 1, 2) @ found[:, :3, :3]
    true_rel = np.swapaxes(true[:1, :3, :3], 1, 2) @ true[:, :3, :3]
    chord = np.linalg.norm(found_rel - true_rel, axis=(1, 2))
    return np.rad2deg(2 * np.arcsin(chord / np.sqrt(8)))


def test_both_mappers_find_the_same_cameras(arc: Any) -> None:
    filmed, frames, matches, work_dir = arc
    mappers: tuple[Mapper, ...] = ("global", "incremental")
    for name in mappers:
        models = mapping._run(name, frames, work_dir, SMALL)
        mapped = mapping._finish(models, name, frames, matches, work_dir, SMALL)
        assert mapped.has_camera.all()
        assert relative_angles_deg(mapped.world_from_cam, filmed.world_from_cam).max() < 0.3
        assert mapped.errors_px.max() < 3.0 and np.median(mapped.errors_px) < 0.5


def test_many_keyframes_are_placed_by_their_longest_tracks_and_see_all_points(
    arc: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    filmed, frames, matches, work_dir = arc
    long = SMALL.mapping.model_copy(update={"long_frames": len(frames.images)})
    config = SMALL.model_copy(update={"mapping": long})
    monkeypatch.setattr(mapping, "TRACKS_PER_FRAME", 60)
    tracks = mapping._global_options(len(frames.images), config).mapper
    assert tracks.track_required_tracks_per_view == 60
    tracks = mapping._global_options(len(frames.images) - 1, config).mapper
    assert tracks.track_required_tracks_per_view > 1e6
    shutil.copy(work_dir / "database.db", tmp_path)
    mapped = mapping.map_frames(frames, matches, tmp_path, config)
    assert mapped is not None and mapped.mapper == "global" and mapped.has_camera.all()
    assert relative_angles_deg(mapped.world_from_cam, filmed.world_from_cam).max() < 0.3
    assert np.median(mapped.errors_px) < 0.5 and mapped.inliers.min() > 60


def test_the_incremental_mapper_steps_in_where_the_global_one_leaves_frames_out(
    arc: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    _, frames, matches, work_dir = arc
    run = mapping._run
    monkeypatch.setattr(
        mapping, "_run", lambda mapper, *rest: [] if mapper == "global" else run(mapper, *rest)
    )
    shutil.copy(work_dir / "database.db", tmp_path)
    mapped = mapping.map_frames(frames, matches, tmp_path, SMALL)
    assert mapped is not None and mapped.mapper == "incremental" and mapped.has_camera.all()


def test_an_arc_is_better_explained_by_six_degrees_of_freedom(arc: Any, tmp_path: Path) -> None:
    filmed, frames, matches, work_dir = arc
    turning = solve_rotation_only(matches, filmed.intrinsics_px, 2.0, np.random.default_rng(0))
    shutil.copy(work_dir / "database.db", tmp_path)
    mapped = mapping.map_frames(frames, matches, tmp_path, SMALL)
    assert mapped is not None and mapped.mapper == "global"
    assert explains_better(mapped, turning, SMALL)
    assert not explains_better(None, turning, SMALL)
    mapped.world_from_cam[9] = np.nan
    assert not explains_better(mapped, turning, SMALL)


SWAYING = SfmConfig(max_features=600)


def film_swaying(reach_m: float, folder: Path) -> tuple[Filmed, Frames, Matches]:
    """What 14 cameras film that sway about one place, and the frames' matches."""
    along = np.linspace(0, 1, 14)
    sway = np.stack([np.sin(5 * along), np.cos(7 * along), np.sin(9 * along + 1)], axis=1) / 2
    person_m = np.stack([-1.0 + 2 * along, 0 * along + 0.4, 0 * along], axis=1)
    centres_m = np.array([0.0, -3.0, 1.5]) + reach_m * sway
    targets_m = person_m + np.array([0.0, 0.0, 1.0])
    cameras = np.array([look_at(c, t) for c, t in zip(centres_m, targets_m, strict=True)])
    filmed = film_cameras(folder / "film", cameras, person_m)
    frames = filmed.frames
    return filmed, frames, match_frames(frames, folder, SWAYING)


@pytest.mark.parametrize("reach_m", [0.085, 0.07, 0.0])
def test_a_camera_that_hardly_leaves_its_place_is_mapped_and_a_pan_is_not(
    reach_m: float, tmp_path: Path
) -> None:
    filmed, frames, matches = film_swaying(reach_m, tmp_path)
    mapped = mapping.map_frames(frames, matches, tmp_path, SWAYING)
    if reach_m == 0:
        assert mapped is None or not mapped.has_camera.all()
        return
    assert mapped is not None and mapped.mapper == "small_parallax" and mapped.has_camera.all()
    assert filmed.centre_errors_m(mapped.world_from_cam[:, :3, 3]).max() < 0.25 * reach_m


def test_a_second_solution_of_a_camera_that_hardly_travels_is_not_given_up_with_one_mapper(
    tmp_path: Path,
) -> None:
    """Of a pan in a street the global mapper found all keyframes and of two in three none: a right
    path was rejected, since nothing confirmed it."""
    _, frames, matches = film_swaying(0.07, tmp_path)
    first = mapping.map_frames(frames, matches, tmp_path, SWAYING)
    assert first is not None
    rows = np.flatnonzero(np.arange(14) % 3 != 1)
    otherwise = replace(first, mapper="incremental")
    second, error_px = mapping.map_again(otherwise, rows, frames, tmp_path, SWAYING)
    assert np.isfinite(second[rows]).all() and error_px < 1.0
    # A camera that travels has the mapper of its first solution alone.
    far = replace(otherwise, points=first.points / 100)
    again = SWAYING.model_copy(update={"seed": 1})
    none, _ = mapping.map_again(far, rows, frames, tmp_path, again)
    assert np.isnan(none).all()
    # Two frames have no model; that mapper is not asked twice.
    nothing, _ = mapping.map_again(first, rows[:2], frames, tmp_path, again)
    assert first.mapper == "small_parallax" and np.isnan(nothing).all()


def test_cameras_that_few_points_hold_are_forgotten() -> None:
    world_from_cam = np.tile(np.eye(4), (3, 1, 1))
    observations = np.array([40, 14, 15])
    points: dict[int, dict[int, np.ndarray]] = {row: {} for row in range(3)}
    mapping._forget_weak(world_from_cam, observations, points, 15)
    assert np.isnan(world_from_cam[1]).all() and sorted(points) == [0, 2]
    assert np.isfinite(world_from_cam[[0, 2]]).all() and observations.tolist() == [40, 0, 15]


def test_a_frame_whose_inside_is_broken_is_named(dolly: Any, tmp_path: Path) -> None:
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
