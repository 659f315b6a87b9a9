"""Scores and comparisons as HTML pages, with the paper's Fig. 5: vertex error over time."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from gmrdata.pages.frames import write_bytes
from gmrdata.pages.html import Table, render
from gmrdata.pages.plots import COLOURS, picture, quiet, svg
from gmrdata.score.compare import (
    HEADINGS,
    Comparison,
    comparison_explanations,
    comparison_lead,
    table_rows,
)
from gmrdata.score.records import Scores
from gmrdata.score.table import explanations, lead, protocol_rows, score_rows
from gmrdata.values.files import remove_orphans, write_text

ROLES = ("gmr", "person", "camera", "good", "bad")
"""Colours of the curves, in their order; then again, dashed."""
SIZE_IN = (7.4, 3.4)
"""Width and height of the plot [inch]."""


def write_scores_page(scores_path: Path) -> Path:
    """Write `scores.html` and `over_time.png` beside a `scores.json`; the path of the page."""
    remove_orphans(scores_path.parent)
    scores = Scores.read(scores_path)
    page = scores_path.with_name("scores.html")
    write_text(page, scores_page(scores))
    drawn = picture(lambda plot: plot_over_time(plot, [scores.name], [scores]), *SIZE_IN)
    write_bytes(scores_path.with_name("over_time.png"), drawn)
    return page


def write_scores_pages(folder: Path) -> None:
    """Write the page of each `<folder>/*/scores.json`."""
    for scores_path in sorted(folder.glob("*/scores.json")):
        write_scores_page(scores_path)


def write_comparison_page(comparison_path: Path, scores_paths: Sequence[Path]) -> Path:
    """Write `comparison.html` beside a `comparison.json`; the path of the page.

    The `scores_paths` are `scores.json` of its runs, in their order.
    """
    remove_orphans(comparison_path.parent)
    records = [Scores.read(path) for path in scores_paths]
    page = comparison_path.with_name("comparison.html")
    write_text(page, comparison_page(Comparison.read(comparison_path), records))
    return page


def scores_page(scores: Scores) -> str:
    """The page of a `scores.json`; the same scores give the same bytes."""
    caption = "Means over motions, and 95 % intervals over clips."
    tables = [("", Table(*score_rows(scores), caption))]
    protocol = protocol_rows(scores)
    if protocol is not None and scores.protocol is not None:
        name = scores.protocol.name
        caption = f"As {name} measures, and 95 % intervals over clips."
        tables.append((f"Protocol {name}", Table(*protocol, caption)))
    return render(
        "scores",
        title=f"Scores of {scores.name}",
        lead=lead(scores),
        heading="Scores",
        tables=tables,
        statements=scores.statements,
        plot=_plot([scores.name], [scores]),
        n_clips=len(scores.over_time.clips),
        explanations=explanations(scores),
    )


def comparison_page(comparison: Comparison, records: Sequence[Scores]) -> str:
    caption = "Differences to the first run, clip by clip."
    return render(
        "scores",
        title="Comparison of runs",
        lead=comparison_lead(comparison),
        heading="Runs",
        tables=[("", Table(HEADINGS, table_rows(comparison), caption))],
        statements=(),
        plot=_plot(comparison.runs, records),
        n_clips=None,
        explanations=comparison_explanations(comparison),
    )


def _plot(names: Sequence[str], records: Sequence[Scores]) -> str:
    return svg(lambda plot: plot_over_time(plot, names, records), *SIZE_IN, "over-time")


def plot_over_time(plot: Figure, names: Sequence[str], records: Sequence[Scores]) -> None:
    """The runs' curves with their intervals, and in grey zero motion on the first one's clips."""
    axes = plot.subplots()
    found = records[0].over_time
    (zero,) = axes.plot(found.times_s, found.zero.vertex_mm, label="zero motion")
    zero.set(color=COLOURS["muted"], linewidth=1.2, linestyle=(0, (4, 3)))
    for number, (name, scores) in enumerate(zip(names, records, strict=True)):
        times_s, curve = scores.over_time.times_s, scores.over_time.predicted
        colour = COLOURS[ROLES[number % len(ROLES)]]
        dashes = "-" if number < len(ROLES) else "--"
        if curve.interval95_mm is not None:
            axes.fill_between(times_s, *curve.interval95_mm, color=colour, alpha=0.16, linewidth=0)
        axes.plot(times_s, curve.vertex_mm, dashes, color=colour, linewidth=1.6, label=name)
    axes.set(xlabel="time [s]", ylabel="vertex error [mm]")
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False, loc="upper left")
    quiet(axes)
