"""Make one of the paper's tables: train what it needs, score it, and lay it beside the paper's."""

import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gmrdata.gmr.config import DataConfig
from gmrdata.gmr.runs import ClipFile, usable_files
from gmrdata.gmr.split import split_manifests
from gmrdata.manifest.current import Clip
from gmrdata.manifest.entry import clip_entry
from gmrdata.manifest.read import rows_in
from gmrdata.manifest.write import write_manifest
from gmrdata.score import METRICS, Method, Metric
from gmrdata.score.records import PaperMetrics, Scores
from gmrdata.stage.jobs import Job, run_jobs, worker_pool
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.tables import ScaleName
from gmrdata.tables.comparison import (
    OverSeeds,
    TableData,
    TableRecord,
    TableRow,
    TrainingSet,
    orderings,
    write_table,
)
from gmrdata.tables.plan import Given, Plan, plan_table, scored_manifest
from gmrdata.tables.recipe import Row, TableRecipe, train_config
from gmrdata.tables.work import score_one, train_one
from gmrdata.values.errors import BadManifest, BadRecipe, MissingInput
from gmrdata.values.files import read_npz, resolve_inside, write_npz


def held_out_set(
    manifest_paths: Sequence[Path], config: DataConfig, out_dir: Path, *, run: Run = DEFAULT_RUN
) -> Path:
    """Write the clips of the held-out subjects, without images, as a set of its own.

    Returns:
        Its `manifest.yaml`.

    Raises:
        BadRecipe: nobody is held out, or no clip is of a held-out subject.
        BadManifest: two clips have one id.
    """
    if not config.held_out_subjects:
        raise BadRecipe("nothing to score: give --scored, or subjects to hold out with --held-out")

    def work(partial_dir: Path) -> None:
        files = split_manifests(manifest_paths, config).held_out
        often = Counter(file.entry.id for file in files)
        if twice := sorted(id for id, n in often.items() if n > 1):
            raise BadManifest(f"held-out clips of one id in two manifests: {', '.join(twice)}")
        write_manifest(
            partial_dir / "manifest.yaml",
            name="held_out",
            version="1.0.0",
            description=f"Clips of {', '.join(map(str, config.held_out_subjects))}, to score.",
            kind="motions",
            licence="as stated by each clip",
            clips=[_copied(file, partial_dir) for file in files],
        )

    inputs = {f"manifest_{i}": path for i, path in enumerate(manifest_paths)}
    return run_stage("held-out", out_dir, config, inputs, work, run=run) / "manifest.yaml"


