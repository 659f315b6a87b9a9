"""Measure how time and memory of each stage grow with the length of a video.

`make bench-long` runs this file alone: the dancer to and fro, of half the size from 5,000 frames
on, by `--poses none` and with her; and a drawn street without people, whose walk never comes back.
`--lengths 300 626` takes only these, `-k street` that alone; all of them take hours.  Each is
solved in a process of its own on one thread.  Writes out/bench/long.json, in which lengths of
earlier runs stay.
"""

import json
import os
import shutil
import subprocess
import sys
import tarfile
from itertools import cycle, islice
from pathlib import Path

import cv2
import numpy as np
import pytest
from long import street
from long.street import film_street
from record import Record, at_most, machine
from render.tables import show

from gmrdata.cameras.files import load_cameras
from gmrdata.cameras.frames import linked
from gmrdata.pages.solved_page import OVERLAY_FILE
from gmrdata.solve.request import SFM
from gmrdata.solve.verdict import VERDICT_FILE, VideoVerdict
from gmrdata.solve.videos import OVERLAY
from gmrdata.values.camera import CameraPath
from gmrdata.values.files import write_bytes
from gmrdata.values.transforms import fit_similarity

pytestmark = pytest.mark.bench
HERE = Path(__file__).parent
OUT_DIR = Path("out/bench")
WORK_DIR = (OUT_DIR / "long").resolve()
LENGTHS = (300, 626, 1252, 2496, 5000, 10_000)
SMALL_FROM, DANCE_FRAMES, FOCAL_PX = 5000, 626, 717.06
KINDS = {"dance": "none", "dance with her": "own", "street": "none"}
MOST_EXPONENT, MOST_GB, MOST_ATE_MM, MOST_OPEN, MOST_VIDEO_MB = 1.1, 2.5, 6.5, 0.01, 8.0


@pytest.fixture(scope="module")
def record(request: pytest.FixtureRequest) -> Record:
    WORK_DIR.mkdir(parents=True, exist_ok=True)
    path = OUT_DIR / "long.json"
    runs = json.loads(path.read_text()).get("runs", {}) if path.is_file() else {}
    return Record(path, request.config.getoption("--small"), machine, {"bars": [], "runs": runs})


def lay_out(kind: str, shared_data: Path, n_frames: int) -> tuple[Path, np.ndarray, float]:
    """A folder of frames, the true places (T, 3) of the camera [m], and the focal length [px]."""
    folder = WORK_DIR / f"{kind.split()[0]}_{n_frames}"
    if kind == "street":
        return folder, film_street(folder, n_frames)[:, :3, 3], street.FOCAL_PX
    half = n_frames >= SMALL_FROM
    source = WORK_DIR / ("half" if half else "whole")
    with tarfile.open(shared_data / "video" / "dance.tar") as tar:
        poses = json.load(tar.extractfile("dance/metadata"))["poses"]  # type: ignore[arg-type]
        for row in range(DANCE_FRAMES):
            data = tar.extractfile(f"dance/rgbd/{row}.jpg").read()  # type: ignore[union-attr]
            write_bytes(source / f"{row}.jpg", _halved(data) if half else data)
    rows = [*range(DANCE_FRAMES), *reversed(range(DANCE_FRAMES))]
    chosen = list(islice(cycle(rows), n_frames))
    shutil.rmtree(folder, ignore_errors=True)
    named = {f"{number:05d}.jpg": source / f"{row}.jpg" for number, row in enumerate(chosen)}
    return linked(folder, named), np.array(poses)[chosen, 4:], FOCAL_PX / (2 if half else 1)


def _halved(data: bytes) -> bytes:
    image = np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR))
    small = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    return bytes(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 95])[1])


def path_figures(path: CameraPath, true_m: np.ndarray) -> dict[str, float]:
    """How far the cameras are from the truth after a similarity, and how far those who stand in one
    place are apart at most, as a share of the way."""
    known = path.has_camera
    places, true_m = path.world_from_cam[known, :3, 3], true_m[known]
    fit = fit_similarity(true_m, places, scale=True)
    places_m = fit.scale * places @ fit.rotmat.T + fit.translation_m
    off_m = places_m - true_m
    way_m = np.linalg.norm(np.diff(true_m, axis=0), axis=1).sum()
    open_m = np.linalg.norm(np.ptp(off_m, axis=0)) if len(true_m) > DANCE_FRAMES else 0.0
    return {
        "cameras": float(known.mean()),
        "ate_mm": float(1e3 * np.sqrt((off_m**2).sum(axis=1).mean())),
        "open_share": float(open_m / way_m),
    }


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n_frames", LENGTHS)
def test_length(
    record: Record, shared_data: Path, request: pytest.FixtureRequest, n_frames: int, kind: str
) -> None:
    asked = LENGTHS[:1] if record.small else request.config.getoption("--lengths") or LENGTHS
    if n_frames not in asked:
        pytest.skip("--lengths names others")
    frames_dir, true_m, focal_px = lay_out(kind, shared_data, n_frames)
    out_dir = WORK_DIR / f"{kind}_{n_frames}_solved"
    shutil.rmtree(out_dir, ignore_errors=True)
    given = [frames_dir, out_dir, shared_data / "models", focal_px, KINDS[kind]]
    command = [sys.executable, str(HERE / "long" / "solve.py"), *map(str, given)]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, env=environment)
    stages = json.loads(done.stdout.splitlines()[-1])
    verdict = VideoVerdict.read(out_dir / VERDICT_FILE)
    row = {"kind": kind, "frames": n_frames, "accepted": verdict.accepted}
    row |= path_figures(load_cameras(out_dir / SFM).path, true_m)
    row["video_mb"] = (out_dir / OVERLAY / OVERLAY_FILE).stat().st_size / 1e6
    row["peak_gb"] = max(one["peak_gb"] for one in stages.values())
    show(f"{n_frames} frames", [{"stage": name} | one for name, one in stages.items()])
    show("", [row])
    record.add(runs=record.content["runs"] | {f"{kind}_{n_frames}": row | {"stages": stages}})


def test_growth(record: Record) -> None:
    """Exponents of processor time by a fit over all lengths from 600 frames that were ever run."""
    runs, rows, bars = record.content["runs"].values(), [], []
    for kind in KINDS:
        long = [run for run in runs if run["kind"] == kind and run["frames"] >= 600]
        if len(long) < 2:
            continue
        frames = np.log([run["frames"] for run in long])
        for stage in long[-1]["stages"]:
            seconds = np.log([run["stages"][stage]["cpu_s"] for run in long])
            exponent = float(np.polyfit(frames, seconds, 1)[0])
            rows.append({"kind": kind, "stage": stage, "exponent": exponent})
            if stage == SFM:
                bars.append(at_most(f"{kind}: exponent of {stage}", exponent, MOST_EXPONENT))
        limits = {"peak_gb": MOST_GB, "open_share": MOST_OPEN, "video_mb": MOST_VIDEO_MB}
        limits |= {} if kind == "street" else {"ate_mm": MOST_ATE_MM}
        for name, limit in limits.items():
            bars.append(at_most(f"{kind}: {name}", max(run[name] for run in long), limit))
    if rows:
        show("Growth", rows)
    record.add(growth=rows)
    record.hold(bars)
