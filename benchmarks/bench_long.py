"""Measure how time and memory of each stage grow with the length of a video.

`make bench-long` runs this file alone: the dancer to and fro, by `--poses none` and with her, up to
2,496 frames; the same of half the size, which small frames take longer for, up to 10,000; a drawn
street without people, whose walk never comes back; and a film of the dancer to and fro, 1280x720
px, in one file of ten minutes and one of 42 s.
`--lengths 300 626` takes only these, `-k street` that alone; all of them take hours.  Each is
solved in a process of its own on one thread, but the films, on all.  Writes out/bench/long.json, in
which lengths of earlier runs stay.
"""

import json
import os
import shutil
import subprocess
import sys
import tarfile
from fractions import Fraction
from itertools import cycle, islice
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from long import street
from long.street import film_street
from record import OUT_DIR, Record, at_most, machine
from render.tables import show

from gmrdata.cameras.files import load_cameras
from gmrdata.cameras.frames import linked
from gmrdata.pages.solved_page import OVERLAY_FILE
from gmrdata.read.frames import read_color
from gmrdata.solve.request import SFM
from gmrdata.solve.verdict import OVERLAY, VERDICT_FILE, VideoVerdict
from gmrdata.values.camera import CameraPath
from gmrdata.values.files import write_bytes
from gmrdata.values.transforms import fit_similarity
from gmrdata.write.video import write_video

pytestmark = pytest.mark.bench
HERE = Path(__file__).parent
WORK_DIR = (OUT_DIR / "long").resolve()
LENGTHS = (300, 626, 1252, 2496, 5000, 10_000)
WHOLE_UPTO, DANCE_FRAMES, FOCAL_PX = 2496, 626, 717.06
LAP_FRAMES = 2 * DANCE_FRAMES
FILMS = {LAP_FRAMES: 1, 15 * LAP_FRAMES: 15}  # laps by frames: 42 s and ten minutes
FILM_ROWS = slice(283, 688)  # of 960: the lens's middle stays in the middle, and 16 to 9
FILM_PX = (1280, 720)
SMALL = "small dance"
KINDS = {"dance": "none", "dance with her": "own", SMALL: "none", "street": "none", "film": "own"}
MOST_EXPONENT, MOST_GB, MOST_ATE_MM, MOST_OPEN, MOST_VIDEO_MB = 1.1, 2.5, 6.5, 0.01, 8.0
MOST_GB_FRAMES = 10_000  # of longer ones the memory is but said
MOST_OF_LENGTH = 12.0  # seconds for a second of film


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
    if kind == "film":
        poses = lay_out("dance", shared_data, LAP_FRAMES)[1]
        path = write_film(folder.with_suffix(".mp4"), WORK_DIR / "whole", FILMS[n_frames])
        return path, np.tile(poses, (FILMS[n_frames], 1)), FOCAL_PX * FILM_PX[0] / 720
    half = kind == SMALL
    source = WORK_DIR / ("half" if half else "whole")
    with tarfile.open(shared_data / "video" / "dance.tar") as tar:
        poses = json.load(tar.extractfile("dance/metadata"))["poses"]  # type: ignore[arg-type]
        for row in range(DANCE_FRAMES):
            data = tar.extractfile(f"dance/rgbd/{row}.jpg").read()  # type: ignore[union-attr]
            write_bytes(source / f"{row}.jpg", _halved(data) if half else data)
    rows = [*range(DANCE_FRAMES), *reversed(range(DANCE_FRAMES))]
    chosen = list(islice(cycle(rows), n_frames))
    shutil.rmtree(folder, ignore_errors=True)
    named = {f"{number:05d}": source / f"{row}.jpg" for number, row in enumerate(chosen)}
    images, _ = linked(named, None, folder)
    return images[0].parent, np.array(poses)[chosen, 4:], FOCAL_PX / (2 if half else 1)


def write_film(path: Path, pictures: Path, laps: int) -> Path:
    """An mp4 of the dancer to and fro, so many times: one lap is encoded, and its packets come
    again."""
    rows = [*range(DANCE_FRAMES), *reversed(range(DANCE_FRAMES))]
    shots = (read_color(pictures / f"{row}.jpg")[FILM_ROWS, :, ::-1] for row in rows)
    large = (cv2.resize(shot, FILM_PX, interpolation=cv2.INTER_CUBIC) for shot in shots)
    lap = path.with_name("lap.mp4")
    write_video(large, lap, 30.0, quick=True)
    with av.open(str(path), "w") as film:
        for number in range(laps):
            with av.open(str(lap)) as source:
                stream = source.streams.video[0]
                out = film.streams.video[0] if number else film.add_stream_from_template(stream)
                apart = int(Fraction(LAP_FRAMES, 30) / (stream.time_base or 1)) * number
                for packet in source.demux(stream):
                    if packet.dts is not None and packet.pts is not None:
                        packet.dts, packet.pts = packet.dts + apart, packet.pts + apart
                        packet.stream = out
                        film.mux(packet)
    return path


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


@pytest.mark.parametrize(
    ("n_frames", "kind"),
    [(n, kind) for kind in ("dance", "dance with her") for n in LENGTHS if n <= WHOLE_UPTO]
    + [(n, kind) for kind in (SMALL, "street") for n in LENGTHS]
    + [(n, "film") for n in FILMS],
)
def test_length(
    record: Record, shared_data: Path, request: pytest.FixtureRequest, n_frames: int, kind: str
) -> None:
    asked = LENGTHS[:1] if record.small else request.config.getoption("--lengths")
    asked = asked or (*LENGTHS, *FILMS)
    if n_frames not in asked:
        pytest.skip("--lengths names others")
    frames_dir, true_m, focal_px = lay_out(kind, shared_data, n_frames)
    out_dir = WORK_DIR / f"{kind}_{n_frames}_solved"
    shutil.rmtree(out_dir, ignore_errors=True)
    given = [frames_dir, out_dir, shared_data / "models", focal_px, KINDS[kind]]
    command = [sys.executable, str(HERE / "long" / "solve.py"), *map(str, given)]
    threads = os.cpu_count() or 1 if kind == "film" else 1
    environment = os.environ | {"OMP_NUM_THREADS": str(threads)}
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, env=environment)
    stages = json.loads(done.stdout.splitlines()[-1])
    verdict = VideoVerdict.read(out_dir / VERDICT_FILE)
    row = {"kind": kind, "frames": n_frames, "accepted": verdict.accepted}
    row |= path_figures(load_cameras(out_dir / SFM).path, true_m)
    row["video_mb"] = (out_dir / OVERLAY / OVERLAY_FILE).stat().st_size / 1e6
    row["of_length"] = 30 * sum(one["wall_s"] for one in stages.values()) / n_frames
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
        limits = {"open_share": MOST_OPEN, "video_mb": MOST_VIDEO_MB}
        limits |= {} if kind == "street" else {"ate_mm": MOST_ATE_MM}
        limits |= {"of_length": MOST_OF_LENGTH} if kind == "film" else {}
        for name, limit in limits.items():
            bars.append(at_most(f"{kind}: {name}", max(run[name] for run in long), limit))
        most_gb = max(run["peak_gb"] for run in long if run["frames"] <= MOST_GB_FRAMES)
        bars.append(at_most(f"{kind}: peak_gb", most_gb, MOST_GB))
    if rows:
        show("Growth", rows)
    record.add(growth=rows)
    record.hold(bars)
