"""Boxes: overlap, suppression, growth and joining over time; YOLOX's picture in and answer out."""

import math
import re
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.people.linking import (
    Detections,
    TrackConfig,
    box_iou,
    detections_as_json,
    detections_from_json,
    fill_boxes,
    grow,
    keep_best,
    link,
    track,
)
from gmrdata.people.yolox import (
    CATEGORY_NUMBERS,
    COCO_NAMES,
    cells,
    class_indices,
    decode,
    letterbox,
    problem_with,
)

CONFIG = TrackConfig(link_iou=0.3, max_gap_frames=2, hold_frames=0)
NO_BOX: list[tuple[float, float]] = []
DOG, CAT = COCO_NAMES.index("dog"), COCO_NAMES.index("cat")


def found(*rows: tuple[float, float, float, float, float, int]) -> Detections:
    table = np.array(rows, dtype=np.float64).reshape(-1, 6)
    return Detections(table[:, :4], table[:, 4], table[:, 5].astype(np.int64))


def test_overlap_of_known_boxes():
    a = np.array([[0.0, 0.0, 4.0, 2.0], [5.0, 5.0, 5.0, 5.0]])
    b = np.array([[2.0, 0.0, 6.0, 2.0], [0.0, 0.0, 4.0, 2.0], [5.0, 5.0, 5.0, 5.0]])
    np.testing.assert_allclose(box_iou(a, b), [[4 / 12, 1.0, 0.0], [0.0, 0.0, 0.0]])


def test_the_weaker_of_two_boxes_of_one_class_goes():
    every = found(
        (0, 0, 10, 10, 0.5, DOG),
        (0, 0, 10, 11, 0.9, DOG),  # 10/11 with the first
        (0, 0, 10, 10, 0.4, CAT),
        (20, 0, 30, 10, 0.3, DOG),
    )
    kept = keep_best(every, 0.6)
    got = set(zip(kept.scores.tolist(), kept.classes.tolist(), strict=True))
    assert got == {(0.9, DOG), (0.4, CAT), (0.3, DOG)}
    assert len(keep_best(every, 0.95)) == 4
    assert len(keep_best(found(), 0.5)) == 0


def test_boxes_grow_by_their_shorter_side_and_a_margin():
    boxes_px = np.array([[10.0, 20.0, 30.0, 120.0]])
    np.testing.assert_allclose(grow(boxes_px, 0.1, 3), [[5.0, 15.0, 35.0, 125.0]])
    assert grow(np.zeros((0, 4)), 0.1, 3).shape == (0, 4)


@given(
    boxes=st.lists(
        st.tuples(*[st.floats(-20, 40) for _ in range(2)], *[st.floats(0, 30) for _ in range(2)]),
        max_size=4,
    )
)
def test_exactly_the_pixels_that_a_box_touches_are_filled(boxes):
    boxes_px = np.array([(x, y, x + w, y + h) for x, y, w, h in boxes]).reshape(-1, 4)
    mask = fill_boxes(boxes_px, (12, 9))
    y, x = np.mgrid[:9, :12]
    expected = np.zeros((9, 12), dtype=bool)
    for left, top, right, bottom in boxes_px:
        expected |= (x + 1 > left) & (x < right) & (y + 1 > top) & (y < bottom)
    assert mask.dtype == np.uint8
    np.testing.assert_array_equal(mask > 0, expected)
    assert set(np.unique(mask)) <= {0, 255}


def test_detections_come_back_from_json():
    one = found((1.234567, 2, 3, 4, 0.876543, DOG))
    back = detections_from_json(detections_as_json(one))
    np.testing.assert_array_equal(back.boxes_px, [[1.23, 2, 3, 4]])
    np.testing.assert_array_equal(back.scores, [0.8765])
    assert detections_from_json(detections_as_json(found())).boxes_px.shape == (0, 4)


