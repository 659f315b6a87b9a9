"""Which frames of a sequence follow each other: by their numbers, and where the picture cuts.

Cuts in words: a sequence that fails because of one should say so.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


def cuts_in_words(cuts_after_frames: Sequence[int] | np.ndarray) -> str:
    """The end of a message about a failure; empty where the picture never changes to another place.

    Args:
        cuts_after_frames: Rows after which it does.
    """
    if len(cuts_after_frames) == 0:
        return ""
    return (
        f"; the picture changes to another place {len(cuts_after_frames)} times, first after frame "
        f"{cuts_after_frames[0]}: cut the sequence there, or put its images in order"
    )


@dataclass(frozen=True, eq=False)
class Timeline:
    """When the T frames were taken, as far as their names and pictures tell."""

    image_numbers: np.ndarray
    """(T,) ascending; the numbers of left-out images are missing among them."""
    cuts: np.ndarray
    """(C,) rows t after which the picture changes to another place."""

    def near(self, rows: np.ndarray, max_gap_frames: int) -> np.ndarray:
        """(R-1,) bool: neighbours of R rows in order with no cut and no long gap between them."""
        short = np.diff(self.image_numbers[rows]) <= max_gap_frames + 1
        cuts_before = np.searchsorted(np.sort(self.cuts), rows)
        return np.asarray(short & (np.diff(cuts_before) == 0))
