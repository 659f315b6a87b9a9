"""Which pieces of tracks are of one person: cut where another takes over, joined across gaps.

Who walks past another may take over its track; the colours change then.  Two pieces fit if the
later begins where the earlier would be by then, as large, and in the same colours.  Best pairs are
joined first, each end once.
"""

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from pydantic import Field

from gmrdata.values.records import Config


class LinkConfig(Config):
    """How far apart two pieces of one person may be."""

    max_gap_frames: int = Field(default=60, ge=1)
    """Most frames without the person between them."""
    max_shift: float = Field(default=0.6, gt=0)
    """Largest distance from where the person would have gone, in the side of its crop; it grows
    with the gap, by the same in `shift_frames`."""
    shift_frames: int = Field(default=30, ge=1)
    max_size_ratio: float = Field(default=1.5, gt=1)
    """Largest ratio of the two sizes."""
    max_colour_distance: float = Field(default=0.3, gt=0, le=1)
    """Largest distance of the colours, after Bhattacharyya: 0 alike, 1 none in common."""


@dataclass(frozen=True, eq=False)
class Sighting:
    """A person in one frame."""

    row: int  # of the frame
    crop: np.ndarray  # (4,) centre x and y, side [px], turn [rad]
    colours: np.ndarray  # (C,) shares, which sum to 1


def cuts_in(piece: list[Sighting], config: LinkConfig) -> list[int]:
    """Where in a piece another person takes over, by the colours before and after."""
    off = [
        _colour_distance(piece[max(0, at - COLOUR_FRAMES) : at], piece[at : at + COLOUR_FRAMES])
        for at in range(LEAST_FRAMES, len(piece) - LEAST_FRAMES + 1)
    ]
    if not off or max(off) <= config.max_colour_distance:
        return []
    at = LEAST_FRAMES + int(np.argmax(off))
    return [*cuts_in(piece[:at], config), at, *(at + n for n in cuts_in(piece[at:], config))]


def join_pieces(pieces: list[list[Sighting]], config: LinkConfig) -> list[list[int]]:
    """People as numbers of pieces in order of time; every piece is of one of them."""
    pairs = [
        (cost, a, b)
        for a, b in permutations(range(len(pieces)), 2)
        if (cost := _cost(pieces[a], pieces[b], config)) is not None
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


def _cost(a: list[Sighting], b: list[Sighting], config: LinkConfig) -> float | None:
    """How ill the second piece goes on from the first; None where it can't."""
    last, first = a[-1], b[0]
    gap = first.row - last.row
    if not 0 < gap <= config.max_gap_frames + 1:
        return None
    side_px = float(np.sqrt(last.crop[2] * first.crop[2]))
    moved_px = np.linalg.norm(first.crop[:2] - last.crop[:2] - gap * _speed_px(a))
    stayed_px = np.linalg.norm(first.crop[:2] - last.crop[:2])
    shift = float(min(moved_px, stayed_px)) / side_px / (1 + gap / config.shift_frames)
    size = float(abs(np.log(first.crop[2] / last.crop[2])) / np.log(config.max_size_ratio))
    colour = _colour_distance(a[-COLOUR_FRAMES:], b[:COLOUR_FRAMES]) / config.max_colour_distance
    worst = max(shift / config.max_shift, size, colour)
    return worst if worst <= 1 else None


COLOUR_FRAMES, SPEED_FRAMES, LEAST_FRAMES = 8, 5, 3


def _speed_px(piece: list[Sighting]) -> np.ndarray:
    """(2,) of a piece's end [px a frame]."""
    early, late = piece[-min(len(piece), SPEED_FRAMES)], piece[-1]
    return np.asarray((late.crop[:2] - early.crop[:2]) / max(1, late.row - early.row))


def _colour_distance(a: list[Sighting], b: list[Sighting]) -> float:
    means = [np.mean([one.colours for one in piece], axis=0) for piece in (a, b)]
    return float(np.sqrt(max(0.0, 1.0 - np.sqrt(means[0] * means[1]).sum())))
