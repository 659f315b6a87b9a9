"""The contact sheet of masks."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.pages.frames import TINT_BGR, make_mask_sheet, mask_sheet
from gmrdata.values.errors import BadFrames


@pytest.fixture
def grey_dirs(tmp_path: Path) -> tuple[Path, Path]:
    """Six grey frames of 80x40 with the left half masked."""
    images_dir, masks_dir = tmp_path / "frames", tmp_path / "masks"
    images_dir.mkdir()
    masks_dir.mkdir()
    mask = np.zeros((40, 80), np.uint8)
    mask[:, :40] = 255
    for i in range(6):
        cv2.imwrite(str(images_dir / f"{i:02d}.png"), np.full((40, 80, 3), 100, np.uint8))
        cv2.imwrite(str(masks_dir / f"{i:02d}.png"), mask)
    return images_dir, masks_dir


def test_the_masked_part_is_tinted_and_the_rest_left(grey_dirs: tuple[Path, Path]) -> None:
    sheet = mask_sheet(*grey_dirs, n_frames=5, tile_width_px=80)
    assert sheet.shape == (2 * 40 + 4, 4 * 80 + 3 * 4, 3)  # four to a row, 4 px apart
    expected = np.round(0.65 * 100 + 0.35 * np.array(TINT_BGR))
    np.testing.assert_array_equal(sheet[20, 20], expected)
    np.testing.assert_array_equal(sheet[20, 60], [100, 100, 100])
    assert sheet[20, 39].min() > 200  # the outline
    np.testing.assert_array_equal(sheet[50:70, 100:], np.full((20, 232, 3), 255))


def test_it_is_made_anew_when_masks_change(grey_dirs: tuple[Path, Path], tmp_path: Path) -> None:
    first = make_mask_sheet(*grey_dirs, tmp_path / "sheet").read_bytes()
    cv2.imwrite(str(grey_dirs[1] / "00.png"), np.zeros((40, 80), np.uint8))
    assert make_mask_sheet(*grey_dirs, tmp_path / "sheet").read_bytes() != first


def test_a_missing_mask_is_an_error(grey_dirs: tuple[Path, Path], tmp_path: Path) -> None:
    (grey_dirs[1] / "05.png").unlink()
    with pytest.raises(BadFrames, match=r"no mask for 05\.png"):
        make_mask_sheet(*grey_dirs, tmp_path / "sheet")
