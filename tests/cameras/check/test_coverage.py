"""How much of the picture a camera that only turns explains."""

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from gmrdata.cameras.map.rotation_only import CELLS, FEWEST_FEATURES, RotationOnly, covered_share
from gmrdata.cameras.match.keyframes import unit_rays
from gmrdata.cameras.match.matches import Matches, PairMatches

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
    rotmats = np.array([np.eye(3), turn.T])
    nothing = np.zeros(0)
    turning = RotationOnly(
        rotmats, np.ones(2, dtype=bool), nothing, nothing, np.array([[0, 1]]), csr_array((6, 6))
    )
    same = np.repeat(np.arange(len(first_px))[:, None], 2, axis=1)
    pair = PairMatches(0, 1, same, "PANORAMIC")
    matches = Matches([first_px, second_px], [pair], [n_free, n_free])
    return covered_share(turning, matches, INTRINSICS_PX, SIZE_PX, 2.0)


@pytest.mark.parametrize("degrees", [0.0, 3.0, 25.0])
def test_a_camera_that_turns_explains_all_that_stays_in_sight(degrees: float) -> None:
    first_px = everywhere(np.random.default_rng(0))
    turn = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    assert share(first_px, turned_px(first_px, turn), turn, len(first_px)) == 1.0


def test_what_stays_while_all_else_moves_counts_by_its_part_of_the_picture() -> None:
    first_px = everywhere(np.random.default_rng(1))
    logo = (first_px < np.array(SIZE_PX) / [2, 4]).all(axis=1)
    second_px = first_px + np.where(logo, 0.0, 9.0)[:, None]
    assert share(first_px, second_px, np.eye(3), len(first_px)) == 1 / 8


def test_what_masks_cover_need_not_be_explained() -> None:
    first_px = everywhere(np.random.default_rng(2))
    masked = first_px[:, 0] > SIZE_PX[0] / 2
    first_px = np.concatenate([first_px[~masked], first_px[masked]])
    second_px = first_px + np.where(np.arange(len(first_px)) < (~masked).sum(), 0.0, 9.0)[:, None]
    assert share(first_px, second_px, np.eye(3), len(first_px)) == 0.5
    assert share(first_px, second_px, np.eye(3), int((~masked).sum())) == 1.0


def test_without_matched_neighbours_nothing_is_said() -> None:
    nobody = RotationOnly(
        np.tile(np.eye(3), (3, 1, 1)), np.ones(3, dtype=bool), np.zeros(0), np.zeros(0),
        np.zeros((0, 2)), csr_array((9, 9)),
    )  # fmt: skip
    matches = Matches([np.zeros((0, 2))] * 3, [PairMatches(0, 2, np.zeros((0, 2), int), "")])
    assert np.isnan(covered_share(nobody, matches, INTRINSICS_PX, SIZE_PX, 2.0))
