"""Patches that shift, turn and grow by known amounts."""

import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gmrdata.cameras.match.keyframes import follow
from gmrdata.cameras.match.keypoint_adjustment import HALF_PX, follow_patches
from tests.cameras.match.test_keyframes import texture

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
    """The picture after a similarity; OpenCV's (0, 0) is the centre of the first pixel."""
    moved = after_from_before.copy()
    moved[:, 2] += after_from_before[:, :2] @ [0.5, 0.5] - 0.5
    return cv2.warpAffine(image, moved, (WIDTH_PX, HEIGHT_PX), flags=cv2.INTER_CUBIC)


def errors_px(found_px: np.ndarray, after_from_before: np.ndarray) -> np.ndarray:
    true_px = POINTS_PX @ after_from_before[:, :2].T + after_from_before[:, 2]
    return np.asarray(np.linalg.norm(found_px - true_px, axis=1))


def guessed_px(after_from_before: np.ndarray, off_px: float = 0.5) -> np.ndarray:
    """Places as SIFT would have them, half a pixel off."""
    rng = np.random.default_rng(0)
    true_px = POINTS_PX @ after_from_before[:, :2].T + after_from_before[:, 2]
    return np.asarray(true_px + rng.normal(0, off_px, true_px.shape))


@settings(max_examples=20)
@given(
    st.floats(0.85, 1.2), st.floats(-0.15, 0.15),
    st.tuples(st.floats(-20, 20), st.floats(-20, 20)), st.integers(0, 20),
)  # fmt: skip
def test_a_patch_is_found_as_it_turns_and_grows(
    growth: float, turn_rad: float, shift_px: tuple[float, float], seed: int
) -> None:
    move, image = similar(growth, turn_rad, shift_px), texture(seed)
    found_px, rests = follow_patches(image, seen_after(image, move), POINTS_PX, guessed_px(move))
    assert rests.mean() > 0.8
    assert np.median(errors_px(found_px, move)[rests]) < 0.05
    assert np.percentile(errors_px(found_px, move)[rests], 90) < 0.2


def test_a_patch_that_may_only_shift_goes_too_far_where_it_grows() -> None:
    """As on a car's path, where the two differed by 0.8 px in one match of ten."""
    image, move = texture(0), similar(1.12, 0.0, (3.0, -2.0))
    after = seen_after(image, move)
    shifted_px, ok = follow(image, after, POINTS_PX, guessed_px(move))
    grown_px, rests = follow_patches(image, after, POINTS_PX, guessed_px(move))
    assert np.percentile(errors_px(shifted_px, move)[ok & rests], 90) > 0.4
    assert np.percentile(errors_px(grown_px, move)[ok & rests], 90) < 0.1


def test_patches_are_where_opencv_finds_them() -> None:
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


def test_what_is_not_there_does_not_come_to_rest_near_it() -> None:
    image, other = texture(1), texture(2)
    found_px, rests = follow_patches(image, other, POINTS_PX, POINTS_PX)
    near = np.linalg.norm(found_px - POINTS_PX, axis=1) < 0.5
    assert (rests & near).mean() < 0.1


def test_no_points_and_no_texture_are_no_error() -> None:
    image = np.full((50, 60), 128, np.uint8)
    found_px, rests = follow_patches(image, image, np.zeros((0, 2)), np.zeros((0, 2)))
    assert found_px.shape == (0, 2) and rests.shape == (0,)
    found_px, _ = follow_patches(image, image, np.array([[30.0, 20.0]]), np.array([[31.0, 20.0]]))
    np.testing.assert_allclose(found_px, [[31.0, 20.0]])
