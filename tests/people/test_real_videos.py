"""From real video to cameras: what moves is masked by the detector, the rest gives the path."""

import shutil
from pathlib import Path

import cv2
import pytest

from gmrdata.cameras.files import load_cameras, load_quality
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.reconstruct import reconstruct
from gmrdata.people.sources import MasksConfig, OnnxSource, make_masks
from gmrdata.read.frames import read_frames
from gmrdata.values.camera import Lens

pytestmark = pytest.mark.slow


def cameras_of(frames: Path, model: Path, focal_px: float, out: Path) -> Path:
    read = read_frames(frames)
    masks = make_masks(read, out / "masks", MasksConfig(sources=(OnnxSource(model=model),)))
    return reconstruct(read, masks, Lens.centred(focal_px, read.size_px), out / "sfm", SfmConfig())


def test_a_moving_camera_round_a_dog_gets_all_its_cameras(shared_path, yolox_nano, tmp_path):
    """Every sixth frame at 3/8 of its size; COLMAP's own calibration of this video gives 929 px."""
    (tmp_path / "frames").mkdir()
    video = cv2.VideoCapture(str(shared_path("video/dog.mp4")))
    for i in range(122):
        decoded, image = video.read()
        assert decoded
        if i % 6 == 0:
            small = cv2.resize(image, (480, 270), interpolation=cv2.INTER_AREA)
            cv2.imwrite(str(tmp_path / "frames" / f"{i // 6:05d}.jpg"), small)
    video.release()
    made = cameras_of(tmp_path / "frames", yolox_nano, 929 * 3 / 8, tmp_path)
    quality = load_quality(made)
    assert (quality.frames_with_camera, quality.frames) == (21, 21)
    assert quality.geometry == "full"
    assert quality.mean_reprojection_px < 1.0


def test_a_still_phone_with_people_in_view_has_no_invented_motion(
    shared_path, yolox_nano, tmp_path
):
    """Every third of the frames; the focal length is not known, and a usual one serves."""
    (tmp_path / "frames").mkdir()
    people_dir = shared_path("video/static_people")
    for i, path in enumerate(sorted(people_dir.glob("*.jpg"))[::3]):
        shutil.copy(path, tmp_path / "frames" / f"{i:05d}.jpg")
    made = cameras_of(tmp_path / "frames", yolox_nano, 900.0, tmp_path)
    cameras, quality = load_cameras(made), load_quality(made)
    assert (cameras.geometry, bool(cameras.path.has_camera.all())) == ("rotation_only", True)
    assert not cameras.path.world_from_cam[:, :3, 3].any()
    assert quality.mean_reprojection_px < 1.0
