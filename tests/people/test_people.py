"""Pieces of tracks: who is one person, and who took over."""

import numpy as np

from gmrdata.people.linking import LinkConfig, Sighting, cuts_in, join_pieces

RED, BLUE = np.eye(2)
CONFIG = LinkConfig()


def piece(first: int, n: int, x_px: float, colours: np.ndarray = RED, side_px: float = 100.0):
    """Somebody who goes 2 px a frame to the right from `x_px`, seen from frame `first` on."""
    return [
        Sighting(first + i, np.array([x_px + 2 * i, 50.0, side_px, 0.0]), colours) for i in range(n)
    ]


def test_who_is_found_again_where_it_went_is_one_person() -> None:
    pieces = [piece(0, 20, 0.0), piece(30, 20, 60.0), piece(0, 50, 400.0)]
    assert join_pieces(pieces, CONFIG) == [[0, 1], [2]]


def test_another_in_the_same_place_is_somebody_else() -> None:
    assert join_pieces([piece(0, 20, 0.0), piece(30, 20, 60.0, BLUE)], CONFIG) == [[0], [1]]


def test_who_is_twice_as_large_is_somebody_else() -> None:
    pieces = [piece(0, 20, 0.0), piece(30, 20, 60.0, side_px=200.0)]
    assert join_pieces(pieces, CONFIG) == [[0], [1]]


def test_a_gap_may_be_too_long() -> None:
    late = 20 + CONFIG.max_gap_frames
    pieces = [piece(0, 20, 0.0), piece(late, 5, 2.0 * late), piece(late + 1, 5, 2.0 * late + 2)]
    assert join_pieces(pieces, CONFIG) == [[0, 1], [2]]


def test_at_one_time_nobody_is_two() -> None:
    assert join_pieces([piece(0, 20, 0.0), piece(10, 20, 20.0)], CONFIG) == [[0], [1]]


def test_two_who_cross_are_told_by_their_colours() -> None:
    """Both are lost at one place and found again at one place."""
    pieces = [
        piece(0, 20, 0.0),
        piece(0, 20, 0.0, BLUE),
        piece(30, 9, 60.0, BLUE),
        piece(30, 9, 60.0),
    ]
    assert join_pieces(pieces, CONFIG) == [[0, 3], [1, 2]]


def test_a_track_is_cut_where_another_takes_over() -> None:
    taken = piece(0, 20, 0.0) + piece(20, 15, 40.0, BLUE) + piece(35, 20, 70.0)
    assert cuts_in(taken, CONFIG) == [20, 35]
    assert cuts_in(piece(0, 20, 0.0), CONFIG) == []
    assert cuts_in(piece(0, 1, 0.0), CONFIG) == []
