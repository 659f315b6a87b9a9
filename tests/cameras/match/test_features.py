"""Features and patches of frames, and keypoints moved by known parts of a pixel."""

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from gmrdata.cameras.colmap import pycolmap
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.match import keypoint_adjustment
from gmrdata.cameras.match.features import (
    FeatureFinder,
    Features,
    _first_octave,
    find_features,
)
from gmrdata.cameras.match.keyframes import follow
from gmrdata.cameras.match.keypoint_adjustment import (
    HALF_PX,
    MEASURED_PX,
    PLACED_PX,
    PatchMotions,
    _fitted,
    adjust_keypoints,
    follow_patches,
)
from gmrdata.cameras.match.matches import DATABASE_FILE, Matches, PairMatches, match_frames
from gmrdata.cameras.recipe import SfmConfig
from tests.cameras.match.test_keyframes import INTRINSICS_PX, SIZE_PX, shifted, texture
from tests.filming import coarse_noise, write_pictures

SMALL_INTRINSICS_PX = np.array([[150.0, 0, 80], [0, 150, 60], [0, 0, 1]])


def features_of(frames: Frames, database_path: Path, config: SfmConfig) -> Features:
    with FeatureFinder(frames, database_path.parent, config) as finder:
        return find_features(frames, database_path, finder)


def keypoints_of(database_path: Path) -> dict[str, np.ndarray]:
    with closing(pycolmap.Database.open(database_path)) as database:
        images = database.read_all_images()
        return {image.name: database.read_keypoints(image.image_id) for image in images}


def test_features_are_those_of_each_frame_alone(tmp_path):
    """COLMAP's extractor gave a frame the orientations of the frame before it."""
    images = write_pictures(tmp_path / "frames", coarse_noise(12))
    frames = Frames(images, None, SMALL_INTRINSICS_PX, (160, 120))
    features_of(frames, tmp_path / "all.db", SfmConfig(threads=4, first_octave=0))
    together = keypoints_of(tmp_path / "all.db")
    for image in images:
        alone = Frames([image], None, SMALL_INTRINSICS_PX, (160, 120))
        features_of(alone, tmp_path / f"{image.stem}.db", SfmConfig(threads=1, first_octave=0))
        expected = keypoints_of(tmp_path / f"{image.stem}.db")[image.name]
        np.testing.assert_array_equal(together[image.name], expected)


def test_features_that_were_begun_early_are_the_same(tmp_path):
    """They are found while keyframes are chosen, more of them than are keyframes in the end."""
    images = write_pictures(tmp_path / "frames", coarse_noise(6))
    frames = Frames(images, None, SMALL_INTRINSICS_PX, (160, 120))
    config, keyframes = SfmConfig(threads=2), frames.some(np.array([0, 2, 5]))
    expected = features_of(keyframes, tmp_path / "late.db", config)
    with FeatureFinder(frames, tmp_path, config) as finder:
        for image in frames.images[:4]:
            finder.begin(image)
        found = find_features(keyframes, tmp_path / "early.db", finder)
    assert found.n_free == expected.n_free
    late, early = keypoints_of(tmp_path / "late.db"), keypoints_of(tmp_path / "early.db")
    assert list(early) == [image.name for image in keyframes.images]
    for name, points in late.items():
        np.testing.assert_array_equal(early[name], points)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["early.db", "frames", "late.db"]


@pytest.mark.parametrize(("asked", "octave"), [(None, -1), (0, 0)])
def test_features_are_those_of_colmap_for_a_single_frame(asked, octave, tmp_path):
    """Of a small frame, which is doubled if nobody says otherwise."""
    images = write_pictures(tmp_path / "frames", coarse_noise(1))
    frames = Frames(images, None, SMALL_INTRINSICS_PX, (160, 120))
    config = SfmConfig(max_features=600, first_octave=asked)
    found = features_of(frames, tmp_path / "own.db", config)
    options = pycolmap.FeatureExtractionOptions()
    options.sift.max_num_features, options.sift.first_octave = 600, octave
    path = tmp_path / "colmap.db"
    pycolmap.extract_features(
        path, images[0].parent, extraction_options=options, device=pycolmap.Device.cpu
    )
    expected = keypoints_of(path)[images[0].name]
    np.testing.assert_array_equal(keypoints_of(tmp_path / "own.db")[images[0].name], expected)
    assert found.n_free == [len(expected)]


