"""Scores on held-out clips during training."""

from collections.abc import Sequence

import numpy as np

from gmrdata.clip import Clip
from gmrdata.evaluate.metrics import orientation_errors_deg, translation_errors_mm
from gmrdata.gmr.config import WindowConfig
from gmrdata.gmr.infer import TrainedGmr, predict_deltas
from gmrdata.gmr.model import Gmr
from gmrdata.gmr.motion_deltas import deltas
from gmrdata.gmr.runs import runs_at


def held_out_scores(model: Gmr, clips: Sequence[Clip], config: WindowConfig) -> dict[str, float]:
    """OME and TME over all motions of some clips (eqs. 15, 16), with true local poses.

    Returns:
        `held_out_ome_deg` and `held_out_tme_mm`.
    """
    gmr = TrainedGmr(model.eval(), config.fps_hz, "(in training)", 0)
    angles_deg, lengths_mm = [], []
    for clip in clips:
        for run in runs_at(clip, config.fps_hz, all_phases=False):
            predicted_rotmats, predicted_m = predict_deltas(gmr, run.motion.local_rotmats)
            true_rotmats, true_m = deltas(run.motion.root_rotmats, run.motion.pelvis_m)
            angles_deg.append(orientation_errors_deg(predicted_rotmats, true_rotmats))
            lengths_mm.append(translation_errors_mm(predicted_m, true_m))
    return {
        "held_out_ome_deg": float(np.concatenate(angles_deg).mean()),
        "held_out_tme_mm": float(np.concatenate(lengths_mm).mean()),
    }
