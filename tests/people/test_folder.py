"""Masks made by others."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.people.folder import FolderMaskConfig, folder_masks
from gmrdata.read.frames import read_gray
from gmrdata.values.errors import BadFrames, MissingInput


@pytest.fixture
def images_dir(tmp_path: Path) -> Path:
    folder = tmp_path / "frames"
    folder.mkdir()
    for i in range(2):
        cv2.imwrite(str(folder / f"{i:05d}.jpg"), np.full((30, 40, 3), 100, np.uint8))
    return folder


def put_masks(folder: Path, name: str, masked_value: int) -> np.ndarray:
    """Masks with one dynamic rectangle; the rectangle as (H, W) bool."""
    folder.mkdir()
    dynamic = np.zeros((30, 40), dtype=bool)
    dynamic[5:12, 20:33] = True
    for i in range(2):
        mask = np.where(dynamic, masked_value, 255 - masked_value).astype(np.uint8)
        cv2.imwrite(str(folder / name.format(f"{i:05d}")), mask)
    return dynamic


@pytest.mark.parametrize("name", ["{}.png", "{}.jpg.png"])
@pytest.mark.parametrize("masked_value", [0, 255])
def test_both_senses_and_namings_become_ours(
    name: str, masked_value: int, images_dir: Path, tmp_path: Path
) -> None:
    dynamic = put_masks(tmp_path / "masks", name, masked_value)
    config = FolderMaskConfig.model_validate({"masked_value": masked_value})
    out_dir = folder_masks(tmp_path / "masks", images_dir, tmp_path / "out", config)
    for stem in ("00000", "00001"):
        assert np.array_equal(read_gray(out_dir / f"{stem}.png"), 255 * dynamic)


def test_masks_are_widened_by_a_disc(images_dir: Path, tmp_path: Path) -> None:
    dynamic = put_masks(tmp_path / "masks", "{}.png", 255)
    config = FolderMaskConfig(dilate_px=3)
    out_dir = folder_masks(tmp_path / "masks", images_dir, tmp_path / "out", config)
    mask = read_gray(out_dir / "00000.png") > 0
    rows, columns = np.nonzero(dynamic)
    y, x = np.mgrid[:30, :40]
    nearest = np.min(np.hypot(y[..., None] - rows, x[..., None] - columns), axis=-1)
    assert mask[nearest <= 2.5].all() and not mask[nearest > 3.5].any()


def test_a_missing_mask_is_an_error(images_dir: Path, tmp_path: Path) -> None:
    put_masks(tmp_path / "masks", "{}.png", 255)
    (tmp_path / "masks" / "00001.png").unlink()
    with pytest.raises(BadFrames, match=r"no mask for 00001\.jpg; expected 00001\.png or"):
        folder_masks(tmp_path / "masks", images_dir, tmp_path / "out", FolderMaskConfig())
    assert not (tmp_path / "out").exists()


def test_a_mask_of_another_size_is_an_error(images_dir: Path, tmp_path: Path) -> None:
    put_masks(tmp_path / "masks", "{}.png", 255)
    cv2.imwrite(str(tmp_path / "masks" / "00001.png"), np.zeros((40, 30), np.uint8))
    with pytest.raises(BadFrames, match=r"00001\.png: 30x40 px, its frame is 40x30 px"):
        folder_masks(tmp_path / "masks", images_dir, tmp_path / "out", FolderMaskConfig())


def test_a_missing_folder_is_an_error(images_dir: Path, tmp_path: Path) -> None:
    with pytest.raises(MissingInput, match="masks"):
        folder_masks(tmp_path / "masks", images_dir, tmp_path / "out", FolderMaskConfig())
