"""Shape checks: arguments and results that are annotated with a shape are checked in tests.

Importing this module checks the packages' modules that are imported after it.
"""

from collections.abc import Callable
from typing import Any, TypeVar, get_args

from beartype import BeartypeConf, beartype
from jaxtyping import AbstractArray, install_import_hook

OF_GMR = ("augmentation", "inputs", "losses", "model", "predict", "windows")
"""Not rotations and vertex_loss: a training calls them thousands of times, at a cost of 40 %."""
PACKAGES = (
    "gmrdata.values",
    "gmrdata.world",
    "gmrdata.score",
    *(f"gmrdata.gmr.{module}" for module in OF_GMR),
)
F = TypeVar("F", bound=Callable[..., object])
# An int where a float is asked for is right, as it is for mypy.
_CONF = BeartypeConf(is_pep484_tower=True)


def checked(function: F) -> F:
    """The function with checks, where it has a shape to check."""
    hints = function.__annotations__.values()
    return beartype(function, conf=_CONF) if any(map(_has_shape, hints)) else function


def _has_shape(hint: Any) -> bool:
    is_array = isinstance(hint, type) and issubclass(hint, AbstractArray)
    return is_array or any(map(_has_shape, get_args(hint)))


install_import_hook(PACKAGES, f"{__name__}.checked")
