"""A prediction beside its truth: what is scored, whoever predicted it."""

from dataclasses import dataclass, replace

import numpy as np

from gmrdata.motion.motion import Motion


@dataclass(frozen=True, eq=False)
class PredictedRun:
    """A person over consecutive frames without a gap: the truth and a prediction of it."""

    true: Motion
    """The truth, in its world."""
    predicted: Motion
    """The same frames at the same rate, in a world of the prediction's own."""


World = tuple[PredictedRun, ...]
"""Runs, in the order of time, whose predictions share one world."""


@dataclass(frozen=True, eq=False)
class PredictedClip:
    """A clip's predictions."""

    clip_id: str
    """The clip."""
    camera_motion: str
    """Class of its camera's motion; "none" without a camera."""
    motion_type: str | None
    """What the person does, where that is on record."""
    runs: tuple[PredictedRun, ...]
    """For OME, TME, VME and the vertex error over time, at their rate."""
    worlds: tuple[World, ...]
    """For a protocol, at the prediction's own rate."""
    dropped_frames: int = 0
    """Valid frames, at the prediction's rate, for which there is no prediction."""


def still_run(run: PredictedRun, first: Motion | None = None) -> PredictedRun:
    """The same run with zero motion: the body stays at the true first root and pelvis.

    Args:
        run: The run.
        first: The motion in whose first frame it stays; None for the run's own.
    """
    where, n = run.true if first is None else first, run.true.n_frames
    still = replace(
        run.true,
        root_rotmats=np.tile(where.root_rotmats[0], (n, 1, 1)),
        pelvis_m=np.tile(where.pelvis_m[0], (n, 1)),
    )
    return PredictedRun(run.true, still)
