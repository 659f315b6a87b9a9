"""Real renders: files, masks, equal bytes, and going on after a crash."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.film.programmes import Circular, camera_path
from gmrdata.film.render import RenderConfig, render_clip
from gmrdata.film.scene import SceneConfig
from gmrdata.read.body_file import save_body
from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.camera import project
from gmrdata.values.clip import Clip, load_clip, save_clip
from gmrdata.values.errors import RenderFailed
from gmrdata.values.files import sha256_of_file
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_vertices_m

REPOSITORY = Path(__file__).resolve().parents[2]
N_FRAMES, WIDTH_PX, HEIGHT_PX = 4, 320, 180
CONFIG = RenderConfig(samples=4, scene=SceneConfig(seed=5))


def walking(body: BodyModel) -> Motion:
    """Four frames of someone who strides along x with the arms down."""
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # faces +x, stands on z
    local = np.tile(np.eye(3), (N_FRAMES, 23, 1, 1))
    for name, angle in (("left_shoulder", -1.2), ("right_shoulder", 1.2)):
        cos, sin = np.cos(angle), np.sin(angle)
        local[:, JOINT[name] - 1, :2, :2] = [[cos, -sin], [sin, cos]]
    for name, sign in (("left_hip", 1), ("right_hip", -1)):
        for row in range(N_FRAMES):
            angle = sign * 0.4 * np.cos(0.9 * row)
            cos, sin = np.cos(angle), np.sin(angle)
            local[row, JOINT[name] - 1, 1:, 1:] = [[cos, -sin], [sin, cos]]
    pelvis = np.c_[0.13 * np.arange(N_FRAMES) + 3, np.full(N_FRAMES, -2), np.full(N_FRAMES, 0.95)]
    root = np.tile(turn, (N_FRAMES, 1, 1))
    return Motion(
        local, root, pelvis, np.zeros(body.n_shape), 10.0, body.name, "neutral", "world", "a stride"
    )


@pytest.fixture(scope="module")
def body_path(small_body: BodyModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("body") / "body.npz"
    save_body(path, small_body)
    return path


@pytest.fixture(scope="module")
def clip_path(small_body: BodyModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    motion = walking(small_body)
    camera = camera_path(
        Circular(), motion.pelvis_m, 10.0, WIDTH_PX, HEIGHT_PX, 60.0, np.random.default_rng(2)
    )
    valid = np.array([True, True, False, True])
    clip = Clip("stride", motion, valid, np.full(N_FRAMES, -1), camera)
    path = tmp_path_factory.mktemp("clip") / "clip.npz"
    save_clip(path, clip, small_body.rest_pelvis_m(motion.shape))
    return path


@pytest.fixture(scope="module")
def rendered(clip_path: Path, body_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An undisturbed render."""
    seen: list[int] = []
    out_dir = tmp_path_factory.mktemp("render") / "stride"
    render_clip(clip_path, body_path, out_dir, CONFIG, on_frame=seen.append)
    assert seen == list(range(N_FRAMES))
    return out_dir


