"""YOLOX's picture in and answer out, against a direct reading of its definition."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.people.yolox import COCO_NAMES, cells, class_indices, decode, letterbox, problem_with

INPUT_PX = (96, 64)
N_CELLS = 12 * 8 + 6 * 4 + 3 * 2
EVERY_CLASS = list(range(80))


def silent_answer(n_cells: int = N_CELLS) -> np.ndarray:
    """An answer that sees nothing."""
    return np.zeros((1, n_cells, 85))


def test_a_picture_of_twice_the_size_is_halved_into_the_corner_on_grey() -> None:
    image = np.random.default_rng(0).integers(0, 256, (80, 192, 3), dtype=np.uint8)
    blob, scales = letterbox(image, INPUT_PX)
    # Bilinear sampling at half the size looks midway between two pixels: the mean of four.
    mean = image.astype(int).reshape(40, 2, 96, 2, 3).sum(axis=(1, 3)) / 4
    assert (blob.shape, blob.dtype) == ((1, 3, 64, 96), np.float32)
    np.testing.assert_array_equal(scales, [0.5, 0.5])
    assert np.abs(blob[0, :, :40] - mean.transpose(2, 0, 1)).max() <= 0.5
    assert (blob[0, :, 40:] == 114).all()


def test_channels_stay_in_order_and_values_unscaled() -> None:
    blob, _ = letterbox(np.full((64, 96, 3), (10, 20, 250), np.uint8), INPUT_PX)
    assert [set(np.unique(channel)) for channel in blob[0]] == [{10.0}, {20.0}, {250.0}]


@given(width=st.integers(1, 600), height=st.integers(1, 600))
def test_any_picture_fits_with_its_aspect_kept(width: int, height: int) -> None:
    image = np.zeros((height, width, 3), np.uint8)
    blob, scales = letterbox(image, INPUT_PX)
    reduced = np.array([width, height]) * scales
    ratio = min(96 / width, 64 / height)
    # Each side is cut to whole pixels, but to one at least.
    np.testing.assert_array_less(np.abs(reduced - np.array([width, height]) * ratio), 1.0 + 1e-9)
    black = (blob[0, 0] == 0).nonzero()
    assert (black[1].max() + 1, black[0].max() + 1) == tuple(reduced.round().astype(int))
    assert (blob == 0).sum() == 3 * round(reduced[0]) * round(reduced[1])


def test_cells_are_counted_row_by_row_from_the_finest_grid() -> None:
    corners, widths = cells(INPUT_PX)
    expected = [
        (x, y, stride)
        for stride in (8, 16, 32)
        for y in range(64 // stride)
        for x in range(96 // stride)
    ]
    np.testing.assert_array_equal(np.concatenate([corners, widths], axis=1), expected)


def test_a_row_means_what_the_definition_says() -> None:
    output = silent_answer()
    row = 12 * 8 + 2 * 6 + 5  # second grid, third row, sixth column
    output[0, row, :5] = [0.25, -0.5, math.log(2.0), math.log(0.5), 0.8]
    output[0, row, 5 + COCO_NAMES.index("dog")] = 0.9
    found = decode(output, INPUT_PX, np.array([0.5, 0.25]), EVERY_CLASS, 0.1)
    centre_x, centre_y = (5 + 0.25) * 16, (2 - 0.5) * 16
    corners = [centre_x - 16, centre_y - 4, centre_x + 16, centre_y + 4]
    expected_px = [corners[0] / 0.5, corners[1] / 0.25, corners[2] / 0.5, corners[3] / 0.25]
    np.testing.assert_allclose(found.boxes_px, [expected_px], atol=1e-12)
    np.testing.assert_allclose(found.scores, [0.72], atol=1e-12)
    assert COCO_NAMES[found.classes[0]] == "dog"


def test_the_best_of_the_wanted_classes_counts() -> None:
    output = silent_answer()
    output[0, 3, 4] = 1.0
    output[0, 3, 5 + COCO_NAMES.index("teddy bear")] = 0.6
    output[0, 3, 5 + COCO_NAMES.index("dog")] = 0.5
    wanted = class_indices(("dog", "person"))
    found = decode(output, INPUT_PX, np.ones(2), wanted, 0.4)
    assert [COCO_NAMES[index] for index in found.classes] == ["dog"]
    assert found.scores.tolist() == [0.5]
    assert len(decode(output, INPUT_PX, np.ones(2), class_indices(("cat",)), 0.4)) == 0


@given(
    row=st.integers(0, N_CELLS - 1),
    centre=st.tuples(st.floats(-50, 150), st.floats(-50, 150)),
    size=st.tuples(st.floats(0.5, 500), st.floats(0.5, 500)),
    scale=st.tuples(st.floats(0.01, 4), st.floats(0.01, 4)),
)
def test_decoding_inverts_encoding(
    row: int, centre: tuple[float, float], size: tuple[float, float], scale: tuple[float, float]
) -> None:
    corners, widths = cells(INPUT_PX)
    output = silent_answer()
    output[0, row, :2] = np.array(centre) / widths[row] - corners[row]
    output[0, row, 2:4] = np.log(np.array(size) / widths[row])
    output[0, row, 4:] = 1.0
    found = decode(output, INPUT_PX, np.array(scale), EVERY_CLASS, 0.5)
    low, high = np.array(centre) - np.array(size) / 2, np.array(centre) + np.array(size) / 2
    expected_px = np.concatenate([low / scale, high / scale])
    np.testing.assert_allclose(found.boxes_px[0], expected_px, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (silent_answer(N_CELLS + 1), r"shape \(1, 127, 85\), but .* gives \(1, 126, 85\)"),
        (np.zeros((1, N_CELLS, 25)), r"shape \(1, 126, 25\)"),
        (np.full((1, N_CELLS, 85), np.nan), "not finite"),
        (np.full((1, N_CELLS, 85), -1.0), "scores are not between 0 and 1"),
    ],
)
def test_other_layouts_are_told(answer: np.ndarray, said: str) -> None:
    problem = problem_with(answer, INPUT_PX)
    assert problem is not None
    assert re.search(said, problem)


def test_decoded_answers_are_told_from_raw_ones() -> None:
    output = silent_answer()
    assert problem_with(output, INPUT_PX) is None
    output[..., 2:4] = 40.0  # a box of 40 px, where its logarithm belongs
    assert "decoded already" in (problem_with(output, INPUT_PX) or "")
