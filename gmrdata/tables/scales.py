"""Names of the sizes at which tables are made; apart, so that the command line loads no recipe."""

from typing import Literal

ScaleName = Literal["paper", "small"]
"""As the paper trains, or as a machine without a GPU can."""
