"""Manifests of many clips: time and memory to write, read, check, and to get a first batch."""

import json
import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from gmrdata.manifest.check import check_manifest
from gmrdata.manifest.current import ClipEntry
from gmrdata.manifest.read import read_manifest
from gmrdata.manifest.write import ManifestHead, write_manifest

N = (1000, 10_000, 100_000)  # clips
HEAD = ManifestHead(name="many", version="1.0.0", description="d", kind="motions", licence="l")


def _clip(number: int) -> ClipEntry:
    return ClipEntry.model_validate({
        "id": f"c{number:06d}", "body": "anny", "fps_hz": 120.0, "n_frames": 400, "frame": "world",
        "licence": "CMU Graphics Lab Motion Capture Database: free for all uses, may not be resold",
        "source": {"dataset": "CMU", "sequence": "06_04"}, "translation_of": "smpl_transl",
        "camera_motion": "none", "kept": ({"start": 0, "stop": 400},),
        "arrays": {"path": f"clips/c{number:06d}/clip.npz", "size_bytes": 245774,
                   "sha256": f"{number:064x}"},
        "quality": {"figures": {"residual_mean_deg": 0.01 * (number % 100)}},
    })  # fmt: skip


STEPS: dict[str, Callable[[Path, int], object]] = {
    "write": lambda path, n: write_manifest(path, HEAD, [_clip(number) for number in range(n)]),
    "read": lambda path, _: read_manifest(path),
    "check": lambda path, _: check_manifest(path, files=False),
}


def measured(n: int, root: Path) -> dict[str, float]:
    """Wall time [s] and largest memory [MiB] of each step, in a process of its own."""
    path = root / f"{n}.yaml"
    row: dict[str, float] = {"clips": n}
    for name in STEPS:
        command = [sys.executable, __file__, name, str(path), str(n)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        row[f"{name}_s"], row[f"{name}_mib"] = json.loads(done.stdout)
    row["file_mib"] = round(path.stat().st_size / 2**20, 1)
    return row


def main(name: str, path: Path, n: int) -> None:
    """Do one step, and say what it took."""
    begin_s = time.perf_counter()
    STEPS[name](path, n)
    status = Path("/proc/self/status").read_text()
    most = re.search(r"VmHWM:\s+(\d+)", status)
    assert most is not None
    seconds, mib = time.perf_counter() - begin_s, int(most[1]) / 1024
    sys.stdout.write(json.dumps([round(seconds, 2), round(mib)]))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]))
