"""Bad input: exit code 1 and one clear line, no traceback, and no Blender started for it."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from blender.__main__ import main, run
from gmrdata.film.camera_moves import look_at
from gmrdata.film.render import RenderConfig, render_clip
from gmrdata.read.body_file import save_body
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath, intrinsics_from_fov
from gmrdata.values.clip import Clip, save_clip
from gmrdata.values.errors import MissingInput, RenderFailed
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import rigid


@pytest.fixture(scope="module")
def body_path(small_body: BodyModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("body") / "body.npz"
    save_body(path, small_body)
    return path


def one_frame(body: BodyModel) -> Clip:
    motion = Motion(
        np.tile(np.eye(3), (1, 23, 1, 1)),
        np.array([[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]),
        np.array([[0.0, 0.0, 0.95]]),
        np.zeros(body.n_shape),
        10.0,
        body.name,
        "neutral",
        "world",
        "standing",
    )
    centre = np.array([[0.0, -4.0, 1.5]])
    camera = CameraPath(
        intrinsics_from_fov(60, 64, 36),
        64,
        36,
        rigid(look_at(centre, motion.pelvis_m), centre),
        np.ones(1, dtype=bool),
    )
    return Clip("one", motion, np.ones(1, dtype=bool), np.array([-1]), camera)


def save(path: Path, clip: Clip, body: BodyModel) -> Path:
    save_clip(path, clip, body.rest_pelvis_m(clip.motion.shape))
    return path


def job_file(tmp_path: Path, clip_path: Path, body_path: Path, **changes: object) -> Path:
    job: dict[str, object] = {
        "clip_path": str(clip_path),
        "body_path": str(body_path),
        "out_dir": str(tmp_path / "out"),
        "config": RenderConfig().model_dump(),
    }
    path = tmp_path / "job.json"
    path.write_text(json.dumps(job | changes), encoding="utf-8")
    return path


def run_blender(*arguments: str) -> tuple[int, str]:
    said = subprocess.run(
        [sys.executable, "-m", "blender", *arguments], capture_output=True, text=True, check=False
    )
    assert "Traceback" not in said.stderr
    return said.returncode, said.stderr


def test_a_missing_clip_or_body(small_body: BodyModel, body_path: Path, tmp_path: Path) -> None:
    missing = tmp_path / "missing.npz"
    code, said = run_blender(str(job_file(tmp_path, missing, body_path)))
    assert code == 1 and said == f"error: {missing}: no such file\n"
    with pytest.raises(MissingInput, match=r"missing\.npz: no such file"):
        render_clip(missing, body_path, tmp_path / "out", RenderConfig())
    clip_path = save(tmp_path / "clip.npz", one_frame(small_body), small_body)
    with pytest.raises(MissingInput, match=r"missing\.npz: no such file"):
        render_clip(clip_path, missing, tmp_path / "out", RenderConfig())


def test_clips_that_cannot_be_filmed(
    small_body: BodyModel, body_path: Path, tmp_path: Path
) -> None:
    good = one_frame(small_body)
    assert good.camera is not None
    in_camera = replace(good, motion=replace(good.motion, frame="camera"))
    lost = replace(good, camera=replace(good.camera, has_camera=np.zeros(1, dtype=bool)))
    stranger = replace(good, motion=replace(good.motion, body="someone"))
    for clip, reason in (
        (replace(good, camera=None), "has no camera; give it one"),
        (in_camera, "not in the world frame"),
        (lost, "some frames have no camera"),
        (stranger, "made for body 'someone'"),
    ):
        clip_path = save(tmp_path / "clip.npz", clip, small_body)
        with pytest.raises(RenderFailed, match=reason) as failure:
            render_clip(
                clip_path, body_path, tmp_path / "out", RenderConfig(), on_frame=lambda _: None
            )
        assert str(clip_path) in str(failure.value)
        assert not (tmp_path / "out").exists()


def test_a_lens_that_blender_lacks(small_body: BodyModel, body_path: Path, tmp_path: Path) -> None:
    good = one_frame(small_body)
    assert good.camera is not None
    stretched_px = good.camera.intrinsics_px * np.array([[1.0], [1.1], [1.0]])
    clip = replace(good, camera=replace(good.camera, intrinsics_px=stretched_px))
    clip_path = save(tmp_path / "clip.npz", clip, small_body)
    with pytest.raises(RenderFailed, match="square pixels"):
        render_clip(clip_path, body_path, tmp_path / "out", RenderConfig(), on_frame=print)


def test_broken_job_files(
    tmp_path: Path, body_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def run_here(*arguments: str) -> tuple[int, str]:
        """As `run_blender` without the start, for what is said before Blender is loaded."""
        return run(lambda: main(list(arguments))), capsys.readouterr().err

    code, said = run_here(str(tmp_path / "none.json"))
    assert code == 1 and said.endswith("none.json: no such job file\n")
    broken = tmp_path / "broken.json"
    broken.write_text('{"clip_path": ', encoding="utf-8")
    code, said = run_here(str(broken))
    assert code == 1 and said.startswith(f"error: {broken}: the file: Invalid JSON")
    config = RenderConfig().model_dump() | {"scene": {"kind": "moon", "seed": 0}}
    code, said = run_here(str(job_file(tmp_path, body_path, body_path, config=config)))
    assert code == 1 and "config.scene.kind: Input should be 'courtyard', 'street'" in said
    code, said = run_here()
    assert code == 1 and "usage: python -m blender job.json" in said


def test_a_folder_that_cannot_be_written(
    small_body: BodyModel, body_path: Path, tmp_path: Path
) -> None:
    clip_path = save(tmp_path / "clip.npz", one_frame(small_body), small_body)
    blocker = tmp_path / "a_file"
    blocker.write_text("not a folder", encoding="utf-8")
    code, said = run_blender(
        str(job_file(tmp_path, clip_path, body_path, out_dir=str(blocker / "out")))
    )
    assert code == 1 and str(blocker) in said and said.startswith("error: ")


def test_bpy_is_imported_in_the_blender_folder_only() -> None:
    code = "import sys, gmrdata.film.render, gmrdata.film.programmes; print('bpy' in sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout == "False\n"
    package = Path(__file__).resolve().parents[2] / "gmrdata"
    for source in package.rglob("*.py"):
        lines = source.read_text(encoding="utf-8").splitlines()
        assert not [x for x in lines if x.split()[:2] in (["import", "bpy"], ["from", "bpy"])]


def test_blender_is_found_from_any_folder(tmp_path: Path) -> None:
    said = subprocess.run(
        [sys.executable, "-m", "blender"],
        cwd=tmp_path,
        env={k: v for k, v in os.environ.items() if k != "PYTHONPATH"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert said.returncode == 1 and "usage:" in said.stderr
