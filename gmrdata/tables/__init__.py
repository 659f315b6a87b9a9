"""The paper's tables again."""

from typing import Literal

ScaleName = Literal["paper", "small"]
"""As the paper trains, or as a machine without a GPU can."""
