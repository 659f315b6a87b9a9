"""Measure what becomes of any video: its lens, people of other systems, real clips, and the time.

`make bench-video` runs this file alone; `--small` tries every part on the first clips.  Twelve
clips are rendered once and kept in out/bench/video_clips.  `--clips FOLDER` holds real clips with
known cameras (real/layout.py) and lines of pictures of known lenses (video/lines.py), `--videos
FOLDER` real videos (video/real.py); what is not there is named and left out.  Prints tables and
writes out/bench/video.json.
"""

import shutil
from dataclasses import asdict
from pathlib import Path

import pytest
from real.clips import FACTS_FILE, RealClip
from record import OUT_DIR, Record, at_least, at_most, machine
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
    WRONG_FACTORS,
    KnownLens,
    dancer_lens,
    focal_figures,
    focal_row,
    rendered_lens,
    wrong_focal_row,
)
from video.lines import (
    LEAST_LINES_IN_1_SIGMA,
    LEAST_LINES_IN_2_SIGMA,
    LEAST_TOLD,
    MOST_LINES_ERROR_PERCENT,
    lines_rows,
)
from video.real import CLIPS, missing, real_figures, real_rows
from video.speed import MOST_BYTES, MOST_S, seconds_10s_720p

pytestmark = pytest.mark.bench
WRONG_FOCAL_CLIPS = (
    "courtyard_circular",
    "park_linear",
    "courtyard_linear",
    "park_beside",
    "dancer",
)
WORK_DIR = (OUT_DIR / "video").resolve()


@pytest.fixture(scope="module")
def record(request: pytest.FixtureRequest) -> Record:
    shutil.rmtree(WORK_DIR, ignore_errors=True)
    WORK_DIR.mkdir(parents=True)
    return Record(OUT_DIR / "video.json", request.config.getoption("--small"), machine)


@pytest.fixture(scope="module")
def clips(record: Record) -> list[Path]:
    """The rendered clips; two of them where only the parts are tried."""
    return make_video_clips((OUT_DIR / "video_clips").resolve(), small=record.small)


@pytest.fixture(scope="module")
def lenses(
    record: Record, clips: list[Path], request: pytest.FixtureRequest
) -> dict[str, KnownLens]:
    """The rendered clips, and the dancer where it is there."""
    known = [rendered_lens(clip) for clip in clips]
    dancer = (request.config.getoption("--clips") or OUT_DIR / "clips") / "dance"
    if (dancer / FACTS_FILE).is_file() and not record.small:
        known.append(dancer_lens(RealClip(dancer)))
    return {lens.name: lens for lens in known}


def test_focal_length(record: Record, lenses: dict[str, KnownLens]) -> None:
    rows = [focal_row(lens, WORK_DIR / "focal" / name) for name, lens in lenses.items()]
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


def test_wrong_focal_lengths(record: Record, lenses: dict[str, KnownLens]) -> None:
    folder = WORK_DIR / "wrong_focal"
    rows = [
        wrong_focal_row(lenses[name], factor, folder / f"{name}_{factor:g}")
        for name in WRONG_FOCAL_CLIPS
        if name in lenses
        for factor in WRONG_FACTORS
    ]
    show("A wrong focal length that is given", [asdict(row) for row in rows])
    certified = sum(row.certified for row in rows)
    record.add(wrong_focal_certified=certified, wrong_focal_clips=[asdict(row) for row in rows])
    record.hold(
        [
            at_least("wrong ones where the frames show it", sum(r.observable for r in rows), 8),
            at_most("of which pass", certified, 0),
        ]
    )


def test_focal_length_by_lines(record: Record, request: pytest.FixtureRequest) -> None:
    folder = request.config.getoption("--clips") or OUT_DIR / "clips"
    rows = dict(lines_rows(folder, small=record.small))
    show("Straight lines", [{"set": name} | asdict(row) for name, row in rows.items()])
    record.add(focal_by_lines={name: asdict(row) for name, row in rows.items()})
    record.hold([at_least("sets of lines", len(rows), 2)])
    for name, row in rows.items():
        error = row.error_percent_median
        record.hold(
            [
                at_least(f"{name}: share that tells", row.told, LEAST_TOLD),
                at_most(f"{name}: focal error, median [%]", error, MOST_LINES_ERROR_PERCENT),
                at_least(f"{name}: share within 1 sigma", row.in_1_sigma, LEAST_LINES_IN_1_SIGMA),
                at_least(f"{name}: within 2 sigma", row.in_2_sigma, LEAST_LINES_IN_2_SIGMA),
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
