"""The paper's tables again."""

from typing import Literal

ScaleName = Literal["paper", "small"]  # as the paper trains, or as a machine without a GPU can
VIBE = "VIBE"
"""Who estimates poses in the paper, and in the names of its rows."""
