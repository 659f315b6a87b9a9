"""Masks of several sources as one: no frame goes unmasked in silence."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.people.folder import RECORD_FILE, UnionConfig, unite_masks
from gmrdata.read.frames import read_gray
from gmrdata.values.errors import BadFrames, MissingInput

SIZE = (48, 64)


def put(folder: Path, *masks: np.ndarray) -> Path:
    folder.mkdir()
    for i, mask in enumerate(masks):
        cv2.imwrite(str(folder / f"{i:05d}.png"), mask)
    return folder


def left_part(share: float) -> np.ndarray:
    mask = np.zeros(SIZE, np.uint8)
    mask[:, : round(64 * share)] = 255
    return mask


def top_part(share: float) -> np.ndarray:
    mask = np.zeros(SIZE, np.uint8)
    mask[: round(48 * share)] = 255
    return mask


def test_a_pixel_is_masked_if_any_source_says_so(
    noise_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a = put(tmp_path / "a", left_part(0.25), left_part(0.5), left_part(0))
    b = put(tmp_path / "b", top_part(0.5), top_part(0), top_part(0))
    out_dir = unite_masks({"one": a, "two": b}, noise_dir, tmp_path / "out", UnionConfig())
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


def test_a_missing_mask_is_an_error_with_the_frame(noise_dir: Path, tmp_path: Path) -> None:
    a = put(tmp_path / "a", *[left_part(0.1)] * 3)
    b = put(tmp_path / "b", *[left_part(0.1)] * 2)
    with pytest.raises(BadFrames, match=r"b: no mask for 00002\.png"):
        unite_masks({"one": a, "two": b}, noise_dir, tmp_path / "out", UnionConfig())
    assert not (tmp_path / "out").exists()


def test_a_mask_of_another_size_is_an_error_with_the_frame(noise_dir: Path, tmp_path: Path) -> None:
    a = put(tmp_path / "a", left_part(0.1), left_part(0.1)[:40], left_part(0.1))
    with pytest.raises(BadFrames, match=r"00001\.png: 64x40 px, its frame is 64x48 px"):
        unite_masks({"one": a}, noise_dir, tmp_path / "out", UnionConfig())


def test_a_mask_that_covers_everything_is_reported_with_the_frame(
    noise_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Neither covers too much alone, both together do.
    a = put(tmp_path / "a", left_part(0.1), left_part(0.5), left_part(0.5))
    b = put(tmp_path / "b", top_part(0), 255 - left_part(0.5), top_part(0.5))
    config = UnionConfig(max_masked_share=0.8)
    out_dir = unite_masks({"one": a, "two": b}, noise_dir, tmp_path / "out", config)
    assert json.loads((out_dir / RECORD_FILE).read_text())["covered"] == ["00001"]
    first = capsys.readouterr().err
    assert "more than 80% of the picture is masked in frame 00001. Look" in " ".join(first.split())
    # It is said again by a run that finds everything done.
    unite_masks({"one": a, "two": b}, noise_dir, tmp_path / "out", config)
    assert capsys.readouterr().err == first


def test_a_missing_folder_is_named(noise_dir: Path, tmp_path: Path) -> None:
    with pytest.raises(MissingInput, match="none"):
        unite_masks({"one": tmp_path / "none"}, noise_dir, tmp_path / "out", UnionConfig())
