"""The lens: its matrix, its distortion against OpenCV's, and its picture at other sizes."""

import cv2
import numpy as np
import pytest

from gmrdata.values.camera import ASSUMED, Lens, Origin, bent, straightened

BENT = Lens((600.0, 605.0), (322.0, 239.0), (640, 480), (-0.15, 0.02))
SEEN_PX = np.array([[10.0, 20.0], [630.0, 470.0], [322.0, 239.0]])


def test_a_lens_is_its_matrix():
    assert np.array_equal(BENT.matrix_px, [[600, 0, 322], [0, 605, 239], [0, 0, 1]])
    assert Lens.of_matrix(BENT.matrix_px, (640, 480), BENT.radial) == BENT
    for matrix in (np.eye(3) + np.eye(3, k=1), np.full((3, 3), np.nan), 2 * np.eye(3)):
        with pytest.raises(ValueError, match="no matrix"):
            Lens.of_matrix(matrix, (640, 480))


def test_a_lens_that_is_assumed_looks_through_the_middle():
    lens = Lens.centred(500.0, (640, 480), Origin("metadata", 0.05))
    assert (lens.focal_px, lens.centre_px, lens.is_pinhole) == ((500, 500), (320, 240), True)
    assert lens.centre_from == lens.radial_from == ASSUMED and lens.focal_from.sigma == 0.05


def test_pixels_scale_with_the_picture():
    half = BENT.at_size((320, 240))
    assert half == Lens((300, 302.5), (161, 119.5), (320, 240), BENT.radial)
    assert np.allclose(half.rays(SEEN_PX / 2), BENT.rays(SEEN_PX))
    assert half.corner_radius == BENT.corner_radius


def test_what_is_seen_goes_to_a_pinhole_and_back():
    straight_px = BENT.pinhole_px(SEEN_PX)
    assert np.allclose(BENT.seen_px(straight_px), SEEN_PX)
    assert straight_px[0, 0] < 0 and np.array_equal(straight_px[2], SEEN_PX[2])
    rays = np.c_[BENT.rays(SEEN_PX), np.ones(3)]
    terms = np.array([*BENT.radial, 0.0, 0.0])
    expected, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), BENT.matrix_px, terms)
    assert np.allclose(expected[:, 0], SEEN_PX)
    pinhole = Lens.of_matrix(BENT.matrix_px, BENT.size_px)
    assert np.array_equal(pinhole.seen_px(SEEN_PX), SEEN_PX)
    assert np.array_equal(pinhole.pinhole_px(SEEN_PX), SEEN_PX)


@pytest.mark.parametrize("k1", [-0.4, -0.1, 0.0, 0.3])
@pytest.mark.parametrize("k2", [-0.1, 0.0, 0.06])
def test_a_lens_bends_as_opencv_says_and_back(k1, k2):
    r = np.linspace(0.0, 1.4, 80)
    r = r[np.cumprod(1 + 3 * k1 * r**2 + 5 * k2 * r**4 > 0.1).astype(bool)]  # up to the fold
    straight = np.stack([0.8 * r, -0.6 * r], axis=1)
    seen = bent(straight, k1, k2)
    points = np.c_[straight, np.ones(len(r))]
    expected, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), np.eye(3), np.array([k1, k2, 0.0, 0.0])
    )
    np.testing.assert_allclose(seen, expected[:, 0], atol=1e-12)
    np.testing.assert_allclose(straightened(seen, k1, k2), straight, atol=1e-7)


@pytest.mark.parametrize(("k1", "k2"), [(-0.3, 0.0), (-0.2, 0.01), (0.3, -0.1), (0.0, -0.1)])
def test_what_a_folding_lens_cannot_show_is_put_on_its_edge(k1, k2):
    r = np.linspace(0.5, 3.0, 10_000)
    shown = r + k1 * r**3 + k2 * r**5
    straight = straightened(np.array([[1.01 * shown.max(), 0.0], [0.0, 50.0]]), k1, k2)
    assert np.linalg.norm(straight, axis=1) == pytest.approx(r[shown.argmax()], abs=1e-3)
