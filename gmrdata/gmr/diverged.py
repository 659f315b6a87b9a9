"""Stop a training before a step without finite loss or gradient touches the weights."""

import math
from collections.abc import Mapping
from pathlib import Path

from gmrdata.errors import TrainingDiverged
from gmrdata.gmr.kept_steps import latest_checkpoint


def check_finite(values: Mapping[str, float], run_dir: Path, step: int) -> None:
    """Refuse a step whose figures are not all finite.

    Args:
        values: Figures of the step, `loss` and `gradient_norm` among them.
        run_dir: The run's folder, whose last checkpoint the message names.
        step: The step, counted from 1.

    Raises:
        TrainingDiverged: one is infinite or NaN.
    """
    if all(math.isfinite(value) for value in values.values()):
        return
    kept = latest_checkpoint(run_dir)
    raise TrainingDiverged(
        f"{run_dir}: in step {step} the loss is {values['loss']:g} and its gradient has length"
        f" {values['gradient_norm']:g}. The last good checkpoint: {kept.name if kept else 'none'}."
        " Lower learning_rate, or set gradient_norm"
    )
