"""What a person may have mistyped: the answer names what was meant."""

import subprocess
from collections.abc import Callable

import pytest

from gmrdata import __version__
from gmrdata.cli import RENAMED, VERBS

Gmrdata = Callable[..., subprocess.CompletedProcess[str]]


def test_version(gmrdata: Gmrdata) -> None:
    said = gmrdata("--version")
    assert (said.returncode, said.stdout) == (0, f"gmrdata {__version__}\n")


@pytest.mark.parametrize(("typed", "meant"), [("vidoe", "video"), ("evalute", "evaluate")])
def test_a_mistyped_verb_gets_the_nearest(gmrdata: Gmrdata, typed: str, meant: str) -> None:
    said = gmrdata(typed, "x")
    assert said.returncode == 2
    assert f"there is no verb '{typed}'; did you mean '{meant}'?" in said.stderr


def test_a_verb_like_none_is_refused(gmrdata: Gmrdata) -> None:
    said = gmrdata("xyzzy")
    assert said.returncode == 2
    assert "there is no verb 'xyzzy'. `gmrdata --help` lists them" in said.stderr


def test_a_mistyped_recipe_gets_the_nearest(gmrdata: Gmrdata) -> None:
    said = gmrdata("run", "syntetic", "--out", "x")
    assert said.returncode == 1
    assert "twins_small; did you mean 'synthetic'?" in " ".join(said.stderr.split())


def test_an_old_flag_names_the_new_one(gmrdata: Gmrdata) -> None:
    assert set(RENAMED) <= set(VERBS)
    for verb, flags in RENAMED.items():
        for flag, now in flags.items():
            for typed in (flag, "--" + flag[2:].replace("-", "_"), f"{flag}=x"):
                said = gmrdata(verb, "x", typed)
                assert said.returncode == 2
                told = f"gmrdata: {verb} {flag} has another name now: {now}"
                assert " ".join(said.stderr.split()) == told
