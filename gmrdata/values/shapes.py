"""Shapes of arrays in annotations: `Float[np.ndarray, "frames 23 3 3"]`, as jaxtyping writes them.

Letters and words stand for lengths that a call's arrays share; `*batch` for any number of them.
The tests check them (`tests/shape_checks.py`).  Elsewhere such an annotation is the plain array
type, and jaxtyping is neither loaded nor needed.
"""

import sys
from typing import TYPE_CHECKING, Any

__all__ = ["Bool", "Float", "Int"]

if TYPE_CHECKING or "jaxtyping" in sys.modules:
    from jaxtyping import Bool, Float, Int
else:

    class Float:
        """The plain array type of an annotation."""

        def __class_getitem__(cls, item: tuple[type, str]) -> Any:
            return item[0]

    Bool = Int = Float
