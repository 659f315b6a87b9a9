"""The paper's tables again."""

from typing import Literal

ScaleName = Literal["paper", "small"]  # as the paper trains, or as a machine without a GPU can
