"""Scores and comparisons as HTML pages, with the paper's Fig. 5: vertex error over time."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from gmrdata.pages.html import Table, render, write_page
from gmrdata.pages.plots import COLOURS, picture, quiet, svg
from gmrdata.score import compare
from gmrdata.score.records import Scores
from gmrdata.score.table import explanations, lead, protocol_rows, score_rows
from gmrdata.values.files import remove_orphans, write_bytes

ROLES = ("gmr", "person", "camera", "good", "bad")
"""Colours of the curves, in their order; then again, dashed."""
SIZE_IN = (7.4, 3.4)  # width and height of the plot [inch]


def write_scores_page(scores_path: Path) -> Path:
    """Write `scores.html` and `over_time.png` beside a `scores.json`; the path of the page."""
    remove_orphans(scores_path.parent)
    scores = Scores.read(scores_path)
    drawn = picture(lambda plot: plot_over_time(plot, [scores.name], [scores]), *SIZE_IN)
    write_bytes(scores_path.with_name("over_time.png"), drawn)
    return write_page(scores_path.with_name("scores.html"), scores_page(scores))


def write_scores_pages(folder: Path) -> None:
    """Write the page of each `<folder>/*/scores.json`."""
    for scores_path in sorted(folder.glob("*/scores.json")):
        write_scores_page(scores_path)


def write_comparison_page(comparison_path: Path, scores_paths: Sequence[Path]) -> Path:
    """Write the page beside a `comparison.json`; each run has its `scores.json`, in their order."""
    remove_orphans(comparison_path.parent)
    records = [Scores.read(path) for path in scores_paths]
    page = comparison_page(compare.Comparison.read(comparison_path), records)
    return write_page(comparison_path.with_name("comparison.html"), page)


def scores_page(scores: Scores) -> str:
    """The page of a `scores.json`; the same scores give the same bytes."""
    caption = "Means over motions, and 95 % intervals over clips."
    tables = [("", Table(*score_rows(scores), caption))]
    protocol = protocol_rows(scores)
    if protocol is not None and scores.protocol is not None:
        name = scores.protocol.name
        caption = f"As {name} measures, and 95 % intervals over clips."
        tables.append((f"Protocol {name}", Table(*protocol, caption)))
    return _page(
        [scores.name], [scores], f"Scores of {scores.name}", lead=lead(scores), heading="Scores",
        tables=tables, statements=scores.statements, n_clips=len(scores.over_time.clips),
        explanations=explanations(scores),
    )  # fmt: skip


def comparison_page(comparison: compare.Comparison, records: Sequence[Scores]) -> str:
    caption = "Differences to the first run, clip by clip."
    table = Table(compare.HEADINGS, compare.table_rows(comparison), caption)
    return _page(
        comparison.runs, records, "Comparison of runs", lead=compare.comparison_lead(comparison),
        heading="Runs", tables=[("", table)], n_clips=None,
        statements=compare.comparison_remarks(comparison),
        explanations=compare.comparison_explanations(comparison),
    )  # fmt: skip


def _page(names: Sequence[str], records: Sequence[Scores], title: str, **shown: object) -> str:
    plot = svg(lambda plot: plot_over_time(plot, names, records), *SIZE_IN, "over-time")
    return render("scores", title=title, plot=plot, **shown)


def plot_over_time(plot: Figure, names: Sequence[str], records: Sequence[Scores]) -> None:
    """The runs' curves with their intervals, and in grey zero motion on the first one's clips."""
    axes = plot.subplots()
    first = records[0].over_time
    (zero,) = axes.plot(first.times_s, first.zero.vertex_mm, label="zero motion")
    zero.set(color=COLOURS["muted"], linewidth=1.2, linestyle=(0, (4, 3)))
    for number, (name, scores) in enumerate(zip(names, records, strict=True)):
        times_s, curve = scores.over_time.times_s, scores.over_time.predicted
        colour = COLOURS[ROLES[number % len(ROLES)]]
        dashes = "-" if number < len(ROLES) else "--"
        if curve.interval95_mm is not None:
            axes.fill_between(times_s, *curve.interval95_mm, color=colour, alpha=0.16, linewidth=0)
        # matplotlib leaves names that begin with _ out of the legend.
        label = f" {name}" if name.startswith("_") else name
        axes.plot(times_s, curve.vertex_mm, dashes, color=colour, linewidth=1.6, label=label)
    axes.set(xlabel="time [s]", ylabel="vertex error [mm]")
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False, loc="upper left")
    quiet(axes)
