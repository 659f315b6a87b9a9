"""A folder that is slow to make is made once for all processes of a test run."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from filelock import FileLock


def made_once(
    tmp_path_factory: pytest.TempPathFactory, name: str, make: Callable[[Path], None]
) -> Path:
    """Folder `name` that `make(folder)` filled, in this process or another; nobody changes it.

    `make` is called with a folder that is not there yet.  Paths that it writes down stay true.
    """
    base = tmp_path_factory.getbasetemp()
    # pytest-xdist gives each process a folder in the run's own.
    root = base.parent if base.name.startswith("popen-") else base
    folder, done = root / name, root / f"{name}.done"
    with FileLock(root / f"{name}.lock"):
        if not done.exists():
            shutil.rmtree(folder, ignore_errors=True)
            make(folder)
            done.touch()
    return folder
