"""Score a trained network, or predictions of anything else, on a manifest's clips."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from gmrdata.gmr.config import Which
from gmrdata.gmr.runs import UsableClip, fitting_clips, usable_clips
from gmrdata.manifest.current import ListManifest, Manifest
from gmrdata.manifest.read import read_manifest
from gmrdata.read.bodies import body_inputs, load_bodies
from gmrdata.score import Deviation, ProtocolName
from gmrdata.score.clip_errors import ClipErrors, across_clips, clip_errors
from gmrdata.score.predictions import PredictedClip, file_clip, network_clip, on_its_body
from gmrdata.score.protocols import (
    H36M_JOINTS,
    H36M_ROWS,
    protocol_as,
    with_mesh_joints,
)
from gmrdata.score.records import (
    Bootstrap,
    Protocol,
    ScoredFiles,
    ScoredNetwork,
    ScoredResults,
    Scores,
)
from gmrdata.score.summary import beside_floor, read_fitting_floor, summarise
from gmrdata.score.table import csv_rows, scores_markdown, write_table_files
from gmrdata.stage import recipes
from gmrdata.stage.progress import track
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values import limits
from gmrdata.values.bodies import body_of, names_of
from gmrdata.values.body import BodyModel
from gmrdata.values.errors import BadBodyFile, BadManifest, BadMotionFile, BadRecipe
from gmrdata.values.records import Config


class ScoreConfig(Config):
    """The recipe of a score."""

    which: Which = "latest"
    """Which weights of a network are scored; predictions from files have none."""
    all_phases: bool = False
    """Whether a clip of a higher frame rate is scored in all its phases, or in the first; the paper
    doesn't say."""
    protocol: ProtocolName | None = None
    """What is measured beside OME, TME, VME and the vertex error over time."""
    original: tuple[Deviation | Literal["all"], ...] = ()
    """In what a protocol follows its released code where it doesn't by itself."""
    fps_hz: float = Field(default=10.0, gt=0)
    """Rate of OME, TME and VME of predictions from files [Hz]; a network is scored at its own."""
    missing: Literal["error", "drop"] = "error"
    """Whether valid frames without a prediction are an error, or dropped and counted."""
    resamples: int = Field(default=2000, ge=100, le=limits.MOST_DRAWS)
    """How often clips are drawn for a bootstrap interval."""
    seed: int = Field(default=0, ge=0)

    def its_protocol(self) -> Protocol | None:
        """The protocol as it is asked for; BadRecipe where it has no such deviation."""
        if self.protocol is None:
            if self.original:
                raise BadRecipe(f"--original {' '.join(self.original)}: give --protocol too")
            return None
        return protocol_as(self.protocol, self.original)


