"""Errors of each clip, by whoever predicts its motion."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gmrdata.body.model import BodyModel
from gmrdata.errors import BadMotionFile
from gmrdata.evaluate.clip_errors import ClipErrors, clip_errors
from gmrdata.evaluate.from_files import file_clip, missing_file
from gmrdata.evaluate.from_network import network_clip
from gmrdata.evaluate.predicted import PredictedClip
from gmrdata.evaluate.protocol_names import ProtocolName
from gmrdata.evaluate.protocols import PROTOCOLS
from gmrdata.evaluate.score_config import ScoreConfig
from gmrdata.gmr.usable import UsableClip
from gmrdata.progress import track

if TYPE_CHECKING:
    from gmrdata.gmr.infer import TrainedGmr

Predict = Callable[[UsableClip], PredictedClip | str]
"""A prediction of a clip, or the reason why there is none."""


def score_clips(
    predict: Predict,
    body: BodyModel,
    clips: Sequence[UsableClip],
    protocol: ProtocolName | None = None,
    predicted_body: BodyModel | None = None,
) -> tuple[list[ClipErrors], dict[str, str]]:
    """Errors of each clip.

    Args:
        predict: Gives a clip's prediction, or the reason why there is none.
        body: The clips' body.
        clips: What to score.
        protocol: What to measure beside OME, TME and VME.
        predicted_body: The predictions' body; None for the clips' own.

    Returns:
        Errors of those clips that have a prediction, and the reason by id of those that have none.

    Raises:
        BadMotionFile: a prediction is of another body.
    """
    chosen = None if protocol is None else PROTOCOLS[protocol]
    scored, skipped = [], {}
    for one in track(clips, "scoring", total=len(clips)):
        predicted = predict(one)
        if isinstance(predicted, str):
            skipped[one.clip.id] = predicted
            continue
        _check_body(predicted, predicted_body or body)
        scored.append(clip_errors(predicted, body, chosen, predicted_body))
    return scored, skipped


def by_network(gmr: "TrainedGmr", config: ScoreConfig, types: Mapping[str, str]) -> Predict:
    """Predictions of a network, at its own rate.

    Args:
        gmr: The network.
        config: Which phases it sees.
        types: Type of motion by clip id.
    """

    def predict(one: UsableClip) -> PredictedClip | str:
        found = network_clip(
            gmr, one, all_phases=config.all_phases, motion_type=types.get(one.clip.id)
        )
        return found or f"no two valid frames in a row at {gmr.fps_hz:g} fps"

    return predict


def from_folder(folder: Path, config: ScoreConfig, types: Mapping[str, str]) -> Predict:
    """Predictions from a folder of clip files.

    Args:
        folder: The folder, with `<clip id>.npz` for each clip.
        config: Rate, phases, and what becomes of missing frames.
        types: Type of motion by clip id.
    """
    protocol_fps_hz = None if config.protocol is None else PROTOCOLS[config.protocol].fps_hz

    def predict(one: UsableClip) -> PredictedClip | str:
        reason = missing_file(folder, one.clip.id)
        if reason is not None and config.missing == "error":
            raise BadMotionFile(
                f"{folder}: {reason}. Predict this clip too, or pass --missing drop to leave it out"
            )
        if reason is not None:
            return reason
        found = file_clip(
            folder,
            one,
            config.fps_hz,
            protocol_fps_hz=protocol_fps_hz,
            all_phases=config.all_phases,
            drop_missing=config.missing == "drop",
            motion_type=types.get(one.clip.id),
        )
        return found or f"no two frames in a row with a prediction at {config.fps_hz:g} fps"

    return predict


def _check_body(predicted: PredictedClip, body: BodyModel) -> None:
    motion = predicted.runs[0].predicted
    if motion.body != body.name or motion.shape.shape != (body.n_shape,):
        raise BadMotionFile(
            f"clip {predicted.clip_id}: its prediction is of body {motion.body} with "
            f"{motion.shape.size} shape coefficients, but the given body is {body.name} with "
            f"{body.n_shape}. Pass the predictions' own body with --predictions-body"
        )