def test_coco_has_80_classes_with_its_category_numbers():
    assert (len(COCO_NAMES), len(set(COCO_NAMES)), len(CATEGORY_NUMBERS)) == (80, 80, 80)
    number = dict(zip(COCO_NAMES, CATEGORY_NUMBERS, strict=True))
    # Known from the data set's own annotation files.
    known = {"person": 1, "stop sign": 13, "dog": 18, "backpack": 27, "bottle": 44, "tv": 72}
    assert {name: number[name] for name in known} == known
    assert number["toothbrush"] == 90
    assert class_indices(("dog", "person", "dog")) == [0, 16]


def frames_of(*frames: list[tuple[float, float]]) -> list[Detections]:
    """Frames of (left edge, score): boxes 10 px wide and high, of one class."""
    return [found(*((x, 0.0, x + 10.0, 10.0, score, 0) for x, score in one)) for one in frames]


def lefts(boxes_px: np.ndarray) -> list[float]:
    return [float(left) for left in boxes_px[:, 0]]


def test_a_missed_frame_gets_a_box_halfway():
    made = track(frames_of([(0, 0.9)], NO_BOX, [(4, 0.9)]), 0.5, CONFIG)
    np.testing.assert_allclose(made[1].filled_px, [[2, 0, 12, 10]])
    assert [frame.rows.tolist() for frame in made] == [[0], [], [0]]


def test_a_gap_is_filled_in_proportion_to_time_up_to_the_limit():
    made = track(frames_of([(0, 0.9)], NO_BOX, NO_BOX, [(3, 0.9)]), 0.5, CONFIG)
    assert [lefts(frame.filled_px) for frame in made] == [[], [1.0], [2.0], []]
    long = track(frames_of([(0, 0.9)], NO_BOX, NO_BOX, NO_BOX, [(3, 0.9)]), 0.5, CONFIG)
    assert [lefts(frame.filled_px) for frame in long] == [[]] * 5


def test_a_weak_box_counts_only_in_a_track_that_is_sure_elsewhere():
    made = track(frames_of([(0, 0.2), (50, 0.2)], [(1, 0.6), (50, 0.3)]), 0.5, CONFIG)
    assert [frame.rows.tolist() for frame in made] == [[0], [0]]


def test_the_first_and_last_box_are_held():
    held = CONFIG.model_copy(update={"hold_frames": 1})
    made = track(frames_of(NO_BOX, NO_BOX, [(0, 0.9)], [(1, 0.9)], NO_BOX, NO_BOX), 0.5, held)
    assert [lefts(frame.filled_px) for frame in made] == [[], [0.0], [], [], [1.0], []]


def test_two_people_who_pass_keep_their_tracks():
    frames = frames_of([(0, 0.9), (6, 0.9)], [(7, 0.9), (1, 0.9)])
    assert sorted(link(frames, CONFIG)) == [[(0, 0), (1, 1)], [(0, 1), (1, 0)]]


def test_nothing_found_is_nothing_masked():
    made = track(frames_of(NO_BOX, NO_BOX), 0.5, TrackConfig())
    assert [(len(frame.rows), frame.filled_px.shape) for frame in made] == [(0, (0, 4))] * 2


boxes = st.lists(st.tuples(st.integers(0, 60), st.floats(0.1, 1.0)), max_size=4)


@given(frames=st.lists(boxes, min_size=1, max_size=8), gap=st.integers(0, 3))
def test_every_box_is_in_one_track_and_tracks_obey_the_limits(frames, gap):
    config = CONFIG.model_copy(update={"max_gap_frames": gap})
    made = frames_of(*frames)
    tracks = link(made, config)
    every = sorted((at, row) for at, found in enumerate(made) for row in range(len(found)))
    assert sorted(step for linked in tracks for step in linked) == every
    for linked in tracks:
        at = [frame for frame, _ in linked]
        assert at == sorted(set(at)) and all(b - a <= gap + 1 for a, b in zip(at, at[1:]))  # noqa: B905, RUF007
    chosen = track(made, 0.0001, config)
    assert [len(c.rows) for c in chosen] == [len(found) for found in made]


