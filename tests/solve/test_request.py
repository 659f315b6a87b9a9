"""What is asked of a sequence, as its stages get it."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from gmrdata import solve_video
from gmrdata.read.frames import write_gray
from gmrdata.read.models import MODELS, POSE_LANDMARKS, QUICK_LANDMARKS, models_dir
from gmrdata.solve.request import FOLLOWED, SolveConfig
from gmrdata.stage.run import Run
from gmrdata.stage.store import StageRecord, run_stage
from gmrdata.values.errors import BadRecipe, StaleOutput
from gmrdata.values.records import Config
from gmrdata.world.bodies import BodiesConfig


@pytest.mark.parametrize(("poses", "network"), [("none", QUICK_LANDMARKS), (None, POSE_LANDMARKS)])
def test_cameras_alone_get_masks_by_the_quick_network(
    shared_path, tmp_path, monkeypatch, poses, network
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    models_dir().mkdir(parents=True)
    for model in MODELS:
        shutil.copy(shared_path(f"models/{model.name}"), models_dir())
    (tmp_path / "frames").mkdir()
    for number in range(3):
        write_gray(tmp_path / "frames" / f"{number}.png", np.full((48, 64), 128, np.uint8))
    solve_video(tmp_path / "frames", tmp_path / "out", poses=poses, fps_hz=30)
    record = StageRecord.of(tmp_path / "out" / FOLLOWED)
    assert record.inputs["landmarks"] == network.sha256
    assert_nothing_is_left_of_another_video(tmp_path / "frames", tmp_path / "out", poses)


def assert_nothing_is_left_of_another_video(frames: Path, out: Path, poses: str | None) -> None:
    """Now there are neither cameras nor people, and its own were exported as if they were."""
    folders = [out / name for name in ("sfm", "pseudo_gt")]
    for folder in folders:
        run_stage("other", folder, Config(), {}, lambda _: None)
    with pytest.raises(StaleOutput, match="--redo"):
        solve_video(frames, out, poses=poses, fps_hz=30)
    solve_video(frames, out, poses=poses, fps_hz=30, run=Run(redo=True))
    assert not any(folder.exists() for folder in folders)


@pytest.mark.parametrize("poses", [None, "own", "none"])
def test_rows_of_every_second_frame_are_of_a_systems_file(tmp_path, poses):
    """Own people of frame 10 were placed in frame 20, where only a part of the video was read."""
    config = SolveConfig(bodies=BodiesConfig(frames_per_row=2))
    with pytest.raises(BadRecipe, match="--poses-every is of another system's file"):
        solve_video(tmp_path / "walk.mp4", tmp_path / "out", poses=poses, config=config)
    assert not (tmp_path / "out").exists()
