"""Joining boxes over time: a person missed in one frame is masked there all the same."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.people.boxes import Detections, TrackConfig, link, track

CONFIG = TrackConfig(link_iou=0.3, max_gap_frames=2, hold_frames=0)
NO_BOX: list[tuple[float, float]] = []


def frames_of(*frames: list[tuple[float, float]]) -> list[Detections]:
    """Frames of (left edge, score): boxes 10 px wide and high."""
    made = []
    for boxes in frames:
        boxes_px = np.array([(x, 0.0, x + 10.0, 10.0) for x, _ in boxes]).reshape(-1, 4)
        scores = np.array([score for _, score in boxes])
        made.append(Detections(boxes_px, scores, np.zeros(len(boxes), dtype=np.int64)))
    return made


def lefts(boxes_px: np.ndarray) -> list[float]:
    return [float(left) for left in boxes_px[:, 0]]


def test_a_missed_frame_gets_a_box_halfway() -> None:
    made = track(frames_of([(0, 0.9)], NO_BOX, [(4, 0.9)]), 0.5, CONFIG)
    np.testing.assert_allclose(made[1].filled_px, [[2, 0, 12, 10]])
    assert [frame.rows.tolist() for frame in made] == [[0], [], [0]]


def test_a_gap_is_filled_in_proportion_to_time_up_to_the_limit() -> None:
    made = track(frames_of([(0, 0.9)], NO_BOX, NO_BOX, [(3, 0.9)]), 0.5, CONFIG)
    assert [lefts(frame.filled_px) for frame in made] == [[], [1.0], [2.0], []]
    long = track(frames_of([(0, 0.9)], NO_BOX, NO_BOX, NO_BOX, [(3, 0.9)]), 0.5, CONFIG)
    assert [lefts(frame.filled_px) for frame in long] == [[]] * 5


def test_a_weak_box_counts_only_in_a_track_that_is_sure_elsewhere() -> None:
    made = track(frames_of([(0, 0.2), (50, 0.2)], [(1, 0.6), (50, 0.3)]), 0.5, CONFIG)
    assert [frame.rows.tolist() for frame in made] == [[0], [0]]


def test_the_first_and_last_box_are_held() -> None:
    held = CONFIG.model_copy(update={"hold_frames": 1})
    made = track(frames_of(NO_BOX, NO_BOX, [(0, 0.9)], [(1, 0.9)], NO_BOX, NO_BOX), 0.5, held)
    assert [lefts(frame.filled_px) for frame in made] == [[], [0.0], [], [], [1.0], []]


def test_two_people_who_pass_keep_their_tracks() -> None:
    frames = frames_of([(0, 0.9), (6, 0.9)], [(7, 0.9), (1, 0.9)])
    assert sorted(link(frames, CONFIG)) == [[(0, 0), (1, 1)], [(0, 1), (1, 0)]]


def test_nothing_found_is_nothing_masked() -> None:
    made = track(frames_of(NO_BOX, NO_BOX), 0.5, TrackConfig())
    assert [(len(frame.rows), frame.filled_px.shape) for frame in made] == [(0, (0, 4))] * 2


boxes = st.lists(st.tuples(st.integers(0, 60), st.floats(0.1, 1.0)), max_size=4)


@given(frames=st.lists(boxes, min_size=1, max_size=8), gap=st.integers(0, 3))
def test_every_box_is_in_one_track_and_tracks_obey_the_limits(
    frames: list[list[tuple[float, float]]], gap: int
) -> None:
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


@pytest.mark.parametrize("bad", [{"link_iou": 0}, {"max_gap_frames": -1}, {"hold": 1}])
def test_wrong_settings_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(bad))):
        TrackConfig.model_validate(bad)
