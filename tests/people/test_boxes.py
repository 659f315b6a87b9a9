"""Boxes: overlap, suppression, growth, and the pixels that they fill."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.people.boxes import (
    Detections,
    box_iou,
    detections_as_json,
    detections_from_json,
    fill_boxes,
    grow,
    keep_best,
)
from gmrdata.people.yolox import CATEGORY_NUMBERS, COCO_NAMES, class_indices

DOG, CAT = COCO_NAMES.index("dog"), COCO_NAMES.index("cat")


def found(*rows: tuple[float, float, float, float, float, int]) -> Detections:
    table = np.array(rows, dtype=np.float64).reshape(-1, 6)
    return Detections(table[:, :4], table[:, 4], table[:, 5].astype(np.int64))


def test_overlap_of_known_boxes() -> None:
    a = np.array([[0.0, 0.0, 4.0, 2.0], [5.0, 5.0, 5.0, 5.0]])
    b = np.array([[2.0, 0.0, 6.0, 2.0], [0.0, 0.0, 4.0, 2.0], [5.0, 5.0, 5.0, 5.0]])
    np.testing.assert_allclose(box_iou(a, b), [[4 / 12, 1.0, 0.0], [0.0, 0.0, 0.0]])


def test_the_weaker_of_two_boxes_of_one_class_goes() -> None:
    every = found(
        (0, 0, 10, 10, 0.5, DOG),
        (0, 0, 10, 11, 0.9, DOG),  # 10/11 with the first
        (0, 0, 10, 10, 0.4, CAT),
        (20, 0, 30, 10, 0.3, DOG),
    )
    kept = keep_best(every, 0.6)
    got = {(*box, score, k) for box, score, k in zip(
        map(tuple, kept.boxes_px.tolist()), kept.scores.tolist(), kept.classes.tolist(), strict=True
    )}  # fmt: skip
    assert {(score, k) for *_, score, k in got} == {(0.9, DOG), (0.4, CAT), (0.3, DOG)}
    assert len(keep_best(every, 0.95)) == 4
    assert len(keep_best(found(), 0.5)) == 0


def test_boxes_grow_by_their_shorter_side_and_a_margin() -> None:
    boxes_px = np.array([[10.0, 20.0, 30.0, 120.0]])
    np.testing.assert_allclose(grow(boxes_px, 0.1, 3), [[5.0, 15.0, 35.0, 125.0]])
    assert grow(np.zeros((0, 4)), 0.1, 3).shape == (0, 4)


@given(
    boxes=st.lists(
        st.tuples(*[st.floats(-20, 40) for _ in range(2)], *[st.floats(0, 30) for _ in range(2)]),
        max_size=4,
    )
)
def test_exactly_the_pixels_that_a_box_touches_are_filled(
    boxes: list[tuple[float, float, float, float]],
) -> None:
    boxes_px = np.array([(x, y, x + w, y + h) for x, y, w, h in boxes]).reshape(-1, 4)
    mask = fill_boxes(boxes_px, (12, 9))
    y, x = np.mgrid[:9, :12]
    expected = np.zeros((9, 12), dtype=bool)
    for left, top, right, bottom in boxes_px:
        expected |= (x + 1 > left) & (x < right) & (y + 1 > top) & (y < bottom)
    assert mask.dtype == np.uint8
    np.testing.assert_array_equal(mask > 0, expected)
    assert set(np.unique(mask)) <= {0, 255}


def test_detections_come_back_from_json() -> None:
    one = found((1.234567, 2, 3, 4, 0.876543, DOG))
    back = detections_from_json(detections_as_json(one))
    np.testing.assert_array_equal(back.boxes_px, [[1.23, 2, 3, 4]])
    np.testing.assert_array_equal(back.scores, [0.8765])
    assert detections_from_json(detections_as_json(found())).boxes_px.shape == (0, 4)


def test_coco_has_80_classes_with_its_category_numbers() -> None:
    assert (len(COCO_NAMES), len(set(COCO_NAMES)), len(CATEGORY_NUMBERS)) == (80, 80, 80)
    number = dict(zip(COCO_NAMES, CATEGORY_NUMBERS, strict=True))
    # Known from the data set's own annotation files.
    known = {"person": 1, "stop sign": 13, "dog": 18, "backpack": 27, "bottle": 44, "tv": 72}
    assert {name: number[name] for name in known} == known
    assert number["toothbrush"] == 90
    assert class_indices(("dog", "person", "dog")) == [0, 16]
