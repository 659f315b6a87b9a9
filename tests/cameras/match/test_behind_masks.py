"""Background inside masks comes back, a person doesn't.  In a filmed room, with the real mapper."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gmrdata.cameras.frames import Frames
from gmrdata.cameras.map import mapping
from gmrdata.cameras.map.refinement import _alike, see_again
from gmrdata.cameras.match.matches import Matches, match_behind_masks, match_frames
from gmrdata.cameras.recipe import BehindMasksConfig, SfmConfig
from gmrdata.read.frames import list_images, read_gray, write_gray
from gmrdata.values.errors import NoReconstruction
from tests.filming import Filmed, film_cameras, look_at

N_FRAMES = 10
SIZE_PX = (320, 180)
SMALL = SfmConfig(max_features=600, first_octave=-1)
MARGIN_PX = 30  # of the filled boxes round the person
EDGE_PX = 3  # features of the room may touch the person's outline


def filmed(folder: Path, person_m: np.ndarray) -> Filmed:
    along = np.linspace(-0.5, 0.5, N_FRAMES)
    centres_m = 3.2 * np.stack([np.sin(along), -np.cos(along), 0 * along], axis=1) + [0, 0.4, 1.5]
    cameras = np.array([look_at(centre_m, np.array([0.0, 0.4, 1.0])) for centre_m in centres_m])
    return film_cameras(folder, cameras, person_m)


def boxed(film: Filmed, masks_dir: Path) -> Frames:
    """The frames with a filled box for a mask."""
    masks_dir.mkdir()
    for path in sorted(film.masks_dir.glob("*.png")):
        left, top, width, height = cv2.boundingRect(read_gray(path, SIZE_PX))
        box = np.zeros(SIZE_PX[::-1], np.uint8)
        rows = slice(max(0, top - MARGIN_PX), top + height + MARGIN_PX)
        box[rows, max(0, left - MARGIN_PX) : left + width + MARGIN_PX] = 255
        write_gray(masks_dir / path.name, box)
    return Frames(list_images(film.images_dir), masks_dir, film.intrinsics_px, SIZE_PX)


def came_back(frames: Frames, matches: Matches, work_dir: Path) -> list[tuple[int, np.ndarray]]:
    """Row and image point of each observation inside the masks, of the model as it is refined."""
    found = mapping.map_frames(frames, matches, work_dir, SMALL)
    assert found is not None and found.has_camera.all()
    return [
        (row, matches.keypoints_px[row][feature])
        for row, points in found.seen.items()
        for feature in points[:, 0]
        if feature >= matches.n_free[row]
    ]


@pytest.fixture(scope="module")
def walking(tmp_path_factory) -> Any:
    """A person who walks, by filled boxes: the film, its frames, matches and their folder."""
    folder, along = tmp_path_factory.mktemp("walking"), np.linspace(0, 1, N_FRAMES)
    film = filmed(folder, np.stack([-0.8 + 1.6 * along, 0 * along + 0.4, 0 * along], axis=1))
    frames = boxed(film, folder / "boxes")
    return film, frames, match_frames(frames, folder, SMALL), folder


def on_the_person(film: Filmed, seen: list[tuple[int, np.ndarray]]) -> int:
    """How many image points are further than EDGE_PX inside the person's silhouette."""
    around = np.ones((2 * EDGE_PX + 1,) * 2, np.uint8)
    paths = sorted(film.masks_dir.glob("*.png"))
    inner = [cv2.erode(read_gray(path, SIZE_PX), around) for path in paths]
    return sum(inner[row][int(y), int(x)] > 0 for row, (x, y) in seen)


def test_features_inside_masks_come_last_and_are_not_matched(walking):
    _, frames, matches, _ = walking
    for row, image in enumerate(frames.images):
        column, line = matches.keypoints_px[row].astype(int).T
        masked = frames.mask(image)[line, column] > 0
        n_free = matches.n_free[row]
        assert not masked[:n_free].any() and masked[n_free:].all() and n_free < len(masked)
        assert matches.descriptors[row].shape == (len(masked), 128)
    for pair in matches.pairs:
        assert pair.features[:, 0].max() < matches.n_free[pair.first]
        assert pair.features[:, 1].max() < matches.n_free[pair.second]


