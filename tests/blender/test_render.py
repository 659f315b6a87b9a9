"""Real renders: files, masks, equal bytes, and going on after a crash."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.film.render import RenderConfig
from gmrdata.film.scene import SceneConfig
from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.camera import intrinsics_from_fov
from gmrdata.values.clip import camera_of, load_clip
from gmrdata.values.errors import RenderFailed
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_vertices_m
from tests.blender.jobs import (
    Job,
    camera_at,
    circling,
    coverage,
    facing_x,
    in_blender,
    mask_of,
    n_features,
    overlap,
    save_job,
)
from tests.folders import bytes_of

N_FRAMES, WIDTH_PX, HEIGHT_PX = 4, 320, 180
CONFIG = RenderConfig(samples=4, scene=SceneConfig(seed=5))


def walking(body: BodyModel) -> Motion:
    """Four frames of someone who strides along x with the arms down."""
    local = np.tile(np.eye(3), (N_FRAMES, 23, 1, 1))
    swings_rad = 0.4 * np.cos(0.9 * np.arange(N_FRAMES))
    for side, sign in (("left", 1), ("right", -1)):
        local[:, JOINT[f"{side}_shoulder"] - 1] = Rotation.from_euler("z", -1.2 * sign).as_matrix()
        hips = Rotation.from_euler("x", sign * swings_rad[:, None])
        local[:, JOINT[f"{side}_hip"] - 1] = hips.as_matrix()
    return facing_x(body, [[0.13 * row + 3, -2.0, 0.95] for row in range(N_FRAMES)], local)


@pytest.fixture(scope="module")
def job(small_body, tmp_path_factory) -> Job:
    motion = walking(small_body)
    camera, valid = circling(motion, (WIDTH_PX, HEIGHT_PX)), np.array([1, 1, 0, 1], bool)
    return save_job(tmp_path_factory.mktemp("clip"), small_body, motion, camera, valid)


@pytest.fixture(scope="module")
def rendered(job, tmp_path_factory) -> Path:
    """An undisturbed render."""
    seen: list[int] = []
    out_dir = tmp_path_factory.mktemp("render") / "stride"
    job.render(out_dir, CONFIG, on_frame=seen.append)
    assert seen == list(range(N_FRAMES))
    return out_dir


def test_the_folder_holds_frames_masks_and_the_clip_and_nothing_else(rendered):
    names = [f"frames/{i:05d}.jpg" for i in range(N_FRAMES)]
    names += [f"masks/{i:05d}.png" for i in range(N_FRAMES)]
    assert sorted(bytes_of(rendered)) == sorted([*names, "clearance.json", "clip.npz"])
    for row in range(N_FRAMES):
        frame = cv2.imread(str(rendered / f"frames/{row:05d}.jpg"), cv2.IMREAD_UNCHANGED)
        mask = cv2.imread(str(rendered / f"masks/{row:05d}.png"), cv2.IMREAD_UNCHANGED)
        assert frame.shape == (HEIGHT_PX, WIDTH_PX, 3) and frame.dtype == np.uint8
        assert mask.shape == (HEIGHT_PX, WIDTH_PX) and set(np.unique(mask)) == {0, 255}
        assert frame.std() > 25  # there is something to see


def test_the_clip_is_the_one_that_went_in_with_blenders_camera(rendered, job):
    asked, got = load_clip(job.clip_path), load_clip(rendered / "clip.npz")
    assert asked.camera is not None and got.camera is not None
    assert got.id == asked.id and got.camera.has_camera.all()
    np.testing.assert_array_equal(got.image_numbers, np.arange(N_FRAMES))
    np.testing.assert_array_equal(got.valid, asked.valid)
    np.testing.assert_allclose(got.motion.pelvis_m, asked.motion.pelvis_m, atol=1e-9)
    np.testing.assert_allclose(got.camera.world_from_cam, asked.camera.world_from_cam, atol=2e-6)
    np.testing.assert_allclose(got.camera.intrinsics_px, asked.camera.intrinsics_px, rtol=1e-6)
    assert (got.camera.width_px, got.camera.height_px) == (WIDTH_PX, HEIGHT_PX)


def test_masks_are_the_projected_mesh(rendered, small_body):
    clip = load_clip(rendered / "clip.npz")
    vertices_m = motion_vertices_m(small_body, clip.motion)
    for row in range(N_FRAMES):
        mask = mask_of(rendered, row)
        expected = coverage(camera_of(clip), small_body, vertices_m[row], row) >= 0.5
        assert expected.sum() > 1000
        iou = overlap(mask, expected)
        assert iou > 0.97, f"frame {row}: IoU {iou:.4f}"
        for shift in ((0, 1), (0, -1), (1, 0), (-1, 0)):  # not even one pixel off
            assert overlap(mask, np.roll(expected, shift, axis=(0, 1))) < iou


def test_someone_at_the_other_end_of_a_long_lens_is_drawn(box_place, small_body, tmp_path):
    """Blender drew nothing that is farther than 500 m, and a recipe's camera may be."""
    motion = facing_x(small_body, [[0.0, 0.0, 0.95]])
    camera = camera_at([[-600.0, 0.0, 1.5]], [[0.0, 0.0, 0.95]], (64, 48))
    camera = replace(camera, intrinsics_px=intrinsics_from_fov(0.5, 64, 48))
    config = RenderConfig(samples=7, scene=box_place)
    out_dir = save_job(tmp_path, small_body, motion, camera).render(tmp_path / "far", config)
    expected = coverage(camera, small_body, motion_vertices_m(small_body, motion)[0], 0) >= 0.5
    assert expected.sum() > 50 and overlap(mask_of(out_dir, 0), expected) > 0.9


