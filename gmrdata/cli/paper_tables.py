"""The verb for the paper's tables: tables."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import OmitArgPrefixes, Positional, UseAppendAction

from gmrdata.cli.answers import answer, print_table, then
from gmrdata.cli.options import FEATURES, KEYPOINTS, POSES, Body, DryRun, RunFlags, body_path
from gmrdata.paper import ScaleName
from gmrdata.stage.run import Run

if TYPE_CHECKING:
    from gmrdata.paper.plan import Plan


@dataclass(frozen=True)
class Seen:
    """Other networks' view of the clips, for Tables 5, 6 and 10."""

    poses: Annotated[Path | None, POSES] = None
    keypoints: Annotated[Path | None, KEYPOINTS] = None
    features: Annotated[Path | None, FEATURES] = None
    videos: UseAppendAction[tuple[Path, ...]] = ()
    """Manifest that the non-sequential model is trained on; may be given several times."""
    estimator: str = "VIBE"
    """The name of the system that made poses and keypoints, for the table."""


def tables(
    table: Positional[str],
    out: Path,
    manifest: UseAppendAction[tuple[Path, ...]] = (),
    scored: Path | None = None,
    scale: ScaleName = "small",
    held_out_subjects: tuple[str, ...] = (),
    seeds: tuple[int, ...] = (),
    network: Path | None = None,
    body: Body = "anny",
    *,
    seen: Annotated[Seen, OmitArgPrefixes],
    run: RunFlags,
    dry_run: DryRun = False,
) -> None:
    """Make one of the paper's tables again: train, score, and lay it beside the paper's figures.

    `gmrdata tables 2 --manifest cmu/motions.yaml --out out/table2`. Trainings run in parallel; a
    command that was stopped goes on where it was.  Tables 5, 6 and 10 need --poses (VIBE's),
    Tables 5 and 6 --keypoints, Table 10 --features and --videos.

    Args:
        table: Number of a table (1 to 6, 9, 10), or a recipe file of kind `table`.
        out: Output folder: table<N>.md, .csv and .json; runs/ and scores/.
        manifest: Manifest of motions to train on; may be given several times.
        scored: Manifest to score; the held-out subjects of the motions when left out.
        scale: "small" shrinks networks and steps for a machine without a GPU; "paper" needs one.
        held_out_subjects: Subjects who are scored and not trained on, in place of the recipe's.
        seeds: Seeds of each row's trainings, in place of the recipe's.
        network: Run folder of a trained GMR, or the word bundled for the package's own, in place of
            trainings; for Tables 5, 6 and 10.
    """
    from gmrdata.gmr.config import network_dir
    from gmrdata.pages.scores import write_scores_pages
    from gmrdata.paper import plan
    from gmrdata.paper.make import make_table

    recipe = plan.load_table(table)
    given = plan.Given(
        manifest, scored, seen.poses, seen.keypoints, seen.features, seen.videos, held_out_subjects,
        body_path(body), network and network_dir(network), seen.estimator,
    )  # fmt: skip
    if dry_run:
        _show_plan(plan.plan_table(recipe, scale, given, seeds), out, run)
        return
    with then(lambda: write_scores_pages(out / "scores")):
        path = make_table(recipe, scale, given, out, seeds=seeds, run=run)
    _show_table(path)


def _show_plan(planned: "Plan", out: Path, run: Run) -> None:
    from gmrdata.paper.make import HEADINGS, planned_runs

    rows, lines = planned_runs(planned, out, run)
    print_table(HEADINGS, rows)
    for line in (*lines, *([planned.lacking_text()] if planned.lacking else ())):
        answer(line)


def _show_table(path: Path) -> None:
    from gmrdata.paper.comparison import TableRecord, explanations, shown_rows

    record = TableRecord.read(path)
    print_table(*shown_rows(record))
    for line in (*explanations(record), *record.statements, path.with_suffix(".md"), path):
        answer(line)
