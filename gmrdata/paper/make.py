"""Make one of the paper's tables: train what it needs, score it, and lay it beside the paper's.

Trainings and scores are jobs for workers; a finished folder is kept.
"""

import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path

from gmrdata.gmr.config import DataConfig, TrainConfig
from gmrdata.gmr.predict import load_gmr
from gmrdata.gmr.runs import (
    ClipFile,
    not_trained_on,
    require_own_ids,
    split_manifests,
    usable_files,
)
from gmrdata.gmr.train import train
from gmrdata.manifest.current import ClipEntry
from gmrdata.manifest.read import read_data_set
from gmrdata.manifest.write import ClipAbout, ClipFiles, ManifestHead, clip_entry, write_manifest
from gmrdata.paper import ScaleName, comparison
from gmrdata.paper.joint import predict_joint, split_videos, train_joint
from gmrdata.paper.plan import (
    Given,
    JointConfig,
    Plan,
    RecipeRow,
    Scoring,
    TableRecipe,
    TrainingCost,
    plan_table,
    probe_training,
    train_config,
)
from gmrdata.paper.vibe_cam import SeenFiles, infer_poses, predict_vibe_cam
from gmrdata.score import METRICS, Method, Metric
from gmrdata.score.camera_as_world import predict_camera_as_world
from gmrdata.score.predictors import ScoreConfig
from gmrdata.score.records import GroupScore, PaperMetrics, Scores
from gmrdata.score.score import score
from gmrdata.stage.jobs import Job, run_jobs
from gmrdata.stage.progress import remark
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage, state_of
from gmrdata.stage.workers import worker_pool
from gmrdata.values.errors import BadManifest, BadRecipe, GmrdataError, MissingInput
from gmrdata.values.files import read_npz, resolve_inside, write_npz
from gmrdata.values.records import with_absolute_paths


