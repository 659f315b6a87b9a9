"""The command line in this process, and a small demo that is run once for all tests here."""

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from gmrdata.cli import main
from gmrdata.cli.demo_recipe import DemoPaths
from tests.cli.small_demos import RECIPE, demo_arguments, finish, start_gmrdata

Answer = subprocess.CompletedProcess[str]


@pytest.fixture
def gmrdata(capsys: pytest.CaptureFixture[str]) -> Callable[..., Answer]:
    """The command line in this process: exit code, and what it wrote to both streams."""

    def run(*arguments: object) -> Answer:
        command, code = [str(argument) for argument in arguments], 0
        capsys.readouterr()
        try:
            main(command)
        except SystemExit as ended:
            code = int(ended.code or 0)
        said = capsys.readouterr()
        return Answer(command, code, said.out, said.err)

    return run


@pytest.fixture(scope="session")
def recipe_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recipe") / "small.yaml"
    path.write_text(yaml.safe_dump(RECIPE))
    return path


@pytest.fixture(scope="session")
def finished(
    tmp_path_factory: pytest.TempPathFactory, recipe_path: Path, cmu_dir: Path
) -> tuple[DemoPaths, str]:
    out = tmp_path_factory.mktemp("demo") / "out"
    said = finish(start_gmrdata(demo_arguments(out, recipe_path, cmu_dir)))
    return DemoPaths(out), said
