"""The progress bar passes every item on and writes to standard error only."""

import pytest

from gmrdata.stage.progress import progress_bar, track


def test_items_pass_through(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(track(range(5), "counting")) == [0, 1, 2, 3, 4]
    assert list(track(iter("abc"), "letters", total=3)) == ["a", "b", "c"]
    assert capsys.readouterr().out == ""


def test_an_error_in_the_loop_comes_through() -> None:
    with pytest.raises(ArithmeticError):
        for _ in track([1, 2], "failing"):
            raise ArithmeticError


def test_brackets_are_text_and_no_markup() -> None:
    assert list(track([1], "checking [/b].yaml")) == [1]


def test_bar_counts() -> None:
    with progress_bar() as bar:
        task = bar.add_task("counting", total=4)
        bar.advance(task, 3)
        assert bar.tasks[0].completed == 3
        assert bar.tasks[0].total == 4
