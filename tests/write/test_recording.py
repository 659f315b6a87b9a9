"""Recordings, opened again by rerun's own reader."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gmrdata.values.body import PARENTS, BodyModel
from gmrdata.values.errors import BadFrames, BadMotionFile, MissingExtra
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_joints_m, motion_vertices_m
from gmrdata.write.recording import write_recording
from gmrdata.write.take import Take
from tests.write.takes import HIDDEN, INTRINSICS_PX, N_FRAMES, SIZE_PX, make_take

dataframe = pytest.importorskip("rerun.dataframe", reason="the reader of rerun 0.23 to 0.30")
SHOWN_FROM_WORLD = np.array([[0.0, -1, 0, 2], [1, 0, 0, 3], [0, 0, 1, 0.5], [0, 0, 0, 1]])


@pytest.fixture(scope="module")
def take(walk: Callable[..., Motion], small_body: BodyModel) -> Take:
    return replace(make_take(walk, small_body), points_m=np.eye(3))


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Path | None], list[Path | None]]:
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
def recording(
    take: Take,
    files: tuple[list[Path | None], list[Path | None]],
    tmp_path_factory: pytest.TempPathFactory,
) -> Any:
    path = tmp_path_factory.mktemp("rrd") / "take.rrd"
    write_recording(
        path,
        [replace(take, name="result"), take],
        shown_from_world={"truth": SHOWN_FROM_WORLD},
        images=files[0],
        masks=files[1],
    )
    return dataframe.load_recording(path)


def rows_of(
    recording: Any, column: str, timeline: str = "frame", *, held: bool = False
) -> dict[Any, Any]:
    """A component's values by time: what was logged then, or with `held` what a viewer shows."""
    view = recording.view(index=timeline, contents=column.partition(":")[0])
    if held:
        view = view.using_index_values(np.arange(N_FRAMES)).fill_latest_at()
    table = view.select().read_all().to_pydict()
    (name,) = [name for name in table if name.startswith(column)]
    return {at: value for at, value in zip(table[timeline], table[name], strict=True) if value}


def test_bodies_are_where_ours_are(recording: Any, take: Take) -> None:
    for person in take.people:
        entity = f"/world/truth/{person.name}"
        joints_m = motion_joints_m(person.body, person.motion)
        vertices_m = motion_vertices_m(person.body, person.motion)
        joints = rows_of(recording, f"{entity}/joints:Position3D")
        skin = rows_of(recording, f"{entity}/body:Position3D")
        bones = rows_of(recording, f"{entity}/bones:LineStrip3D")
        for row in np.flatnonzero(person.shown).tolist():
            np.testing.assert_allclose(joints[row], joints_m[row], atol=1e-6)
            np.testing.assert_allclose(skin[row], vertices_m[row], atol=1e-6)
            np.testing.assert_allclose(
                bones[row], joints_m[row][list(enumerate(PARENTS))[1:]], atol=1e-6
            )
    everywhere = set(range(N_FRAMES))
    for component in ("joints:Position3D", "body:Position3D", "bones:LineStrip3D"):
        shown = rows_of(recording, f"/world/truth/second/{component}", held=True)
        assert everywhere - shown.keys() == set(HIDDEN)
    kept = rows_of(recording, "/world/truth/second/body:TriangleIndices", held=True)
    assert np.array_equal(kept[N_FRAMES - 1], take.people[1].body.faces)


def test_the_camera_is_ours(recording: Any, take: Take) -> None:
    camera = take.camera
    assert camera is not None
    shown = rows_of(recording, "/world/result/camera/image:PinholeProjection", held=True)
    assert set(range(N_FRAMES)) - shown.keys() == {HIDDEN[-1]}
    for name in ("result", "truth"):
        entity = f"/world/{name}/camera"
        centres = rows_of(recording, f"{entity}:Translation3D")
        turns = rows_of(recording, f"{entity}:TransformMat3x3")
        lenses = rows_of(recording, f"{entity}/image:PinholeProjection")
        sizes = rows_of(recording, f"{entity}/image:Resolution")
        assert HIDDEN[-1] not in lenses.keys() | turns.keys()
        for row in np.flatnonzero(camera.has_camera).tolist():
            np.testing.assert_allclose(centres[row][0], camera.centres_world_m[row], atol=1e-6)
            columns = camera.world_from_cam[row, :3, :3].T.ravel()
            np.testing.assert_allclose(turns[row][0], columns, atol=1e-6)
            np.testing.assert_allclose(lenses[row][0], INTRINSICS_PX.T.ravel(), atol=1e-5)
            assert sizes[row][0] == list(SIZE_PX)
    placed = recording.view(index="frame", contents="/world/truth").select_static()
    moved_m = placed.read_all().to_pydict()["/world/truth:Translation3D"]
    np.testing.assert_allclose(moved_m[0][0], SHOWN_FROM_WORLD[:3, 3])


def test_frames_and_masks_are_the_files(
    recording: Any, files: tuple[list[Path | None], list[Path | None]]
) -> None:
    blobs = rows_of(recording, "/world/result/camera/image:Blob")
    masks = rows_of(recording, "/world/result/camera/image/mask:ImageBuffer")
    for row, (image, mask) in enumerate(zip(*files, strict=True)):
        if image is None or mask is None:
            assert row not in blobs and row not in masks
            continue
        assert bytes(blobs[row][0]) == image.read_bytes()
        pixels = np.array(masks[row][0], np.uint8).reshape(SIZE_PX[::-1])
        assert np.array_equal(255 * pixels, cv2.imread(str(mask), cv2.IMREAD_GRAYSCALE))
    assert "/world/truth/camera/image/mask:ImageBuffer" not in str(recording.schema())


def test_times_are_the_frames_over_their_rate(recording: Any) -> None:
    joints = rows_of(recording, "/world/result/person/joints:Position3D", "time")
    seconds = [at.total_seconds() for at in joints]
    np.testing.assert_allclose(seconds, np.arange(N_FRAMES) / 29.97, atol=1e-6)


def test_what_cannot_be_written_is_said(
    take: Take,
    files: tuple[list[Path | None], list[Path | None]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    images, masks = files
    path = tmp_path / "bad.rrd"
    with pytest.raises(BadMotionFile, match="nobody"):
        write_recording(path, [replace(take, people=())])
    with pytest.raises(BadFrames, match="other numbers"):
        write_recording(path, [take], images=images[:3])
    small = tmp_path / "small" / "00000.jpg"
    small.parent.mkdir()
    cv2.imwrite(str(small), np.zeros((48, 64, 3), np.uint8))
    with pytest.raises(BadFrames, match="64x48 px, but the camera has 160x96"):
        write_recording(path, [take], images=[small, *[None] * (N_FRAMES - 1)])
    with pytest.raises(BadFrames, match="64x48 px, its frame is 160x96"):
        write_recording(path, [take], masks=[small, *[None] * (N_FRAMES - 1)])
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingExtra, match=r"gmrdata\[view\]"):
        write_recording(path, [take], images=images, masks=masks)
    assert [file.name for file in tmp_path.iterdir()] == ["small"]