def test_the_room_inside_a_filled_box_comes_back_and_the_person_does_not(walking):
    film, frames, matches, work_dir = walking
    seen = came_back(frames, matches, work_dir)
    assert len(seen) > 100
    assert on_the_person(film, seen) == 0


def test_a_person_who_stands_still_stays_out(tmp_path):
    film = filmed(tmp_path, np.tile([0.0, 0.4, 0.0], (N_FRAMES, 1)))
    frames = boxed(film, tmp_path / "boxes")
    seen = came_back(frames, match_frames(frames, tmp_path, SMALL), tmp_path)
    assert len(seen) > 20
    assert on_the_person(film, seen) == 0


def test_neighbours_that_match_need_nothing_from_inside_masks(walking):
    _, frames, matches, work_dir = walking
    assert match_behind_masks(matches, frames, work_dir, SMALL) is matches


@pytest.mark.parametrize("walks", [True, False])
def test_what_masks_hide_is_matched_with_what_they_show_and_the_person_is_not(walks, tmp_path):
    along = np.linspace(0, 1, N_FRAMES) if walks else np.full(N_FRAMES, 0.5)
    film = filmed(tmp_path, np.stack([-0.8 + 1.6 * along, 0 * along + 0.4, 0 * along], axis=1))
    frames = boxed(film, tmp_path / "boxes")
    before = match_frames(frames, tmp_path, SMALL)
    always = SMALL.model_copy(update={"masks": BehindMasksConfig(hardly_matched=10_000)})
    matches = match_behind_masks(before, frames, tmp_path, always)
    hidden = []
    for pair in matches.pairs:
        n_free = [matches.n_free[pair.first], matches.n_free[pair.second]]
        inside = pair.features >= n_free
        assert not inside.all(axis=1).any()
        for row, column in ((pair.first, 0), (pair.second, 1)):
            features = pair.features[inside[:, column], column]
            hidden += [(row, matches.keypoints_px[row][feature]) for feature in features]
    assert len(hidden) > 50
    # A feature of the person would have to match the room.
    assert on_the_person(film, hidden) <= 0.02 * len(hidden)
    # A feature that has a point is not given another one.
    seen = came_back(frames, matches, tmp_path)
    assert on_the_person(film, seen) == 0


def test_a_feature_shows_one_of_two_points_that_look_the_same():
    """A feature was given two points, and COLMAP ended the stage: a dancer cut to 432x576."""
    looks = np.zeros((3, 128), np.float32)
    looks[:2, 0] = looks[2, 1] = 1
    point, feature = np.array([0, 1, 2, 2]), np.array([1, 1, 0, 2])
    looks_here = looks[[2, 0, 2]]
    assert _alike(point, feature, looks, looks_here, 0.9) == [(0, 1), (2, 0)]


def test_without_masks_nothing_is_sought(walking, tmp_path):
    _, frames, _, _ = walking
    whole = replace(frames.some(np.arange(3)), masks_dir=None)
    matches = match_frames(whole, tmp_path, SMALL)
    assert matches.descriptors is None
    assert matches.n_free == [len(points_px) for points_px in matches.keypoints_px]
    assert see_again(None, matches, whole, SMALL.masks) == 0


def test_a_black_frame_between_others_has_no_features(walking, tmp_path):
    film, frames, _, _ = walking
    for kind in ("frames", "masks"):
        (tmp_path / kind).mkdir()
    for row, image in enumerate(frames.images[:3]):
        gray = read_gray(image, SIZE_PX) * np.uint8(row != 1)
        cv2.imwrite(str(tmp_path / "frames" / f"{row:05d}.png"), gray)
        write_gray(tmp_path / "masks" / f"{row:05d}.png", frames.mask(image))
    images = list_images(tmp_path / "frames")
    two = Frames(images, tmp_path / "masks", film.intrinsics_px, SIZE_PX)
    with pytest.raises(NoReconstruction, match="features per frame outside the masks"):
        match_frames(two, tmp_path, SMALL)
