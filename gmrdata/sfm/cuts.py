"""Cuts in words: a sequence that fails because of one should say so."""

from collections.abc import Sequence

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