def contents(folder: Path) -> dict[str, str]:
    """Hashes of all files but the stage's record, which holds times."""
    return {
        path.relative_to(folder).as_posix(): sha256_of_file(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "stage.json"
    }


def test_the_folder_holds_frames_masks_and_the_clip_and_nothing_else(rendered: Path) -> None:
    names = [f"frames/{i:05d}.jpg" for i in range(N_FRAMES)]
    names += [f"masks/{i:05d}.png" for i in range(N_FRAMES)]
    assert sorted(contents(rendered)) == sorted([*names, "clearance.json", "clip.npz"])
    for row in range(N_FRAMES):
        frame = cv2.imread(str(rendered / f"frames/{row:05d}.jpg"), cv2.IMREAD_UNCHANGED)
        mask = cv2.imread(str(rendered / f"masks/{row:05d}.png"), cv2.IMREAD_UNCHANGED)
        assert frame.shape == (HEIGHT_PX, WIDTH_PX, 3) and frame.dtype == np.uint8
        assert mask.shape == (HEIGHT_PX, WIDTH_PX) and set(np.unique(mask)) == {0, 255}
        assert frame.std() > 25  # there is something to see


def test_the_clip_is_the_one_that_went_in_with_blenders_camera(
    rendered: Path, clip_path: Path
) -> None:
    asked, got = load_clip(clip_path), load_clip(rendered / "clip.npz")
    assert asked.camera is not None and got.camera is not None
    assert got.id == asked.id and got.camera.has_camera.all()
    np.testing.assert_array_equal(got.image_numbers, np.arange(N_FRAMES))
    np.testing.assert_array_equal(got.valid, asked.valid)
    np.testing.assert_allclose(got.motion.pelvis_m, asked.motion.pelvis_m, atol=1e-9)
    np.testing.assert_allclose(got.camera.world_from_cam, asked.camera.world_from_cam, atol=2e-6)
    np.testing.assert_allclose(got.camera.intrinsics_px, asked.camera.intrinsics_px, rtol=1e-6)
    assert (got.camera.width_px, got.camera.height_px) == (WIDTH_PX, HEIGHT_PX)


def silhouette(clip: Clip, body: BodyModel, row: int) -> np.ndarray:
    """(H, W) bool: pixels that the projected mesh covers by half, drawn eight times as fine."""
    fine = 8
    assert clip.camera is not None
    vertices_m = motion_vertices_m(body, clip.motion, np.array([row]))[0].astype(np.float64)
    points_px = project(clip.camera.world_from_cam[row], vertices_m, clip.camera.intrinsics_px)
    canvas = np.zeros((HEIGHT_PX * fine, WIDTH_PX * fine), np.uint8)
    for face in np.round((points_px * fine - 0.5) * 16).astype(np.int32)[body.faces]:
        cv2.fillConvexPoly(canvas, face, (255,), shift=4)
    return cv2.resize(canvas, (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_AREA) >= 128


def test_masks_are_the_projected_mesh(rendered: Path, small_body: BodyModel) -> None:
    clip = load_clip(rendered / "clip.npz")
    for row in range(N_FRAMES):
        mask = cv2.imread(str(rendered / f"masks/{row:05d}.png"), cv2.IMREAD_GRAYSCALE) > 0
        expected = silhouette(clip, small_body, row)
        assert expected.sum() > 1000
        iou = (mask & expected).sum() / (mask | expected).sum()
        assert iou > 0.97, f"frame {row}: IoU {iou:.4f}"
        for shift in ((0, 1), (0, -1), (1, 0), (-1, 0)):  # not even one pixel off
            moved = np.roll(expected, shift, axis=(0, 1))
            assert (mask & moved).sum() / (mask | moved).sum() < iou


def test_the_scene_has_enough_to_match(rendered: Path) -> None:
    for row in range(N_FRAMES):
        frame = cv2.imread(str(rendered / f"frames/{row:05d}.jpg"), cv2.IMREAD_GRAYSCALE)
        mask = cv2.imread(str(rendered / f"masks/{row:05d}.png"), cv2.IMREAD_GRAYSCALE)
        outside = np.where(cv2.dilate(mask, np.ones((5, 5), np.uint8)) == 0, 255, 0)
        assert len(cv2.SIFT.create().detect(frame, outside.astype(np.uint8))) > 300


def test_another_run_with_other_threads_gives_the_same_bytes(
    rendered: Path, clip_path: Path, body_path: Path, tmp_path: Path
) -> None:
    render_clip(
        clip_path, body_path, tmp_path / "again", CONFIG, threads=2, on_frame=lambda _: None
    )
    assert contents(tmp_path / "again") == contents(rendered)


def test_the_blender_process_has_no_use_for_torch() -> None:
    """Loading it takes longer than a clip's scene: a twentieth of the time of a short clip."""
    code = "import sys, blender.__main__, blender.render; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=REPOSITORY).returncode == 0


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
def before_boxes(box_place: SceneConfig) -> RenderConfig:
    """The same in a place that takes no time to paint, for runs that are cut short."""
    return CONFIG.model_copy(update={"scene": box_place, "samples": 2})


@pytest.fixture(scope="module")
def undisturbed(
    before_boxes: RenderConfig,
    clip_path: Path,
    body_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[str, str]:
    """What a render of that leaves when nobody kills it."""
    out_dir = tmp_path_factory.mktemp("boxes") / "stride"
    return contents(
        render_clip(clip_path, body_path, out_dir, before_boxes, on_frame=lambda _: None)
    )


def test_a_killed_parent_takes_blender_along_and_the_next_run_goes_on(
    before_boxes: RenderConfig,
    undisturbed: dict[str, str],
    clip_path: Path,
    body_path: Path,
    tmp_path: Path,
) -> None:
    out_dir = tmp_path / "stride"
    code = (
        "import sys; from pathlib import Path; from gmrdata.film.render import *\n"
        "clip, body, out, config = sys.argv[1:]\n"
        "render_clip(Path(clip), Path(body), Path(out), RenderConfig.model_validate_json(config))"
    )
    words = [str(clip_path), str(body_path), str(out_dir), before_boxes.model_dump_json()]
    parent = subprocess.Popen([sys.executable, "-c", code, *words], stderr=subprocess.DEVNULL)
    partial = out_dir.with_name("stride.partial")
    first = partial / "frames/00000.jpg"
    assert wait_until(first.is_file, 120)
    assert blender_pids(partial)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    assert wait_until(lambda: not blender_pids(partial), 10), "Blender lives on without its parent"
    for name, data in contents(partial).items():  # what is there is complete
        if name.startswith(("frames/", "masks/")):
            assert data == undisturbed[name]
    assert not out_dir.exists()
    written_ns = first.stat().st_mtime_ns
    render_clip(clip_path, body_path, out_dir, before_boxes, on_frame=lambda _: None)
    assert contents(out_dir) == undisturbed
    assert (out_dir / "frames/00000.jpg").stat().st_mtime_ns == written_ns  # not made again


def test_a_killed_blender_is_an_error_and_missing_frames_are_made_again(
    before_boxes: RenderConfig,
    undisturbed: dict[str, str],
    clip_path: Path,
    body_path: Path,
    tmp_path: Path,
) -> None:
    out_dir = tmp_path / "stride"
    partial = out_dir.with_name("stride.partial")

    def kill_at_second(frame: int) -> None:
        if frame == 1:
            os.kill(blender_pids(partial)[0], signal.SIGKILL)

    with pytest.raises(RenderFailed, match=r"signal 9; run again"):
        render_clip(clip_path, body_path, out_dir, before_boxes, on_frame=kill_at_second)
    (partial / "masks/00000.png").unlink()
    render_clip(clip_path, body_path, out_dir, before_boxes, on_frame=lambda _: None)
    assert contents(out_dir) == undisturbed
