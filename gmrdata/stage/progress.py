"""Two consoles, one for progress and one for answers, and one progress bar for all long work."""

import os
import re
import time
from collections.abc import Iterable, Iterator
from datetime import timedelta
from typing import Any, TypeVar

from rich import progress
from rich.console import Console
from rich.text import Text

from gmrdata.values.files import as_text

_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f]")


class _Console(Console):
    """One that no name or text of others commands: its control characters are shown as `\\x1b`."""

    def render_str(self, text: str, **options: Any) -> Text:
        shown = _CONTROL.sub(lambda match: f"\\x{ord(match[0]):02x}", as_text(text))
        return super().render_str(shown, **options)


console = _Console(stderr=True, highlight=False, emoji=False)
"""Progress and errors, for the person who waits, as they are: `:b:` is no sign."""

answers = _Console(highlight=False, emoji=False)
"""What was asked for, on standard output; wide where it is piped, so that no cell is cut."""
if not answers.file.isatty() and "COLUMNS" not in os.environ:
    answers.width = 160

LINE_EVERY_S = 30.0  # in a log file, where a bar can't be drawn over
Item = TypeVar("Item")


def remark(text: str, style: str | None = None) -> None:
    """Say on standard error what does not stop a command."""
    console.print(text, style=style, markup=False, soft_wrap=True)


class _Bar(progress.Progress):
    """A bar; without a terminal a line now and then, and the finished bar."""

    def __init__(self, *columns: progress.ProgressColumn, **options: Any) -> None:
        self._said_s = time.monotonic()
        super().__init__(*columns, **options)

    def update(self, task_id: progress.TaskID, **changes: Any) -> None:
        super().update(task_id, **changes)
        self._say(task_id)

    def advance(self, task_id: progress.TaskID, advance: float = 1) -> None:
        super().advance(task_id, advance)
        self._say(task_id)

    def _say(self, task_id: progress.TaskID) -> None:
        now_s = time.monotonic()
        if self.disable or self.console.is_terminal or now_s - self._said_s < LINE_EVERY_S:
            return
        self._said_s = now_s
        task = self._tasks[task_id]
        done = f"{task.completed:g}" + ("" if task.total is None else f" of {task.total:g}")
        parts = [done, f"{_clock(task.elapsed)} gone"]
        if task.time_remaining is not None:
            parts.append(f"{_clock(task.time_remaining)} left")
        remark(f"{task.description}: {', '.join(parts)}")


def _clock(seconds: float | None) -> str:
    return str(timedelta(seconds=int(seconds or 0)))


def progress_bar(*, shown: bool = True) -> progress.Progress:
    """A bar with counts, elapsed and remaining time; use it as a context manager.

    Where standard error is no terminal, a line says the same every `LINE_EVERY_S`.
    """
    return _Bar(
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
