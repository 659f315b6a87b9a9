"""What the command line says: answers, tables, and what went wrong."""

import errno
import json
import logging
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from gmrdata.stage.progress import answers, console, remark
from gmrdata.stage.run import Run
from gmrdata.stage.store import state_of
from gmrdata.values.errors import GmrdataError, NoWorkers, StageFailed


def answer(value: object) -> None:
    """Print a result to standard output, as it is."""
    answers.print(str(value), markup=False, soft_wrap=True)


def answer_json(value: object) -> None:
    """Print one JSON object to standard output, for a script."""
    answer(json.dumps(value))


def answer_state(out: Path, make: Callable[..., object], redo: bool) -> None:
    """Say whether a stage's folder is there, as a run with these flags would find it."""
    answer(f"{out}: {state_of(partial(make, run=Run(anew=redo, only_look=True)))}")


class _Stages(logging.Handler):
    """Lines of `-v`, above a bar that is drawn."""

    def emit(self, record: logging.LogRecord) -> None:
        remark(f"{time.strftime('%H:%M:%S')} {record.getMessage()}")


@contextmanager
def as_loud(*, quiet: bool, verbose: bool) -> Iterator[None]:
    """Quiet: only answers and errors are said inside; verbose: each stage too."""
    log, handler = logging.getLogger("gmrdata"), _Stages()
    before = console.quiet, log.level
    console.quiet = quiet or console.quiet  # `merge` runs another verb inside
    if verbose:
        log.addHandler(handler)
        log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(handler)
        console.quiet, log.level = before[0], before[1]


def print_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    from rich.markup import escape
    from rich.table import Table

    # Without this "[s]" in a heading is the sign for crossed-out text, and is not shown.
    table = Table(*map(escape, headings), box=None)
    if rows:
        table.columns[0].no_wrap = len(rows[0]) > 1  # names are whole, whatever else is cut
    for row in rows:
        table.add_row(*map(escape, row))
    answers.print(table)


@contextmanager
def then(draw: Callable[[], object]) -> Iterator[None]:
    """Draw pages after the stages inside, of what there is where some of it failed: what failed is
    said then, not that nothing is there to draw.  Without workers nothing is drawn: what there is
    is an earlier run's."""
    try:
        yield
    except NoWorkers:
        raise
    except StageFailed:
        with suppress(GmrdataError):
            draw()
        raise
    draw()


def fail(message: str, code: int = 1) -> None:
    """Say on standard error what went wrong, and end."""
    console.quiet = False
    remark(f"gmrdata: {message}", style="bold red")
    sys.exit(code)


def explain(error: OSError) -> str:
    """A system error with the file and what can be done."""
    remedies = {
        errno.ENOSPC: "the disk is full. Free some space and run the same command again",
        errno.EDQUOT: "your disk quota is used up. Free some space and run the same command again",
        errno.EFBIG: "the file grew beyond the limit for files. Raise it (ulimit -f) and run again",
        errno.EACCES: "no permission. Choose another --out, or change the folder's permissions",
        errno.EEXIST: "a file is there, where a folder is needed. Choose another --out",
        errno.ENOTDIR: "lies below a file, not in a folder. Choose another --out",
        errno.EROFS: "a read-only file system. Choose another --out",
    }
    remedy = remedies.get(error.errno or 0, error.strerror or str(error))
    return f"{error.filename or 'writing'}: {remedy}"
