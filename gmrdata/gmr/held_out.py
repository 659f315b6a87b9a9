"""Scores on held-out clips during training."""

from collections.abc import Sequence

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip
from gmrdata.errors import BadManifest
from gmrdata.evaluate.metrics import orientation_errors_deg, translation_errors_mm
from gmrdata.gmr.infer import TrainedGmr, predict_deltas
from gmrdata.gmr.model import Gmr
from gmrdata.gmr.motion_deltas import deltas
from gmrdata.gmr.runs import Run, runs_at
from gmrdata.gmr.usable import fitting_clips


def held_out_runs(clips: Sequence[Clip], body: BodyModel, fps_hz: float) -> list[Run]:
    """What to score: the runs of valid frames of the held-out clips, first phase.

    Raises:
        BadManifest: there are clips, but none with two valid frames in a row, or not of this body.
        BadMotionFile: a clip holds NaN, or has a lower frame rate.
    """
    if not clips:
        return []
    fitting = fitting_clips(clips, body)
    runs = [run for clip in fitting for run in runs_at(clip, fps_hz, all_phases=False)]
    if not runs:
        raise BadManifest(
            f"none of the {len(clips)} held-out clips has two valid frames in a row at {fps_hz:g}"
            " fps. Give others, or none"
        )
    return runs


def held_out_scores(model: Gmr, runs: Sequence[Run], fps_hz: float) -> dict[str, float]:
    """OME and TME over all motions of the runs (eqs. 15, 16), with true local poses.

    Returns:
        `held_out_ome_deg` and `held_out_tme_mm`.
    """
    gmr = TrainedGmr(model.eval(), fps_hz, "(in training)", 0)
    angles_deg, lengths_mm = [], []
    for run in runs:
        predicted_rotmats, predicted_m = predict_deltas(gmr, run.motion.local_rotmats)
        true_rotmats, true_m = deltas(run.motion.root_rotmats, run.motion.pelvis_m)
        angles_deg.append(orientation_errors_deg(predicted_rotmats, true_rotmats))
        lengths_mm.append(translation_errors_mm(predicted_m, true_m))
    return {
        "held_out_ome_deg": float(np.concatenate(angles_deg).mean()),
        "held_out_tme_mm": float(np.concatenate(lengths_mm).mean()),
    }
