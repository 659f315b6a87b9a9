"""The verb for the paper's tables: tables."""

from pathlib import Path

from tyro.conf import Positional, UseAppendAction

from gmrdata.cli.answers import answer, print_table, then
from gmrdata.cli.options import body_path
from gmrdata.stage.run import Run
from gmrdata.tables.recipe import ScaleName
from gmrdata.values.errors import BadRecipe


def tables(
    table: Positional[str],
    out: Path,
    manifest: UseAppendAction[tuple[Path, ...]] = (),
    scored: Path | None = None,
    scale: ScaleName = "small",
    held_out: tuple[str, ...] = (),
    seeds: tuple[int, ...] = (),
    poses: Path | None = None,
    keypoints: Path | None = None,
    features: Path | None = None,
    videos: UseAppendAction[tuple[Path, ...]] = (),
    body: str = "anny",
    workers: int = 2,
    scheduler: str | None = None,
    redo: bool = False,
    dry_run: bool = False,
) -> None:
    """Make one of the paper's tables again: train, score, and lay it beside the paper's figures.

    `gmrdata tables 2 --manifest cmu/motions.yaml --out out/table2`. Trainings run in parallel; a
    command that was stopped goes on where it was.

    Args:
        table: Number of a table (1 to 6, 9, 10), or a recipe file of kind `table`.
        out: Output folder: table<N>.md, .csv and .json; runs/ and scores/.
        manifest: Manifest of motions to train on; may be given several times.
        scored: Manifest to score; the held-out subjects of the motions when left out.
        scale: "small" shrinks networks and steps for a machine without a GPU; "paper" needs one.
        held_out: Subjects who are scored and not trained on, in place of the recipe's.
        seeds: Seeds of each row's trainings, in place of the recipe's.
        poses: Another network's poses (VIBE's): <clip id>.npz (Tables 5, 6, 10).
        keypoints: 2D keypoints of STAF or OpenPose: <clip id>/ (Tables 5, 6).
        features: Image features: <clip id>.npz (Table 10).
        videos: Manifest that the non-sequential model is trained on (Table 10); may be repeated.
        body: "anny", or the path of the clips' body model.
        workers: Worker processes.
        scheduler: Address of a Dask cluster (tcp://host:port); local processes when left out.
        redo: Throw away runs of other settings.
        dry_run: List the trainings with an estimate of their time, and do nothing.
    """
    from gmrdata.pages.scores import write_scores_pages
    from gmrdata.tables.comparison import explanations, shown_rows
    from gmrdata.tables.make import lacking_text, make_table
    from gmrdata.tables.plan import HEADINGS, Given, plan_table, planned_runs
    from gmrdata.tables.recipe import load_table
    from gmrdata.values.files import read_json

    if workers < 1:
        raise BadRecipe(f"--workers {workers}: at least one process has to do the work")
    _, recipe = load_table(table)
    given = Given(
        manifest, scored, poses, keypoints, features, videos, held_out,
        body_path(body),
    )  # fmt: skip
    if dry_run:
        plan = plan_table(recipe, scale, given, seeds)
        rows, lines = planned_runs(plan, out, workers)
        print_table(HEADINGS, rows)
        for line in lines:
            answer(line)
        if plan.lacking:
            answer(lacking_text(recipe, plan, all_of_it=not plan.scorings))
        return
    run = Run(redo=redo, workers=workers, scheduler=scheduler)
    with then(lambda: write_scores_pages(out / "scores")):
        path = make_table(recipe, scale, given, out, seeds=seeds, run=run)
    record = read_json(path)
    print_table(*shown_rows(record))
    for line in (*explanations(record), *record["statements"]):
        answer(line)
    answer(path.with_suffix(".md"))
    answer(path)
