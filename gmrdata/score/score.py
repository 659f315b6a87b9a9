"""Score a network, or predictions of anything else, on a manifest's clips: OME, TME and VME."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from gmrdata.gmr.config import is_network, network_dir
from gmrdata.gmr.runs import (
    LazyClips,
    UsableClip,
    fitting_clips,
    given_body,
    source_key,
    usable_files,
)
from gmrdata.manifest.current import Manifest
from gmrdata.manifest.read import published_list
from gmrdata.read.bodies import body_inputs, load_bodies
from gmrdata.score import METHODS
from gmrdata.score.clip_errors import ClipErrors, across_clips, clip_errors
from gmrdata.score.compare import CompareConfig, compare
from gmrdata.score.predictions import PredictedClip, on_its_body
from gmrdata.score.predictors import (
    PredictorSource,
    ResultSets,
    ScoreConfig,
    check_people,
    check_read,
    clip_names,
    clips_source,
    network_source,
)
from gmrdata.score.protocols import H36M_JOINTS, H36M_ROWS, with_mesh_joints
from gmrdata.score.records import Bootstrap, Protocol, Scores
from gmrdata.score.result_files import COMPARISON, ClipFolder, find_result_sets
from gmrdata.score.summary import beside_floor, read_fitting_floor, summarise
from gmrdata.score.table import csv_rows, scores_markdown, write_table_files
from gmrdata.stage import recipes
from gmrdata.stage.progress import track
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import Inputs, NotMade, StageRecord, run_stage, state_of
from gmrdata.values.body import BodyModel, body_of, names_of
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadBodyFile, BadManifest, BadMotionFile, BadRecipe, StaleOutput
from gmrdata.values.files import NUMPY_ERRORS, STAGE_FILE, sha256_of_file


@dataclass(frozen=True)
class Scored:
    """The files that `score` wrote."""

    scores: tuple[Path, ...]  # the `scores.json` of each set of predictions
    comparison: Path | None  # `comparison.json` of several sets; None for one


def score(
    predictor: Path | str,
    manifest_path: Path | str,
    out_dir: Path | str,
    config: ScoreConfig | None = None,
    *,
    body_path: Path | str | None = None,
    predictions_body_path: Path | str | None = None,
    floor_path: Path | str | None = None,
    joint_regressor_path: Path | str | None = None,
    run: Run = DEFAULT_RUN,
) -> Scored:
    """Score what a network, or anything else, predicts for a manifest's clips (eqs. 15-17).

    Clips that the manifest rejects are left out and named.  Differences are never taken across
    frames that are not valid.  `out_dir` gets `scores.json`, `scores.csv` and `scores.md`; several
    sets of results are in `out_dir/<set>` each, and compared with the first in `comparison`.

    Args:
        predictor: A network, as `load_gmr` takes it, or a folder with `<clip id>.npz`, as baselines
            write it.  Or results of other systems as they write them, a file or a folder
            (docs/scores.md says how files are named).
        body_path: The clips' body, or a folder of bodies, as `load_bodies` takes it; None for the
            default body.
        predictions_body_path: The predictions' body or bodies, of the same mesh; None for those of
            `body_path`.
        floor_path: A `floor.json`: the error of the pseudo ground truth itself, to lay beside.
        joint_regressor_path: A .npy of (joints, vertices) that takes a protocol's joints from posed
            meshes, as some released code does; None for the bodies' own joints.

    MissingInput where there is no predictor.  BadManifest where no clip can be scored, one is of
    another body, or a floor is given for a manifest that is no pseudo ground truth.  BadRecord
    where the floor is of another frame rate.  BadMotionFile where a prediction is missing, lacks
    frames and may not be dropped, is of another clip or body, has several people and none was
    named, or none of a clip's frames.  BadBodyFile where the two bodies have different meshes.
    """
    optional = (body_path, predictions_body_path, floor_path, joint_regressor_path)
    given = _ScoredOn(Path(manifest_path), *(None if it is None else Path(it) for it in optional))
    config, out_dir = config or ScoreConfig(), Path(out_dir)
    sources = _sources(predictor, given, config)
    of_folders = zip(_folders(out_dir, sources), sources, strict=True)
    made = [partial(_write_scores, folder, one, given, config, run) for folder, one in of_folders]
    if run.only_look and "to make" in [*map(state_of, made)]:  # each folder is looked at
        raise NotMade(out_dir)
    scores = [one() for one in made]
    if len(sources) == 1:
        return Scored(tuple(scores), None)
    names = tuple(one.name for one in sources)
    compared = CompareConfig(names=names, resamples=config.resamples, seed=config.seed)
    return Scored(tuple(scores), compare(scores, out_dir / COMPARISON, compared, run=run))


def _folders(out_dir: Path, sources: Sequence[PredictorSource]) -> list[Path]:
    """Where scores go: those of several sets into a folder each, in one that is no stage's own."""
    if len(sources) == 1:
        return [out_dir]
    if (out_dir / STAGE_FILE).is_file():
        what = "holds what a single stage made, and several sets get a folder each"
        raise StaleOutput(f"{out_dir}: {what}. Pass another --out")
    return [out_dir / one.name for one in sources]


