"""Keyframes and the frames between them, on pictures that are shifted by known amounts."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.cameras.files import load_cameras, load_quality
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.match.keyframes import (
    FOLLOWED,
    choose_keyframes,
    follow,
    is_free,
    parallax_px,
    with_frames_between,
)
from gmrdata.cameras.match.matches import Matches, PairMatches, match_frames
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.reconstruct import reconstruct
from gmrdata.read.frames import read_frames
from gmrdata.values.camera import Lens, project
from gmrdata.values.errors import BadFrames
from tests.filming import turn_errors_deg, write_pictures

SIZE_PX = (240, 160)
INTRINSICS_PX = np.array([[220.0, 0, 120], [0, 220.0, 80], [0, 0, 1]])


def texture(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    image = sum(
        cv2.resize(rng.uniform(0, 255, (n, 2 * n)), (600, 300), interpolation=cv2.INTER_CUBIC)
        for n in (10, 30, 75)
    )
    return np.clip(image / 3, 0, 255).astype(np.uint8)


def shifted(image: np.ndarray, shift_px: float) -> np.ndarray:
    """The part of a picture that a camera sees after it has gone so far to the right."""
    width_px, height_px = SIZE_PX
    centre = (20 + shift_px + (width_px - 1) / 2, 20 + (height_px - 1) / 2)
    return cv2.getRectSubPix(image, SIZE_PX, centre)


def given(images: list[Path], masks_dir: Path | None = None) -> Frames:
    return Frames(images, masks_dir, INTRINSICS_PX, SIZE_PX)


def grid_px(first: float, step: float) -> np.ndarray:
    """(N, 2) points of a grid over the middle of the picture."""
    axes = np.arange(first, 200, step), np.arange(first, 120, step)
    return np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)


def test_points_are_followed_to_a_tenth_of_a_pixel():
    image = texture(0)
    points_px = grid_px(40.0, 20)
    found_px, ok = follow(shifted(image, 0), shifted(image, 6.25), points_px)
    assert ok.mean() > 0.9
    assert np.abs(found_px[ok] - (points_px[ok] - [6.25, 0])).max() < 0.1
    again_px, ok = follow(shifted(image, 0), shifted(image, 6.25), points_px, points_px - [6, 0])
    assert np.abs(again_px[ok] - (points_px[ok] - [6.25, 0])).max() < 0.1


def test_what_is_on_another_picture_is_not_found():
    points_px = grid_px(40.0, 20)
    _, ok = follow(shifted(texture(0), 0), shifted(texture(1), 0), points_px)
    assert ok.mean() < 0.1
    _, ok = follow(shifted(texture(0), 0), shifted(texture(1), 0), points_px, and_back=False)
    assert ok.mean() > 0.5
    assert follow(texture(0), texture(1), np.zeros((0, 2)))[0].shape == (0, 2)


def test_a_point_is_free_inside_the_frame_and_outside_the_mask():
    free = np.ones((4, 6), dtype=bool)
    free[1, 2] = False
    points_px = np.array([[0.0, 0.0], [5.9, 3.9], [6.0, 1.0], [-0.1, 1.0], [2.5, 1.5], [3.0, 1.5]])
    assert is_free(points_px, free).tolist() == [True, True, False, False, False, True]


def test_keyframes_come_as_fast_as_the_background_moves(tmp_path):
    image, step = texture(0), 4.0
    frames = write_pictures(tmp_path / "frames", [shifted(image, step * row) for row in range(25)])
    config = SfmConfig(keyframe_step=11.5 / 240, keyframe_gap=100, min_keyframes=2)
    keys = choose_keyframes(given(frames), config)
    assert keys.rows.tolist() == [*range(0, 24, 3), 24]
    assert keys.survived.min() > 0.8 and not len(keys.cuts)
    every = choose_keyframes(given(frames), SfmConfig(keyframe_step=0))
    assert every.rows.tolist() == list(range(25))
    still = write_pictures(tmp_path / "still", [shifted(image, 0)] * 12)
    config = SfmConfig(keyframe_gap=5, min_keyframes=2)
    assert choose_keyframes(given(still), config).rows.tolist() == [0, 5, 10, 11]
    # A slow or short sequence would leave the mappers with a pair or two.
    more = SfmConfig(keyframe_gap=100, min_keyframes=6)
    assert choose_keyframes(given(still), more).rows.tolist() == [0, 2, 4, 7, 9, 11]
    more = SfmConfig(keyframe_gap=100, min_keyframes=50)
    assert choose_keyframes(given(still), more).rows.tolist() == list(range(12))


def points_seen(place: list[float], turn_deg: float) -> np.ndarray:
    """100 points 2 m away and 300 points 50 m away, in a camera that has moved and turned [px]."""
    rng = np.random.default_rng(0)
    near = rng.uniform([-0.8, -0.5, 2.0], [0.8, 0.5, 2.2], (100, 3))
    far = rng.uniform([-20.0, -15.0, 50.0], [20.0, 15.0, 60.0], (300, 3))
    camera = np.eye(4)
    camera[:3, :3] = cv2.Rodrigues(np.deg2rad([0.0, turn_deg, 0.0]))[0]
    camera[:3, 3] = place
    return project(camera, np.concatenate([near, far]), INTRINSICS_PX)


def test_parallax_is_what_a_turn_leaves_and_a_walking_person_has_none():
    start_px = points_seen([0.0, 0.0, 0.0], 0.0)
    turned_px = points_seen([0.0, 0.0, 0.0], 5.0)
    assert parallax_px(start_px, turned_px, INTRINSICS_PX).max() < 0.01
    moved_px = points_seen([0.1, 0.0, 0.0], 5.0)
    parallax = parallax_px(start_px, moved_px, INTRINSICS_PX)
    # 0.1 m before 2.1 m is 10.5 px, before 55 m 0.4 px.
    assert np.median(parallax[:100]) == pytest.approx(10.5, abs=0.8)
    assert parallax[100:].max() < 1.0
    walking_px = moved_px.copy()
    walking_px[:100:3] += [0.0, 12.0]
    assert parallax_px(start_px, walking_px, INTRINSICS_PX)[:100:3].max() == 0.0
    assert parallax_px(start_px[:19], moved_px[:19], INTRINSICS_PX).tolist() == [0.0] * 19


def test_masked_parts_do_not_count(tmp_path):
    background, person = texture(0), texture(1)
    pictures, mask = [], np.zeros(SIZE_PX[::-1], np.uint8)
    mask[:, 36:216] = 255
    for row in range(6):
        picture = shifted(background, 0).copy()
        picture[:, 44:208] = shifted(person, 9.0 * row)[:, 44:208]
        pictures.append(picture)
    frames = write_pictures(tmp_path / "frames", pictures)
    write_pictures(tmp_path / "masks", [mask] * 6)
    config = SfmConfig(keyframe_step=0.02, keyframe_gap=100, min_keyframes=2)
    assert choose_keyframes(given(frames, tmp_path / "masks"), config).rows.tolist() == [0, 5]
    assert len(choose_keyframes(given(frames), config).rows) > 2
    (tmp_path / "masks" / "00003.png").unlink()
    with pytest.raises(BadFrames, match="00003"):
        choose_keyframes(given(frames, tmp_path / "masks"), config)


MATCHED = ((3, 4), (4, 8))
"""What lies before the second cut has matches behind it, but not across it alone."""


def test_a_cut_and_black_frames_are_noticed(tmp_path):
    pictures = [shifted(texture(0), row) for row in range(4)]
    pictures += [shifted(texture(1), row) for row in range(4)]
    pictures += [np.zeros(SIZE_PX[::-1], np.uint8)] * 3
    frames = write_pictures(tmp_path / "frames", pictures)
    keys = choose_keyframes(given(frames), SfmConfig(keyframe_gap=100, min_keyframes=2))
    assert keys.cuts.tolist() == [3, 7]
    assert keys.featureless.tolist() == [8, 9, 10]
    # Both sides of a cut are looked at more closely.
    assert {0, 3, 4, 7, 8, 10} <= set(keys.rows.tolist())
    points_px = [np.zeros((1, 2))] * len(keys.rows)
    at = {row: key for key, row in enumerate(keys.rows.tolist())}
    pairs = [PairMatches(at[a], at[b], np.zeros((1, 2), int), "CALIBRATED") for a, b in MATCHED]
    assert keys.but_matched(Matches(points_px, pairs)).cuts.tolist() == [7]


def test_a_covered_lens_takes_few_keyframes(tmp_path, monkeypatch):
    """Each was one, and stood between those before and after, which were not matched."""
    pictures = [shifted(texture(0), 4.0 * row) for row in range(6)]
    pictures += [np.zeros(SIZE_PX[::-1], np.uint8)] * 40
    pictures += [shifted(texture(0), 4.0 * row) for row in range(6, 12)]
    frames = given(write_pictures(tmp_path / "frames", pictures))
    keys = choose_keyframes(frames, SfmConfig(keyframe_gap=10, min_keyframes=2))
    rows = keys.rows.tolist()
    assert [row for row in rows if 6 <= row < 46] == [6] and {0, 5, 46, 51} <= set(rows)
    assert keys.featureless.tolist() == list(range(6, 46))
    # Nor are the frames between decoded all at once: of four minutes they took 8 GB.
    decoded, read = [], Frames.read

    def noted(self: Frames, image: Path, shrink: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        decoded.append(int(image.stem))
        return read(self, image, shrink)

    monkeypatch.setattr(Frames, "read", noted)
    nothing = Matches([np.zeros((0, 2))] * len(rows), [])
    config = SfmConfig(keyframe_gap=10)
    found = with_frames_between(nothing, keys.rows, frames, np.zeros(0), config)
    assert len(found.keypoints_px) == 52 and not [row for row in decoded if 6 < row < 45]
    assert set(range(1, 5)) <= set(decoded)


def test_a_low_frame_rate_is_no_cut_where_features_match(tmp_path):
    pictures = [shifted(texture(seed), 110.0 * row) for seed in (0, 1) for row in range(4)]
    frames, config = (
        given(write_pictures(tmp_path / "frames", pictures)),
        SfmConfig(first_octave=-1),
    )
    keys = choose_keyframes(frames, config)
    assert keys.rows.tolist() == list(range(8)) and keys.cuts.tolist() == list(range(7))
    (tmp_path / "colmap").mkdir()
    matches = match_frames(frames.some(keys.rows), tmp_path / "colmap", config)
    assert keys.but_matched(matches).cuts.tolist() == [3]


def test_features_are_followed_into_the_frames_between(tmp_path):
    image = texture(0)
    frames = write_pictures(tmp_path / "frames", [shifted(image, 2.5 * row) for row in range(5)])
    points_px = grid_px(45.0, 30)
    n = len(points_px)
    # The last point of the first keyframe has no partner, so nobody knows where it is in space.
    same = np.stack([np.arange(n - 1)] * 2, axis=1)
    keys = Matches([points_px, points_px - [10.0, 0]], [PairMatches(0, 1, same, "CALIBRATED")])
    config = SfmConfig(followed_points=20)
    all_frames = with_frames_between(keys, np.array([0, 4]), given(frames), np.zeros(0), config)
    assert len(all_frames.keypoints_px) == 5
    rows = [(pair.first, pair.second, pair.configuration) for pair in all_frames.pairs]
    between = [(0, row, FOLLOWED) for row in (1, 2, 3)] + [(row, 4, FOLLOWED) for row in (1, 2, 3)]
    assert sorted(rows) == sorted([*between, (0, 4, "CALIBRATED")])
    for pair in all_frames.pairs:
        shift_px = 2.5 * (pair.second - pair.first)
        first_px, second_px = all_frames.ends_px(pair)
        assert np.abs(first_px - [shift_px, 0] - second_px).max() < 0.1
        assert n - 1 not in (pair.features[:, 0] if pair.first == 0 else pair.features[:, 1])


def test_frames_between_get_cameras_as_good_as_keyframes(film, tmp_path):
    filmed = film("dolly", 24)
    config = SfmConfig(max_features=400, first_octave=-1, keyframe_step=0.1, min_keyframes=3)
    out_dir = filmed.solved(tmp_path / "sfm", config)
    quality, cameras = load_quality(out_dir), load_cameras(out_dir)
    keys = quality.keyframes
    assert 3 <= len(keys) <= 14 and keys[0] == 0 and keys[-1] == 23
    assert cameras.path.has_camera.all() and quality.cuts_after_frames == ()
    assert turn_errors_deg(cameras.path.world_from_cam, filmed.world_from_cam).max() < 0.1


def test_a_camera_that_stands_still_is_static(tmp_path):
    rng = np.random.default_rng(0)
    image = texture(0)
    noisy = [
        np.clip(shifted(image, 0) + rng.normal(0, 3, SIZE_PX[::-1]), 0, 255).astype(np.uint8)
        for _ in range(6)
    ]
    write_pictures(tmp_path / "frames", noisy)
    frames, lens = read_frames(tmp_path / "frames"), Lens.centred(220.0, SIZE_PX)
    out_dir = reconstruct(frames, None, lens, tmp_path / "sfm", SfmConfig(keyframe_gap=2))
    cameras, quality = load_cameras(out_dir), load_quality(out_dir)
    assert cameras.geometry == quality.geometry == "static"
    assert np.array_equal(cameras.path.world_from_cam, np.tile(np.eye(4), (6, 1, 1)))
    assert quality.largest_turn_deg is not None and quality.largest_turn_deg < 0.05