def held_out_set(
    manifest_paths: Sequence[Path],
    config: DataConfig,
    out_dir: Path,
    *,
    to_train: bool = True,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Write the clips of the held-out subjects, without images, as a set; gives its manifest.
    BadManifest where no other clip is there `to_train` on."""
    if not config.held_out_subjects:
        raise BadRecipe("nothing to score: give --scored, or --held-out-subjects")

    files = split_manifests(manifest_paths, config, to_train=to_train).held_out
    require_own_ids(files, "held-out clips")

    def work(partial_dir: Path) -> None:
        write_manifest(
            partial_dir / "manifest.yaml",
            ManifestHead(
                name="held_out",
                version="1.0.0",
                description=f"Clips of {', '.join(map(str, config.held_out_subjects))}, to score.",
                kind="motions",
                licence="as stated by each clip",
            ),
            [_copied(file, partial_dir) for file in files],
        )

    inputs = {f"manifest_{i}": path for i, path in enumerate(manifest_paths)}
    return run_stage("held-out", out_dir, config, inputs, work, run=run) / "manifest.yaml"


def _copied(file: ClipFile, folder: Path) -> ClipEntry:
    entry, valid = file.entry, file.load().valid
    path = resolve_inside(folder, f"clips/{entry.id}.npz")
    # The arrays as they are: written anew, rotations would be rounded.
    write_npz(path, read_npz(file.arrays_path) | {"valid": valid})
    about = ClipAbout(
        id=entry.id, camera_motion=entry.camera_motion, licence=entry.licence, source=entry.source
    )
    return clip_entry(folder, ClipFiles(path), about)


def make_table(
    recipe: TableRecipe,
    scale: ScaleName,
    given: Given,
    out_dir: Path,
    *,
    seeds: Sequence[int] = (),
    run: Run = DEFAULT_RUN,
) -> Path:
    """Train and score each row that the given files allow; what is made already is kept.

    `out_dir` gets runs/, scores/, and `table<N>.json` (which is returned), `.csv` and `.md`.  The
    `seeds` stand in place of the recipe's.  MissingInput where no row can be made of what is given,
    StageFailed where a training or a score failed; the others are kept.
    """
    given, out_dir = with_absolute_paths(given), out_dir.resolve()
    plan = plan_table(recipe, scale, given, seeds)
    _make_scored(plan, out_dir, run)
    shared = {"given": given, "out_dir": out_dir, "run": run}
    scores_dir, failures_dir = out_dir / "scores", out_dir / "failures"
    training = [
        Job(id.replace("/", "."), train_one, {"id": id, "config": config} | shared)
        for id, config in plan.trainings.items()
    ]
    scoring = [
        Job(one.id.replace("/", "."), score_one, {"scoring": one} | shared)
        for ones in plan.scorings.values()
        for one in ones
    ]
    with worker_pool(run) as pool:
        run_jobs("train", training, pool, failures_dir / "train")
    # Of several shards only the last comes here, and scores take seconds.
    with worker_pool(replace(run, shard=None)) as pool:
        run_jobs("score", scoring, pool, failures_dir / "score")
    scores = {
        name: [Scores.read(scores_dir / one.id / "scores.json") for one in ones]
        for name, ones in plan.scorings.items()
    }
    manifest = read_data_set(_scored_manifest(given, out_dir))
    classes = {one.id: one.camera_motion for one in manifest.clips}
    return comparison.write_table(out_dir, _record(plan, scores, classes))


def _make_scored(plan: Plan, out_dir: Path, run: Run) -> None:
    """The clips to score, where none are given; MissingInput where no row can be made."""
    if not plan.scorings:
        raise MissingInput(plan.lacking_text())
    if plan.given.scored is None:
        data, trains = _data_config(plan), plan.given.network is None
        held_out_set(plan.given.manifests, data, out_dir / "held_out", to_train=trains, run=run)


def _scored_manifest(given: Given, out_dir: Path) -> Path:
    return given.scored or out_dir / "held_out" / "manifest.yaml"


def _data_config(plan: Plan) -> DataConfig:
    """The data are those of every row."""
    return train_config(plan.recipe, plan.recipe.rows[0], plan.scale, 0, plan.subjects).data


def _record(
    plan: Plan, scores: Mapping[str, Sequence[Scores]], classes: Mapping[str, str]
) -> comparison.TableRecord:
    """The table; `classes` are those of the set's clips' cameras, by id."""
    recipe, lacking = plan.recipe, dict(plan.lacking)
    fullest = max(chain(*scores.values()), key=lambda one: one.overall.n_motions)
    rows = [_row(plan, row, scores.get(row.name, ()), classes) for row in recipe.rows]
    for row in rows:
        if row.ours is None and row.name not in lacking:
            lacking[row.name] = [f"a prediction of a clip whose camera {_DOES[row.clips]}"]
    zero_motion = comparison.TableRow(
        name="no motion at all", name_in_paper=None, method="zero", clips="all", seeds=(),
        settings=None, paper=PaperMetrics(**dict.fromkeys(METRICS)),
        ours=_over_seeds([fullest], "zero"), dropped_frames=fullest.dropped_frames,
        left_out=fullest.skipped,
    )  # fmt: skip
    return comparison.TableRecord(
        table=recipe.table,
        title=recipe.title,
        scale=plan.scale,
        # It is of the trainings, and a given network may stand for all of them.
        note=recipe.scales[plan.scale].note if plan.trainings else "",
        data=_data(plan, fullest.overall),
        rows=(*rows, zero_motion),
        lacking={name: tuple(wanted) for name, wanted in lacking.items()},
        statements=tuple(comparison.orderings(rows)),
    )


def _row(
    plan: Plan, row: RecipeRow, scores: Sequence[Scores], classes: Mapping[str, str]
) -> comparison.TableRow:
    used = {one.training for one in plan.scorings.get(row.name, ())}
    configs = [config for id, config in plan.trainings.items() if id in used]
    # Frames and clips are left out before a network sees them, so a row's seeds have the same.
    skipped = scores[0].skipped if scores else {}
    left_out = {id: why for id, why in skipped.items() if _counts(row, classes[id])}
    counted = [clip for one in scores[:1] for clip in one.clips if _counts(row, clip.camera_motion)]
    is_made = bool(counted) or (bool(scores) and not left_out)
    return comparison.TableRow(
        name=plan.shown_name(row),
        name_in_paper=row.name if row.paper else None,
        method=plan.recipe.scored_row(row).method,
        clips=row.clips,
        paper=PaperMetrics(**{metric: row.paper.get(metric) for metric in METRICS}),
        seeds=tuple(config.seed for config in configs),
        settings=configs[0].model_dump(mode="json", exclude={"seed"}) if configs else None,
        ours=_over_seeds(scores, "predicted", row) if is_made else None,
        dropped_frames=sum(clip.dropped_frames for clip in counted),
        left_out=left_out,
    )


def _over_seeds(
    scores: Sequence[Scores], method: Method, row: RecipeRow | None = None
) -> PaperMetrics[comparison.OverSeeds]:
    by_metric = {}
    for metric in METRICS:
        values = tuple(clip_figure(metric, one, method, row) for one in scores)
        spread = statistics.stdev(values) if len(values) > 1 else None
        mean = statistics.fmean(values)
        by_metric[metric] = comparison.OverSeeds(mean=mean, spread=spread, by_seed=values)
    return PaperMetrics(**by_metric)


def clip_figure(metric: Metric, scores: Scores, method: Method, row: RecipeRow | None) -> float:
    """Mean over all motions of the clips that count."""
    if row is None or row.clips == "all":
        return scores.overall.paper().get(method).get(metric)
    groups = [group for name, group in scores.camera_motion.items() if _counts(row, name)]
    n_motions = sum(group.n_motions for group in groups)
    if not n_motions:
        what = f"of the scored clips none has a camera that {_DOES[row.clips]}"
        raise BadManifest(f"row {row.name!r}: {what}. Give a set with both, like clips and twins")
    sums = [group.paper().get(method).get(metric) * group.n_motions for group in groups]
    return sum(sums) / n_motions


_DOES = {"still": "stands still", "moving": "moves"}


def _counts(row: RecipeRow, camera_motion: str) -> bool:
    """Whether clips of a class of camera motion count in a row."""
    if row.clips == "all":
        return True
    return camera_motion != "none" and (camera_motion == "static") == (row.clips == "still")


def _data(plan: Plan, overall: GroupScore) -> comparison.TableData:
    given, kinds = plan.given, {type(config) for config in plan.trainings.values()}
    # On whom a given network was trained is not known here.
    manifests = given.manifests if TrainConfig in kinds else ()
    videos = given.videos if JointConfig in kinds else ()
    splits = [split_manifests(manifests, _data_config(plan))] if manifests else []
    splits += [split_videos(videos, given.held_out)] if videos else []
    sizes = chain(*(split.mix.sizes_of_manifests for split in splits))
    sets = zip((*manifests, *videos), sizes, strict=True)
    left_out = sum((Counter(split.left_out) for split in splits), Counter[str]())
    training = list(chain(*(split.training for split in splits)))
    what = "the held-out subjects" if given.scored is None else _name_of(given.scored)
    asked = [] if given.scored is None else usable_files(given.scored)[0]
    n_known = len(asked) - len(not_trained_on(asked, training))
    known = f"; {n_known} of these clips are trained on" if n_known else ""
    if n_known:
        remark(f"{what}{known}: a network's figures are too good")
    return comparison.TableData(
        paper=plan.recipe.paper_data,
        training=tuple(comparison.TrainedOn(name=_name_of(path), clips=n) for path, n in sets),
        left_out=dict(left_out),
        network=None if given.network is None else load_gmr(given.network).name,
        estimator=given.estimator,
        scored=f"{what} ({overall.n_clips} clips, {overall.n_motions} motions{known})",
        held_out_subjects=() if given.network else plan.subjects,
    )


def _name_of(path: Path) -> str:
    return f"{path.resolve().parent.name}/{path.name}"


def train_one(
    id: str, config: TrainConfig | JointConfig, given: Given, out_dir: Path, run: Run
) -> None:
    """Train a network into `out_dir/runs`; errors as in the trainers."""
    run_dir, body = out_dir / "runs" / id, given.body
    if isinstance(config, TrainConfig):
        train(given.manifests, run_dir, config, body_path=body, run=run)
    else:
        assert given.features is not None
        files = split_videos(given.videos, given.held_out).training
        train_joint(files, given.features, run_dir, config, body_path=body, run=run)


HEADINGS = ("training", "parameters", "steps", "state", "minutes")


def planned_runs(
    plan: Plan, out_dir: Path, run: Run = DEFAULT_RUN
) -> tuple[list[tuple[str, ...]], list[str]]:
    """The trainings of a table as rows under `HEADINGS`, and lines on the sum of what is left.  The
    estimate is of the network's forward and backward pass here; loss and data come on top."""
    probed: dict[object, TrainingCost] = {}
    rows: list[tuple[str, ...]] = []
    left_minutes: list[float | None] = []
    look, workers = Run(anew=run.redo, only_look=True), run.workers or 2
    state_of(partial(_make_scored, plan, out_dir, look))  # or its refusal
    for id, config in plan.trainings.items():
        parameters, step_s = "-", None
        if isinstance(config, TrainConfig):
            key = config.model, config.batch_size, config.windows, config.device, config.threads
            if key not in probed:
                probed[key] = probe_training(config)
            parameters, step_s = f"{probed[key].n_parameters:,}", probed[key].step_s
        minutes = None if step_s is None else config.steps * step_s / 60
        try:
            state = state_of(partial(train_one, id, config, plan.given, out_dir, look))
        except (GmrdataError, OSError) as error:  # as its worker would say
            state = str(error)
        if state in ("to make", "begun"):
            left_minutes.append(minutes)
        shown = "?" if minutes is None else f"{minutes:.1f}"
        rows.append((id, parameters, str(config.steps), state, shown))
    n_left, known = len(left_minutes), [one for one in left_minutes if one is not None]
    least = sum(known) / max(1, min(workers, n_left))
    total = f"at least {least:.0f} minutes, loss and data on top"
    if len(known) < n_left:
        total = "no estimate for those with ?: their device is not here, or their input is unknown"
    return rows, [
        f"{n_left} of {len(plan.trainings)} trainings to make with {workers} workers: {total}",
        f"{sum(map(len, plan.scorings.values()))} scores",
    ]


def score_one(scoring: Scoring, given: Given, out_dir: Path, run: Run) -> Path:
    """Predict where a row needs it, and score into `out_dir/scores`; gives its `scores.json`.

    Frames and clips without a prediction are left out: estimators don't see all.
    """
    manifest = _scored_manifest(given, out_dir)
    scores_dir, config = out_dir / "scores" / scoring.id, ScoreConfig()
    if scoring.row.method == "gmr" and scoring.row.poses == "true":
        predictor = _network(scoring, given, out_dir)
    else:
        predictor = _predict(scoring, manifest, given, out_dir, run)
        config = ScoreConfig(missing="drop")
    return score(predictor, manifest, scores_dir, config, body_path=given.body, run=run).scores[0]


def _network(scoring: Scoring, given: Given, out_dir: Path) -> Path:
    """The run that a row's training left, or the network that was given in its place."""
    if scoring.training is None and given.network is not None:
        return given.network
    return out_dir / "runs" / str(scoring.training)


def _predict(scoring: Scoring, manifest: Path, given: Given, out_dir: Path, run: Run) -> Path:
    into, run_dir = out_dir / "predictions" / scoring.id, _network(scoring, given, out_dir)
    match scoring.row.method:
        case "gmr":
            assert given.poses is not None
            return infer_poses(run_dir, manifest, given.poses, into, body_path=given.body, run=run)
        case "joint":
            assert given.features is not None
            features = given.features
            return predict_joint(run_dir, manifest, features, into, body_path=given.body, run=run)
        case "vibe_cam":
            assert given.poses is not None and given.keypoints is not None
            files = SeenFiles(given.poses, given.keypoints, given.body)
            return predict_vibe_cam(manifest, files, into, run=run)
        case "camera_as_world":
            return predict_camera_as_world(manifest, into, run=run)
