"""Two consoles, one for progress and one for answers, and one progress bar for all long work."""

import os
import sys
from collections.abc import Iterable, Iterator
from typing import TypeVar

from rich import progress
from rich.console import Console

console = Console(stderr=True, highlight=False, emoji=False)
"""Progress and errors, for the person who waits, as they are: `:b:` is no sign."""

_KNOWN_WIDTH = sys.stdout.isatty() or "COLUMNS" in os.environ
answers = Console(highlight=False, emoji=False, width=None if _KNOWN_WIDTH else 160)
"""What was asked for, on standard output; wide where it is piped, so that no cell is cut."""

Item = TypeVar("Item")


def remark(text: str, style: str | None = None) -> None:
    """Say on standard error what does not stop a command."""
    console.print(text, style=style, markup=False, soft_wrap=True)


def progress_bar(*, shown: bool = True) -> progress.Progress:
    """A bar with counts, elapsed and remaining time; use it as a context manager."""
    return progress.Progress(
        progress.TextColumn("{task.description}", markup=False),
        progress.BarColumn(),
        progress.MofNCompleteColumn(),
        progress.TimeElapsedColumn(),
        progress.TimeRemainingColumn(),
        console=console,
        disable=not shown,
    )


def track(items: Iterable[Item], description: str, total: int | None = None) -> Iterator[Item]:
    with progress_bar() as bar:
        yield from bar.track(items, total=total, description=description)
