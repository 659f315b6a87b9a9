"""Progress in a log file: a line now and then."""

import io

import pytest
from rich.console import Console

from gmrdata.stage import progress


@pytest.mark.parametrize(
    ("terminal", "every_s", "lines"),
    [
        (False, 0.0, ["work: 1 of 3", "work: 2 of 3", "work: 3 of 3"]),
        (False, 30.0, []),
        (True, 0.0, []),
    ],
)
def test_a_log_file_gets_lines(monkeypatch, terminal, every_s, lines):
    written = io.StringIO()
    console = Console(file=written, force_terminal=terminal, width=200)
    monkeypatch.setattr(progress, "console", console)
    monkeypatch.setattr(progress, "LINE_EVERY_S", every_s)
    with progress.progress_bar() as bar:
        task = bar.add_task("work", total=3)
        for _ in range(3):
            bar.advance(task)
    said = [line for line in written.getvalue().splitlines() if line.startswith("work: ")]
    assert [line.split(",")[0] for line in said] == lines
    assert all(line.endswith(("gone", "left")) for line in said)


def test_tracked_items_get_lines(monkeypatch):
    written = io.StringIO()
    monkeypatch.setattr(progress, "console", Console(file=written, force_terminal=False, width=200))
    monkeypatch.setattr(progress, "LINE_EVERY_S", 0.0)
    assert list(progress.track(iter("abc"), "letters", total=3)) == list("abc")
    assert "letters: 3 of 3" in written.getvalue()
