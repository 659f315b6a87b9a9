"""A table beside the paper's: JSON for programs, CSV for spreadsheets, Markdown for readers."""

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Literal, NamedTuple

from pydantic import JsonValue

from gmrdata.paper import VIBE
from gmrdata.score import METRICS, Metric
from gmrdata.score.records import PaperMetrics
from gmrdata.score.table import METRIC_WORDS, Cell, Table, markdown, write_table_files
from gmrdata.values.errors import some
from gmrdata.values.records import Config, Record


class OverSeeds(Config):
    """One error over a row's seeds."""

    mean: float
    spread: float | None
    """Standard deviation over seeds; None for a single one."""
    by_seed: tuple[float, ...]


class TableRow(Config):
    name: str
    """What it is called at this size."""
    name_in_paper: str | None
    """None for a row that the paper does not have."""
    method: str
    clips: Literal["all", "moving", "still"]
    """Which of the scored clips count."""
    paper: PaperMetrics[float | None]
    """The paper's figures; None where it has none."""
    seeds: tuple[int, ...]
    settings: dict[str, JsonValue] | None
    """Settings of its trainings but the seed; None without any."""
    ours: PaperMetrics[OverSeeds] | None
    """Our figures; None where the row could not be made."""
    dropped_frames: int
    """Valid frames of its clips that have no prediction."""
    left_out: dict[str, str]
    """Why clips of the set are not scored, by id."""


class TrainedOn(Config):
    """A manifest, and its clips that were trained on."""

    name: str
    """Its file's name and the folder around it."""
    clips: int


class TableData(Config):
    """What was trained and scored on."""

    paper: str
    training: tuple[TrainedOn, ...]
    left_out: dict[str, int]
    """Their clips that were not trained on, by reason."""
    network: str | None
    """The trained GMR that was used in place of trainings; None without one."""
    estimator: str
    """Who estimated poses and keypoints where the paper has VIBE."""
    scored: str
    held_out_subjects: tuple[int | str, ...]


class TableRecord(Record):
    """A `table<N>.json`."""

    format: Literal["gmrdata-table/4"] = "gmrdata-table/4"
    table: int
    title: str
    scale: str
    note: str
    data: TableData
    rows: tuple[TableRow, ...]
    """In the paper's order, and zero motion."""
    lacking: dict[str, tuple[str, ...]]
    """What would have to be given for a row that could not be made."""
    statements: tuple[str, ...]
    """Which of the paper's orderings hold here."""


def write_table(folder: Path, record: TableRecord) -> Path:
    """Write `table<N>.json`, `.csv` and `.md`; returns the JSON file's path."""
    path = folder / f"table{record.table}.json"
    record.write(path)
    lines = (*explanations(record), *record.statements)
    title = f"Table {record.table}: {record.title}"
    write_table_files(path, csv_rows(record), markdown(title, "", {"": shown_rows(record)}, lines))
    return path


def explanations(record: TableRecord) -> list[str]:
    """What must be known to read the table: the data of both, the size, and what is missing."""
    data = record.data
    trained = ", ".join(f"{one.name} ({one.clips} clips)" for one in data.training) or "nothing"
    held_out, who = ", ".join(map(str, data.held_out_subjects)), data.estimator
    return [
        f"Paper: {data.paper}.",
        f"Here: trained on {trained}; scored on {data.scored}.",
        *([f"GMR: network {data.network}, as it is."] if data.network else []),
        *([f"{who}: who estimates where the paper has VIBE."] * (who != VIBE)),
        *([f"Not trained on: subjects {held_out}."] if held_out else []),
        f"Scale {record.scale}. {record.note}".strip(),
        *_paper_readings(record.rows),
        "± is the standard deviation over seeds. The data differ, so figures don't compare.",
        *_left_out(record.rows),
        *(f"{row}: not made. It needs {'; '.join(what)}." for row, what in record.lacking.items()),
    ]


def _left_out(rows: Sequence[TableRow]) -> list[str]:
    """What is not scored, with the rows of which that is said."""
    names: dict[tuple[int, tuple[str, ...]], list[str]] = {}
    for row in rows:
        names.setdefault((row.dropped_frames, tuple(sorted(row.left_out))), []).append(row.name)
    lines = []
    for (n_frames, ids), of_rows in names.items():
        parts = [f"valid frames without a prediction: {n_frames}"] if n_frames else []
        parts += [f"clips: {some(list(ids))}"] if ids else []
        if parts:
            lines.append(f"Left out of {'; '.join(of_rows)}: {'; '.join(parts)}.")
    return lines


