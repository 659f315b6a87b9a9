"""Folders of masks: those of others, and several as one; no frame goes unmasked in silence."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.people.folder import (
    RECORD_FILE,
    FolderMaskConfig,
    UnionConfig,
    folder_masks,
    unite_masks,
)
from gmrdata.read.frames import read_frames, read_gray
from gmrdata.values.errors import BadFrames, MissingInput

SIZE = (48, 64)
DYNAMIC = np.zeros(SIZE, dtype=bool)
DYNAMIC[5:12, 20:33] = True


def put(folder: Path, *masks: np.ndarray, name: str = "{}.png") -> Path:
    folder.mkdir()
    for i, mask in enumerate(masks):
        cv2.imwrite(str(folder / name.format(f"{i:05d}")), mask)
    return folder


def left_part(share: float) -> np.ndarray:
    mask = np.zeros(SIZE, np.uint8)
    mask[:, : round(64 * share)] = 255
    return mask


def top_part(share: float) -> np.ndarray:
    mask = np.zeros(SIZE, np.uint8)
    mask[: round(48 * share)] = 255
    return mask


@pytest.mark.parametrize("name", ["{}.png", "{}.png.png"])
@pytest.mark.parametrize("masked_value", [0, 255])
def test_both_senses_and_namings_become_ours(
    name: str, masked_value: int, noise_dir: Path, tmp_path: Path
) -> None:
    mask = np.where(DYNAMIC, masked_value, 255 - masked_value).astype(np.uint8)
    masks = put(tmp_path / "masks", *[mask] * 3, name=name)
    config = FolderMaskConfig.model_validate({"masked_value": masked_value})
    out_dir = folder_masks(masks, read_frames(noise_dir), tmp_path / "out", config)
    for stem in ("00000", "00001"):
        assert np.array_equal(read_gray(out_dir / f"{stem}.png"), 255 * DYNAMIC)


def test_masks_are_widened_by_a_disc(noise_dir: Path, tmp_path: Path) -> None:
    masks = put(tmp_path / "masks", *[DYNAMIC * np.uint8(255)] * 3)
    out_dir = folder_masks(
        masks, read_frames(noise_dir), tmp_path / "out", FolderMaskConfig(dilate_px=3)
    )
    mask = read_gray(out_dir / "00000.png") > 0
    rows, columns = np.nonzero(DYNAMIC)
    y, x = np.mgrid[:48, :64]
    nearest = np.min(np.hypot(y[..., None] - rows, x[..., None] - columns), axis=-1)
    assert mask[nearest <= 2.5].all() and not mask[nearest > 3.5].any()


Stage = Callable[[Path, Path, Path], Path]


def as_ours(masks: Path, images: Path, out: Path) -> Path:
    return folder_masks(masks, read_frames(images), out, FolderMaskConfig())


def as_one(masks: Path, images: Path, out: Path) -> Path:
    return unite_masks({"one": masks}, read_frames(images), out, UnionConfig())


@pytest.mark.parametrize("stage", [as_ours, as_one])
@pytest.mark.parametrize(
    ("masks", "error", "said"),
    [
        (None, MissingInput, "masks"),
        (
            [left_part(0.1)] * 2,
            BadFrames,
            r"masks: no mask for 00002\.png; expected 00002\.png or",
        ),
        (
            [left_part(0.1), left_part(0.1)[:40], left_part(0.1)],
            BadFrames,
            r"00001\.png: 64x40 px, its frame is 64x48 px",
        ),
    ],
)
def test_a_missing_folder_or_mask_and_one_of_another_size_are_named(
    stage: Stage,
    masks: list[np.ndarray] | None,
    error: type[Exception],
    said: str,
    noise_dir: Path,
    tmp_path: Path,
) -> None:
    if masks is not None:
        put(tmp_path / "masks", *masks)
    with pytest.raises(error, match=said):
        stage(tmp_path / "masks", noise_dir, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_pixel_is_masked_if_any_source_says_so(
    noise_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a = put(tmp_path / "a", left_part(0.25), left_part(0.5), left_part(0))
    b = put(tmp_path / "b", top_part(0.5), top_part(0), top_part(0))
    out_dir = unite_masks(
        {"one": a, "two": b}, read_frames(noise_dir), tmp_path / "out", UnionConfig()
    )
    united = [read_gray(out_dir / f"{i:05d}.png", (64, 48)) for i in range(3)]
    np.testing.assert_array_equal(united[0], np.maximum(left_part(0.25), top_part(0.5)))
    np.testing.assert_array_equal(united[1], left_part(0.5))
    assert not united[2].any()
    record = json.loads((out_dir / RECORD_FILE).read_text())
    assert record["sources"] == ["one", "two"]
    assert record["masked_share"]["00000"] == {"one": 0.25, "two": 0.5, "united": 0.625}
    assert (record["covered"], record["unmasked"]) == ([], ["00002"])
    said = " ".join(capsys.readouterr().err.split())
    assert "nothing is masked in frame 00002 (1 of 3). If somebody is to be seen there" in said


def test_a_mask_that_covers_everything_is_reported_with_the_frame(
    noise_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Neither covers too much alone, both together do.
    a = put(tmp_path / "a", left_part(0.1), left_part(0.5), left_part(0.5))
    b = put(tmp_path / "b", top_part(0), 255 - left_part(0.5), top_part(0.5))
    config = UnionConfig(max_masked_share=0.8)
    out_dir = unite_masks({"one": a, "two": b}, read_frames(noise_dir), tmp_path / "out", config)
    assert json.loads((out_dir / RECORD_FILE).read_text())["covered"] == ["00001"]
    first = capsys.readouterr().err
    assert "more than 80% of the picture is masked in frame 00001. Look" in " ".join(first.split())
    # It is said again by a run that finds everything done.
    unite_masks({"one": a, "two": b}, read_frames(noise_dir), tmp_path / "out", config)
    assert capsys.readouterr().err == first
