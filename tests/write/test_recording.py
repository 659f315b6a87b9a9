"""Recordings, opened again by rerun's own reader."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gmrdata.values.body import PARENTS
from gmrdata.values.errors import BadFrames, BadMotionFile, MissingExtra
from gmrdata.values.skinning import motion_joints_m, motion_vertices_m
from gmrdata.write.recording import write_recording
from gmrdata.write.take import Take
from tests.write.rerun_files import Recorded
from tests.write.takes import HIDDEN, INTRINSICS_PX, N_FRAMES, SIZE_PX, save_turned

Files = tuple[list[Path | None], list[Path | None]]
SHOWN_FROM_WORLD = np.array([[0.0, -1, 0, 2], [1, 0, 0, 3], [0, 0, 1, 0.5], [0, 0, 0, 1]])


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> Files:
    """A frame and a mask for each row but the last."""
    folder, rng = tmp_path_factory.mktemp("frames"), np.random.default_rng(0)
    images: list[Path | None] = []
    masks: list[Path | None] = []
    for row in range(N_FRAMES - 1):
        images.append(folder / f"{row:05d}.jpg")
        masks.append(folder / f"{row:05d}.png")
        picture = rng.integers(0, 255, (SIZE_PX[1], SIZE_PX[0], 3), dtype=np.uint8)
        cv2.imwrite(str(images[-1]), picture)
        mask = np.zeros(SIZE_PX[::-1], np.uint8)
        mask[10:30, 20 : 40 + row] = 255
        cv2.imwrite(str(masks[-1]), mask)
    return [*images, None], [*masks, None]


@pytest.fixture(scope="module")
def recording(take, files, tmp_path_factory) -> Recorded:
    path = tmp_path_factory.mktemp("rrd") / "take.rrd"
    write_recording(
        path,
        [replace(take, name="result", points_m=np.eye(3)), take],
        shown_from_world={"truth": SHOWN_FROM_WORLD},
        images=files[0],
        masks=files[1],
    )
    return Recorded(path)


def test_bodies_are_where_ours_are(recording, take):
    for person in take.people:
        entity = f"world/truth/{person.name}"
        joints_m = motion_joints_m(person.body, person.motion)
        vertices_m = motion_vertices_m(person.body, person.motion)
        joints = recording.values(f"{entity}/joints", "Points3D:positions")
        skin = recording.values(f"{entity}/body", "Mesh3D:vertex_positions")
        bones = recording.values(f"{entity}/bones", "LineStrips3D:strips")
        shown = np.flatnonzero(person.shown).tolist()
        assert sorted(joints) == sorted(skin) == sorted(bones) == shown
        for row in shown:
            np.testing.assert_allclose(joints[row], joints_m[row], atol=1e-6)
            np.testing.assert_allclose(skin[row], vertices_m[row], atol=1e-6)
            ends_m = joints_m[row][list(enumerate(PARENTS))[1:]]
            np.testing.assert_allclose(bones[row], ends_m, atol=1e-6)
        (faces,) = recording.values(f"{entity}/body", "Mesh3D:triangle_indices").values()
        assert np.array_equal(faces, person.body.faces)


def test_what_is_not_known_is_not_shown(recording):
    """A viewer goes on showing what was logged last, until it is cleared."""
    everywhere = set(range(N_FRAMES))
    for part, component in (
        ("second/joints", "Points3D:positions"),
        ("second/body", "Mesh3D:vertex_positions"),
        ("second/bones", "LineStrips3D:strips"),
    ):
        shown = recording.shown(f"world/truth/{part}", component, N_FRAMES)
        assert everywhere - shown == set(HIDDEN)
    for entity in ("world/result/camera", "world/truth/camera"):
        shown = recording.shown(f"{entity}/image", "Pinhole:image_from_camera", N_FRAMES)
        assert everywhere - shown == {HIDDEN[-1]}
        shown = recording.shown(entity, "Transform3D:mat3x3", N_FRAMES)
        assert everywhere - shown == {HIDDEN[-1]}
    shown = recording.shown("world/result/camera/image", "EncodedImage:blob", N_FRAMES)
    assert everywhere - shown == {N_FRAMES - 1}


def test_the_camera_is_ours(recording, take):
    camera = take.camera
    assert camera is not None
    for name in ("result", "truth"):
        entity = f"world/{name}/camera"
        found = recording.transforms(entity)
        lenses = recording.values(f"{entity}/image", "Pinhole:image_from_camera")
        sizes = recording.values(f"{entity}/image", "Pinhole:resolution")
        assert sorted(found) == sorted(lenses) == np.flatnonzero(camera.has_camera).tolist()
        for row in found:
            np.testing.assert_allclose(found[row], camera.world_from_cam[row], atol=1e-6)
            np.testing.assert_allclose(lenses[row][0], INTRINSICS_PX.T.ravel(), atol=1e-5)
            assert sizes[row][0] == list(SIZE_PX)
    np.testing.assert_allclose(recording.transforms("world/truth")[None], SHOWN_FROM_WORLD)


def test_frames_and_masks_are_the_files(recording, files):
    entity = "world/result/camera/image"
    blobs = recording.values(entity, "EncodedImage:blob")
    masks = recording.values(f"{entity}/mask", "SegmentationImage:buffer")
    assert sorted(blobs) == sorted(masks) == list(range(N_FRAMES - 1))
    for row, (image, mask) in enumerate(zip(*files, strict=True)):
        if image is None or mask is None:
            continue
        assert bytes(blobs[row][0]) == image.read_bytes()
        pixels = np.array(masks[row][0], np.uint8).reshape(SIZE_PX[::-1])
        assert np.array_equal(255 * pixels, cv2.imread(str(mask), cv2.IMREAD_GRAYSCALE))
    assert "world/truth/camera/image/mask" not in recording.entities()


def test_times_are_the_frames_over_their_rate(recording):
    times_s = recording.times_s("world/result/person/joints", "Points3D:positions")
    assert list(times_s) == list(range(N_FRAMES))
    np.testing.assert_allclose(list(times_s.values()), np.arange(N_FRAMES) / 29.97, atol=1e-6)


def test_frames_without_a_camera_are_there(take, files, tmp_path):
    write_recording(
        tmp_path / "a.rrd", [replace(take, camera=None)], images=files[0], masks=files[1]
    )
    recorded, entity = Recorded(tmp_path / "a.rrd"), "world/truth/camera/image"
    assert len(recorded.values(entity, "EncodedImage:blob")) == N_FRAMES - 1
    assert len(recorded.values(f"{entity}/mask", "SegmentationImage:buffer")) == N_FRAMES - 1
    assert not recorded.values(entity, "Pinhole:image_from_camera")


def test_what_cannot_be_written_is_said(take, files, tmp_path, monkeypatch):
    images, masks = files
    small = tmp_path / "small" / "00000.jpg"
    small.parent.mkdir()
    cv2.imwrite(str(small), np.zeros((48, 64, 3), np.uint8))
    smaller = [small, *[None] * (N_FRAMES - 1)]

    def refused(error: type[Exception], why: str, takes: list[Take], **seen: Any) -> None:
        with pytest.raises(error, match=why):
            write_recording(tmp_path / "bad.rrd", takes, **seen)

    refused(BadMotionFile, "nobody", [replace(take, people=())])
    refused(BadMotionFile, "a name of its own", [take, take])
    refused(BadFrames, "other numbers", [take], images=images[:3])
    refused(BadFrames, "64x48 px, but the camera has 160x96", [take], images=smaller)
    refused(BadFrames, "64x48 px, its frame is 160x96", [take], masks=smaller)
    monkeypatch.setitem(sys.modules, "rerun", None)
    refused(MissingExtra, "pip install rerun-sdk", [take], images=images, masks=masks)
    assert [file.name for file in tmp_path.iterdir()] == ["small"]


def test_an_image_that_exif_turns_is_recorded_as_it_is_seen(take, files, tmp_path):
    """Viewers show the pixels as they are stored."""
    turned = tmp_path / "00000.jpg"
    seen = np.zeros((SIZE_PX[1], SIZE_PX[0], 3), np.uint8)
    seen[:, : SIZE_PX[0] // 2] = 255
    cv2.imwrite(str(turned), seen)
    save_turned(turned)
    images = [turned, *files[0][1:]]
    write_recording(tmp_path / "take.rrd", [take], images=images)
    blobs = Recorded(tmp_path / "take.rrd").values("world/truth/camera/image", "EncodedImage:blob")
    content = np.array(blobs[0], np.uint8).ravel()
    shown = cv2.imdecode(content, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    assert shown.shape == seen.shape and np.abs(shown.astype(int) - seen).mean() < 5
