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


def body_of(motion: Motion, bodies: Iterable[BodyModel]) -> BodyModel | None:
    """The body that a motion is of, all of whose shape it has; None where it is not among them."""
    return next((body for body in bodies if _has_shape(body, motion)), None)


def _has_shape(body: BodyModel, motion: Motion) -> bool:
    shape = motion.shape
    if body.name != motion.body or shape.ndim != 1:
        return False
    by_size = body.name.startswith(SMPL) and not shape[body.n_shape :].any()
    return len(shape) == body.n_shape or by_size


def on_body(motion: Motion, body: BodyModel) -> Motion:
    """A motion with as many coefficients as its body has; itself if it has them or another body."""
    if motion.shape.size == body.n_shape or body_of(motion, [body]) is None:
        return motion
    return replace(motion, shape=shape_on(body, motion.shape))


def sized(body: BodyModel, n_shape: int) -> BodyModel:
    """The same body with so many coefficients: the first, or more that change nothing."""
    if n_shape == body.n_shape:
        return body
    more = ((0, 0), (0, 0), (0, max(0, n_shape - body.n_shape)))
    return replace(
        body,
        shape_dirs_m=np.pad(body.shape_dirs_m[..., :n_shape], more),
        joint_shape_dirs_m=np.pad(body.joint_shape_dirs_m[..., :n_shape], more),
    )


def of_equal_size(bodies: Sequence[BodyModel]) -> tuple[BodyModel, ...]:
    """The same bodies with as many coefficients as the one that has most."""
    size = max(body.n_shape for body in bodies)
    return tuple(sized(body, size) for body in bodies)


def names_of(bodies: Iterable[BodyModel]) -> str:
    """Names of bodies, for records and messages."""
    return ", ".join(body.name for body in bodies)
