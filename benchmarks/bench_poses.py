"""Measure the built-in local poses on rendered people whose motions nothing was trained on.

`make bench-poses` runs this file alone; `--small` tries every part on one clip.  Twelve clips of
CMU's subjects 02 and 08 are rendered once and kept in out/bench/pose_clips.  Local poses are scored
frame by frame, and what `gmrdata video` makes of them in the world as one path a clip; a clip that
its verdict rejects counts, and is named.  Prints tables and writes out/bench/poses.json.
"""

import shutil
from dataclasses import asdict
from pathlib import Path

import pytest
from poses.clips import make_pose_clips
from poses.score import PoseRow, means, pose_row
from poses.world import WorldRow, solve, world_figures, world_row
from record import OUT_DIR, Record, at_most, machine
from render.tables import show

pytestmark = pytest.mark.bench
WORK_DIR = (OUT_DIR / "poses").resolve()
MOST_PA_MPJPE_MM, MOST_WA_MPJPE_MM, MOST_RTE_PERCENT = 75.0, 130.0, 5.0
MOST_STATIC_RATIO, MOST_PLACEMENT_RATIO = 0.7, 1.0


@pytest.fixture(scope="module")
def record(request: pytest.FixtureRequest) -> Record:
    if not request.config.getoption("--resume"):
        shutil.rmtree(WORK_DIR, ignore_errors=True)
    WORK_DIR.mkdir(parents=True, exist_ok=True)
    return Record(OUT_DIR / "poses.json", request.config.getoption("--small"), machine)


@pytest.fixture(scope="module")
def clips(record: Record, cmu_dir: Path) -> list[Path]:
    """The rendered clips; one of them where only the parts are tried."""
    return make_pose_clips((OUT_DIR / "pose_clips").resolve(), cmu_dir, small=record.small)


def test_own_poses(record: Record, clips: list[Path], shared_data: Path) -> None:
    models_dir = shared_data / "models"
    rows: list[PoseRow] = []
    in_world: list[WorldRow] = []
    nowhere: list[str] = []
    for clip in clips:
        work_dir = WORK_DIR / clip.name
        verdict = solve(clip, work_dir, models_dir)
        rows.append(pose_row(clip, work_dir, models_dir))
        placed = world_row(clip, work_dir, verdict)
        if placed is None:
            nowhere.append(clip.name)
        else:
            in_world.append(placed)
    show("Local poses", [asdict(row) for row in rows])
    show("In the world", [asdict(row) for row in in_world])
    mean = means(rows)
    record.add(
        pa_mpjpe_mm=mean["fit_mm"],
        pa_mpjpe_raw_12_mm=mean["raw_mm"],
        clips=[asdict(row) for row in rows],
        worlds=[asdict(row) for row in in_world],
        rejected_clips=[row.clip for row in in_world if not row.accepted],
        clips_without_world=nowhere,
    )
    if record.small and not in_world:
        return
    figures = world_figures(in_world)
    record.add(**figures)
    record.hold(
        [
            at_most("pa_mpjpe_mm", mean["fit_mm"], MOST_PA_MPJPE_MM),
            at_most("wa_mpjpe_mm", figures["wa_mpjpe_mm"], MOST_WA_MPJPE_MM),
            at_most("rte_percent", figures["rte_percent"], MOST_RTE_PERCENT),
            at_most("static_camera_ratio", figures["static_camera_ratio"], MOST_STATIC_RATIO),
            at_most("placement_ratio", figures["placement_ratio"], MOST_PLACEMENT_RATIO),
            at_most("clips without a world", len(nowhere), 0),
        ]
    )
