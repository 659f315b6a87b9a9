"""The measurements use the tests' fixtures."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
pytest_plugins = ["conftest"]
