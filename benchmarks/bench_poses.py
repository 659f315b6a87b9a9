"""Measure the built-in local poses on rendered people whose motions nothing was trained on.

`make bench-poses` runs this file alone; `--small` tries every part on one clip.  Twelve clips of
CMU's subjects 02 and 08 are rendered once and kept in out/bench/pose_clips.  Prints tables and
writes out/bench/poses.json.
"""

import shutil
from dataclasses import asdict
from pathlib import Path

import pytest
from poses.clips import make_pose_clips
from poses.score import METHODS, PoseRow, means, pose_row
from record import Record, at_most, machine
from render.tables import show

pytestmark = pytest.mark.bench
OUT_DIR = Path("out/bench")
WORK_DIR = (OUT_DIR / "poses").resolve()
MOST_PA_MPJPE_MM = 75.0


@pytest.fixture(scope="module")
def record(request: pytest.FixtureRequest) -> Record:
    shutil.rmtree(WORK_DIR, ignore_errors=True)
    WORK_DIR.mkdir(parents=True)
    return Record(OUT_DIR / "poses.json", request.config.getoption("--small"), machine)


@pytest.fixture(scope="module")
def clips(record: Record, cmu_dir: Path) -> list[Path]:
    """The rendered clips; one of them where only the parts are tried."""
    return make_pose_clips((OUT_DIR / "pose_clips").resolve(), cmu_dir, small=record.small)


def test_local_poses(record: Record, clips: list[Path], shared_data: Path) -> None:
    rows: list[PoseRow] = []
    for clip in clips:
        rows.append(pose_row(clip, WORK_DIR / clip.name, shared_data / "models", METHODS))
    show("Local poses", [asdict(row) for row in rows])
    mean = means(rows)
    record.add(
        pa_mpjpe_mm=mean["lifter_mm"],
        pa_mpjpe_fit_mm=mean["fit_mm"],
        pa_mpjpe_lifter_fit_mm=mean["lifter_fit_mm"],
        pa_mpjpe_raw_12_mm=mean["raw_mm"],
        clips=[asdict(row) for row in rows],
    )
    record.hold([at_most("pa_mpjpe_mm", mean["lifter_mm"], MOST_PA_MPJPE_MM)])