def test_frames_of_a_quarter_of_a_megapixel_are_taken_as_they_are():
    assert [_first_octave(size_px, SfmConfig()) for size_px in ((499, 500), (500, 500))] == [-1, 0]
    assert _first_octave((160, 120), SfmConfig(first_octave=1)) == 1


def test_features_inside_masks_are_last_and_have_no_descriptors(tmp_path):
    images = write_pictures(tmp_path / "frames", coarse_noise(2))
    mask = np.zeros((120, 160), np.uint8)
    mask[:, :70] = 255
    write_pictures(tmp_path / "masks", [mask] * len(images))
    frames = Frames(images, tmp_path / "masks", SMALL_INTRINSICS_PX, (160, 120))
    found = features_of(frames, tmp_path / "masked.db", SfmConfig())
    places = keypoints_of(tmp_path / "masked.db")
    with closing(pycolmap.Database.open(tmp_path / "masked.db")) as database:
        for image in database.read_all_images():
            row = int(Path(image.name).stem)
            x_px, n_free = places[image.name][:, 0], found.n_free[row]
            assert (x_px[:n_free] >= 70).all() and (x_px[n_free:] < 70).all()
            kept = np.asarray(database.read_descriptors(image.image_id).data)
            np.testing.assert_array_equal(kept, found.descriptors[row][:n_free])
            assert len(found.descriptors[row]) == len(x_px)


LARGE_PX = (961, 641)
BLOB_PX = np.stack(np.meshgrid(np.arange(60.3, 900, 85), np.arange(52.6, 600, 85)), -1)


def blobs() -> np.ndarray:
    """Bright spots (H, W) at known places [px from the outer corner], each of its own size."""
    x, y = np.arange(LARGE_PX[0]) + 0.5, np.arange(LARGE_PX[1]) + 0.5
    image = np.full(LARGE_PX[::-1], 60.0)
    for n, (at_x, at_y) in enumerate(BLOB_PX.reshape(-1, 2)):
        sigma_px = 5 + n % 5
        across = np.exp(-(((x - at_x) / sigma_px) ** 2) / 2)
        image += 150 * np.exp(-(((y - at_y) / sigma_px) ** 2) / 2)[:, None] * across
    return np.round(image).astype(np.uint8)


def test_features_of_large_frames_are_where_the_frame_has_them(tmp_path):
    """By OpenCV's SIFT on half the size, whose (0, 0) is the centre of a pixel."""
    cv2.imwrite(str(tmp_path / "00000.png"), blobs())
    frames = Frames([tmp_path / "00000.png"], None, SMALL_INTRINSICS_PX, LARGE_PX)
    found = features_of(frames, tmp_path / "own.db", SfmConfig(max_orientations=1))
    places_px = keypoints_of(tmp_path / "own.db")["00000.png"][:, :2]
    assert found.n_free == [len(places_px)]
    true_px = BLOB_PX.reshape(-1, 2)
    apart_px = places_px[:, None] - true_px
    nearest = np.linalg.norm(apart_px, axis=2).argmin(axis=0)
    off_px = apart_px[nearest, np.arange(len(true_px))]
    there = np.linalg.norm(off_px, axis=1) < 1
    assert there.mean() > 0.95
    assert np.abs(off_px[there]).max() < 0.1 and np.abs(off_px[there].mean(axis=0)).max() < 0.02


