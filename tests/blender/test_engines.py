"""Renderers: which can run here, clear words where one can't, and pictures of each."""

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from gmrdata.film.render import RenderConfig, find_renderer
from gmrdata.stage.store import StageRecord
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.errors import EngineMissing
from gmrdata.values.files import sha256_of_file
from gmrdata.values.skinning import motion_vertices_m
from tests.blender.jobs import (
    Job,
    camera_at,
    coverage,
    facing_x,
    grown,
    in_blender,
    mask_of,
    overlap,
    save_job,
)

N_FRAMES, WIDTH_PX, HEIGHT_PX = 3, 160, 90
SHARP = RenderConfig(samples=8, image_format="png", depth=True, normals=True, flow=True)
STEP_M = 0.5


@pytest.fixture(scope="module")
def job(small_body, tmp_path_factory) -> Job:
    """Someone with wide arms who is carried to the side, half a metre a frame."""
    motion = facing_x(small_body, [[0.0, STEP_M * (row - 1), 0.95] for row in range(N_FRAMES)])
    centres_m, targets_m = [[4.0, 0.0, 1.2]] * N_FRAMES, [[0.0, 0.0, 1.0]] * N_FRAMES
    camera = camera_at(centres_m, targets_m, (WIDTH_PX, HEIGHT_PX))
    return save_job(tmp_path_factory.mktemp("job"), small_body, motion, camera)


@pytest.fixture(scope="module")
def sharp(job, tmp_path_factory) -> Path:
    """Cycles, png, with the scene saved beside."""
    out_dir = tmp_path_factory.mktemp("sharp") / "carried"
    config = SHARP.model_copy(update={"blend": True})
    return job.render(out_dir, config)


