"""Kill the whole demo five times at random moments, and compare with an undisturbed run.

Prints when it was killed and writes out/bench/kill.json.  Takes about three times as long as the
demo.
"""

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from record import OUT_DIR

from gmrdata.stage.progress import console
from gmrdata.values.files import write_json

pytestmark = pytest.mark.bench
MANIFESTS = ("training.yaml", "synthetic.yaml", "pseudo_gt.yaml")
N_KILLS = 5
START_S = 6.0
"""A run that goes on needs this long to find what is done."""
OUT = OUT_DIR / "kill.json"


def start(out: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-c", "from gmrdata.cli import main; main()", "demo", "--out", out]
    return subprocess.Popen([str(part) for part in command], stderr=subprocess.DEVNULL)


def test_five_kills_change_nothing(tmp_path: Path) -> None:
    undisturbed, killed = tmp_path / "undisturbed", tmp_path / "killed"
    begin = time.monotonic()
    assert start(undisturbed).wait() == 0
    whole_s = time.monotonic() - begin
    # Five moments of the whole run; each start goes on until the next of them.
    moments_s = np.sort(np.random.default_rng().uniform(0, 0.95 * whole_s, N_KILLS))
    kills = []
    for after_s in START_S + np.diff(moments_s, prepend=0.0):
        process = start(killed)
        try:
            process.wait(after_s)
            console.print("finished before it could be killed")
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
        folders = sorted(path.relative_to(killed) for path in killed.rglob("*.partial"))
        kills.append({"after_s": round(after_s, 1), "unfinished": [str(path) for path in folders]})
        console.print(kills[-1])
    assert start(killed).wait() == 0
    same = {
        name: (killed / name).read_bytes() == (undisturbed / name).read_bytes()
        for name in MANIFESTS
    }
    write_json(OUT, {"kills": kills, "same_bytes": same})
    console.print(same)
    assert all(same.values())
