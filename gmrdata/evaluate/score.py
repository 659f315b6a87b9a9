"""Score a trained network on the clips of a manifest, with zero motion beside it."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.config import Config
from gmrdata.errors import BadManifest
from gmrdata.evaluate import metrics
from gmrdata.evaluate.beside_floor import beside_floor, read_fitting_floor
from gmrdata.evaluate.vertices import posed_vertex_errors_mm
from gmrdata.gmr.motion_deltas import deltas
from gmrdata.gmr.runs import Run, runs_at
from gmrdata.gmr.usable import UsableClip, check_clips_fit, usable_clips
from gmrdata.progress import track
from gmrdata.store import run_stage, write_json

if TYPE_CHECKING:
    from gmrdata.gmr.infer import TrainedGmr

METRICS = ("ome_deg", "tme_mm", "vme_mm")
METHODS = ("gmr", "zero")


class ScoreConfig(Config):
    """How clips are scored; the frame rate is the network's, 10 Hz for the paper's."""

    all_phases: bool = False
    """Whether a clip of a higher frame rate is scored in all its phases, or in the first; the paper
    doesn't say."""


@dataclass(frozen=True, eq=False)
class ClipErrors:
    """Errors of one clip per motion: arrays (n,) by method, "gmr" or "zero", and metric."""

    clip_id: str
    camera_motion: str
    errors: dict[str, dict[str, np.ndarray]]

    @property
    def n_motions(self) -> int:
        """Motions that were scored."""
        return len(self.errors["gmr"]["ome_deg"])


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
        out_dir: Gets `scores.json`.
        config: The recipe; None for its defaults.
        floor_path: A `floor.json`: the error of the pseudo ground truth itself, to lay beside.
        redo: Throw away a result of another recipe.

    Returns:
        Path of `scores.json`: per clip, per class of camera motion and overall, each pooled over
        motions and, where several clips are put together, as the mean of the clips' means.

    Raises:
        MissingInput: a file is not there.
        BadCheckpoint: the run's checkpoint is broken.
        BadManifest: no clip can be scored, a clip is of another body, or a floor is given for a
            manifest that is no pseudo ground truth.
        BadRecord: the floor is broken, or of another frame rate.
    """
    from gmrdata.body.load import load_body
    from gmrdata.gmr.infer import load_gmr

    config = config or ScoreConfig()
    inputs = {"run": run_dir, "manifest": manifest_path}
    if body_path is not None:
        inputs["body"] = body_path
    if floor_path is not None:
        inputs["floor"] = floor_path

    def work(partial_dir: Path) -> None:
        gmr = load_gmr(run_dir)
        floor = None
        if floor_path is not None:
            floor = read_fitting_floor(floor_path, manifest_path, gmr.fps_hz)
        body = load_body("anny" if body_path is None else str(body_path))
        usable = usable_clips(manifest_path)
        check_clips_fit([one.clip for one in usable.clips], body)
        scored, too_short = score_clips(gmr, body, usable.clips, config)
        if not scored:
            raise BadManifest(f"{manifest_path}: no clip has two valid frames in a row")
        summary = summarise(scored)
        record = (summary if floor is None else beside_floor(summary, floor)) | {
            "format": "gmrdata-scores/1",
            "fps_hz": gmr.fps_hz,
            "body": body.name,
            "model": {
                "run": gmr.name,
                "step": gmr.step,
                "network": gmr.model.config.model_dump(mode="json"),
            },
            "skipped": usable.skipped | too_short,
        }
        write_json(partial_dir / "scores.json", record)

    return run_stage("score", out_dir, config, inputs, work, redo=redo) / "scores.json"


def score_clips(
    gmr: "TrainedGmr", body: BodyModel, clips: Sequence[UsableClip], config: ScoreConfig
) -> tuple[list[ClipErrors], dict[str, str]]:
    """Errors per motion of each clip.

    Args:
        gmr: The network.
        body: The clips' body.
        clips: What to score.
        config: The recipe.

    Returns:
        Errors of those clips that have motions, and the reason by id of those that have none.
    """
    scored, too_short = [], {}
    for one in track(clips, "scoring", total=len(clips)):
        runs = runs_at(one.clip, gmr.fps_hz, all_phases=config.all_phases)
        if not runs:
            too_short[one.clip.id] = f"no two valid frames in a row at {gmr.fps_hz:g} fps"
            continue
        parts = [_run_errors(gmr, body, run) for run in runs]
        errors = {
            method: {
                metric: np.concatenate([part[method][metric] for part in parts])
                for metric in METRICS
            }
            for method in METHODS
        }
        scored.append(ClipErrors(one.clip.id, one.camera_motion, errors))
    return scored, too_short


def summarise(scored: Sequence[ClipErrors]) -> dict[str, Any]:
    """Scores per clip, per class of camera motion, and overall, as JSON values."""
    by_class: dict[str, list[ClipErrors]] = defaultdict(list)
    for one in scored:
        by_class[one.camera_motion].append(one)
    return {
        "clips": [
            {
                "id": one.clip_id,
                "camera_motion": one.camera_motion,
                "n_motions": one.n_motions,
            }
            | _pooled([one])
            for one in scored
        ],
        "camera_motion": {name: _group(by_class[name]) for name in sorted(by_class)},
        "overall": _group(scored),
    }


def _run_errors(gmr: "TrainedGmr", body: BodyModel, run: Run) -> dict[str, dict[str, np.ndarray]]:
    from gmrdata.gmr.infer import predict_deltas

    predicted_rotmats, predicted_m = predict_deltas(gmr, run.motion.local_rotmats)
    true_rotmats, true_m = deltas(run.motion.root_rotmats, run.motion.pelvis_m)
    still_rotmats, still_m = np.tile(np.eye(3), (len(true_m), 1, 1)), np.zeros_like(true_m)
    return {
        method: {
            "ome_deg": metrics.orientation_errors_deg(rotmats, true_rotmats),
            "tme_mm": metrics.translation_errors_mm(metres, true_m),
            "vme_mm": posed_vertex_errors_mm(
                body,
                run.motion.shape,
                run.motion.local_rotmats[: len(metres)],
                rotmats,
                metres,
                true_rotmats,
                true_m,
            ),
        }
        for method, rotmats, metres in (
            ("gmr", predicted_rotmats, predicted_m),
            ("zero", still_rotmats, still_m),
        )
    }


def _group(scored: Sequence[ClipErrors]) -> dict[str, Any]:
    return {
        "n_clips": len(scored),
        "n_motions": sum(one.n_motions for one in scored),
        "pooled_over_motions": _pooled(scored),
        "mean_of_clips": {
            method: {
                metric: float(np.mean([one.errors[method][metric].mean() for one in scored]))
                for metric in METRICS
            }
            for method in METHODS
        },
    }


def _pooled(scored: Sequence[ClipErrors]) -> dict[str, Any]:
    return {
        method: {
            metric: float(np.concatenate([one.errors[method][metric] for one in scored]).mean())
            for metric in METRICS
        }
        for method in METHODS
    }