PLAN_HEADINGS = ("what", "clips", "frames", "left out")


def plan_scores(
    predictor: Path | str, manifest_path: Path | str, config: ScoreConfig
) -> list[tuple[str, ...]]:
    """Rows of `PLAN_HEADINGS`: what `score` would score, and on what; errors as there."""
    given = _ScoredOn(Path(manifest_path), None, None, None, None)
    files, skipped, _ = usable_files(given.manifest_path)
    rows = list[tuple[str, ...]]()
    for one in _sources(predictor, given, config):
        frames = [file.entry.n_frames for file in files if file.entry.id not in one.lacking]
        n_out = len(skipped) + len(one.lacking)
        rows.append((one.name, str(len(frames)), str(sum(frames)), str(n_out)))
    return rows


@dataclass(frozen=True)
class _ScoredOn:
    """What predictions are scored on, and beside."""

    manifest_path: Path
    body_path: Path | None
    predictions_body_path: Path | None
    floor_path: Path | None
    joint_regressor_path: Path | None

    def inputs(self) -> Inputs:
        bodies = body_inputs(self.body_path)
        bodies |= body_inputs(self.predictions_body_path, "predictions_body")
        others = {"floor": self.floor_path, "joint_regressor": self.joint_regressor_path}
        return {"manifest": self.manifest_path, **bodies, **others}


def _sources(predictor: Path | str, given: _ScoredOn, config: ScoreConfig) -> list[PredictorSource]:
    """What is scored by itself: the network, or each set of predictions in a folder."""
    config.its_protocol()  # or an error, before anything is read
    if is_network(predictor):
        check_read(config, "a network")
        if given.predictions_body_path is not None:
            raise BadRecipe("--predictions-body: a network's motions are on the clips' own bodies")
        return [network_source(network_dir(predictor), config)]
    (names, others), path = clip_names(given.manifest_path), Path(predictor)
    result_sets = find_result_sets(path, names, others)
    check_people(config, names, result_sets)
    results = [one for one in result_sets if not isinstance(one, ClipFolder)]
    check_read(config, "results of other systems" if results else "clips of gmrdata")
    body_path = given.predictions_body_path or given.body_path
    folders = [one.folder for one in result_sets if isinstance(one, ClipFolder)]
    sets = ResultSets(path, results, names, given.manifest_path, body_path, config, folders)
    return [
        clips_source(one, config, sets) if isinstance(one, ClipFolder) else sets.source(one)
        for one in result_sets
    ]


