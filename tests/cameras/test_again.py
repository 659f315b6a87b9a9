"""A video solved again: a filmed pan agrees with itself, and a path that does not is refused."""

from pathlib import Path
from typing import Any

import pytest
from scipy.spatial.transform import Rotation

from gmrdata.cameras import again
from gmrdata.cameras.again import AGAIN_FILE, AgainRecord, SolvedAgain, solve_again
from gmrdata.cameras.files import CAMERAS_FILE, Agreement, load_cameras, save_cameras
from gmrdata.cameras.recipe import CamerasVerdictConfig, SfmConfig
from gmrdata.cameras.reconstruct import reconstruct
from tests.record_keys import assert_each_key_is_needed

SMALL = SfmConfig(max_features=400)
CONFIG = CamerasVerdictConfig()
SOLVED = SolvedAgain("backward, the video", "full", Agreement(12, 0.1, 0.005), "")


def test_a_filmed_pan_agrees_with_itself_and_not_with_another_turn(
    pan: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames, masks = pan.taken(), pan.masks_dir
    sfm = reconstruct(frames, masks, pan.lens, tmp_path / "sfm", SMALL)
    out = solve_again(sfm, frames, masks, tmp_path / "again", SMALL)
    assert {path.name for path in out.iterdir()} == {AGAIN_FILE, "stage.json"}
    record = AgainRecord.read(out / AGAIN_FILE)
    assert [solved.geometry for solved in record.solutions] == ["rotation_only"] * 4
    cameras = [solved.agreement.cameras for solved in record.solutions if solved.agreement]
    assert cameras == [12, 6, 12, 12]
    assert list(record.reasons(CONFIG)) == []
    wider = load_cameras(sfm)
    turns = Rotation.from_matrix(wider.path.world_from_cam[:, :3, :3]).as_rotvec()
    wider.path.world_from_cam[:, :3, :3] = Rotation.from_rotvec(1.3 * turns).as_matrix()
    save_cameras(sfm / CAMERAS_FILE, wider)
    monkeypatch.setattr(again, "WAYS", again.WAYS[:1])
    out = solve_again(sfm, frames, masks, tmp_path / "wider_again", SMALL)
    (reason,) = AgainRecord.read(out / AGAIN_FILE).reasons(CONFIG)
    assert reason.startswith("backward, the video gives another path: the camera turns")


def test_each_disagreement_is_a_reason_and_names_the_way() -> None:
    turned = SolvedAgain("backward, the video", "full", Agreement(12, 1.6, 0.01), "")
    lost = SolvedAgain("with another seed, the video", None, None, "no two frames match")
    record = AgainRecord(solutions=(SOLVED, turned, lost))
    turns, nothing = record.reasons(CONFIG)
    assert turns.startswith("backward, the video gives another path: the camera turns 1.6 degrees")
    assert nothing == "with another seed, the video gives no path to compare: no two frames match"


def test_the_record_needs_each_key(tmp_path: Path) -> None:
    lost = SolvedAgain("backward", None, None, "no two frames match")
    assert_each_key_is_needed(AgainRecord(solutions=(SOLVED, lost)), tmp_path / AGAIN_FILE)


@pytest.mark.parametrize("n", [5, 6])
def test_the_ways_take_the_frames_they_say(n: int) -> None:
    rows = [way.rows(n).tolist() for way in again.WAYS]
    assert rows[0] == list(range(n))[::-1] and rows[1] == list(range(0, n, 2))
    assert rows[2] == rows[3] == list(range(n)) and len({way.seed for way in again.WAYS}) == 3
