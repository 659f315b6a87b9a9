"""The measurements use the tests' fixtures."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from sfm.session import Session

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "tests"), str(HERE)]
pytest_plugins = ["conftest"]


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--small`: try every part of a measurement, without its bars.  `--twins`: see bench_sfm."""
    parser.addoption("--small", action="store_true", help="small sizes, and no bars")
    parser.addoption("--twins", type=Path, help="a folder that `gmrdata threedpw twin` made")


@pytest.fixture(scope="session")
def sfm(request: pytest.FixtureRequest) -> Session:
    """What the measurements of the COLMAP stage share."""
    from sfm.session import Session

    return Session(
        small=request.config.getoption("--small"),
        twins_given=request.config.getoption("--twins"),
        motions_dir=lambda: request.getfixturevalue("cmu_dir"),
    )
