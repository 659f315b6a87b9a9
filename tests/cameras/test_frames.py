"""Frames are decoded once, as long as memory is meant to hold them."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gmrdata.cameras import frames as module
from gmrdata.cameras.files import load_cameras
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.reconstruct import reconstruct
from gmrdata.read.frames import list_images, read_gray


@pytest.fixture
def decoded(monkeypatch: pytest.MonkeyPatch) -> Counter[Path]:
    """How often each file was decoded."""
    count: Counter[Path] = Counter()

    def read(path: Path, size_px: tuple[int, int] | None = None) -> np.ndarray:
        count[path] += 1
        return read_gray(path, size_px)

    monkeypatch.setattr(module, "read_gray", read)
    return count


def test_the_stage_decodes_each_frame_once(
    dolly: Any, decoded: Counter[Path], tmp_path: Path
) -> None:
    reconstruct(dolly.taken(), None, dolly.lens, tmp_path / "sfm", SfmConfig())
    assert decoded == dict.fromkeys(list_images(dolly.images_dir), 1)


def test_what_memory_is_not_meant_to_hold_is_decoded_again(
    dolly: Any, decoded: Counter[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, most_bytes in {"all": 2**30, "few": 3 * 320 * 180}.items():
        monkeypatch.setattr(module, "MOST_KEPT_BYTES", most_bytes)
        reconstruct(dolly.taken(), None, dolly.lens, tmp_path / name, SfmConfig())
    images = list_images(dolly.images_dir)
    assert [decoded[image] for image in images[:3]] == [2, 2, 2] and decoded[images[3]] > 2
    all_kept, few_kept = (load_cameras(tmp_path / name).path for name in ("all", "few"))
    np.testing.assert_array_equal(all_kept.world_from_cam, few_kept.world_from_cam)


def test_some_of_the_frames_share_what_was_decoded(dolly: Any, decoded: Counter[Path]) -> None:
    frames = Frames(list_images(dolly.images_dir), None, dolly.intrinsics_px, (320, 180))
    some = frames.some(np.array([0, 2]))
    assert some.gray(some.images[1]) is frames.gray(frames.images[2])
    assert decoded == {frames.images[2]: 1}
