"""Videos as frames, and videos that aren't."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.read.video import extract_video, is_video
from gmrdata.values.errors import BadFrames, MissingInput


def write_video(path: Path, n_frames: int) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10, (64, 48))
    for i in range(n_frames):
        writer.write(np.full((48, 64, 3), 20 * i, dtype=np.uint8))
    writer.release()
    return path


def test_every_frame_is_written_under_its_number(tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.mp4", 7)
    assert is_video(video) and not is_video(tmp_path)
    frames = extract_video(video, tmp_path / "frames")
    assert sorted(p.name for p in frames.glob("*.jpg")) == [f"{i:05d}.jpg" for i in range(7)]
    for i in range(7):
        assert abs(float(cv2.imread(str(frames / f"{i:05d}.jpg")).mean()) - 20 * i) < 4


@pytest.mark.parametrize("n_frames", [0, 1])
def test_fewer_than_two_frames_are_refused_and_leave_no_folder(
    tmp_path: Path, n_frames: int
) -> None:
    video = write_video(tmp_path / "a.mp4", n_frames)
    video.touch()
    with pytest.raises(BadFrames, match=f"{n_frames} frames could be read"):
        extract_video(video, tmp_path / "frames")
    assert not (tmp_path / "frames").exists()


def test_what_is_no_video_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(b"not a video at all")
    with pytest.raises(BadFrames, match="a.mp4"):
        extract_video(tmp_path / "a.mp4", tmp_path / "frames")
    with pytest.raises(MissingInput, match="no.mp4"):
        extract_video(tmp_path / "no.mp4", tmp_path / "frames")


def test_a_real_video(shared_path: Callable[[str], Path], tmp_path: Path) -> None:
    frames = extract_video(shared_path("video/dog.mp4"), tmp_path / "frames")
    images = sorted(frames.glob("*.jpg"))
    assert [p.stem for p in images] == [f"{i:05d}" for i in range(122)]
    assert cv2.imread(str(images[0])).shape == (720, 1280, 3)
