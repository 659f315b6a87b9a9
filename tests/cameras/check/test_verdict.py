"""A path solved again, how far two agree, and which are out of order."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.cameras import again
from gmrdata.cameras.again import AGAIN_FILE, AgainRecord, SolvedAgain, solve_again
from gmrdata.cameras.check.agreement import agreement, least_extent
from gmrdata.cameras.check.verdict import lens_notes, lens_reasons, turn_spread_deg
from gmrdata.cameras.files import (
    CAMERAS_FILE,
    Agreement,
    Geometry,
    SfmCameras,
    load_cameras,
    save_cameras,
)
from gmrdata.cameras.map.rotation_only import CELLS, FEWEST_FEATURES, covered_share
from gmrdata.cameras.match.keyframes import unit_rays
from gmrdata.cameras.match.matches import Matches, PairMatches
from gmrdata.cameras.recipe import CamerasVerdictConfig, SfmConfig
from gmrdata.cameras.reconstruct import reconstruct
from gmrdata.values.camera import CameraPath
from gmrdata.values.transforms import rigid
from tests.cameras.drawn_models import turning_by
from tests.reconstructions import lens
from tests.record_keys import assert_each_key_is_needed

N = 41
CONFIG = CamerasVerdictConfig()


def pan(degrees: float, geometry: Geometry = "rotation_only") -> SfmCameras:
    """A camera that turns evenly; its last row has none."""
    angles = np.deg2rad(degrees) * np.linspace(-0.5, 0.5, N)
    turns = Rotation.from_rotvec(angles[:, None] * [0.0, 1.0, 0.0]).as_matrix()
    cameras = np.concatenate([rigid(turns, np.zeros(3)), np.full((1, 4, 4), np.nan)])
    path = CameraPath(np.diag([900.0, 900, 1]), 1280, 720, cameras, np.arange(N + 1) < N)
    return SfmCameras(path, geometry, np.arange(N + 1), np.zeros(N + 1, dtype=bool))


def test_the_spread_of_turns_is_that_about_their_mean():
    assert turn_spread_deg(pan(60.0).path.world_from_cam) == pytest.approx(
        60 / np.sqrt(12), rel=0.06
    )
    assert turn_spread_deg(np.full((3, 4, 4), np.nan)) == 0


def test_a_wide_pan_with_a_guessed_lens_rejects_and_a_small_one_only_says_so():
    guess = lens("prior", 0.3)
    (reason,) = lens_reasons(pan(60.0), guess, CONFIG)
    assert reason.startswith("the focal length is known to ±30% only, so the camera's turns, 17.")
    assert "are to ±5." in reason and "--focal" in reason
    assert list(lens_reasons(pan(6.0), guess, CONFIG)) == []
    (note,) = lens_notes(pan(6.0), guess)
    assert "1088 px, is a guess to ±30%" in note and "turns are to ±0.5 degrees" in note


def test_points_hold_the_turns_of_a_camera_that_travels_unless_its_lens_is_a_guess():
    wide, known = pan(150.0, "full"), lens("self_calibrated", 0.05)
    assert list(lens_reasons(wide, known, CONFIG)) == lens_notes(wide, known) == []
    assert len(list(lens_reasons(pan(150.0), known, CONFIG))) == 1
    assert len(list(lens_reasons(wide, lens("prior", 0.3), CONFIG))) == 1


def test_what_speaks_against_a_given_lens_is_a_reason():
    given = lens("given", 0.01, ("the frames ask for 435 px, not 635",))
    assert list(lens_reasons(pan(5.0), given, CONFIG)) == ["the frames ask for 435 px, not 635"]


N_FRAMES = 20
TIME = np.linspace(0.0, 1.0, N_FRAMES)[:, None]


def path() -> np.ndarray:
    """A camera that goes 2 units to the side and turns by 30 degrees."""
    turns = Rotation.from_rotvec(np.deg2rad(30) * TIME * [0.0, 1.0, 0.0]).as_matrix()
    return rigid(turns, 2.0 * TIME * [1.0, 0.0, 0.0])


def elsewhere(cameras: np.ndarray) -> np.ndarray:
    """The same path in another world and unit."""
    moved = rigid(Rotation.from_rotvec([0.3, -2.0, 1.0]).as_matrix(), np.array([5.0, 1.0, 2.0]))
    other = moved @ cameras
    other[:, :3, 3] *= 3.7
    return other


def test_the_same_path_in_another_world_agrees_and_gaps_do_not_count():
    other = elsewhere(path())
    other[::2] = np.nan
    found = agreement(path(), other, 0.0)
    assert found is not None and found.cameras == N_FRAMES // 2
    assert found.turn_deg < 1e-6 and found.place_share < 1e-9


def test_another_turn_and_another_way_are_told_in_degrees_and_shares():
    turned = path()
    turned[:, :3, :3] @= Rotation.from_rotvec(np.deg2rad(6) * (TIME > 0.5) * [1, 0, 0]).as_matrix()
    found = agreement(path(), elsewhere(turned), 0.0)
    assert found is not None and found.turn_deg == pytest.approx(3.0, abs=0.01)
    bowed = path()
    bowed[:, 2, 3] += 0.4 * np.sin(np.pi * TIME[:, 0])
    found = agreement(path(), elsewhere(bowed), 0.0)
    spread = 0.4 * np.sin(np.pi * TIME[:, 0]).std() / 2.0
    assert found is not None and found.place_share == pytest.approx(spread, rel=0.03)
    backward = path()
    backward[:, :3, 3] *= -1
    found = agreement(path(), backward, 0.0)
    assert found is not None and found.place_share > 0.25


def test_a_camera_that_hardly_travels_need_not_have_a_path():
    rng = np.random.default_rng(0)
    shaky = [path() for _ in range(2)]
    for cameras in shaky:
        cameras[:, :3, 3] = rng.normal(0, 0.01, (N_FRAMES, 3))
    points = rng.normal([0.0, 0.0, 10.0], 0.1, (500, 3))
    least = least_extent(shaky[0], points, 0.1)
    assert least == pytest.approx(1.0, rel=0.05) and least_extent(shaky[0], points[:0], 0.1) == 0
    found = agreement(*shaky, least)
    assert found is not None and found.place_share < 0.03
    found = agreement(*shaky, 0.0)
    assert found is not None and found.place_share > 0.1


def test_too_few_common_cameras_say_nothing():
    few = path()
    few[3:] = np.nan
    assert agreement(path(), few, 0.0) is None


SIZE_PX = (640, 360)
INTRINSICS_PX = np.array([[500.0, 0, 320], [0, 500.0, 180], [0, 0, 1]])


def everywhere(rng: np.random.Generator) -> np.ndarray:
    """(N, 2) as many image points in each cell as it needs to show something."""
    corners = np.stack(np.meshgrid(np.arange(CELLS), np.arange(CELLS)), axis=-1).reshape(-1, 1, 2)
    inside = rng.uniform(0.05, 0.95, (CELLS**2, FEWEST_FEATURES, 2))
    return ((corners + inside) * SIZE_PX / CELLS).reshape(-1, 2)


def turned_px(image_px: np.ndarray, turn: np.ndarray) -> np.ndarray:
    seen = unit_rays(image_px, INTRINSICS_PX) @ turn.T @ INTRINSICS_PX.T
    return seen[:, :2] / seen[:, 2:]


def share(first_px: np.ndarray, second_px: np.ndarray, turn: np.ndarray, n_free: int) -> float:
    """Of two frames, each of whose features is matched."""
    turning = turning_by(np.array([np.eye(3), turn.T]), pairs_rows=[(0, 1)])
    same = np.repeat(np.arange(len(first_px))[:, None], 2, axis=1)
    pair = PairMatches(0, 1, same, "PANORAMIC")
    matches = Matches([first_px, second_px], [pair], [n_free, n_free])
    return covered_share(turning, matches, INTRINSICS_PX, SIZE_PX, 2.0)


@pytest.mark.parametrize("degrees", [0.0, 3.0, 25.0])
def test_a_camera_that_turns_explains_all_that_stays_in_sight(degrees):
    first_px = everywhere(np.random.default_rng(0))
    turn = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    assert share(first_px, turned_px(first_px, turn), turn, len(first_px)) == 1.0


def test_what_stays_while_all_else_moves_counts_by_its_part_of_the_picture():
    first_px = everywhere(np.random.default_rng(1))
    logo = (first_px < np.array(SIZE_PX) / [2, 4]).all(axis=1)
    second_px = first_px + np.where(logo, 0.0, 9.0)[:, None]
    assert share(first_px, second_px, np.eye(3), len(first_px)) == 1 / 8


def test_what_masks_cover_need_not_be_explained():
    first_px = everywhere(np.random.default_rng(2))
    masked = first_px[:, 0] > SIZE_PX[0] / 2
    first_px = np.concatenate([first_px[~masked], first_px[masked]])
    second_px = first_px + np.where(np.arange(len(first_px)) < (~masked).sum(), 0.0, 9.0)[:, None]
    assert share(first_px, second_px, np.eye(3), len(first_px)) == 0.5
    assert share(first_px, second_px, np.eye(3), int((~masked).sum())) == 1.0


def test_without_matched_neighbours_nothing_is_said():
    nobody = turning_by(np.tile(np.eye(3), (3, 1, 1)))
    matches = Matches([np.zeros((0, 2))] * 3, [PairMatches(0, 2, np.zeros((0, 2), int), "")])
    assert np.isnan(covered_share(nobody, matches, INTRINSICS_PX, SIZE_PX, 2.0))


SMALL = SfmConfig(max_features=400)
SOLVED = SolvedAgain("backward, the video", "full", Agreement(12, 0.1, 0.005), "")


@pytest.mark.slow
def test_a_filmed_pan_agrees_with_itself_and_not_with_another_turn(pan, tmp_path, monkeypatch):
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


def test_each_disagreement_is_a_reason_and_names_the_way():
    turned = SolvedAgain("backward, the video", "full", Agreement(12, 1.6, 0.01), "")
    lost = SolvedAgain("with another seed, the video", None, None, "no two frames match")
    record = AgainRecord(solutions=(SOLVED, turned, lost))
    turns, nothing = record.reasons(CONFIG)
    assert turns.startswith("backward, the video gives another path: the camera turns 1.6 degrees")
    assert nothing == "with another seed, the video gives no path to compare: no two frames match"


def test_the_record_needs_each_key(tmp_path):
    lost = SolvedAgain("backward", None, None, "no two frames match")
    assert_each_key_is_needed(AgainRecord(solutions=(SOLVED, lost)), tmp_path / AGAIN_FILE)


@pytest.mark.parametrize("n", [5, 6])
def test_the_ways_take_the_frames_they_say(n):
    rows = [way.rows(n).tolist() for way in again.WAYS]
    assert rows[0] == list(range(n))[::-1] and rows[1] == list(range(0, n, 2))
    assert rows[2] == rows[3] == list(range(n)) and len({way.seed for way in again.WAYS}) == 3
