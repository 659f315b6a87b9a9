"""Predictions of a trained network for a clip."""

from dataclasses import replace
from typing import TYPE_CHECKING

from gmrdata.evaluate.predicted import PredictedClip, PredictedRun
from gmrdata.gmr.motion_deltas import accumulate
from gmrdata.gmr.runs import Run, runs_at
from gmrdata.gmr.usable import UsableClip

if TYPE_CHECKING:
    from gmrdata.gmr.infer import TrainedGmr


def network_clip(
    gmr: "TrainedGmr", one: UsableClip, *, all_phases: bool, motion_type: str | None = None
) -> PredictedClip | None:
    """What a network sees in a clip's local poses; None where no two valid frames are in a row.

    Each run of valid frames is a sequence, and a world, of its own: motions are accumulated
    (eqs. 3-4) from the run's true first pose.

    Args:
        gmr: The network.
        one: The clip.
        all_phases: As for `runs_at`.
        motion_type: What the person does.

    Raises:
        BadMotionFile: as `runs_at` does.
    """
    runs = tuple(
        _predicted(gmr, run) for run in runs_at(one.clip, gmr.fps_hz, all_phases=all_phases)
    )
    if not runs:
        return None
    worlds = tuple((run,) for run in runs)
    return PredictedClip(one.clip.id, one.camera_motion, motion_type, runs, worlds)


def _predicted(gmr: "TrainedGmr", run: Run) -> PredictedRun:
    from gmrdata.gmr.infer import predict_deltas

    true = run.motion
    delta_rotmats, delta_m = predict_deltas(gmr, true.local_rotmats)
    root_rotmats, pelvis_m = accumulate(
        delta_rotmats, delta_m, true.root_rotmats[0], true.pelvis_m[0]
    )
    return PredictedRun(true, replace(true, root_rotmats=root_rotmats, pelvis_m=pelvis_m))
