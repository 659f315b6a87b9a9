"""Kill the whole demo five times at random moments, and compare with an undisturbed run.

Prints when it was killed and writes out/bench/kill.json.  Takes about three times as long as the
demo.
"""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from gmrdata.progress import console

pytestmark = pytest.mark.bench
MANIFESTS = ("training.yaml", "synthetic.yaml", "pseudo_gt.yaml")
N_KILLS = 5
OUT = Path("out/bench/kill.json")


def start(out: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-c", "from gmrdata.cli import main; main()", "demo", "--out", out]
    return subprocess.Popen([str(part) for part in command], stderr=subprocess.DEVNULL)


def test_five_kills_change_nothing(tmp_path: Path) -> None:
    undisturbed = Path(os.environ.get("UNDISTURBED", tmp_path / "undisturbed"))
    begin = time.monotonic()
    assert start(undisturbed).wait() == 0
    whole_s = time.monotonic() - begin
    rng = np.random.default_rng()
    # Each kill falls somewhere in what is left, so that late stages are hit as well.
    longest_s = float(os.environ.get("LONGEST_S", max(whole_s, 60.0))) / 2
    killed = tmp_path / "killed"
    kills = []
    for _ in range(N_KILLS):
        process = start(killed)
        after_s = float(rng.uniform(3, longest_s))
        try:
            process.wait(after_s)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
        unfinished = sorted(path.name for path in killed.rglob("*.partial"))
        kills.append({"after_s": round(after_s, 1), "unfinished": unfinished})
        console.print(kills[-1])
    assert start(killed).wait() == 0
    same = {
        name: (killed / name).read_bytes() == (undisturbed / name).read_bytes()
        for name in MANIFESTS
    }
    OUT.parent.mkdir(parents=True, exist_ok=True)
    OUT.write_text(json.dumps({"kills": kills, "same_bytes": same}, indent=2) + "\n")
    console.print(same)
    assert all(same.values())
