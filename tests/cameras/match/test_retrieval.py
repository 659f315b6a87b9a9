"""Frames that look alike are found among all that came before."""

import numpy as np
import pytest

from gmrdata.cameras.frames import Frames
from gmrdata.cameras.match.matches import match_frames
from gmrdata.cameras.match.retrieval import alike_before
from gmrdata.cameras.recipe import MappingConfig, SfmConfig
from tests.cameras.match.test_keyframes import INTRINSICS_PX, SIZE_PX, shifted, texture
from tests.filming import write_pictures

RNG = np.random.default_rng(0)
PLACES = RNG.integers(0, 120, size=(6, 80, 128))


def of_place(place: int) -> np.ndarray:
    """Descriptors of a look at one of the places, a little different each time."""
    noisy = PLACES[place] + RNG.integers(-6, 7, size=PLACES[place].shape)
    return RNG.permutation(noisy.clip(0, 255)).astype(np.uint8)


def test_a_place_that_is_seen_again_is_found():
    there_and_back = [0, 1, 2, 3, 4, 5, 4, 3, 2, 1, 0]
    pairs = alike_before([of_place(place) for place in there_and_back], 1, 1, seed=0)
    assert {(0, 10), (1, 9), (2, 8), (3, 7), (4, 6)} <= set(pairs)
    assert pairs == sorted(pairs) and all(second - first > 1 for first, second in pairs)


@pytest.mark.parametrize("frames", [[np.zeros((0, 128), np.uint8)] * 5, [of_place(0)]])
def test_frames_that_show_nothing_are_like_no_other(frames):
    assert alike_before(frames, 0, 2, seed=0) == []


def test_a_black_frame_between_is_left_out():
    frames = [*map(of_place, range(5)), np.zeros((0, 128), np.uint8), of_place(0)]
    pairs = alike_before(frames, 1, 1, seed=0)
    assert (0, 6) in pairs and not any(5 in pair for pair in pairs)


def test_the_same_frames_give_the_same_pairs():
    frames = [of_place(place) for place in (0, 1, 2, 3, 0, 1, 2, 3)]
    assert alike_before(frames, 2, 2, seed=1) == alike_before(frames, 2, 2, seed=1)


def test_a_black_frame_of_a_long_video_hides_no_place_that_is_seen_again(tmp_path):
    """COLMAP's database has no descriptors of it, and says so by a table of (0, 0)."""
    picture = texture(0)
    pictures = [shifted(picture, shift_px) for shift_px in (0, 90, 180, 90, 0)]
    pictures.insert(2, np.zeros_like(pictures[0]))
    images = write_pictures(tmp_path / "frames", pictures)
    mapping = MappingConfig(part_frames=5, part_overlap=3, near_overlap=1, alike=1)
    frames = Frames(images, None, INTRINSICS_PX, SIZE_PX)
    pairs = match_frames(frames, tmp_path, SfmConfig(mapping=mapping)).n_of_pair
    assert (0, 5) in pairs and not any(2 in pair for pair in pairs)
