"""Score a trained network, or predictions of anything else, on a manifest's clips."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.errors import BadBodyFile, BadManifest
from gmrdata.evaluate.beside_floor import beside_floor, read_fitting_floor
from gmrdata.evaluate.motion_types import motion_types
from gmrdata.evaluate.record import FORMAT, protocol_record
from gmrdata.evaluate.score_clips import Predict, by_network, from_folder, score_clips
from gmrdata.evaluate.score_config import ScoreConfig
from gmrdata.evaluate.summary import summarise
from gmrdata.evaluate.write_scores import write_scores
from gmrdata.gmr.usable import check_clips_fit, usable_clips
from gmrdata.store import run_stage

__all__ = ["ScoreConfig", "score_manifest", "score_predictions"]


def score_manifest(
    run_dir: Path,
    manifest_path: Path,
    body_path: Path | None,
    out_dir: Path,
    config: ScoreConfig | None = None,
    *,
    floor_path: Path | None = None,
    redo: bool = False,
) -> Path:
    """Score a trained network on a manifest's clips: OME, TME and VME (eqs. 15-17).

    The input is each clip's own local pose and shape, so VME is of the motion alone.  Clips that
    the manifest rejects are left out and named.  Differences are never taken across frames that are
    not valid; each run of valid frames is a sequence of its own for the network.

    Args:
        run_dir: A finished training run.
        manifest_path: The clips.
        body_path: Their body, as `load_body` takes it; None for the default body.
        out_dir: Gets `scores.json`, `scores.csv`, `scores.md`, `scores.html` and `over_time.png`.
        config: The recipe; None for its defaults.
        floor_path: A `floor.json`: the error of the pseudo ground truth itself, to lay beside.
        redo: Throw away a result of another recipe.

    Returns:
        Path of `scores.json`: per clip, per class of camera motion, per type of motion and overall,
        each pooled over motions and, where several clips are put together, as the mean of the
        clips' means, with bootstrap intervals.

    Raises:
        MissingInput: a file is not there.
        BadCheckpoint: the run's checkpoint is broken.
        BadManifest: no clip can be scored, a clip is of another body, or a floor is given for a
            manifest that is no pseudo ground truth.
        BadRecord: the floor is broken, or of another frame rate.
    """
    from gmrdata.gmr.infer import load_gmr

    config = config or ScoreConfig()
    optional = {"body": body_path, "floor": floor_path}

    def work(partial_dir: Path) -> None:
        gmr = load_gmr(run_dir, config.which)
        predict = by_network(gmr, config, motion_types(manifest_path))
        record = _record(predict, manifest_path, optional, gmr.fps_hz, config)
        network = gmr.model.config.model_dump(mode="json")
        model = {"run": gmr.name, "step": gmr.step, "which": config.which, "network": network}
        write_scores(partial_dir, record | {"name": gmr.name, "model": model})

    inputs = {"run": run_dir, "manifest": manifest_path, **_given(optional)}
    return run_stage("score", out_dir, config, inputs, work, redo=redo) / "scores.json"


def score_predictions(
    predictions_dir: Path,
    manifest_path: Path,
    body_path: Path | None,
    out_dir: Path,
    config: ScoreConfig | None = None,
    *,
    predictions_body_path: Path | None = None,
    floor_path: Path | None = None,
    redo: bool = False,
) -> Path:
    """Score predicted world motions, whatever made them, by the same code as a network's.

    Args:
        predictions_dir: `<clip id>.npz` for each clip, as `gmrdata.clip.save_clip` writes it, each
            in a world of its own; row i is the clip's row i, or row k i where the clip's rate is k
            times the prediction's.  Its local pose and shape count in VME and in a protocol.
        manifest_path: The true clips.
        body_path: Their body, as `load_body` takes it; None for the default body.
        out_dir: As for `score_manifest`.
        config: The recipe; None for its defaults.
        predictions_body_path: The predictions' body, of the same mesh; None for the clips' own.
        floor_path: As for `score_manifest`.
        redo: Throw away a result of another recipe.

    Returns:
        Path of `scores.json`.

    Raises:
        MissingInput: a file is not there.
        BadManifest: as for `score_manifest`.
        BadMotionFile: a prediction is missing or lacks frames, and may not be dropped; or it is
            broken, of another clip or body, or in the camera's frame.
        BadBodyFile: the two bodies have different meshes.
        BadRecord: the floor is broken, or of another frame rate.
    """
    config = config or ScoreConfig()
    optional = {
        "body": body_path,
        "predictions_body": predictions_body_path,
        "floor": floor_path,
    }

    def work(partial_dir: Path) -> None:
        predict = from_folder(predictions_dir, config, motion_types(manifest_path))
        record = _record(predict, manifest_path, optional, config.fps_hz, config)
        name = _name_of(predictions_dir)
        write_scores(partial_dir, record | {"name": name, "model": {"predictions": name}})

    inputs = {"predictions": predictions_dir, "manifest": manifest_path, **_given(optional)}
    return run_stage("score", out_dir, config, inputs, work, redo=redo) / "scores.json"


def _name_of(predictions_dir: Path) -> str:
    """The folder's name, or that of the folder around one that is called just predictions."""
    folder = predictions_dir.resolve()
    return folder.parent.name if folder.name == "predictions" else folder.name


def _given(optional: Mapping[str, Path | None]) -> dict[str, Path]:
    return {key: path for key, path in optional.items() if path is not None}


def _record(
    predict: Predict,
    manifest_path: Path,
    optional: Mapping[str, Path | None],
    fps_hz: float,
    config: ScoreConfig,
) -> dict[str, Any]:
    """Everything in `scores.json` but what is the predictor's own."""
    floor_path = optional["floor"]
    floor = None
    if floor_path is not None:
        floor = read_fitting_floor(floor_path, manifest_path, fps_hz)
    body, predicted_body = _bodies(optional["body"], optional.get("predictions_body"))
    usable = usable_clips(manifest_path)
    check_clips_fit([one.clip for one in usable.clips], body)
    scored, skipped = score_clips(predict, body, usable.clips, config.protocol, predicted_body)
    if not scored:
        raise BadManifest(f"{manifest_path}: no clip has two valid frames in a row")
    rng = np.random.default_rng(config.seed)
    summary = summarise(scored, fps_hz, config.resamples, rng)
    return (summary if floor is None else beside_floor(summary, floor)) | {
        "format": FORMAT,
        "fps_hz": fps_hz,
        "body": body.name,
        "protocol": protocol_record(config.protocol),
        "bootstrap": {"resamples": config.resamples, "seed": config.seed},
        "skipped": usable.skipped | skipped,
        "dropped_frames": sum(one.dropped_frames for one in scored),
    }


def _bodies(
    body_path: Path | None, predicted_body_path: Path | None
) -> tuple[BodyModel, BodyModel | None]:
    """The clips' body, and the predictions' where that is another one."""
    from gmrdata.body.load import load_body

    body = load_body("anny" if body_path is None else str(body_path))
    if predicted_body_path is None:
        return body, None
    predicted_body = load_body(str(predicted_body_path))
    n_vertices, n_predicted = len(body.template_m), len(predicted_body.template_m)
    if n_vertices != n_predicted:
        raise BadBodyFile(
            f"{predicted_body_path}: {n_predicted} vertices, but the clips' body {body.name} has "
            f"{n_vertices}, so no vertex error can be measured. Give predictions of a body with "
            "the clips' mesh"
        )
    return body, predicted_body
