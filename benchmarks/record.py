"""What a measurement found, as JSON, and the bars that it must keep to."""

import operator
import os
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from render.tables import show

from gmrdata.values.files import write_json

OUT_DIR = Path("out/bench")
Bar = tuple[str, Any, str, bool]
"""Name, figure, what is asked of it, and whether it holds."""


def machine() -> dict[str, Any]:
    """What a measurement ran on, and how busy that is."""
    load = round(os.getloadavg()[0], 1)
    cores = len(os.sched_getaffinity(0))
    return {"cores": cores, "load_at_the_end": load, "python": platform.python_version()}


@dataclass
class Record:
    """The file of one run of a measurement; it grows as parts are done."""

    path: Path
    """The file."""
    small: bool
    """Whether to only try every part, without insisting on bars."""
    settings: Callable[[], dict[str, Any]]
    """What was measured with."""
    content: dict[str, Any] = field(default_factory=lambda: {"bars": []})
    """What the file holds."""

    def add(self, **parts: Any) -> None:
        """Write what was measured so far."""
        self.content |= {"settings": self.settings()} | parts
        write_json(self.path, self.content)

    def hold(self, bars: Sequence[Bar]) -> None:
        """Print bars, record them, and insist on them where the sizes are full."""
        rows = bar_rows(bars)
        show("Bars", rows)
        self.add(bars=[*self.content["bars"], *rows])
        missed = [row["figure"] for row in rows if row["met"] == "no"]
        assert self.small or not missed, f"bars not met: {', '.join(missed)}"


SENSES: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
}  # fmt: skip


def bar_of(name: str, value: float | None, sense: str, limit: float | None) -> Bar:
    """What a figure must be beside a limit; an unknown limit is met by any figure."""
    holds = value is not None and (limit is None or SENSES[sense](value, limit))
    return name, value, f"{sense} {_text(limit)}", holds


def at_most(name: str, value: float | None, limit: float | None) -> Bar:
    """A figure that must not be larger."""
    return bar_of(name, value, "<=", limit)


def at_least(name: str, value: float | None, limit: float | None) -> Bar:
    """A figure that must not be smaller."""
    return bar_of(name, value, ">=", limit)


def bar_rows(bars: Sequence[Bar]) -> list[dict[str, Any]]:
    """Rows for a table and for JSON."""
    return [
        {"figure": name, "value": value, "bar": bar, "met": "yes" if met else "no"}
        for name, value, bar, met in bars
    ]


def _text(limit: float | None) -> str:
    return "nothing to compare with" if limit is None else f"{limit:g}"
