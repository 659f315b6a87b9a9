"""A page as a reader's browser shows it: headless Chromium, with no way to the net."""

import json
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from shutil import which

import cv2
import numpy as np
import pytest


@dataclass(frozen=True)
class Visit:
    """What came of opening a page."""

    dom: str
    """The document after its scripts ran, as HTML."""
    complaints: list[str]
    """Lines of the console."""
    requests: list[str]
    """Addresses that the page asked the net for; none is answered."""


@pytest.fixture
def browse(tmp_path) -> Callable[[Path], Visit]:
    """Opens a file in Chromium."""

    def visit(page: Path) -> Visit:
        return _open(tmp_path, "--dump-dom", page.as_uri())

    return visit


@pytest.fixture
def photograph(tmp_path) -> Callable[[Path, str, int], tuple[np.ndarray, Visit]]:
    """Opens a page at an anchor, so many pixels wide, and gives its picture (H, W, 3)."""

    def take(page: Path, anchor: str, width_px: int) -> tuple[np.ndarray, Visit]:
        path = tmp_path / "page.png"
        flags = f"--window-size={width_px},600", "--virtual-time-budget=5000"
        visit = _open(tmp_path, *flags, f"--screenshot={path}", f"{page.as_uri()}#{anchor}")
        return cv2.imread(str(path)), visit

    return take


def _open(folder: Path, *arguments: str) -> Visit:
    if which("chromium") is None:
        pytest.skip("chromium is not installed")
    net_log = folder / "net.json"
    answer = subprocess.run(
        [
            "chromium", "--headless", "--no-sandbox", "--no-first-run",
            "--use-angle=swiftshader", "--enable-unsafe-swiftshader",  # WebGL without a GPU
            "--disable-background-networking", "--disable-component-update", "--disable-sync",
            "--no-proxy-server", "--host-resolver-rules=MAP * ~NOTFOUND",
            f"--user-data-dir={folder / 'profile'}", f"--log-net-log={net_log}",
            "--enable-logging=stderr", *arguments,
        ],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    complaints = [line for line in answer.stderr.splitlines() if ":CONSOLE:" in line]
    return Visit(answer.stdout, complaints, _requests(net_log))


def _requests(net_log: Path) -> list[str]:
    """Addresses of a page's requests; Chromium's own have no origin."""
    log = json.loads(net_log.read_text())
    start = log["constants"]["logEventTypes"]["URL_REQUEST_START_JOB"]
    started = [event.get("params", {}) for event in log["events"] if event["type"] == start]
    asked = [job for job in started if "url" in job]
    return [job["url"] for job in asked if job["initiator"] != "not an origin"]
