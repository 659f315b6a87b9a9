"""What bash completes with the script of `gmrdata --completion bash`."""

import subprocess
from pathlib import Path

import pytest

from gmrdata.cli import main
from tests.fixtures.command_line import fails_cleanly


@pytest.fixture(scope="module")
def script(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("completion") / "gmrdata"
    with pytest.MonkeyPatch.context() as patch, path.open("w") as file:
        patch.setattr("sys.stdout", file)
        main(["--completion", "bash"])
    return path


def in_bash(script: Path, lines: str) -> list[str]:
    command = ["bash", "--norc", "-c", f'source "{script}"; {lines}']
    answer = subprocess.run(command, capture_output=True, text=True, check=True)
    assert answer.stderr == ""
    return answer.stdout.splitlines()


@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        ("vi", ["video"]),
        ("video --he", ["--height-m", "--help"]),
        ("video walk.mp4 --poses", ["--poses", "--poses-every"]),
        ("manifest ch", ["check"]),
        ("export out --to tum co", ["colmap"]),
        ("evaluate a b --protocol vi", ["vibe"]),
        ("video wal", []),
        ("video --gravity wal", []),
    ],
)
def test_bash_completes(script, typed, completed):
    """Where nothing of gmrdata's fits, readline completes files, by `-o default`."""
    words = f"COMP_WORDS=(gmrdata {typed}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); _tyro_gmrdata"
    assert sorted(in_bash(script, f'{words}; printf "%s\\n" ${{COMPREPLY[@]}}')) == (
        completed or [""]
    )
    assert in_bash(script, "complete -p gmrdata") == [
        "complete -o default -F _tyro_gmrdata gmrdata"
    ]


def test_a_word_after_a_verb_is_a_flag_or_a_verb(script):
    """A description of several lines is none of them."""
    words = "COMP_WORDS=(gmrdata video ''); COMP_CWORD=2; _tyro_gmrdata"
    offered = in_bash(script, f'{words}; printf "%s\\n" "${{COMPREPLY[@]}}"')
    assert "--height-m" in offered and [word for word in offered if word[0] != "-"] == []


def test_other_shells_are_refused(gmrdata, works):
    assert works("--completion", "zsh").stdout.startswith("#compdef gmrdata")
    fails_cleanly(gmrdata("--completion", "fish"), "give bash or zsh", code=2)
