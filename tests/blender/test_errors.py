"""Bad input: exit code 1 and one clear line, no traceback, and no Blender started for it."""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blender.__main__ import main, run
from gmrdata.film.render import RenderConfig
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.errors import MissingInput, RenderFailed
from tests.blender.jobs import Job, camera_at, facing_x, in_blender, save_job


def one_frame(folder: Path, body: BodyModel, change: Callable[[Clip], Clip] = lambda c: c) -> Job:
    motion = facing_x(body, [[0.0, 0.0, 0.95]])
    job = save_job(folder, body, motion, camera_at([[0.0, -4.0, 1.5]], motion.pelvis_m, (64, 36)))
    clip = change(load_clip(job.clip_path))
    save_clip(job.clip_path, clip, body.rest_pelvis_m(clip.motion.shape))
    return job


def job_file(tmp_path: Path, job: Job, **changes: object) -> Path:
    paths = {name: str(path) for name, path in job._asdict().items()}
    rest = {"out_dir": str(tmp_path / "out"), "config": RenderConfig().model_dump()}
    path = tmp_path / "job.json"
    path.write_text(json.dumps(paths | rest | changes), encoding="utf-8")
    return path


def run_blender(*arguments: str, **options: Any) -> tuple[int, str]:
    said = in_blender("blender", *arguments, check=False, **options)
    assert "Traceback" not in said.stderr
    return said.returncode, said.stderr


def test_a_missing_clip_or_body(small_body, tmp_path):
    missing, job = tmp_path / "missing.npz", one_frame(tmp_path, small_body)
    code, said = run_blender(str(job_file(tmp_path, job._replace(clip_path=missing))))
    assert code == 1 and said == f"error: {missing}: no such file\n"
    for less in (job._replace(clip_path=missing), job._replace(body_path=missing)):
        with pytest.raises(MissingInput, match=r"missing\.npz: no such file"):
            less.render(tmp_path / "out", RenderConfig())


def lens(clip: Clip, **changes: Any) -> Clip:
    return replace(clip, camera=replace(camera_of(clip), **changes))


def nowhere(clip: Clip, key: str) -> Clip:
    """A frame that is not valid may say nothing of the person."""
    lost = {key: np.full_like(getattr(clip.motion, key), np.nan)}
    return replace(clip, motion=replace(clip.motion, **lost), valid=np.zeros(1, dtype=bool))


STRETCHED = np.array([[1.0], [1.1], [1.0]])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda c: replace(c, camera=None), "has no camera; give it one"),
        (lambda c: replace(c, motion=replace(c.motion, frame="camera")), "not in the world frame"),
        (lambda c: lens(c, has_camera=np.zeros(1, dtype=bool)), "some frames have no camera"),
        (lambda c: nowhere(c, "pelvis_m"), "some frames hold no motion; slice them off"),
        (lambda c: nowhere(c, "local_rotmats"), "some frames hold no motion; slice them off"),
        (lambda c: replace(c, motion=replace(c.motion, body="someone")), "made for body 'someone'"),
        (lambda c: lens(c, intrinsics_px=c.camera.intrinsics_px * STRETCHED), "square pixels"),
    ],
)
def test_clips_that_cannot_be_filmed(change, reason, small_body, tmp_path):
    job = one_frame(tmp_path, small_body, change)
    with pytest.raises(RenderFailed, match=reason) as failure:
        job.render(tmp_path / "out", RenderConfig())
    # A lens that Blender lacks is found where the file is not known.
    assert str(job.clip_path) in str(failure.value) or reason == "square pixels"
    assert not (tmp_path / "out").exists()


def test_broken_job_files(tmp_path, capsys):
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
    code, said = run_here(str(job_file(tmp_path, Job(tmp_path, tmp_path), config=config)))
    assert code == 1 and "config.scene.kind: Input should be 'courtyard', 'street'" in said
    code, said = run_here()
    assert code == 1 and "usage: python -m blender job.json" in said


def test_a_folder_that_cannot_be_written(small_body, tmp_path):
    blocker = tmp_path / "a_file"
    blocker.write_text("not a folder", encoding="utf-8")
    job = job_file(tmp_path, one_frame(tmp_path, small_body), out_dir=str(blocker / "out"))
    code, said = run_blender(str(job))
    assert code == 1 and str(blocker) in said and said.startswith("error: ")


def test_bpy_is_imported_in_the_blender_folder_only():
    code = "import sys, gmrdata.film.render, gmrdata.film.programmes; print('bpy' in sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout == "False\n"
    package = Path(__file__).resolve().parents[2] / "gmrdata"
    for source in package.rglob("*.py"):
        lines = source.read_text(encoding="utf-8").splitlines()
        assert not [x for x in lines if x.split()[:2] in (["import", "bpy"], ["from", "bpy"])]


def test_blender_is_found_from_any_folder(tmp_path):
    code, said = run_blender(cwd=tmp_path)
    assert code == 1 and "usage:" in said
