"""Read every real motion file and put it on the default body.

Prints the figures and writes out/bench/motions.json.  Seconds depend on the machine; the ratio to
NumPy's text reader, which only reads the numbers of the same files, does less so.
"""

import io
import time
from pathlib import Path

import numpy as np
import pytest
from record import OUT_DIR

from gmrdata.motion.files import read_motion
from gmrdata.read.bodies import load_body
from gmrdata.stage.progress import console, track
from gmrdata.values.files import write_json

pytestmark = pytest.mark.bench
OUT = OUT_DIR / "motions.json"


def numpy_seconds(path: Path) -> float:
    """Time that NumPy takes to read the file's numbers alone."""
    lines = path.read_text().split("MOTION", 1)[1].split("\n", 3)[3]
    start = time.perf_counter()
    np.loadtxt(io.StringIO(lines))
    return time.perf_counter() - start


def test_every_file_reads(cmu_dir: Path) -> None:
    body = load_body("anny")
    files = sorted(cmu_dir.glob("bvh/*.bvh")) + sorted(cmu_dir.glob("amc/*.amc"))
    assert len(files) == 256
    start = time.perf_counter()
    n_frames = sum(read_motion(path, body).n_frames for path in track(files, "reading"))
    seconds = time.perf_counter() - start
    sample = [path for path in files if path.suffix == ".bvh"][::15]
    start = time.perf_counter()
    for path in sample:
        read_motion(path, body)
    ours_s = time.perf_counter() - start
    theirs_s = sum(numpy_seconds(path) for path in sample)
    record = {
        "files": len(files),
        "frames": n_frames,
        "seconds": round(seconds, 1),
        "bvh_ratio_to_numpy_loadtxt": round(ours_s / theirs_s, 2),
    }
    write_json(OUT, record)
    console.print(record)
