"""Which pieces of tracks are of one person: all that is seen speaks for or against it together.

Where the second piece begins where the first would be by then, as large, and in the same colours,
each counts by how much likelier it is of one person than of two (a sum of logarithms of ratios), so
that a dancer whose colours change while it stands in one place is still one.  A track is cut where
its colours change, since who walks past another may take it over; what goes on is then joined to
whom it fits best.
"""

from dataclasses import dataclass
from itertools import combinations, permutations
from typing import Self

import numpy as np
from pydantic import Field

from gmrdata.values.records import Config


class LinkConfig(Config):
    """How alike two pieces of one person are."""

    max_gap_frames: int = Field(default=60, ge=1)
    """Most frames without the person between them."""
    shift: float = Field(default=0.2, gt=0)
    """Usual distance from where the person would have gone, in the side of its crop; it grows with
    the gap, by the same in `shift_frames`."""
    shift_frames: int = Field(default=30, ge=1)
    size: float = Field(default=0.16, gt=0)
    """Usual difference of the two sizes' logarithms."""
    colour: float = Field(default=0.15, gt=0, le=1)
    """Usual distance of the colours, after Bhattacharyya: 0 alike, 1 none in common."""
    cut_colour: float = Field(default=0.3, gt=0, le=1)
    """Distance of the colours before and after, from which another may have taken over a track."""
    sure: float = Field(default=3.0, ge=0)
    """Evidence against one person, from which those never seen together are two: e^3 to one."""


STRANGERS_SIDES = 3.0  # of a crop: within so much another person may be anywhere
STRANGERS_SIZE = 0.5  # usual difference of the logarithms of two people's sizes
STRANGERS_COLOUR, STRANGERS_SPREAD = 0.55, 0.2  # mean distance of two people's colours
LOOK_ALIKES = 0.2  # share of strangers who wear the same
COLOUR_FRAMES, SPEED_FRAMES, LEAST_FRAMES = 8, 5, 3


@dataclass(frozen=True, eq=False)
class Piece:
    """A person over T frames in which it was followed."""

    rows: np.ndarray  # (T,) int, rising: of the frames
    crops: np.ndarray  # (T, 4) centre x and y, side [px], turn [rad]
    colours: np.ndarray  # (T, C) shares, which sum to 1

    def __len__(self) -> int:
        return len(self.rows)

    def part(self, start: int, stop: int | None = None) -> Self:
        """Some frames of it."""
        some = slice(start, stop)
        return type(self)(self.rows[some], self.crops[some], self.colours[some])


def cuts_in(piece: Piece, config: LinkConfig) -> list[int]:
    """Where in a piece another person may have taken over, by the colours before and after."""
    off = [
        _colour_distance(piece.part(0, at), piece.part(at))
        for at in range(LEAST_FRAMES, len(piece) - LEAST_FRAMES + 1)
    ]
    if not off or max(off) <= config.cut_colour:
        return []
    at = LEAST_FRAMES + int(np.argmax(off))
    before, after = cuts_in(piece.part(0, at), config), cuts_in(piece.part(at), config)
    return [*before, at, *(at + n for n in after)]


def join_pieces(pieces: list[Piece], config: LinkConfig) -> list[list[int]]:
    """People as numbers of pieces in order of time, every piece once; best pairs are joined first,
    each end once."""
    pairs = [
        (-evidence, a, b)
        for a, b in permutations(range(len(pieces)), 2)
        if (evidence := _evidence(pieces[a], pieces[b], config)) > 0
    ]
    after: dict[int, int] = {}
    for _, a, b in sorted(pairs):
        if a not in after and b not in after.values():
            after[a] = b
    people = []
    for start in range(len(pieces)):
        if start not in after.values():
            line = [start]
            while line[-1] in after:
                line.append(after[line[-1]])
            people.append(line)
    return people


def unsure_pairs(people: list[Piece], config: LinkConfig) -> list[tuple[int, int]]:
    """Pairs of people who are never seen in one frame, and whose colours don't tell them apart."""
    return [
        (a, b)
        for a, b in combinations(range(len(people)), 2)
        if not np.isin(people[a].rows, people[b].rows).any()
        and _colour_evidence(_mean_distance(people[a], people[b]), config) > -config.sure
    ]


def _evidence(a: Piece, b: Piece, config: LinkConfig) -> float:
    """Logarithm of how much likelier the second piece goes on from the first than is another's."""
    gap = int(b.rows[0] - a.rows[-1])
    if not 0 < gap <= config.max_gap_frames + 1:
        return -np.inf
    last, first = a.crops[-1], b.crops[0]
    stayed_px = first[:2] - last[:2]
    moved_px = stayed_px - gap * _speed_px(a)
    off_px = min(np.linalg.norm(stayed_px), np.linalg.norm(moved_px))
    shift = float(off_px / np.sqrt(last[2] * first[2]))
    usual = config.shift * (1 + gap / config.shift_frames)
    place = np.log(STRANGERS_SIDES**2 / (2 * np.pi * usual**2)) - 0.5 * (shift / usual) ** 2
    grown = float(np.log(first[2] / last[2]))
    size = np.log(STRANGERS_SIZE / config.size)
    size += 0.5 * grown**2 * (STRANGERS_SIZE**-2 - config.size**-2)
    return float(place + size + _colour_evidence(_colour_distance(a, b), config))


def _colour_evidence(distance: float, config: LinkConfig) -> float:
    """The same of the colours alone."""
    of_one = np.log(2) + _log_normal(distance, 0.0, config.colour)
    of_two = _log_normal(distance, STRANGERS_COLOUR, STRANGERS_SPREAD)
    alike, unlike = np.log(LOOK_ALIKES) + of_one, np.log(1 - LOOK_ALIKES) + of_two
    return float(of_one - np.logaddexp(alike, unlike))


def _log_normal(value: float, mean: float, deviation: float) -> float:
    return float(-0.5 * ((value - mean) / deviation) ** 2 - np.log(deviation * np.sqrt(2 * np.pi)))


def _speed_px(piece: Piece) -> np.ndarray:
    """(2,) of a piece's end [px a frame]."""
    early = -min(len(piece), SPEED_FRAMES)
    steps = max(1, piece.rows[-1] - piece.rows[early])
    return np.asarray((piece.crops[-1, :2] - piece.crops[early, :2]) / steps)


def _colour_distance(before: Piece, after: Piece) -> float:
    """Of the end of one piece and the begin of another."""
    return _mean_distance(before.part(-COLOUR_FRAMES), after.part(0, COLOUR_FRAMES))


def _mean_distance(a: Piece, b: Piece) -> float:
    both = np.sqrt(a.colours.mean(axis=0) * b.colours.mean(axis=0)).sum()
    return float(np.sqrt(max(0.0, 1.0 - both)))