@pytest.mark.parametrize(("masked_px", "weak_too"), [(0, False), (641, True)])
def test_weak_features_are_taken_where_masks_leave_few(masked_px, weak_too, tmp_path):
    """Firm texture on the left, which a mask may hide, and a weak one on the right."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(-100, 101, (214, 321)).astype(np.float32)
    coarse[:, 214:] *= 0.1
    image = cv2.resize(coarse, LARGE_PX, interpolation=cv2.INTER_CUBIC) + 128
    mask = np.zeros(LARGE_PX[::-1], np.uint8)
    mask[:, :masked_px] = 255
    picture = np.clip(np.round(image), 0, 255).astype(np.uint8)
    images = write_pictures(tmp_path / "frames", [picture])
    write_pictures(tmp_path / "masks", [mask])
    frames = Frames(images, tmp_path / "masks", SMALL_INTRINSICS_PX, LARGE_PX)
    features_of(frames, tmp_path / "own.db", SfmConfig())
    x_px = keypoints_of(tmp_path / "own.db")["00000.png"][:, 0]
    n_weak = int((x_px > 661).sum())
    assert n_weak > 600 if weak_too else n_weak < 150


def test_a_place_has_as_many_directions_as_are_asked_for(tmp_path):
    rng = np.random.default_rng(0)
    coarse = rng.integers(0, 255, (80, 120)).astype(np.uint8)
    image = cv2.resize(coarse, LARGE_PX, interpolation=cv2.INTER_CUBIC)
    cv2.imwrite(str(tmp_path / "00000.png"), image)
    frames = Frames([tmp_path / "00000.png"], None, SMALL_INTRINSICS_PX, LARGE_PX)
    counts = []
    for most in (1, 2):
        path = tmp_path / f"{most}.db"
        features_of(frames, path, SfmConfig(max_features=300, max_orientations=most))
        keypoints = keypoints_of(path)["00000.png"]
        _, each = np.unique(keypoints[:, :2], axis=0, return_counts=True)
        assert each.max() == most and len(each) == 300
        counts.append(len(keypoints))
    assert counts[1] > counts[0] == 300


HEIGHT_PX, WIDTH_PX = 300, 600
SPOTS_PX = np.stack(np.meshgrid(np.arange(150.0, 460, 12), np.arange(80.0, 230, 12)), -1)
POINTS_PX = SPOTS_PX.reshape(-1, 2)
MIDDLE_PX = np.array([WIDTH_PX / 2, HEIGHT_PX / 2])


def similar(growth: float, turn_rad: float, shift_px: tuple[float, float]) -> np.ndarray:
    """(2, 3) after_from_before, about the middle of the picture."""
    turn = growth * np.array(
        [[np.cos(turn_rad), -np.sin(turn_rad)], [np.sin(turn_rad), np.cos(turn_rad)]]
    )
    return np.c_[turn, MIDDLE_PX - turn @ MIDDLE_PX + shift_px]


def seen_after(image: np.ndarray, after_from_before: np.ndarray) -> np.ndarray:
    """The picture after a similarity.  OpenCV's own warps round places to 1/32 px."""
    places_px = np.stack(np.meshgrid(np.arange(WIDTH_PX), np.arange(HEIGHT_PX)), axis=-1) + 0.5
    back = np.linalg.inv(after_from_before[:, :2])
    before_px = (places_px - after_from_before[:, 2]) @ back.T - 0.5
    seen = map_coordinates(image.astype(float), [before_px[..., 1], before_px[..., 0]])
    return np.clip(np.rint(seen), 0, 255).astype(np.uint8)


def errors_px(found_px: np.ndarray, after_from_before: np.ndarray) -> np.ndarray:
    true_px = POINTS_PX @ after_from_before[:, :2].T + after_from_before[:, 2]
    return np.asarray(np.linalg.norm(found_px - true_px, axis=1))


def guessed_px(after_from_before: np.ndarray) -> np.ndarray:
    """Places as SIFT would have them, half a pixel off."""
    rng = np.random.default_rng(0)
    true_px = POINTS_PX @ after_from_before[:, :2].T + after_from_before[:, 2]
    return np.asarray(true_px + rng.normal(0, 0.5, true_px.shape))


@settings(max_examples=20)
@given(
    st.floats(0.85, 1.2), st.floats(-0.15, 0.15),
    st.tuples(st.floats(-20, 20), st.floats(-20, 20)), st.integers(0, 20),
)  # fmt: skip
def test_a_patch_is_found_as_it_turns_and_grows(growth, turn_rad, shift_px, seed):
    move, image = similar(growth, turn_rad, shift_px), texture(seed)
    found_px, rests = follow_patches(image, seen_after(image, move), POINTS_PX, guessed_px(move))
    assert rests.mean() > 0.8
    assert np.median(errors_px(found_px, move)[rests]) < 0.03
    assert np.percentile(errors_px(found_px, move)[rests], 90) < 0.1


