"""What measurements call, which no type checker sees, is there."""

import pytest

from benchmarks.release_smoke import COMMANDS
from benchmarks.scale.manifests import STEPS
from tests.docs.page_commands import parse


@pytest.mark.parametrize("command", COMMANDS)
def test_the_command_line_takes_what_a_release_is_tried_with(command):
    parse(tuple(command.split()))


def test_manifests_are_written_read_and_checked(tmp_path):
    """Writing them ended in a traceback."""
    for step in STEPS.values():
        step(tmp_path / "many.yaml", 3)
