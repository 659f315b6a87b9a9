"""What is asked of a sequence, as its stages get it."""

import shutil

import numpy as np
import pytest

from gmrdata import solve_video
from gmrdata.read.frames import write_gray
from gmrdata.read.models import MODELS, POSE_LANDMARKS, QUICK_LANDMARKS, models_dir
from gmrdata.solve.request import FOLLOWED
from gmrdata.stage.store import StageRecord


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
