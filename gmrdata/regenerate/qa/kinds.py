"""The reasons for which frames are dropped, by kind: those that differ in a number are of one."""

import re
from collections.abc import Sequence
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
    kinds = {}
    for number, (pattern, members) in enumerate(groups.items()):
        colour = COLOURS[number] if number < len(COLOURS) else OTHER
        kind = Kind(members[0] if len(members) == 1 else pattern, colour)
        kinds |= dict.fromkeys(members, kind)
    return kinds
