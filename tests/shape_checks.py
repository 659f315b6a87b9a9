"""Shape checks: arguments and results that are annotated with a shape are checked in tests.

Importing this module checks the packages' modules that are imported after it.
"""

from collections.abc import Callable
from typing import Any, TypeVar, get_args

import jaxtyping
from beartype import BeartypeConf, beartype
from jaxtyping import AbstractArray, install_import_hook, jaxtyped

OF_GMR = ("augmentation", "losses", "model", "predict", "soles", "windows")
"""Not rotations and supports: a training calls them thousands of times, at a cost of 40 %."""
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
    return beartype(function, conf=_CONF) if _has_shapes(function) else function


def _has_shapes(function: Any) -> bool:
    return any(map(_is_shape, function.__annotations__.values()))


def _is_shape(hint: Any) -> bool:
    is_array = isinstance(hint, type) and issubclass(hint, AbstractArray)
    return is_array or any(map(_is_shape, get_args(hint)))


def shaped_alone(*, typechecker: Any) -> Callable[[F], F]:
    """jaxtyping's decorator, for what has a shape: all else it would call in four steps."""
    return lambda made: jaxtyped(made, typechecker=typechecker) if _has_shapes(made) else made


jaxtyping.jaxtyped = shaped_alone
install_import_hook(PACKAGES, f"{__name__}.checked")
