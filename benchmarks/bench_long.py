"""Measure how time and memory of each stage grow with the length of a video.

`make bench-long` runs this file alone: the dancer to and fro, her whole path again and again, of
half the size from 5,000 frames on, by `--poses none` and with her.  `--lengths 300 626` takes only
these; all of them take hours.  Each is solved in a process of its own on one thread.  Writes
out/bench/long.json, in which lengths of earlier runs stay.
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
from record import Record, at_most, machine
from render.tables import show

from gmrdata.cameras.files import load_cameras
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
POSES = ("none", "own")
MOST_EXPONENT, MOST_GB, MOST_ATE_MM, MOST_OPEN, MOST_VIDEO_MB = 1.1, 2.5, 6.5, 0.01, 8.0


@pytest.fixture(scope="module")
def record(request: pytest.FixtureRequest) -> Record:
    WORK_DIR.mkdir(parents=True, exist_ok=True)
    path = OUT_DIR / "long.json"
    runs = json.loads(path.read_text()).get("runs", {}) if path.is_file() else {}
    return Record(path, request.config.getoption("--small"), machine, {"bars": [], "runs": runs})


def lay_out(archive: Path, n_frames: int) -> tuple[Path, np.ndarray]:
    """A folder of frames to and fro, and the true places (T, 3) of the camera [m]."""
    half = n_frames >= SMALL_FROM
    folder, size = WORK_DIR / f"frames_{n_frames}", "half" if half else "whole"
    source = WORK_DIR / f"dance_{size}"
    with tarfile.open(archive) as tar:
        poses = json.load(tar.extractfile("dance/metadata"))["poses"]  # type: ignore[arg-type]
        for row in range(DANCE_FRAMES):
            data = tar.extractfile(f"dance/rgbd/{row}.jpg").read()  # type: ignore[union-attr]
            write_bytes(source / f"{row}.jpg", _halved(data) if half else data)
    rows = [*range(DANCE_FRAMES), *reversed(range(DANCE_FRAMES))]
    chosen = list(islice(cycle(rows), n_frames))
    folder.mkdir(exist_ok=True)
    for number, row in enumerate(chosen):
        if not (path := folder / f"{number:05d}.jpg").exists():
            os.link(source / f"{row}.jpg", path)
    return folder, np.array(poses)[chosen, 4:]


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


@pytest.mark.parametrize("poses", POSES)
@pytest.mark.parametrize("n_frames", LENGTHS)
def test_length(
    record: Record, shared_data: Path, request: pytest.FixtureRequest, n_frames: int, poses: str
) -> None:
    asked = LENGTHS[:1] if record.small else request.config.getoption("--lengths") or LENGTHS
    if n_frames not in asked:
        pytest.skip("--lengths names others")
    frames_dir, true_m = lay_out(shared_data / "video" / "dance.tar", n_frames)
    out_dir = WORK_DIR / f"{poses}_{n_frames}"
    shutil.rmtree(out_dir, ignore_errors=True)
    focal_px = FOCAL_PX / 2 if n_frames >= SMALL_FROM else FOCAL_PX
    given = [frames_dir, out_dir, shared_data / "models", focal_px, poses]
    command = [sys.executable, str(HERE / "long" / "solve.py"), *map(str, given)]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, env=environment)
    stages = json.loads(done.stdout.splitlines()[-1])
    figures = path_figures(load_cameras(out_dir / SFM).path, true_m)
    verdict = VideoVerdict.read(out_dir / VERDICT_FILE)
    row = {"frames": n_frames, "people": poses == "own", "accepted": verdict.accepted, **figures}
    video_mb = (out_dir / OVERLAY / OVERLAY_FILE).stat().st_size / 1e6
    row |= {"peak_gb": max(one["peak_gb"] for one in stages.values()), "video_mb": video_mb}
    show(f"{n_frames} frames", [{"stage": name} | one for name, one in stages.items()])
    show("", [row])
    record.add(runs=record.content["runs"] | {f"{poses}_{n_frames}": row | {"stages": stages}})


def test_growth(record: Record) -> None:
    """Exponents of processor time by a fit over all lengths from 600 frames that were ever run."""
    runs, rows, bars = record.content["runs"].values(), [], []
    for with_people in (False, True):
        long = [run for run in runs if run["people"] == with_people and run["frames"] >= 600]
        if len(long) < 2:
            continue
        frames = np.log([run["frames"] for run in long])
        for stage in long[-1]["stages"]:
            seconds = np.log([run["stages"][stage]["cpu_s"] for run in long])
            exponent = float(np.polyfit(frames, seconds, 1)[0])
            rows.append({"stage": stage, "people": with_people, "exponent": exponent})
            if stage == SFM:
                bars.append(at_most(f"{stage}, people {with_people}", exponent, MOST_EXPONENT))
        bars += [
            at_most("peak_gb", max(run["peak_gb"] for run in long), MOST_GB),
            at_most("ate_mm", max(run["ate_mm"] for run in long), MOST_ATE_MM),
            at_most("open_share", max(run["open_share"] for run in long), MOST_OPEN),
            at_most("video_mb", max(run["video_mb"] for run in long), MOST_VIDEO_MB),
        ]
    show("Growth", rows)
    record.add(growth=rows)
    record.hold(bars)