def _paper_readings(rows: Sequence[TableRow]) -> list[str]:
    """How the trainings take what the paper leaves open, as their settings say."""
    lines = []
    for part, key, words in _READINGS:
        parts = [row.settings.get(part) for row in rows if row.settings is not None]
        used = [one.get(key) for one in parts if isinstance(one, dict)]
        lines += [text for value, text in words.items() if value in used]
    return lines


_READINGS: tuple[tuple[str, str, dict[JsonValue, str]], ...] = (
    ("loss", "reduction", {
        "sum": "The loss's terms are sums over motions and vertices, as eqs. 9-14 are written.",
        "mean": "The loss's terms are means over motions and vertices, where eqs. 9-14 are sums.",
    }),
    ("windows", "all_phases", {
        True: "Clips of a higher rate are trained on in all their phases at the network's rate.",
        False: "Clips of a higher rate are trained on in one phase at the network's rate.",
    }),
)  # fmt: skip


def shown_rows(record: TableRecord) -> Table:
    """Headings and rows for a reader: the paper's figure and ours, metric by metric."""
    headings = ["row", "seeds"]
    for metric in METRICS:
        words = METRIC_WORDS[metric]
        headings += [f"{words.title} paper [{words.unit}]", f"{words.title} here [{words.unit}]"]
    return tuple(headings), [_shown(row) for row in record.rows]


def _shown(row: TableRow) -> tuple[str, ...]:
    cells = [row.name, str(len(row.seeds) or "-")]
    for metric in METRICS:
        paper, ours = row.paper.get(metric), row.ours.get(metric) if row.ours else None
        spread = f" ± {ours.spread:.2f}" if ours and ours.spread is not None else ""
        cells.append("-" if paper is None else f"{paper:.2f}")
        cells.append(f"{ours.mean:.2f}{spread}" if ours else "not made")
    return tuple(cells)


def csv_rows(record: TableRecord) -> list[list[Cell]]:
    head: list[Cell] = ["row", "n_seeds"]
    for metric in METRICS:
        head += [f"paper_{metric}", f"{metric}_mean", f"{metric}_spread"]
    rows = [head]
    for row in record.rows:
        cells: list[Cell] = [row.name, len(row.seeds)]
        for metric in METRICS:
            ours = row.ours.get(metric) if row.ours else None
            cells += [row.paper.get(metric), *((ours.mean, ours.spread) if ours else (None, None))]
        rows.append(cells)
    return rows


def orderings(rows: Sequence[TableRow]) -> list[str]:
    """For each metric, how many of the paper's orderings hold here, and which hold or don't."""
    return [line for metric in METRICS for line in _of_metric(metric, rows)]


class _Row(NamedTuple):
    """A row in one metric: the paper's figure, and ours with its spread over seeds."""

    row: TableRow
    paper: float
    ours: OverSeeds


def _of_metric(metric: Metric, rows: Sequence[TableRow]) -> list[str]:
    known = [
        _Row(row, paper, row.ours.get(metric))
        for row in rows
        if row.ours is not None and (paper := row.paper.get(metric)) is not None
    ]
    both = (sorted(pair, key=lambda one: one.paper) for pair in combinations(known, 2))
    pairs = [(better, worse) for better, worse in both if better.paper != worse.paper]
    if not pairs:
        return []
    title = METRIC_WORDS[metric].title
    holds = [pair for pair in pairs if pair[0].ours.mean < pair[1].ours.mean]
    fails = [pair for pair in pairs if pair not in holds]
    lines = [f"{title}: {len(holds)} of the paper's {len(pairs)} orderings hold here."]
    for word, listed in (("holds", holds), ("does not hold", fails)):
        if listed:
            lines.append(f"{title}, {word}: {'; '.join(map(_ordering, listed))}.")
    if len(known) > 2:
        best_there = min(known, key=lambda one: one.paper)
        best_here = min(known, key=lambda one: one.ours.mean)
        where = "as here" if best_there is best_here else f"here it is {best_here.row.name}"
        lines.append(f"{title}: the paper's best row is {best_there.row.name}, {where}.")
    return lines


def _ordering(pair: tuple[_Row, _Row]) -> str:
    """The ordering, with remarks where the rows differ by no more than seeds do, and where one of
    them leaves out frames that the other is scored on, which may be the hard ones."""
    (better, _, a), (worse, _, b) = pair
    remarks = []
    lacks = [(row.dropped_frames, sorted(row.left_out)) for row in (better, worse)]
    if better.clips == worse.clips and lacks[0] != lacks[1]:
        remarks.append("on other frames")
    spread = None if a.spread is None or b.spread is None else max(a.spread, b.spread)
    if spread is not None and abs(a.mean - b.mean) <= spread:
        remarks.append("within the seeds' spread")
    text = f"{better.name} below {worse.name}"
    return f"{text} ({', '.join(remarks)})" if remarks else text