def test_the_scene_has_enough_to_match(rendered):
    assert all(n_features(rendered, row) > 300 for row in range(N_FRAMES))


def test_another_run_with_other_threads_gives_the_same_bytes(rendered, job, tmp_path):
    assert bytes_of(job.render(tmp_path / "again", CONFIG, threads=2)) == bytes_of(rendered)


def test_the_blender_process_has_no_use_for_torch(tmp_path):
    """Loading it takes longer than a clip's scene: a twentieth of the time of a short clip."""
    script = tmp_path / "loaded.py"
    script.write_text("import sys, blender.__main__, blender.render; print(*sys.modules)")
    loaded = set(in_blender(script).stdout.split())
    assert "blender.render" in loaded and not loaded & {"torch", "rich", "dask"}


def blender_pids(folder: Path) -> list[int]:
    """Blender processes that work for a folder."""
    pids = []
    for command in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = command.read_bytes()
        except OSError:
            continue  # it ended meanwhile
        if str(folder).encode() in words and b"\0blender\0" in words:
            pids.append(int(command.parent.name))
    return pids


def wait_until(true: Callable[[], object], seconds: float) -> bool:
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        if true():
            return True
        time.sleep(0.02)
    return False


@pytest.fixture(scope="module")
def before_boxes(box_place) -> RenderConfig:
    """The same in a place that takes no time to paint, for runs that are cut short."""
    return CONFIG.model_copy(update={"scene": box_place, "samples": 2})


@pytest.fixture(scope="module")
def undisturbed(before_boxes, job, tmp_path_factory) -> dict[str, bytes]:
    """What a render of that leaves when nobody kills it."""
    return bytes_of(job.render(tmp_path_factory.mktemp("boxes") / "stride", before_boxes))


def test_a_killed_parent_takes_blender_along_and_the_next_run_goes_on(
    before_boxes, undisturbed, job, tmp_path
):
    out_dir = tmp_path / "stride"
    code = (
        "import sys; from pathlib import Path; from gmrdata.film.render import *\n"
        "clip, body, out, config = sys.argv[1:]\n"
        "render_clip(Path(clip), Path(body), Path(out), RenderConfig.model_validate_json(config))"
    )
    words = [*map(str, (*job, out_dir)), before_boxes.model_dump_json()]
    parent = subprocess.Popen([sys.executable, "-c", code, *words], stderr=subprocess.DEVNULL)
    partial = out_dir.with_name("stride.partial")
    first = partial / "frames/00000.jpg"
    assert wait_until(first.is_file, 120)
    assert blender_pids(partial)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    assert wait_until(lambda: not blender_pids(partial), 10), "Blender lives on without its parent"
    for name, data in bytes_of(partial).items():  # what is there is complete
        if name.startswith(("frames/", "masks/")):
            assert data == undisturbed[name]
    assert not out_dir.exists()
    written_ns = first.stat().st_mtime_ns
    job.render(out_dir, before_boxes)
    assert bytes_of(out_dir) == undisturbed
    assert (out_dir / "frames/00000.jpg").stat().st_mtime_ns == written_ns  # not made again


def test_a_killed_blender_is_an_error_and_missing_frames_are_made_again(
    before_boxes, undisturbed, job, tmp_path
):
    out_dir = tmp_path / "stride"
    partial = out_dir.with_name("stride.partial")

    def kill_at_second(frame: int) -> None:
        if frame == 1:
            os.kill(blender_pids(partial)[0], signal.SIGKILL)

    with pytest.raises(RenderFailed, match=r"signal 9; run again"):
        job.render(out_dir, before_boxes, on_frame=kill_at_second)
    (partial / "masks/00000.png").unlink()
    job.render(out_dir, before_boxes)
    assert bytes_of(out_dir) == undisturbed
