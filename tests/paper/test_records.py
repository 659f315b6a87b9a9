"""The records of baselines: each key counts."""

from pathlib import Path
from typing import Any

import pytest

from gmrdata.paper.vibe_cam import VibeCamPredictions
from gmrdata.score.baselines import MeanPredictions, NetworkPredictions, Predictions
from gmrdata.score.camera_as_world import CameraPredictions
from tests.record_keys import assert_each_key_is_needed

CLIP = {"fps_hz": 20.0, "n_frames": 40, "n_valid": 36}
PLACED = {
    "median_residual_px": 1.5,
    "n_rows_with_several_people": 2,
    "not_predicted": [{"start": 3, "stop": 7, "reason": "no image"}],
}
MEAN = {
    "mean_rotvec_rad": (0.0, 0.1, 0.0),
    "mean_m": (0.0, 0.0, 0.1),
    "fps_hz": 10.0,
    "n_motions": 9,
}


@pytest.mark.parametrize(
    ("record", "figures", "of_clip"),
    [
        (Predictions, {}, {}),
        (MeanPredictions, MEAN, {}),
        (CameraPredictions, {"camera": "ignored"}, {}),
        (NetworkPredictions, {"run": "gmr"}, {}),
        (VibeCamPredictions, {}, PLACED),
    ],
)
def test_each_key_of_predictions_is_needed(
    record: type[Predictions], figures: dict[str, Any], of_clip: dict[str, Any], tmp_path: Path
) -> None:
    found = record.model_validate(
        {
            "method": "a baseline",
            "figures": figures,
            "clips": {"walk": CLIP | of_clip},
            "left_out": {"run": "no frame is valid"},
        }
    )
    assert_each_key_is_needed(found, tmp_path / "predictions.json", free=("left_out", "clips"))