def test_a_patch_that_may_only_shift_goes_too_far_where_it_grows():
    """As on a car's path, where the two differed by 0.8 px in one match of ten."""
    image, move = texture(0), similar(1.12, 0.0, (3.0, -2.0))
    after = seen_after(image, move)
    shifted_px, ok = follow(image, after, POINTS_PX, guessed_px(move))
    grown_px, rests = follow_patches(image, after, POINTS_PX, guessed_px(move))
    assert np.percentile(errors_px(shifted_px, move)[ok & rests], 90) > 0.4
    assert np.percentile(errors_px(grown_px, move)[ok & rests], 90) < 0.1


def test_patches_are_where_opencv_finds_them():
    """OpenCV's own alignment (enhanced correlation, Evangelidis and Psarakis 2008), one by one."""
    image, move = texture(3), similar(1.06, 0.05, (4.0, 1.0))
    after, guess_px = seen_after(image, move), guessed_px(move)
    found_px, rests = follow_patches(image, after, POINTS_PX, guess_px)
    chosen = np.flatnonzero(rests)[::9]
    apart_px = []
    for n in chosen:
        corner = np.floor(POINTS_PX[n]).astype(int) - HALF_PX
        side = 2 * HALF_PX + 1
        patch = image[corner[1] : corner[1] + side, corner[0] : corner[0] + side]
        start = np.c_[np.eye(2), guess_px[n] - POINTS_PX[n] + corner].astype(np.float32)
        until = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-6)
        _, warp = cv2.findTransformECC(
            patch, after, start, cv2.MOTION_AFFINE, until, np.full_like(after, 255), 1
        )
        own_px = POINTS_PX[n] - corner - 0.5
        theirs_px = warp[:, :2] @ own_px + warp[:, 2] + 0.5
        apart_px.append(np.linalg.norm(theirs_px - found_px[n]))
    assert len(chosen) > 20
    assert np.median(apart_px) < 0.05


def test_what_is_not_there_does_not_come_to_rest_near_it():
    image, other = texture(1), texture(2)
    found_px, rests = follow_patches(image, other, POINTS_PX, POINTS_PX)
    near = np.linalg.norm(found_px - POINTS_PX, axis=1) < 0.5
    assert (rests & near).mean() < 0.1


def test_no_points_and_no_texture_are_no_error():
    image = np.full((50, 60), 128, np.uint8)
    found_px, rests = follow_patches(image, image, np.zeros((0, 2)), np.zeros((0, 2)))
    assert found_px.shape == (0, 2) and rests.shape == (0,)
    found_px, _ = follow_patches(image, image, np.array([[30.0, 20.0]]), np.array([[31.0, 20.0]]))
    np.testing.assert_allclose(found_px, [[31.0, 20.0]])


SHIFTS_PX = np.array([0.0, 3.3, 6.85, 10.4])


@pytest.fixture
def found(tmp_path) -> tuple[Matches, Frames, Path]:
    """Four shifted pictures, and what COLMAP finds and matches in them."""
    images = write_pictures(
        tmp_path / "frames", [shifted(texture(0), by_px) for by_px in SHIFTS_PX]
    )
    frames = Frames(images, None, INTRINSICS_PX, SIZE_PX)
    return match_frames(frames, tmp_path, SfmConfig(first_octave=-1)), frames, tmp_path


def keypoint_errors_px(matches: Matches) -> np.ndarray:
    """(M,) by how much the motions of matched features are wrong."""
    errors = []
    for pair in matches.pairs:
        first_px, second_px = matches.ends_px(pair)
        moved_px = second_px - first_px
        true_px = [SHIFTS_PX[pair.first] - SHIFTS_PX[pair.second], 0.0]
        errors.append(np.linalg.norm(moved_px - true_px, axis=1))
    return np.concatenate(errors)


