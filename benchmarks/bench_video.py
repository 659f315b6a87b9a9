"""Measure what becomes of any video: its lens, people of other systems, real clips, and the time.

`make bench-video` runs this file alone; `--small` tries every part on the first clips.  Twelve
clips are rendered once and kept in out/bench/video_clips.  `--clips FOLDER` holds real clips with
known cameras (real/layout.py), `--videos FOLDER` real videos (video/real.py); what is not there is
named and left out.  Prints tables and writes out/bench/video.json.
"""

import os
import platform
import shutil
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from real.clips import FACTS_FILE, RealClip
from record import Record, at_least, at_most
from render.tables import show
from video.bodies import (
    MOST_OME_DEG,
    MOST_PLACEMENT_PERCENT,
    MOST_TME_MM,
    bodies_figures,
    bodies_rows,
)
from video.clips import make_video_clips
from video.focal import (
    LEAST_IN_2_SIGMA,
    MOST_ERROR_PERCENT,
    MOST_K1_ERROR,
    dancer_row,
    focal_figures,
    rendered_row,
)
from video.real import CLIPS, missing, real_figures, real_rows
from video.speed import MOST_BYTES, MOST_S, seconds_10s_720p

pytestmark = pytest.mark.bench
OUT_DIR = Path("out/bench")
WORK_DIR = (OUT_DIR / "video").resolve()


@pytest.fixture(scope="module")
def record(request: pytest.FixtureRequest) -> Record:
    shutil.rmtree(WORK_DIR, ignore_errors=True)
    WORK_DIR.mkdir(parents=True)

    def settings() -> dict[str, Any]:
        load = round(os.getloadavg()[0], 1)
        return {"cores": os.cpu_count(), "load": load, "python": platform.python_version()}

    return Record(OUT_DIR / "video.json", request.config.getoption("--small"), settings)


@pytest.fixture(scope="module")
def clips(record: Record) -> list[Path]:
    """The rendered clips; two of them where only the parts are tried."""
    return make_video_clips((OUT_DIR / "video_clips").resolve(), small=record.small)


def test_focal_length(record: Record, clips: list[Path], request: pytest.FixtureRequest) -> None:
    rows = [rendered_row(clip, WORK_DIR / "focal" / clip.name) for clip in clips]
    dancer = (request.config.getoption("--clips") or OUT_DIR / "clips") / "dance"
    if (dancer / FACTS_FILE).is_file() and not record.small:
        rows.append(dancer_row(RealClip(dancer), WORK_DIR / "focal" / "dancer"))
    show("The lens, not told", [asdict(row) for row in rows])
    figures = focal_figures(rows)
    record.add(**figures)
    error, share = figures["focal_error_percent_median"], figures["focal_in_2_sigma_share"]
    k1 = figures["k1_error_max"]
    record.hold(
        [
            at_least("clips of known focal length", len(rows), 13),
            at_most("focal error, median [%]", error, MOST_ERROR_PERCENT),
            at_least("share within 2 sigma", share, LEAST_IN_2_SIGMA),
            at_most("error of k1", k1, MOST_K1_ERROR),
        ]
    )


def test_bodies_of_other_systems(record: Record, clips: list[Path]) -> None:
    rows = list(bodies_rows(clips, WORK_DIR / "bodies"))
    show("People of other systems", [asdict(row) for row in rows])
    figures = bodies_figures(rows)
    record.add(**figures)
    placement, ome = figures["placement_error_percent"], figures["bodies_ome_deg"]
    tme = figures["bodies_tme_mm"]
    record.hold(
        [
            at_most("placement [% of the distance]", placement, MOST_PLACEMENT_PERCENT),
            at_most("OME [deg]", ome, MOST_OME_DEG),
            at_most("TME [mm]", tme, MOST_TME_MM),
        ]
    )


def test_real_videos(record: Record, request: pytest.FixtureRequest, shared_data: Path) -> None:
    videos = request.config.getoption("--videos") or OUT_DIR / "videos"
    names = [name for name in CLIPS if name not in missing(videos)]
    names = names[:1] if record.small else names
    rows = list(real_rows(videos, WORK_DIR / "real", shared_data / "models", names))
    figures = real_figures(rows)
    record.add(**figures)
    show("Real videos", [{"clip": row.name, "wrong": row.wrong} for row in rows])
    record.hold(
        [
            at_least("real videos", len(rows), 8),
            at_most("wrong ones", figures["real_wrong"], 0),
        ]
    )


def test_ten_seconds(record: Record, shared_data: Path) -> None:
    models, dog = shared_data / "models", shared_data / "video" / "dog.mp4"
    figures = seconds_10s_720p(dog, models, WORK_DIR / "speed")
    record.add(**figures)
    show("300 frames of 1280x720 px", [figures])
    most_mib = MOST_BYTES / (1 << 20)
    record.hold(
        [
            at_most("wall time [s]", figures["seconds_10s_720p"], MOST_S),
            at_most("memory [MiB]", figures["most_memory_mib_10s_720p"], most_mib),
        ]
    )