def score_manifest(
    run_dir: Path,
    manifest_path: Path,
    body_path: Path | None,
    out_dir: Path,
    config: ScoreConfig | None = None,
    *,
    floor_path: Path | None = None,
    joint_regressor_path: Path | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Score a trained network on a manifest's clips: OME, TME and VME (eqs. 15-17).

    The input is each clip's own local pose and shape, so VME is of the motion alone.  Clips that
    the manifest rejects are left out and named.  Differences are never taken across frames that are
    not valid; each run of valid frames is a sequence of its own for the network.

    Args:
        body_path: Their body, or a folder of bodies, as `load_bodies` takes it; None for the
            default body.
        out_dir: Gets `scores.json`, whose path is returned, `scores.csv` and `scores.md`.
        floor_path: A `floor.json`: the error of the pseudo ground truth itself, to lay beside.
        joint_regressor_path: A .npy of (joints, vertices) that takes a protocol's joints from posed
            meshes, as some released code does; None for the bodies' own joints.

    BadManifest where no clip can be scored, one is of another body, or a floor is given for a
    manifest that is no pseudo ground truth; BadRecord where the floor is of another frame rate.
    """
    from gmrdata.gmr.predict import load_gmr

    config = config or ScoreConfig()

    def predictor() -> Predictor:
        gmr = load_gmr(run_dir, config.which)
        network = gmr.model.config.model_dump(mode="json")
        model = ScoredNetwork(
            kind="network", run=gmr.name, step=gmr.step, which=config.which, network=network
        )
        protocol = config.its_protocol()
        smoothing = protocol.smoothing_frames if protocol else 0.0
        predict = partial(
            network_clip, gmr, all_phases=config.all_phases, smoothing_frames=smoothing
        )
        return gmr.name, model, predict, gmr.fps_hz

    inputs = {"run": run_dir, "manifest": manifest_path, "body": body_path, "floor": floor_path}
    inputs["joint_regressor"] = joint_regressor_path
    return write_scores(out_dir, manifest_path, predictor, inputs, config, run)


def score_predictions(
    predictions_dir: Path,
    manifest_path: Path,
    body_path: Path | None,
    out_dir: Path,
    config: ScoreConfig | None = None,
    *,
    predictions_body_path: Path | None = None,
    floor_path: Path | None = None,
    joint_regressor_path: Path | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Score predicted world motions, whatever made them, by the same code as a network's.

    What is not said here is as for `score_manifest`.

    Args:
        predictions_dir: `<clip id>.npz` for each clip, as `save_clip` writes it, each in a world of
            its own; row i is the clip's row i, or row k i where the clip's rate is k times the
            prediction's.  Its local pose and shape count in VME and in a protocol.
        predictions_body_path: The predictions' body or bodies, of the same mesh; None for those of
            `body_path`.

    BadMotionFile where a prediction is missing, lacks frames and may not be dropped, is of another
    clip or body, or in the camera's frame; BadBodyFile where the two bodies have different meshes.
    """
    config = config or ScoreConfig()

    def predictor() -> Predictor:
        folder, protocol = predictions_dir.resolve(), config.its_protocol()
        name = folder.parent.name if folder.name == "predictions" else folder.name
        predict = partial(
            file_clip,
            predictions_dir,
            fps_hz=config.fps_hz,
            protocol_fps_hz=protocol.fps_hz if protocol else None,
            smoothing_frames=protocol.smoothing_frames if protocol else 0.0,
            all_phases=config.all_phases,
            drop_missing=config.missing == "drop",
        )
        return name, ScoredFiles(kind="files", predictions=name), predict, config.fps_hz

    inputs = {"predictions": predictions_dir, "manifest": manifest_path, "body": body_path}
    inputs |= {"floor": floor_path, "predictions_body": predictions_body_path}
    inputs["joint_regressor"] = joint_regressor_path
    return write_scores(out_dir, manifest_path, predictor, inputs, config, run)


Predict = Callable[[UsableClip], PredictedClip | str]  # or the reason why there is none
Predictor = tuple[str, ScoredNetwork | ScoredFiles | ScoredResults, Predict, float]
"""Its name, what predicts, and the rate of OME, TME and VME [Hz]."""


@dataclass(frozen=True, eq=False)
class ScoredBodies:
    """The bodies that clips and predictions may have, all of one mesh."""

    of_clips: tuple[BodyModel, ...]
    of_predictions: tuple[BodyModel, ...]


def score_clips(
    predict: Predict,
    bodies: ScoredBodies,
    clips: Sequence[UsableClip],
    protocol: Protocol | None = None,
    regressor: np.ndarray | None = None,
) -> tuple[list[ClipErrors], dict[str, str]]:
    """Errors of each clip that has a prediction, and the reason by id of each that has none.

    Clip and prediction are posed on their own bodies.
    """
    scored, skipped = [], {}
    fitting = fitting_clips((one.clip for one in clips), bodies.of_clips)
    for one, clip in track(list(zip(clips, fitting, strict=True)), "scoring", total=len(clips)):
        predicted = predict(replace(one, clip=clip))
        if isinstance(predicted, str):
            skipped[clip.id] = predicted
            continue
        body = body_of(clip.motion, bodies.of_clips)
        assert body is not None  # or the clip would not fit
        its_body = _predicted_body(predicted, bodies)
        other_body = None if its_body is body else its_body
        predicted = on_its_body(predicted, its_body)
        scored.append(clip_errors(predicted, body, protocol, other_body, regressor))
    return scored, skipped


def _predicted_body(predicted: PredictedClip, bodies: ScoredBodies) -> BodyModel:
    motion = predicted.runs[0].predicted
    body = body_of(motion, bodies.of_predictions)
    if body is None:
        given = ", ".join(f"{one.name} with {one.n_shape}" for one in bodies.of_predictions)
        raise BadMotionFile(
            f"clip {predicted.clip_id}: its prediction is of body {motion.body} with "
            f"{motion.shape.size} shape coefficients, but the given body is {given}. Pass the "
            "predictions' own body with --predictions-body"
        )
    return body


def motion_types(manifest: Manifest) -> dict[str, str]:
    """Type of motion by clip id: the label of its sequence in a published list, if it has one."""
    labels: dict[tuple[str, str], str] = {}
    for name in recipes.published_names():
        published = read_manifest(recipes.published_manifest(name))
        if isinstance(published, ListManifest):
            for row in published.clips:
                if row.label is not None:
                    labels.setdefault((row.source.dataset, row.source.sequence), row.label)
    sources = {one.id: (one.source.dataset, one.source.sequence) for one in manifest.clips}
    return {id: labels[source] for id, source in sources.items() if source in labels}


def videos_of(manifest: Manifest) -> dict[str, str]:
    """Which video each clip is of, by clip id."""
    return {one.id: f"{one.source.dataset}/{one.source.sequence}" for one in manifest.clips}


SUBSETS = {"emdb1": "EMDB 1", "emdb2": "EMDB 2"}  # figures of a clip, 1 or 0, and their names


def subsets_of(manifest: Manifest) -> dict[str, tuple[str, ...]]:
    """Named parts of a data set that each clip belongs to, by clip id."""
    figures = {one.id: one.quality.figures if one.quality else {} for one in manifest.clips}
    return {
        id: tuple(name for key, name in SUBSETS.items() if of_clip.get(key) == 1)
        for id, of_clip in figures.items()
    }


def write_scores(
    out_dir: Path,
    manifest_path: Path,
    predictor: Callable[[], Predictor],
    inputs: Mapping[str, Path | None],
    config: ScoreConfig,
    run: Run,
) -> Path:
    def work(partial_dir: Path) -> None:
        scores = _scores(predictor(), manifest_path, inputs, config)
        path = partial_dir / "scores.json"
        scores.write(path)
        write_table_files(path, csv_rows(scores), scores_markdown(scores))

    given = {key: path for key, path in inputs.items() if path is not None}
    for role in ("body", "predictions_body"):
        if (path := given.pop(role, None)) is not None:
            given |= body_inputs(path, role)
    return run_stage("score", out_dir, config, given, work, run=run) / "scores.json"


def _scores(
    predictor: Predictor,
    manifest_path: Path,
    inputs: Mapping[str, Path | None],
    config: ScoreConfig,
) -> Scores:
    name, model, predict, fps_hz = predictor
    usable, floor, protocol = usable_clips(manifest_path), None, config.its_protocol()
    if (path := inputs["floor"]) is not None:
        floor = read_fitting_floor(path, manifest_path, usable.manifest.kind, fps_hz)
    bodies, regressor = bodies_for(inputs["body"], inputs.get("predictions_body")), None
    if (path := inputs["joint_regressor"]) is not None:
        regressor, protocol = _joint_regressor(path, bodies.of_clips[0], protocol)
    scored, skipped = score_clips(predict, bodies, usable.clips, protocol, regressor)
    used = {one.clip.motion.body for one in usable.clips}
    if not scored:
        raise BadManifest(f"{manifest_path}: no clip has two valid frames in a row")
    scored = across_clips(scored, protocol, videos_of(usable.manifest))
    types, subsets = motion_types(usable.manifest), subsets_of(usable.manifest)
    typed = [
        replace(one, motion_type=types.get(one.clip_id), subsets=subsets.get(one.clip_id, ()))
        for one in scored
    ]
    summary = summarise(typed, fps_hz, config.resamples, np.random.default_rng(config.seed))
    if floor is not None:
        summary = beside_floor(summary, floor)
    return Scores(
        **dict(summary),
        name=name,
        model=model,
        fps_hz=fps_hz,
        body=names_of(body for body in bodies.of_clips if body.name in used),
        protocol=protocol,
        bootstrap=Bootstrap(resamples=config.resamples, seed=config.seed),
        skipped=usable.skipped | skipped,
        dropped_frames=sum(one.dropped_frames for one in scored),
    )


def _joint_regressor(
    path: Path, body: BodyModel, protocol: Protocol | None
) -> tuple[np.ndarray, Protocol]:
    """(J, V) joints of a mesh as a file says, and the protocol with them."""
    if protocol is None or not protocol.metrics:
        raise BadRecipe("--joint-regressor: give a --protocol that measures joints too")
    try:
        matrix = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise BadBodyFile(f"{path}: not a .npy of numbers ({error})") from None
    n_vertices = len(body.template_m)
    if not isinstance(matrix, np.ndarray) or matrix.dtype.kind not in "fiu" or matrix.ndim != 2:
        raise BadBodyFile(f"{path}: not a .npy with one matrix of joints by vertices")
    if matrix.shape[1] != n_vertices or not np.isfinite(matrix).all():
        raise BadBodyFile(
            f"{path}: {matrix.shape[0]} by {matrix.shape[1]} numbers, but the body {body.name} has "
            f"{n_vertices} vertices, or not all are finite. Give the regressor of this mesh"
        )
    fitting = with_mesh_joints(protocol, len(matrix))
    rows = matrix[list(H36M_ROWS)] if len(matrix) == H36M_JOINTS else matrix
    return rows.astype(float), fitting


def bodies_for(body_path: Path | None, predicted_body_path: Path | None) -> ScoredBodies:
    """The clips' bodies, and the predictions' where those are others.

    BadBodyFile: meshes of different sizes.
    """
    bodies = load_bodies("anny" if body_path is None else str(body_path))
    predicted = bodies
    if predicted_body_path is not None:
        predicted = load_bodies(str(predicted_body_path))
    n_vertices = len(bodies[0].template_m)
    for body in (*bodies, *predicted):
        if len(body.template_m) != n_vertices:
            raise BadBodyFile(
                f"{predicted_body_path or body_path}: {len(body.template_m)} vertices of "
                f"{body.name}, but the clips' body {bodies[0].name} has {n_vertices}, so no vertex "
                "error can be measured. Give predictions of a body with the clips' mesh"
            )
    return ScoredBodies(bodies, predicted)