def test_features_move_as_their_pictures_do(found):
    """Features of one blob in shifted pictures differ little: noise of SIFT is laid over them."""
    matches, frames, work_dir = found
    rng = np.random.default_rng(0)
    noisy = [px + rng.normal(0, 0.3, px.shape) for px in matches.keypoints_px]
    before = replace(matches, keypoints_px=noisy)
    after = adjust_keypoints(before, frames, work_dir)
    assert len(keypoint_errors_px(before)) > 100
    assert np.median(keypoint_errors_px(before)) > 0.4
    assert np.median(keypoint_errors_px(after)) < 0.08
    # What all frames have in common is not measured: they stay about where they were.
    apart_px = np.concatenate(after.keypoints_px) - np.concatenate(noisy)
    assert np.abs(apart_px.mean(axis=0)).max() < 0.02
    assert np.median(np.linalg.norm(apart_px, axis=1)) < 0.5


def test_the_mappers_see_the_same_points(found):
    matches, frames, work_dir = found
    after = adjust_keypoints(matches, frames, work_dir)
    with closing(pycolmap.Database.open(work_dir / DATABASE_FILE)) as database:
        for image in database.read_all_images():
            written = database.read_keypoints(image.image_id)
            points_px = after.keypoints_px[[path.name for path in frames.images].index(image.name)]
            np.testing.assert_array_equal(written[:, :2], points_px.astype(np.float32))
            assert (written[:, 2:] != 0).any()  # shapes stay
    assert after.pairs is matches.pairs


def test_what_moves_in_a_mask_moves_no_point(found, tmp_path):
    matches, frames, work_dir = found
    masks_dir, mask = tmp_path / "masks", np.zeros(SIZE_PX[::-1], np.uint8)
    mask[:, :120] = 255
    write_pictures(masks_dir, [mask] * len(frames.images))
    after = adjust_keypoints(matches, replace(frames, masks_dir=masks_dir), work_dir)
    before_px, after_px = np.concatenate(matches.keypoints_px), np.concatenate(after.keypoints_px)
    masked = before_px[:, 0] < 120
    np.testing.assert_allclose(after_px[masked], before_px[masked], atol=1e-9)
    assert np.abs(after_px[~masked] - before_px[~masked]).max() > 0.01


def test_a_patch_that_is_found_elsewhere_counts_for_nothing(found):
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


def test_without_neighbours_nothing_moves(found):
    matches, frames, work_dir = found
    far = [pair for pair in matches.pairs if pair.second > pair.first + 1]
    after = adjust_keypoints(replace(matches, pairs=far), frames, work_dir)
    for before_px, after_px in zip(matches.keypoints_px, after.keypoints_px, strict=True):
        np.testing.assert_array_equal(before_px, after_px)


@given(st.integers(0, 2**32 - 1), st.integers(1, 30))
def test_the_fit_is_that_of_numpy(seed, m):
    rng = np.random.default_rng(seed)
    places_px = rng.uniform(0, 100, (12, 2))
    measured = PatchMotions(rng.integers(0, 6, m), rng.integers(6, 12, m), rng.normal(0, 5, (m, 2)))
    rows = np.zeros((m, 12))
    rows[np.arange(m), measured.second] = 1
    rows[np.arange(m), measured.first] -= 1
    weighted = np.concatenate([np.eye(12) / PLACED_PX, rows / MEASURED_PX])
    wanted = np.concatenate([places_px / PLACED_PX, measured.moved_px / MEASURED_PX])
    expected = np.linalg.lstsq(weighted, wanted, rcond=None)[0]
    np.testing.assert_allclose(_fitted(places_px, measured), expected, atol=1e-6)


def test_many_image_points_are_moved_chain_by_chain_as_if_at_once(monkeypatch):
    rng, n_chains, long = np.random.default_rng(3), 40, 6
    places_px = rng.uniform(0, 100, (n_chains * long + 5, 2))
    numbers = rng.permutation(n_chains * long).reshape(n_chains, long)
    first, second = numbers[:, :-1].ravel(), numbers[:, 1:].ravel()
    measured = PatchMotions(first, second, rng.normal(0, 1, (len(first), 2)))
    whole = _fitted(places_px, measured)
    monkeypatch.setattr(keypoint_adjustment, "AT_ONCE", 17)
    groups = keypoint_adjustment._apart(measured, len(places_px))
    assert len(groups) > 5 and max(map(len, groups)) < 17 + long
    np.testing.assert_array_equal(np.sort(np.concatenate(groups)), np.arange(len(first)))
    np.testing.assert_allclose(_fitted(places_px, measured), whole, atol=1e-9)
