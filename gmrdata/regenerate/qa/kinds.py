"""The reasons for which frames are dropped, by kind: those that differ in a number are of one."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

COLOURS = ("#e69f00", "#56b4e9", "#cc79a7", "#d55e00", "#0072b2", "#c9b800", "#8a6d3b")
"""Colour-blind readers tell these apart (Okabe and Ito 2008), on white and on black."""
OTHER = "#8f979e"
"""The colour of all further kinds."""


@dataclass(frozen=True)
class Kind:
    """One kind of reason."""

    words: str
    """The reason; "…" for the number in which several differ."""
    colour: str
    """Its colour."""


def kinds_of(reasons: Sequence[Sequence[str]]) -> dict[str, Kind]:
    """The kind of each reason that occurs, in the order in which they do.

    Args:
        reasons: (P, T) why each frame is dropped; empty where it is kept.
    """
    found = list(dict.fromkeys(reason for person in reasons for reason in person if reason))
    groups: dict[str, list[str]] = {}
    for reason in found:
        groups.setdefault(re.sub(r"[0-9]+", "…", reason), []).append(reason)
    kinds: dict[str, Kind] = {}
    for number, (pattern, members) in enumerate(groups.items()):
        colour = COLOURS[number] if number < len(COLOURS) else OTHER
        kind = Kind(members[0] if len(members) == 1 else pattern, colour)
        kinds |= dict.fromkeys(members, kind)
    return kinds


def counts_of(reasons: Sequence[Sequence[str]], kinds: Mapping[str, Kind]) -> dict[Kind, int]:
    """How many frames of all people are dropped for each kind, the most frequent first."""
    counts = Counter(kinds[reason] for person in reasons for reason in person if reason)
    return dict(counts.most_common())


def example_frames(reasons: Sequence[Sequence[str]], kinds: Mapping[str, Kind]) -> dict[Kind, int]:
    """For each kind the middle one of the frames that are dropped for it, of whoever comes first.

    Args:
        reasons: (P, T) why each frame is dropped; empty where it is kept.
        kinds: Their kinds.
    """
    frames: dict[Kind, list[int]] = {}
    for person in reasons:
        earlier = set(frames)
        for frame, reason in enumerate(person):
            if reason and kinds[reason] not in earlier:
                frames.setdefault(kinds[reason], []).append(frame)
    return {kind: of_kind[len(of_kind) // 2] for kind, of_kind in frames.items()}
