"""The measurements use the tests' fixtures."""

import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "tests"), str(HERE)]
pytest_plugins = ["conftest"]


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--small`: try every part of a measurement, without its bars."""
    parser.addoption("--small", action="store_true", help="small sizes, and no bars")