def read(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None, path
    return np.asarray(image).astype(int)


def same_files(a: Path, b: Path, *folders: str) -> bool:
    """Whether all that `a` has in some folders, of which none is empty, is the same in `b`."""
    names = [sorted(path.name for path in (a / folder).iterdir()) for folder in folders]
    assert all(names)
    return all(
        sha256_of_file(a / folder / name) == sha256_of_file(b / folder / name)
        for folder, inside in zip(folders, names, strict=True)
        for name in inside
    )


def without_opengl(code: str) -> subprocess.CompletedProcess[str]:
    """Run code where no OpenGL library offers itself."""
    environment = os.environ | {"__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent"}
    command = [sys.executable, "-c", code]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("engine", ["eevee", "workbench"])
def test_without_opengl_it_is_said_before_any_frame(engine):
    answer = without_opengl(
        "from gmrdata.film.render import find_renderer\n"
        "from gmrdata.values.errors import EngineMissing\n"
        f"try: print(find_renderer({engine!r}, 'cpu'))\n"
        "except EngineMissing as error: print('missing:', error)"
    )
    assert answer.stdout.startswith(f"missing: engine: {engine}: ")
    assert "Take `engine: cycles`" in answer.stdout and "libegl1" in answer.stdout


def test_cycles_on_the_cpu_needs_no_trial():
    assert find_renderer("cycles", "cpu") == "Cycles on the CPU"


def test_without_a_gpu_the_devices_are_named(job, tmp_path, monkeypatch):
    for hidden in ("CUDA_VISIBLE_DEVICES", "HIP_VISIBLE_DEVICES"):
        monkeypatch.setenv(hidden, "")
    find_renderer.cache_clear()
    with pytest.raises(EngineMissing, match=r"Cycles finds no GPU here, only .*\(CPU\)"):
        find_renderer("cycles", "gpu")
    config = RenderConfig(device="gpu")
    with pytest.raises(EngineMissing, match="device: cpu"):
        job.render(tmp_path / "out", config)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("said", [{"device": "gpu"}, {"shutter": 0.5}, {"readout": 0.6}])
def test_what_eevee_has_not(said):
    with pytest.raises(ValidationError):
        RenderConfig.model_validate({"engine": "eevee"} | said)


def test_png_frames_are_lossless_and_the_record_names_the_renderer(sharp):
    assert StageRecord.of(sharp).facts["renderer"] == "Cycles on the CPU"
    names = sorted(path.name for path in (sharp / "frames").iterdir())
    assert names == [f"{row:05d}.png" for row in range(N_FRAMES)]
    assert read(sharp / "frames/00000.png").shape == (HEIGHT_PX, WIDTH_PX, 3)


@pytest.mark.slow
def test_eevee_shows_the_same_place_with_the_same_truth(sharp, job, tmp_path, small_body):
    try:
        renderer = find_renderer("eevee", "cpu")
    except EngineMissing as error:
        pytest.skip(str(error))
    two = load_clip(job[0]).take(slice(0, 2))  # without a GPU a frame takes 15 s
    save_clip(tmp_path / "two.npz", two, small_body.rest_pelvis_m(two.motion.shape))
    config = SHARP.model_copy(update={"engine": "eevee"})
    short = Job(tmp_path / "two.npz", job.body_path)
    out_dir = short.render(tmp_path / "eevee", config, layout_paths=[job.clip_path])
    assert StageRecord.of(out_dir).facts["renderer"] == renderer
    assert same_files(out_dir, sharp, "masks", "depth", "normals", "flow")
    for row in range(2):
        ours = read(out_dir / f"frames/{row:05d}.png")
        off = np.abs(ours - read(sharp / f"frames/{row:05d}.png"))
        assert np.median(off) < 8 and ours.std() > 25  # one place, one light, other edges


def covered(clip: Clip, body: BodyModel, moment: float) -> np.ndarray:
    """(H, W) share of each pixel that the mesh covers, a share of a frame after frame 1.

    Between frames the person goes straight.
    """
    ahead_m = np.array([0.0, moment * STEP_M, 0.0])
    vertices_m = motion_vertices_m(body, clip.motion)[1] + ahead_m
    return coverage(camera_of(clip), body, vertices_m, 1)


def smear(clip: Clip, body: BodyModel, shutter: float) -> np.ndarray:
    """(H, W) mean share that is covered while a shutter is open, of 17 moments."""
    moments = shutter * ((np.arange(17) + 0.5) / 17 - 0.5)
    return np.mean([covered(clip, body, moment) for moment in moments], axis=0)


def test_an_open_shutter_smears_the_person_and_leaves_the_truth(sharp, job, tmp_path, small_body):
    shutter = 0.3  # 5 px of 17 px a frame
    config = SHARP.model_copy(update={"shutter": shutter, "samples": 32})
    blurred = job.render(tmp_path / "blurred", config)
    assert same_files(sharp, blurred, "depth", "normals", "flow")
    assert sha256_of_file(sharp / "clip.npz") == sha256_of_file(blurred / "clip.npz")
    clip = load_clip(job[0])
    smeared, still = smear(clip, small_body, shutter), smear(clip, small_body, 0.0)
    mask, expected = mask_of(blurred, 1), smeared >= 0.5
    iou = overlap(mask, expected)
    assert expected.sum() > 300 and iou > 0.85, f"IoU {iou:.3f}"
    # The colours mix where the person is for a part of the time, and nowhere else.
    frames = [read(folder / "frames/00001.png") for folder in (blurred, sharp)]
    change = np.abs(frames[0] - frames[1]).mean(axis=-1)
    mixed = np.abs(smeared - still) > 0.25
    untouched = ~grown(smeared > 0, 3)
    assert mixed.sum() > 200
    assert change[mixed].mean() > 3 * change[untouched].mean()


@pytest.mark.parametrize("shutter", [0.0, 0.1])
def test_a_rolling_shutter_shows_each_row_at_its_own_time(
    shutter, box_place, sharp, job, tmp_path, small_body
):
    """The mask is that of the mesh row by row, and no other order of the rows fits as well."""
    readout, clip = 0.9, load_clip(job[0])  # 15 px from the top row to the bottom row
    config = RenderConfig(
        samples=31, image_format="png", shutter=shutter, readout=readout, scene=box_place
    )
    out_dir = job.render(tmp_path / "rolled", config)
    mask = mask_of(out_dir, 1)
    iou = {}
    for direction in (1, 0, -1):
        moments = direction * readout * ((np.arange(HEIGHT_PX) + 0.5) / HEIGHT_PX - 0.5)
        rows = [covered(clip, small_body, moment)[row] for row, moment in enumerate(moments)]
        expected = np.array(rows) >= 0.5
        iou[direction] = overlap(mask, expected)
    assert mask.sum() > 300 and iou[1] > 0.9 > iou[0] + 0.1 > iou[-1], iou
    assert sha256_of_file(out_dir / "clip.npz") == sha256_of_file(sharp / "clip.npz")


def in_saved_scene(code: str, folder: Path, scene: Path, *words: object) -> str:
    """What code says that Blender runs in a saved scene."""
    start = "import bpy, sys\nbpy.ops.wm.open_mainfile(filepath=sys.argv[1])\n"
    script = folder / "script.py"
    script.write_text(f"{start}scene = bpy.context.scene\n{code}")
    return in_blender(script, scene, *words).stdout


def test_a_saved_scene_plays_at_the_clip_s_rate(job, box_place, small_body, tmp_path):
    clip = load_clip(job.clip_path)
    motion = clip.motion.take(slice(1, 2), fps_hz=59.94)
    job = save_job(tmp_path / "in", small_body, motion, camera_of(clip).at_rows(slice(1, 2)))
    config = RenderConfig(samples=1, blend=True, scene=box_place)
    saved = job.render(tmp_path / "out", config) / "scene" / "scene.blend"
    code = "print('RATE', scene.render.fps / scene.render.fps_base)"
    said = in_saved_scene(code, tmp_path, saved).split("RATE ")[1]
    assert float(said.split()[0]) == pytest.approx(59.94)


def test_a_saved_scene_renders_the_same_pixels_elsewhere(sharp, tmp_path):
    (sharp / "scene").rename(tmp_path / "moved")
    try:
        picture = tmp_path / "again.bmp"
        code = (
            "scene.frame_set(1)\n"
            "scene.cycles.seed = 1\n"
            "scene.render.filepath = sys.argv[2]\n"
            "bpy.ops.render.render(write_still=True)\n"
        )
        in_saved_scene(code, tmp_path, tmp_path / "moved/scene.blend", picture)
    finally:
        (tmp_path / "moved").rename(sharp / "scene")
    np.testing.assert_array_equal(read(picture), read(sharp / "frames/00001.png"))
    # It wrote a mask to the folder that the set was rendered in, and made that where it was gone.
    assert not sharp.with_name(f"{sharp.name}.partial").exists()