def _write_scores(
    out_dir: Path, source: PredictorSource, given: _ScoredOn, config: ScoreConfig, run: Run
) -> Path:
    def work(partial_dir: Path) -> None:
        scores = _scores(source, given, config)
        lines = (*scores.statements, *_if_trained_on(source, given.manifest_path))
        scores = scores.model_copy(update={"statements": lines})
        path = partial_dir / "scores.json"
        scores.write(path)
        write_table_files(path, csv_rows(scores), scores_markdown(scores))

    inputs = {**source.inputs, **given.inputs()}
    return run_stage("score", out_dir, config, inputs, work, run=run) / "scores.json"


def _if_trained_on(source: PredictorSource, manifest_path: Path) -> list[str]:
    """A sentence where a network was trained on this very manifest, as its run's record says."""
    run_dir = source.run_dir
    if run_dir is None or not (run_dir / STAGE_FILE).is_file():
        return []
    made, scored = StageRecord.of(run_dir), sha256_of_file(manifest_path)
    if not any(key.startswith("manifest_") and made.inputs[key] == scored for key in made.inputs):
        return []
    left_out = made.facts.get("left_out")
    reasons = " and ".join(left_out) if isinstance(left_out, dict) else ""
    but = f", but for clips {reasons}" if reasons else ""
    return [f"The network was trained on this manifest{but}: its figures are too good."]


def _scores(source: PredictorSource, given: _ScoredOn, config: ScoreConfig) -> Scores:
    one, protocol = source.open(), config.its_protocol()
    usable, left_out, manifest = usable_files(given.manifest_path)
    files = [file for file in usable if file.entry.id not in source.lacking]
    floor = regressor = None
    if given.floor_path is not None:
        kind = manifest.kind
        floor = read_fitting_floor(given.floor_path, given.manifest_path, kind, one.fps_hz)
    bodies = bodies_for(given.body_path, given.predictions_body_path)
    if given.joint_regressor_path is not None:
        body = bodies.of_clips[0]
        regressor, protocol = _joint_regressor(given.joint_regressor_path, body, protocol)
    clips, classes = LazyClips(files), [file.entry.camera_motion for file in files]
    scored, skipped = score_clips(one.predict, bodies, clips, classes, protocol, regressor)
    used = {file.entry.body for file in files}
    if not scored:
        id, reason = next(iter(skipped.items()))
        raise BadManifest(f"{given.manifest_path}: no clip can be scored. Clip {id}: {reason}")
    labelled = _labelled(scored, manifest, protocol)
    _require_finite(labelled)
    rng = np.random.default_rng(config.seed)
    summary = summarise(labelled, one.fps_hz, config.resamples, rng, protocol)
    return Scores(
        **dict(summary if floor is None else beside_floor(summary, floor)),
        name=one.name,
        model=one.model,
        fps_hz=one.fps_hz,
        body=names_of(body for body in bodies.of_clips if body.name in used),
        protocol=protocol,
        bootstrap=Bootstrap(resamples=config.resamples, seed=config.seed),
        skipped=left_out | dict(source.lacking) | skipped,
        dropped_frames=sum(clip.dropped_frames for clip in scored),
    )


def _labelled(
    scored: Sequence[ClipErrors], manifest: Manifest, protocol: Protocol | None
) -> list[ClipErrors]:
    """Clips with what a protocol takes across them, and with the groups that they belong to."""
    types = motion_types(manifest)
    figures = {one.id: one.quality.figures if one.quality else {} for one in manifest.clips}
    subsets = {
        id: tuple(name for key, name in SUBSETS.items() if of_clip.get(key) == 1)
        for id, of_clip in figures.items()
    }
    videos = {one.id: f"{one.source.dataset}/{one.source.sequence}" for one in manifest.clips}
    return [
        replace(one, motion_type=types.get(one.clip_id), subsets=subsets[one.clip_id])
        for one in across_clips(scored, protocol, videos)
    ]


def _require_finite(scored: Sequence[ClipErrors]) -> None:
    """Refuse errors that no number holds, as of places too far away to be squared."""
    for one in scored:
        samples: list[tuple[str, np.ndarray]] = []
        for method in METHODS:
            samples += [*one.errors[method].items(), *one.protocol.get(method, {}).items()]
            samples.append(("vertex error", one.over_time_mm[method]))
        bad = (name for name, values in samples if not np.isfinite(values).all())
        if name := next(bad, None):
            remedy = "Look for places and shapes beyond all measure in its prediction"
            raise BadMotionFile(f"clip {one.clip_id}: {name} is no finite number. {remedy}")