def _copied(file: ClipFile, folder: Path) -> Clip:
    entry = file.entry
    arrays = read_npz(resolve_inside(file.manifest_path.parent, entry.arrays.path))
    path = resolve_inside(folder, f"clips/{entry.id}.npz")
    # The arrays as they are: written anew, rotations would be rounded.
    write_npz(path, arrays | {"valid": arrays["valid"] & rows_in(entry.kept, entry.n_frames)})
    return clip_entry(
        folder,
        clip_path=path,
        id=entry.id,
        camera_motion=entry.camera_motion,
        licence=entry.licence,
        source=entry.source,
    )


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

    Args:
        out_dir: Gets runs/, scores/, and `table<N>.json` (which is returned), `.csv` and `.md`.
        seeds: In place of the recipe's.

    Raises:
        MissingInput: no row can be made of what is given; says what each of them lacks.
        StageFailed: a training or a score failed; the others are kept.
    """
    plan = plan_table(recipe, scale, given, seeds)
    if not plan.scorings:
        raise MissingInput(lacking_text(recipe, plan))
    subjects = given.subjects(recipe.scales[scale])
    if given.scored is None:
        config = train_config(recipe, recipe.rows[0], scale, 0, subjects).data
        held_out_set(given.manifests, config, out_dir / "held_out", run=run)
    shared = {"given": given, "out_dir": out_dir, "run": run}
    training = {
        out_dir / "runs" / one.id: Job(_job_id(one.id), train_one, {"training": one} | shared)
        for one in plan.trainings
    }
    scoring = {
        out_dir / "scores" / one.id: Job(_job_id(one.id), score_one, {"scoring": one} | shared)
        for ones in plan.scorings.values()
        for one in ones
    }
    _run("train", training, out_dir / "failures" / "train", run)
    paths = _run("score", scoring, out_dir / "failures" / "score", run)
    scores = {
        name: [Scores.read(paths[_job_id(one.id)]) for one in ones]
        for name, ones in plan.scorings.items()
    }
    return write_table(out_dir, _record(recipe, scale, given, plan, scores, out_dir))


def _run(what: str, jobs: Mapping[Path, Job], failures_dir: Path, run: Run) -> dict[str, Any]:
    """Results by job id.  Where a folder is there, its stage only looks whether it is the right
    one, for which no worker has to start."""
    made = [] if run.redo else [job for folder, job in jobs.items() if folder.is_dir()]
    results = {job.id: job.call(**job.arguments) for job in made}
    left = [job for job in jobs.values() if job.id not in results]
    if left:
        with worker_pool(run) as client:
            results |= run_jobs(what, left, client, failures_dir)
    return results


def lacking_text(recipe: TableRecipe, plan: Plan, *, all_of_it: bool = True) -> str:
    """What rows of a table lack; `all_of_it`: whether nothing can be made of it."""
    listed = "\n".join(f"  {name}: {'; '.join(what)}" for name, what in plan.lacking.items())
    which = "no row" if all_of_it else "not every row"
    return f"table {recipe.table}: {which} can be made of what is given. What is missing:\n{listed}"


def _job_id(id: str) -> str:
    return id.replace("/", ".")


def _record(
    recipe: TableRecipe,
    scale: ScaleName,
    given: Given,
    plan: Plan,
    scores: Mapping[str, Sequence[Scores]],
    out_dir: Path,
) -> TableRecord:
    rows = [_row(recipe, row, scale, scores.get(row.name, ()), plan) for row in recipe.rows]
    zero_motion = TableRow(
        name="no motion at all", name_in_paper=None, method="zero", clips="all", seeds=(),
        settings=None, paper=PaperMetrics(**dict.fromkeys(METRICS)),
        ours=_over_seeds(next(iter(scores.values()))[:1], "zero"),
    )  # fmt: skip
    return TableRecord(
        table=recipe.table,
        title=recipe.title,
        scale=scale,
        note=recipe.scales[scale].note,
        data=_data(recipe, scale, given, scores, out_dir),
        rows=(*rows, zero_motion),
        lacking={name: tuple(wanted) for name, wanted in plan.lacking.items()},
        statements=tuple(orderings(rows)),
    )


def _row(
    recipe: TableRecipe, row: Row, scale: ScaleName, scores: Sequence[Scores], plan: Plan
) -> TableRow:
    used = {one.training for one in plan.scorings.get(row.name, ())}
    configs = [one.config for one in plan.trainings if one.id in used]
    return TableRow(
        name=row.name_at(scale),
        name_in_paper=row.name if row.paper else None,
        method=recipe.scored_row(row).method,
        clips=row.clips,
        paper=PaperMetrics(**{metric: row.paper.get(metric) for metric in METRICS}),
        seeds=tuple(config.seed for config in configs),
        settings=configs[0].model_dump(mode="json", exclude={"seed"}) if configs else None,
        ours=_over_seeds(scores, "predicted", row) if scores else None,
    )


def _over_seeds(
    scores: Sequence[Scores], method: Method, row: Row | None = None
) -> PaperMetrics[OverSeeds]:
    found = {}
    for metric in METRICS:
        values = tuple(clip_figure(metric, one, method, row) for one in scores)
        spread = statistics.stdev(values) if len(values) > 1 else None
        found[metric] = OverSeeds(mean=statistics.fmean(values), spread=spread, by_seed=values)
    return PaperMetrics(**found)


def clip_figure(metric: Metric, scores: Scores, method: Method, row: Row | None) -> float:
    """Mean over all motions of the clips that count."""
    if row is None or row.clips == "all":
        return scores.overall.paper().get(method).get(metric)
    still = row.clips == "still"
    groups = [group for name, group in scores.camera_motion.items() if (name == "static") == still]
    n_motions = sum(group.n_motions for group in groups)
    if not n_motions:
        raise BadManifest(
            f"row {row.name!r}: of the scored clips none has a camera that "
            f"{'stands still' if still else 'moves'}. Give a set with both, like clips and twins"
        )
    sums = [group.paper().get(method).get(metric) * group.n_motions for group in groups]
    return sum(sums) / n_motions


def _data(
    recipe: TableRecipe,
    scale: ScaleName,
    given: Given,
    scores: Mapping[str, Sequence[Scores]],
    out_dir: Path,
) -> TableData:
    subjects = given.subjects(recipe.scales[scale])
    sizes, left_out = [len(usable_files(path)[0]) for path in given.videos], {}
    if given.manifests:
        config = train_config(recipe, recipe.rows[0], scale, 0, subjects).data
        split = split_manifests(given.manifests, config)
        sizes, left_out = [*split.mix.sizes, *sizes], split.left_out
    paths = (*given.manifests, *given.videos)
    overall = next(iter(scores.values()))[0].overall
    scored_path = scored_manifest(given, out_dir)
    what = _name_of(scored_path) if given.scored is not None else "the held-out subjects"
    return TableData(
        paper=recipe.paper_data,
        training=tuple(
            TrainingSet(name=_name_of(path), clips=n) for path, n in zip(paths, sizes, strict=True)
        ),
        left_out=left_out,
        scored=f"{what} ({overall.n_clips} clips, {overall.n_motions} motions)",
        held_out_subjects=subjects,
    )


def _name_of(path: Path) -> str:
    """A manifest by its file's name and the folder around it."""
    return f"{path.resolve().parent.name}/{path.name}"
