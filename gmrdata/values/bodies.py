"""Several bodies at once: which of them a motion is of, and its shape on that body.

SMPL's shape coefficients come by size, so files with 10, 16 or 300 of them are of one space: fewer
are the same shape with zeros behind them.  Those of any other body must be as many as the body has.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from gmrdata.values.body import BodyModel
from gmrdata.values.motion import Motion

SMPL = "smpl-"
"""What the names of SMPL's bodies begin with; the gender follows."""


def shape_on(body: BodyModel, betas: np.ndarray) -> np.ndarray:
    """(S,) SMPL's coefficients, as many as the body has: cut, or zeros behind them."""
    shape = np.zeros(body.n_shape)
    kept = np.asarray(betas, dtype=np.float64)[: body.n_shape]
    shape[: len(kept)] = kept
    return shape


def takes_shape(body: BodyModel, name: str, n_shape: int) -> bool:
    """Whether so many coefficients of a body of that name are a shape of this body, uncut."""
    if body.name != name:
        return False
    return n_shape == body.n_shape or (name.startswith(SMPL) and n_shape < body.n_shape)


def body_of(motion: Motion, bodies: Iterable[BodyModel]) -> BodyModel | None:
    """The body that a motion is of; None where it is not among them."""
    fitting = (body for body in bodies if takes_shape(body, motion.body, motion.shape.size))
    return next(fitting, None) if motion.shape.ndim == 1 else None


def on_body(motion: Motion, body: BodyModel) -> Motion:
    """A motion of a body, with as many coefficients as the body has; itself if it has them."""
    if motion.shape.size == body.n_shape:
        return motion
    return replace(motion, shape=shape_on(body, motion.shape))


def of_equal_size(bodies: Sequence[BodyModel]) -> tuple[BodyModel, ...]:
    """The same bodies with as many coefficients as the one that has most; more change nothing."""
    size = max(body.n_shape for body in bodies)
    return tuple(body if body.n_shape == size else _grown(body, size) for body in bodies)


def names_of(bodies: Iterable[BodyModel]) -> str:
    """Names of bodies, for records and messages."""
    return ", ".join(body.name for body in bodies)


def _grown(body: BodyModel, size: int) -> BodyModel:
    more = ((0, 0), (0, 0), (0, size - body.n_shape))
    return replace(
        body,
        shape_dirs_m=np.pad(body.shape_dirs_m, more),
        joint_shape_dirs_m=np.pad(body.joint_shape_dirs_m, more),
    )