@dataclass(frozen=True, eq=False)
class ScoredBodies:
    """The bodies that clips and predictions may have, all of one mesh."""

    of_clips: tuple[BodyModel, ...]
    of_predictions: tuple[BodyModel, ...]


def score_clips(
    predict: Callable[[UsableClip], PredictedClip | str],
    bodies: ScoredBodies,
    clips: Sequence[Clip],
    camera_motions: Sequence[str],
    protocol: Protocol | None = None,
    regressor: np.ndarray | None = None,
) -> tuple[list[ClipErrors], dict[str, str]]:
    """Errors of each clip that has a prediction, and the reason by id of each that has none.

    Clip and prediction are posed on their own bodies.  `camera_motions` are the classes of the
    clips' cameras.  Clips are gone through once and not kept, so they may come from disk.
    """
    scored, skipped = [], {}
    fitting = zip(fitting_clips(clips, bodies.of_clips), camera_motions, strict=True)
    for clip, camera_motion in track(fitting, "scoring", total=len(clips)):
        predicted = predict(UsableClip(clip, camera_motion))
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
    motion, whose = predicted.runs[0].predicted, f"clip {predicted.clip_id}: its prediction is of"
    remedy = "Pass the predictions' own body with --predictions-body"
    return given_body(motion, bodies.of_predictions, BadMotionFile, whose, remedy)


def motion_types(manifest: Manifest) -> dict[str, str]:
    """Type of motion by clip id: the label of its sequence in a published list, if it has one."""
    labels: dict[tuple[str, str], str] = {}
    for name in recipes.published_names():
        for row in published_list(name):
            if row.label is not None:
                labels.setdefault(source_key(row.source), row.label)
    keys = {one.id: source_key(one.source) for one in manifest.clips}
    return {id: labels[key] for id, key in keys.items() if key in labels}


SUBSETS = {"emdb1": "EMDB 1", "emdb2": "EMDB 2"}  # figures of a clip, 1 or 0, and their names
SUM_OFF = 0.01  # of a joint's weights, which files round


def _joint_regressor(
    path: Path, body: BodyModel, protocol: Protocol | None
) -> tuple[np.ndarray, Protocol]:
    """(J, V) joints of a mesh as a file says, and the protocol with them."""
    if protocol is None or not protocol.metrics:
        raise BadRecipe("--joint-regressor: give a --protocol that measures joints too")
    try:
        matrix = np.load(path, allow_pickle=False)
    except NUMPY_ERRORS as error:
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
    if not np.allclose(matrix.sum(axis=1), 1.0, rtol=0, atol=SUM_OFF):
        what = "its rows don't sum to 1, so its joints are no means of vertices"
        raise BadBodyFile(f"{path}: {what}. Give a regressor of joints")
    rows = matrix[list(H36M_ROWS)] if len(matrix) == H36M_JOINTS else matrix
    return rows.astype(float), fitting


def bodies_for(body_path: Path | None, predicted_body_path: Path | None) -> ScoredBodies:
    """The clips' bodies, and the predictions' where those are others.

    BadBodyFile: meshes of different sizes.
    """
    bodies = load_bodies(body_path)
    predicted = bodies if predicted_body_path is None else load_bodies(predicted_body_path)
    n_vertices = len(bodies[0].template_m)
    for body in (*bodies, *predicted):
        if len(body.template_m) != n_vertices:
            raise BadBodyFile(
                f"{predicted_body_path or body_path}: {len(body.template_m)} vertices of "
                f"{body.name}, but the clips' body {bodies[0].name} has {n_vertices}, so no vertex "
                "error can be measured. Give predictions of a body with the clips' mesh"
            )
    return ScoredBodies(bodies, predicted)