def linked_in_s(n: int) -> float:
    """One object in every second frame, and something else for a moment in each frame."""
    frames = frames_of(*([(20.0 * (at % 50) + 20, 0.9)] + [(0, 0.9)] * (at % 2) for at in range(n)))
    started_s = time.process_time()
    made = track(frames, 0.5, CONFIG)
    taken_s = time.process_time() - started_s
    assert lefts(made[100].filled_px) == [0.0]
    assert sum(len(frame.filled_px) for frame in made) == n // 2 - 1
    return taken_s


def test_linking_takes_as_long_as_there_are_frames():
    """All tracks were gone through in each frame: 16 times the frames took 95 times as long."""
    assert linked_in_s(16_000) < 40 * linked_in_s(1_000)


@pytest.mark.parametrize("bad", [{"link_iou": 0}, {"max_gap_frames": -1}, {"hold": 1}])
def test_wrong_settings_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        TrackConfig.model_validate(bad)


INPUT_PX = (96, 64)
N_CELLS = 12 * 8 + 6 * 4 + 3 * 2
EVERY_CLASS = list(range(80))


def silent_answer(n_cells: int = N_CELLS) -> np.ndarray:
    """An answer that sees nothing."""
    return np.zeros((1, n_cells, 85))


def test_a_picture_of_twice_the_size_is_halved_into_the_corner_on_grey():
    image = np.random.default_rng(0).integers(0, 256, (80, 192, 3), dtype=np.uint8)
    blob, scales = letterbox(image, INPUT_PX)
    # Bilinear sampling at half the size looks midway between two pixels: the mean of four.
    mean = image.astype(int).reshape(40, 2, 96, 2, 3).sum(axis=(1, 3)) / 4
    assert (blob.shape, blob.dtype) == ((1, 3, 64, 96), np.float32)
    np.testing.assert_array_equal(scales, [0.5, 0.5])
    assert np.abs(blob[0, :, :40] - mean.transpose(2, 0, 1)).max() <= 0.5
    assert (blob[0, :, 40:] == 114).all()


def test_channels_stay_in_order_and_values_unscaled():
    blob, _ = letterbox(np.full((64, 96, 3), (10, 20, 250), np.uint8), INPUT_PX)
    assert [set(np.unique(channel)) for channel in blob[0]] == [{10.0}, {20.0}, {250.0}]


@given(width=st.integers(1, 600), height=st.integers(1, 600))
def test_any_picture_fits_with_its_aspect_kept(width, height):
    image = np.zeros((height, width, 3), np.uint8)
    blob, scales = letterbox(image, INPUT_PX)
    reduced = np.array([width, height]) * scales
    ratio = min(96 / width, 64 / height)
    # Each side is cut to whole pixels, but to one at least.
    np.testing.assert_array_less(np.abs(reduced - np.array([width, height]) * ratio), 1.0 + 1e-9)
    black = (blob[0, 0] == 0).nonzero()
    assert (black[1].max() + 1, black[0].max() + 1) == tuple(reduced.round().astype(int))
    assert (blob == 0).sum() == 3 * round(reduced[0]) * round(reduced[1])


def test_cells_are_counted_row_by_row_from_the_finest_grid():
    corners, widths = cells(INPUT_PX)
    expected = [
        (x, y, stride)
        for stride in (8, 16, 32)
        for y in range(64 // stride)
        for x in range(96 // stride)
    ]
    np.testing.assert_array_equal(np.concatenate([corners, widths], axis=1), expected)


def test_a_row_means_what_the_definition_says():
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


def test_the_best_of_the_wanted_classes_counts():
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
def test_decoding_inverts_encoding(row, centre, size, scale):
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
def test_other_layouts_are_told(answer, said):
    problem = problem_with(answer, INPUT_PX)
    assert problem is not None
    assert re.search(said, problem)


def test_decoded_answers_are_told_from_raw_ones():
    output = silent_answer()
    assert problem_with(output, INPUT_PX) is None
    output[..., 2:4] = 40.0  # a box of 40 px, where its logarithm belongs
    assert "decoded already" in (problem_with(output, INPUT_PX) or "")
