"""Keypoint adjustment, on pictures that are shifted by known parts of a pixel."""

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.cameras.colmap import pycolmap
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.match.keypoint_adjustment import (
    MEASURED_PX,
    PLACED_PX,
    Motions,
    _fitted,
    adjust_keypoints,
)
from gmrdata.cameras.match.matches import DATABASE_FILE, Matches, PairMatches, match_frames
from gmrdata.cameras.recipe import SfmConfig
from tests.cameras.match.test_keyframes import INTRINSICS_PX, SIZE_PX, shifted, texture
from tests.filming import write_pictures

SHIFTS_PX = np.array([0.0, 3.3, 6.85, 10.4])


@pytest.fixture
def found(tmp_path: Path) -> tuple[Matches, Frames, Path]:
    """Four shifted pictures, and what COLMAP finds and matches in them."""
    images = write_pictures(
        tmp_path / "frames", [shifted(texture(0), by_px) for by_px in SHIFTS_PX]
    )
    frames = Frames(images, None, INTRINSICS_PX, SIZE_PX)
    return match_frames(frames, tmp_path, SfmConfig(first_octave=-1)), frames, tmp_path


def errors_px(matches: Matches) -> np.ndarray:
    """(M,) by how much the motions of matched features are wrong."""
    errors = []
    for pair in matches.pairs:
        ends = matches.keypoints_px[pair.first], matches.keypoints_px[pair.second]
        moved_px = ends[1][pair.features[:, 1]] - ends[0][pair.features[:, 0]]
        true_px = [SHIFTS_PX[pair.first] - SHIFTS_PX[pair.second], 0.0]
        errors.append(np.linalg.norm(moved_px - true_px, axis=1))
    return np.concatenate(errors)


def test_features_move_as_their_pictures_do(found: tuple[Matches, Frames, Path]) -> None:
    """Features of one blob in shifted pictures differ little: noise of SIFT is laid over them."""
    matches, frames, work_dir = found
    rng = np.random.default_rng(0)
    noisy = [px + rng.normal(0, 0.3, px.shape) for px in matches.keypoints_px]
    before = replace(matches, keypoints_px=noisy)
    after = adjust_keypoints(before, frames, work_dir)
    assert len(errors_px(before)) > 100
    assert np.median(errors_px(before)) > 0.4
    assert np.median(errors_px(after)) < 0.08
    # What all frames have in common is not measured: they stay about where they were.
    apart_px = np.concatenate(after.keypoints_px) - np.concatenate(noisy)
    assert np.abs(apart_px.mean(axis=0)).max() < 0.02
    assert np.median(np.linalg.norm(apart_px, axis=1)) < 0.5


def test_the_mappers_see_the_same_points(found: tuple[Matches, Frames, Path]) -> None:
    matches, frames, work_dir = found
    after = adjust_keypoints(matches, frames, work_dir)
    with closing(pycolmap.Database.open(work_dir / DATABASE_FILE)) as database:
        for image in database.read_all_images():
            written = database.read_keypoints(image.image_id)
            points_px = after.keypoints_px[[path.name for path in frames.images].index(image.name)]
            np.testing.assert_array_equal(written[:, :2], points_px.astype(np.float32))
            assert (written[:, 2:] != 0).any()  # shapes stay
    assert after.pairs is matches.pairs


def test_what_moves_in_a_mask_moves_no_point(
    found: tuple[Matches, Frames, Path], tmp_path: Path
) -> None:
    matches, frames, work_dir = found
    masks_dir, mask = tmp_path / "masks", np.zeros(SIZE_PX[::-1], np.uint8)
    mask[:, :120] = 255
    write_pictures(masks_dir, [mask] * len(frames.images))
    after = adjust_keypoints(matches, replace(frames, masks_dir=masks_dir), work_dir)
    before_px, after_px = np.concatenate(matches.keypoints_px), np.concatenate(after.keypoints_px)
    masked = before_px[:, 0] < 120
    np.testing.assert_allclose(after_px[masked], before_px[masked], atol=1e-9)
    assert np.abs(after_px[~masked] - before_px[~masked]).max() > 0.01


def test_a_patch_that_is_found_elsewhere_counts_for_nothing(
    found: tuple[Matches, Frames, Path],
) -> None:
    """A wrong match: the feature that it names is nowhere near."""
    matches, frames, work_dir = found
    wrong = [
        PairMatches(pair.first, pair.second, np.roll(pair.features, 5, axis=0) * [1, 0] + [0, 3],
                    "CALIBRATED")
        for pair in matches.pairs
    ]  # fmt: skip
    away = [PairMatches(p.first, p.second, p.features[p.features[:, 0] > 20], "") for p in wrong]
    after = adjust_keypoints(replace(matches, pairs=away), frames, work_dir)
    moved_px = np.concatenate(after.keypoints_px) - np.concatenate(matches.keypoints_px)
    assert (np.linalg.norm(moved_px, axis=1) > 1e-6).mean() < 0.02


def test_without_neighbours_nothing_moves(found: tuple[Matches, Frames, Path]) -> None:
    matches, frames, work_dir = found
    far = [pair for pair in matches.pairs if pair.second > pair.first + 1]
    after = adjust_keypoints(replace(matches, pairs=far), frames, work_dir)
    for before_px, after_px in zip(matches.keypoints_px, after.keypoints_px, strict=True):
        np.testing.assert_array_equal(before_px, after_px)


@given(st.integers(0, 2**32 - 1), st.integers(1, 30))
def test_the_fit_is_that_of_numpy(seed: int, m: int) -> None:
    rng = np.random.default_rng(seed)
    places_px = rng.uniform(0, 100, (12, 2))
    measured = Motions(rng.integers(0, 6, m), rng.integers(6, 12, m), rng.normal(0, 5, (m, 2)))
    rows = np.zeros((m, 12))
    rows[np.arange(m), measured.second] = 1
    rows[np.arange(m), measured.first] -= 1
    weighted = np.concatenate([np.eye(12) / PLACED_PX, rows / MEASURED_PX])
    wanted = np.concatenate([places_px / PLACED_PX, measured.moved_px / MEASURED_PX])
    expected = np.linalg.lstsq(weighted, wanted, rcond=None)[0]
    np.testing.assert_allclose(_fitted(places_px, measured), expected, atol=1e-6)
