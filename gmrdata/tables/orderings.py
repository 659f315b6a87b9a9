"""Which of the paper's orderings of a table's rows hold here, in sentences."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from gmrdata.evaluate.metric_words import METRIC_WORDS
from gmrdata.tables.recipe import METRICS, Metric


@dataclass(frozen=True)
class RowFigures:
    """A row of the table that was made."""

    name: str
    """The row."""
    paper: dict[Metric, float]
    """The paper's figures; empty where it has none."""
    mean: dict[Metric, float]
    """Ours, as the mean over seeds."""
    spread: dict[Metric, float | None]
    """Standard deviation over seeds; None for a single one."""


def orderings(rows: Sequence[RowFigures]) -> list[str]:
    """For each metric, how many of the paper's orderings hold here, and which hold or don't."""
    return [line for metric in METRICS for line in _of_metric(metric, rows)]


def _of_metric(metric: Metric, rows: Sequence[RowFigures]) -> list[str]:
    known = [row for row in rows if metric in row.paper]
    pairs = [
        (a, b) if a.paper[metric] < b.paper[metric] else (b, a)
        for a, b in combinations(known, 2)
        if a.paper[metric] != b.paper[metric]
    ]
    if not pairs:
        return []
    title = METRIC_WORDS[metric].title
    holds = [pair for pair in pairs if pair[0].mean[metric] < pair[1].mean[metric]]
    fails = [pair for pair in pairs if pair not in holds]
    lines = [f"{title}: {len(holds)} of the paper's {len(pairs)} orderings hold here."]
    if holds:
        lines.append(f"{title}, holds: {_listed(metric, holds)}.")
    if fails:
        lines.append(f"{title}, does not hold: {_listed(metric, fails)}.")
    best_there = min(known, key=lambda row: row.paper[metric])
    best_here = min(known, key=lambda row: row.mean[metric])
    if len(known) > 2:
        same = best_there is best_here
        there = f"{title}: the paper's best row is {best_there.name}"
        lines.append(f"{there}, as here." if same else f"{there}, here it is {best_here.name}.")
    return lines


def _listed(metric: Metric, pairs: Sequence[tuple[RowFigures, RowFigures]]) -> str:
    return "; ".join(
        f"{better.name} below {worse.name}{_doubt(metric, better, worse)}"
        for better, worse in pairs
    )


def _doubt(metric: Metric, a: RowFigures, b: RowFigures) -> str:
    """A remark where two rows differ by no more than seeds do."""
    spreads = [row.spread[metric] for row in (a, b)]
    known = [spread for spread in spreads if spread is not None]
    if len(known) < len(spreads):
        return ""
    is_small = abs(a.mean[metric] - b.mean[metric]) <= max(known)
    return " (within the seeds' spread)" if is_small else ""
