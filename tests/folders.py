"""The repository's folder, and what a folder holds."""

import subprocess
import time
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parents[1]


def bytes_of(folder: Path) -> dict[str, bytes]:
    """Every file by its path within a folder, but for a stage's record, which holds times."""
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != "stage.json"]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def wait_for(path: Path, process: "subprocess.Popen[Any]") -> None:
    """Wait until a process has made a file, which it must within a minute."""
    deadline_s = time.monotonic() + 60
    while not path.exists():
        assert process.poll() is None, "the process ended too early"
        assert time.monotonic() < deadline_s, f"{path} did not appear"
        time.sleep(0.01)
