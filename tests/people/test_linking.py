"""Pieces of tracks: who is one person, and who took over."""

import numpy as np

from gmrdata.people.linking import LinkConfig, Piece, cuts_in, join_pieces, unsure_pairs

RED, BLUE = np.eye(2)
CONFIG = LinkConfig()


def piece(first: int, n: int, x_px: float, colours: np.ndarray = RED, side_px: float = 100.0):
    """Somebody who goes 2 px a frame to the right from `x_px`, seen from frame `first` on."""
    crops = [[x_px + 2 * i, 50.0, side_px, 0.0] for i in range(n)]
    return Piece(np.arange(first, first + n), np.array(crops), np.tile(colours, (n, 1)))


def together(*pieces: Piece) -> Piece:
    """Pieces as one."""
    return Piece(
        np.concatenate([one.rows for one in pieces]),
        np.concatenate([one.crops for one in pieces]),
        np.concatenate([one.colours for one in pieces]),
    )


def like_red(distance: float) -> np.ndarray:
    """Colours at a distance from red."""
    share = (1 - distance**2) ** 2
    return np.array([share, 1 - share])


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
    taken = together(piece(0, 20, 0.0), piece(20, 15, 40.0, BLUE), piece(35, 20, 70.0))
    assert cuts_in(taken, CONFIG) == [20, 35]
    assert cuts_in(piece(0, 20, 0.0), CONFIG) == []
    assert cuts_in(piece(0, 1, 0.0), CONFIG) == []


def test_place_size_and_time_count_with_the_colours() -> None:
    """Who turns in one place may change its colours; after a while, or elsewhere, it is unsure."""
    turned = like_red(0.31)
    assert cuts_in(together(piece(0, 20, 0.0), piece(20, 20, 40.0, turned)), CONFIG) == [20]
    before, after = piece(0, 20, 0.0), piece(20, 20, 40.0, turned)
    assert join_pieces([before, after], CONFIG) == [[0, 1]]
    late = piece(75, 20, 240.0, like_red(0.4))
    assert join_pieces([before, late], CONFIG) == [[0], [1]]
    assert unsure_pairs([before, late], CONFIG) == [(0, 1)]
    elsewhere = piece(20, 20, 240.0, turned)
    assert join_pieces([before, elsewhere], CONFIG) == [[0], [1]]
    assert unsure_pairs([before, elsewhere], CONFIG) == [(0, 1)]


def test_who_is_seen_together_or_in_other_colours_is_surely_two() -> None:
    assert unsure_pairs([piece(0, 20, 0.0), piece(19, 20, 400.0)], CONFIG) == []
    assert unsure_pairs([piece(0, 20, 0.0), piece(30, 20, 60.0, BLUE)], CONFIG) == []
    assert unsure_pairs([piece(0, 20, 0.0), piece(300, 20, 60.0)], CONFIG) == [(0, 1)]
