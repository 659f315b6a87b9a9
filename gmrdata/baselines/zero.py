"""Stage: the person does not move."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from gmrdata.baselines.predictions import (
    Prediction,
    Subject,
    first_pose,
    manifest_subjects,
    predicted,
    write_predictions,
)
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.records import Config


class ZeroConfig(Config):
    """No motion at all; there is nothing to choose."""


def predict_zero(manifest_path: Path, out_dir: Path, *, run: Run = DEFAULT_RUN) -> Path:
    """Predict that everybody stays in the pose of the first valid frame, local pose as it is.

    Args:
        manifest_path: The clips.
        out_dir: Folder to make; see `gmrdata.baselines.predictions`.

    Returns:
        `out_dir`.

    Raises:
        GmrdataError: as `manifest_subjects` and `first_pose`.
    """

    def work(partial_dir: Path) -> None:
        subjects, skipped = manifest_subjects(manifest_path)
        write_predictions(partial_dir, "zero", [at_rest(one) for one in subjects], skipped)

    inputs = {"manifest": manifest_path}
    return run_stage("baseline-zero", out_dir, ZeroConfig(), inputs, work, run=run)


def at_rest(subject: Subject) -> Prediction:
    """A subject that stays where it is."""
    root_rotmat, pelvis_m = first_pose(subject.clip)
    n = subject.clip.motion.n_frames
    motion = replace(
        subject.clip.motion,
        root_rotmats=np.tile(root_rotmat, (n, 1, 1)),
        pelvis_m=np.tile(pelvis_m, (n, 1)),
        frame="world",
        source=f"zero motion, local pose of: {subject.clip.motion.source}",
    )
    return predicted(subject, motion, subject.clip.valid)
