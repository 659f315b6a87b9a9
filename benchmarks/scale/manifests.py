"""Manifests of many clips: time and memory to write, read, check, and to get a first batch."""

import json
import subprocess
import sys
from pathlib import Path

N = (1000, 10_000, 100_000)  # clips

_WRITE = """
from gmrdata.manifest.current import Clip
from gmrdata.manifest.write import write_manifest
def clip(number):
    return Clip.model_validate({
        "id": f"c{number:06d}", "body": "anny", "fps_hz": 120.0, "n_frames": 400, "frame": "world",
        "licence": "CMU Graphics Lab Motion Capture Database: free for all uses, may not be resold",
        "source": {"dataset": "CMU", "sequence": "06_04"}, "translation_of": "smpl_transl",
        "camera_motion": "none", "kept": ({"start": 0, "stop": 400},),
        "arrays": {"path": f"clips/c{number:06d}/clip.npz", "size_bytes": 245774,
                   "sha256": f"{number:064x}"},
        "quality": {"figures": {"residual_mean_deg": 0.01 * (number % 100)}},
    })
work = lambda: write_manifest(path, name="many", version="1.0.0", description="d", kind="motions",
                              licence="l", clips=[clip(number) for number in range(n)])
"""
_READ = "from gmrdata.manifest.read import read_manifest\nwork = lambda: read_manifest(path)\n"
_CHECK = """
from gmrdata.manifest.check import check_manifest
work = lambda: check_manifest(path, files=False)
"""
_MEASURE = r"""
import json, re, time
begin_s = time.perf_counter()
work()
mib = int(re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())[1]) / 1024
print(json.dumps([round(time.perf_counter() - begin_s, 2), round(mib)]))
"""


def measured(n: int, root: Path) -> dict[str, float]:
    """Wall time [s] and largest memory [MiB] of each step, in a process of its own."""
    path = root / f"{n}.yaml"
    row: dict[str, float] = {"clips": n}
    for name, code in (("write", _WRITE), ("read", _READ), ("check", _CHECK)):
        row[f"{name}_s"], row[f"{name}_mib"] = _run(code, path, n)
    row["file_mib"] = round(path.stat().st_size / 2**20, 1)
    return row


def _run(code: str, path: Path, n: int) -> tuple[float, float]:
    head = f"from pathlib import Path\npath, n = Path({str(path)!r}), {n}\n"
    command = [sys.executable, "-c", head + code + _MEASURE]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    seconds, mib = json.loads(done.stdout)
    return seconds, mib
