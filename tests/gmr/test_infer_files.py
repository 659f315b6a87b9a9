"""`gmrdata infer`: what it writes for each format, what it refuses, and how it goes on."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from gmrdata.fusion.fuse import FusedInputs
from gmrdata.gmr import infer as stage
from gmrdata.gmr.infer import InferConfig
from gmrdata.gmr.predict import load_gmr, predict_world_motion
from gmrdata.motion import local_poses as reader
from gmrdata.pages.inference import draw_motion
from gmrdata.read.body_file import save_body
from gmrdata.read.systems import slahmr
from gmrdata.stage import store
from gmrdata.stage.run import Run
from gmrdata.values.body import WORLD_FROM_REST
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import load_clip, save_clip
from gmrdata.values.errors import (
    BadCheckpoint,
    BadMotionFile,
    GmrdataError,
    MissingInput,
    StaleOutput,
)
from gmrdata.values.files import read_json, write_text
from gmrdata.write.bvh import write_bvh
from tests.fixtures.command_line import fails_cleanly
from tests.joblib_layout import joblib_bytes
from tests.motions import bare_clip, save_bare
from tests.read.system_files import (
    phalp_frame,
    phalp_poses,
    some_gvhmr,
    some_poses,
    some_wham,
    vibe_person,
    write_joblib,
    write_phalp,
    write_slahmr,
    write_torch,
)
from tests.record_keys import assert_each_key_is_needed

FILES = ["amass.npz", "body.glb", "clip.npz", "motion.bvh", "path.png", "view3d.html"]
QUICK = InferConfig(fps_hz=30.0, video=False)
infer = partial(stage.infer, draw=draw_motion)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_each_format_gives_each_file(tmp_path, run_dir, body_path, small_body, walk):
    motion = walk(30.0, 40)
    save_bare(tmp_path / "a walk.npz", small_body, motion).rename(tmp_path / "clip.npz")
    write_bvh(tmp_path / "walk.bvh", motion, small_body)
    np.savez(
        tmp_path / "amass.npz",
        poses=some_poses(40, 52),
        trans=np.zeros((40, 3)),
        betas=np.zeros(16),
        gender="male",
        mocap_framerate=60.0,
    )
    poses = phalp_poses(40)
    frames = [phalp_frame(t, {1: poses[t]}) for t in range(40)]
    sources = {
        write_joblib(tmp_path / "vibe_output.pkl", {3: vibe_person(40)}): "person_3",
        write_joblib(tmp_path / "wham_output.pkl", some_wham({0: 40})): "person_0",
        write_phalp(tmp_path / "demo_x.pkl", frames): "person_1",
        write_torch(tmp_path / "hmr4d_results.pt", some_gvhmr(40)): "person_0",
        tmp_path / "clip.npz": "a_walk",
        tmp_path / "walk.bvh": "walk",
        tmp_path / "amass.npz": "amass",
    }
    for source, name in sources.items():
        out = tmp_path / "out" / source.stem
        config = InferConfig(fps_hz=30.0 if source.suffix in (".pkl", ".pt") else None, video=False)
        infer(run_dir, source, out, config, body_path=body_path)
        assert names(out) == sorted(["infer.json", "stage.json", name])
        assert names(out / name) == FILES
        world = load_clip(out / name / "clip.npz").motion
        assert (world.n_frames, world.frame) == (40, "world")
        assert world.fps_hz == (60.0 if source.stem == "amass" else 30.0)
        record = read_json(out / "infer.json")
        assert record["model"] == {"run": "run", "step": 1, "fps_hz": 10.0}
        assert record["motions"][name]["frames"] == 40
        assert record["left_out"] == {}


def test_the_clip_is_what_python_predicts(tmp_path, run_dir, body_path, small_body):
    path = write_joblib(tmp_path / "v.pkl", {0: vibe_person(40)})
    infer(run_dir, path, tmp_path / "out", QUICK, body_path=body_path)
    found = load_clip(tmp_path / "out" / "person_0" / "clip.npz")
    (run,) = reader.read_local_poses(path, 30.0, body=small_body)
    expected = predict_world_motion(load_gmr(run_dir), run.motion)
    # Worlds differ in heading, up and floor; the motion between the network's frames does not.
    relative = found.motion.root_rotmats[0].T @ found.motion.root_rotmats[::3]
    np.testing.assert_allclose(relative, expected.root_rotmats, atol=1e-6)
    steps_m = found.motion.pelvis_m[::3] - found.motion.pelvis_m[0]
    np.testing.assert_allclose(steps_m @ found.motion.root_rotmats[0], expected.pelvis_m, atol=1e-6)
    np.testing.assert_allclose(found.motion.local_rotmats, run.motion.local_rotmats, atol=1e-9)
    assert np.array_equal(found.image_numbers, run.image_numbers)


def test_a_systems_folder_is_its_file_and_what_else_lies_there_does_not_count(
    tmp_path, run_dir, body_path
):
    path = write_joblib(tmp_path / "walk" / "vibe_output.pkl", {0: vibe_person(40)})
    out = infer(run_dir, path, tmp_path / "out", QUICK, body_path=body_path)
    (path.parent / "rendered.mp4").write_bytes(b"a video")
    assert infer(run_dir, path.parent, out, QUICK, body_path=body_path) == out


def test_the_papers_first_pose_is_kept_on_demand_and_recorded(tmp_path, run_dir, body_path):
    path = write_joblib(tmp_path / "v.pkl", {0: vibe_person(40)})
    config = QUICK.model_copy(update={"level": "first_pose"})
    out = infer(run_dir, path, tmp_path / "out", config, body_path=body_path)
    found = load_clip(out / "person_0" / "clip.npz").motion
    np.testing.assert_allclose(found.root_rotmats[0], WORLD_FROM_REST, atol=1e-12)
    np.testing.assert_allclose(found.pelvis_m[0], 0.0, atol=1e-12)
    record = read_json(out / "infer.json")
    assert (record["level"], record["translation"]) == ("first_pose", "pelvis")


def test_runs_have_a_folder_each_and_short_ones_are_said(tmp_path, run_dir, body_path, capsys):
    frame_ids = [*range(5, 25), 30, *range(40, 43), *range(50, 62)]
    people = {2: vibe_person(len(frame_ids), frame_ids), 9: vibe_person(1, [0])}
    path = write_joblib(tmp_path / "v.pkl", people)
    out = infer(run_dir, path, tmp_path / "out", QUICK, body_path=body_path)
    record = read_json(out / "infer.json")
    assert {n: (m["first_frame"], m["last_frame"]) for n, m in record["motions"].items()} == {
        "person_2_from_5": (5, 24),
        "person_2_from_50": (50, 61),
    }
    assert record["left_out"] == {
        "person_2_from_30": "1 frame at 30 fps: less than two at 10 fps",
        "person_2_from_40": "3 frames at 30 fps: less than two at 10 fps",
        "person_9": "1 frame at 30 fps: less than two at 10 fps",
    }
    assert "left out person_9: 1 frame" in capsys.readouterr().err
    for name in record["motions"]:
        motion = load_clip(out / name / "clip.npz").motion
        np.testing.assert_allclose(motion.pelvis_m[0, :2], 0.0, atol=1e-12)


def test_short_gaps_are_filled_on_demand_and_counted(tmp_path, run_dir, body_path):
    people = {2: vibe_person(30, [*range(10), *range(12, 32)])}
    path = write_joblib(tmp_path / "v.pkl", people)
    config = QUICK.model_copy(update={"bridge_frames": 2})
    out = infer(run_dir, path, tmp_path / "out", config, body_path=body_path)
    record = read_json(out / "infer.json")["motions"]["person_2"]
    assert (record["frames"], record["filled_frames"]) == (32, 2)
    assert "2 missing frames filled" in record["source"]
    clip = load_clip(out / "person_2" / "clip.npz")
    assert np.flatnonzero(~clip.valid).tolist() == [10, 11]
    assert np.isfinite(clip.motion.pelvis_m).all()


def _nan_person() -> dict[str, Any]:
    poses = some_poses(40)
    poses[3, 3] = np.nan
    return vibe_person(40) | {"pose": poses}


BAD: dict[str, tuple[Callable[[], dict[Any, Any]], float | None, str]] = {
    "one frame": (lambda: {0: vibe_person(1)}, 30.0, "no person has two frames in a row"),
    "three frames": (lambda: {0: vibe_person(3)}, 30.0, "no run of frames is long enough"),
    "22 joints": (
        lambda: {0: vibe_person(9) | {"pose": some_poses(9, 22)}},
        30.0,
        r"\(9, 66\), not \(T, 72\)",
    ),
    "NaN": (lambda: {0: _nan_person()}, 30.0, "pose of person_0 is not finite at frame 3"),
    "slow": (lambda: {0: vibe_person(40)}, 5.0, r"person_0 of .*bad\.pkl: 5 fps is lower than 10"),
    "no rate": (lambda: {0: vibe_person(40)}, None, "does not say its frame rate"),
}


@pytest.mark.parametrize("fault", sorted(BAD))
def test_bad_poses_leave_nothing_behind(fault, tmp_path, run_dir, body_path):
    make, fps_hz, message = BAD[fault]
    source = tmp_path / "in" / "bad.pkl"
    source.parent.mkdir()
    source.write_bytes(joblib_bytes(make()))
    before = sorted(tmp_path.rglob("*"))
    config = InferConfig(fps_hz=fps_hz)
    with pytest.raises(BadMotionFile, match=message) as caught:
        infer(run_dir, source, tmp_path / "o" / "out", config, body_path=body_path)
    assert "bad.pkl" in str(caught.value)
    assert sorted(tmp_path.rglob("*")) == before
    with pytest.raises(BadMotionFile, match=message) as planned:
        stage.plan_infer(run_dir, source, config, body_path=body_path)
    assert str(planned.value) == str(caught.value)


def test_broken_files_and_runs_leave_nothing_behind(tmp_path, run_dir, body_path):
    good = write_joblib(tmp_path / "good.pkl", {0: vibe_person(12)})
    cut = tmp_path / "cut.pkl"
    cut.write_bytes(good.read_bytes()[:-900])
    other = tmp_path / "other"
    other.mkdir()
    before = sorted(tmp_path.rglob("*"))
    for run, source in ((run_dir, cut), (run_dir, tmp_path / "none.pkl"), (other, good)):
        with pytest.raises(GmrdataError, match=r"cut\.pkl|none\.pkl|other"):
            infer(run, source, tmp_path / "out", QUICK, body_path=body_path)
        assert sorted(tmp_path.rglob("*")) == before
    weights = next((run_dir / "checkpoints").rglob("model.safetensors"))
    weights.write_bytes(weights.read_bytes()[:100])
    with pytest.raises(BadCheckpoint, match=r"model\.safetensors"):
        infer(run_dir, good, tmp_path / "out", QUICK, body_path=body_path)
    with pytest.raises(MissingInput, match=r"no\.npz"):
        infer(run_dir, good, tmp_path / "out", QUICK, body_path=tmp_path / "no.npz")
    assert not (tmp_path / "out").exists()


def test_a_hostile_clip_name_stays_inside(
    tmp_path, run_dir, body_path, small_body,
    walk
):  # fmt: skip
    motion = walk(30.0, 20)
    clip = bare_clip("../../x y", motion)
    save_clip(tmp_path / "c.npz", clip, small_body.rest_pelvis_m(motion.shape))
    out = tmp_path / "deep" / "out"
    infer(run_dir, tmp_path / "c.npz", out, InferConfig(video=False), body_path=body_path)
    assert names(out) == ["_.._x_y", "infer.json", "stage.json"]
    assert not (tmp_path / "x y").exists()
    # On disks of macOS and Windows the last one is infer.json, too.
    for name in ("infer.json", "stage.json", "recipe.json", "Infer.JSON"):
        write_bvh(tmp_path / f"{name}.bvh", motion, small_body)
        out = tmp_path / f"out {name}"
        infer(run_dir, tmp_path / f"{name}.bvh", out, InferConfig(video=False), body_path=body_path)
        assert names(out) == sorted(["infer.json", "stage.json", f"{name}_2"])


def test_the_second_time_nothing_is_done_and_a_killed_run_goes_on(
    tmp_path, run_dir, body_path, monkeypatch
):
    path = write_joblib(tmp_path / "v.pkl", {0: vibe_person(20), 1: vibe_person(20, seed=4)})
    out = tmp_path / "out"
    written: list[str] = []

    def killed(glb_path: Path, *rest: Any) -> None:
        if "person_1" in glb_path.parts:
            raise KeyboardInterrupt
        write_glb(glb_path, *rest)

    write_glb, write_amass = stage.write_glb, stage.write_amass

    def counted(amass_path: Path, *rest: Any) -> None:
        written.append(amass_path.parent.name)
        write_amass(amass_path, *rest)

    monkeypatch.setattr(stage, "write_amass", counted)
    monkeypatch.setattr(stage, "write_glb", killed)
    with pytest.raises(KeyboardInterrupt):
        infer(run_dir, path, out, QUICK, body_path=body_path)
    assert not out.exists()
    monkeypatch.setattr(stage, "write_glb", write_glb)
    infer(run_dir, path, out, QUICK, body_path=body_path)
    assert written == ["person_0", "person_1"]
    times = {file: file.stat().st_mtime_ns for file in out.rglob("*")}
    infer(run_dir, path, out, QUICK, body_path=body_path)
    assert {file: file.stat().st_mtime_ns for file in out.rglob("*")} == times
    with pytest.raises(StaleOutput, match=r"config\.fps_hz"):
        other = InferConfig(fps_hz=25.0, video=False)
        infer(run_dir, path, out, other, body_path=body_path)
    infer(run_dir, path, out, other, run=Run(redo=True), body_path=body_path)
    assert load_clip(out / "person_0" / "clip.npz").motion.fps_hz == 25.0


def test_a_folder_that_cannot_be_filled_is_said_before_anything_is_predicted(
    tmp_path, run_dir, body_path, monkeypatch
):
    path = write_joblib(tmp_path / "v.pkl", {0: vibe_person(20)})
    out = infer(run_dir, path, tmp_path / "out", QUICK, body_path=body_path)
    inside = write_joblib(out / "v.pkl", {0: vibe_person(20)})
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").touch()
    monkeypatch.setattr(stage, "_predict", lambda *_: pytest.fail("hours of work"))
    with pytest.raises(StaleOutput, match=r"config\.fps_hz"):
        infer(run_dir, path, out, InferConfig(fps_hz=25.0, video=False), body_path=body_path)
    with pytest.raises(StaleOutput, match=r"holds .*v\.pkl, which is read"):
        infer(run_dir, inside, out, QUICK, run=Run(redo=True), body_path=body_path)
    with pytest.raises(StaleOutput, match="no gmrdata stage made it"):
        infer(run_dir, path, tmp_path / "mine", QUICK, body_path=body_path)


def test_what_lies_beside_a_runs_checkpoints_makes_nothing_stale(tmp_path, run_dir, body_path):
    """`delta-errors` writes there, and a result that was kept there made itself stale."""
    path = write_joblib(tmp_path / "v.pkl", {0: vibe_person(20)})
    out = infer(run_dir, path, run_dir / "world", QUICK, body_path=body_path)
    (run_dir / "delta_errors.json").write_text("{}")
    made = (out / "infer.json").stat().st_mtime_ns
    assert infer(run_dir, path, out, QUICK, body_path=body_path) == out
    assert (out / "infer.json").stat().st_mtime_ns == made
    weights = next(run_dir.glob("checkpoints/*/model.safetensors"))
    weights.write_bytes(weights.read_bytes()[:-1])
    with pytest.raises(StaleOutput, match=r"values of inputs\.run\."):
        infer(run_dir, path, out, QUICK, body_path=body_path)


def test_what_a_result_is_read_with_makes_its_motion_stale(
    tmp_path, run_dir, body_path, small_body, walk
):
    """SLAHMR's rate and people stand in files of their own: corrected, the old motion stayed."""
    motion, still = walk(30.0, 40), np.tile(np.eye(4), (40, 1, 1))
    camera = CameraPath(np.diag([500.0, 500.0, 1.0]), 640, 480, still, np.ones(40, bool))
    run = write_slahmr(tmp_path / "x", {7: motion}, camera, small_body.rest_pelvis_m(motion.shape))
    poses, config = run / "motion_chunks" / "x_000040_world_results.npz", run / slahmr.CONFIG
    write_text(config, "data: {type: video, frame_opts: {fps: 30}}\n")
    out = tmp_path / "out"

    def rate_hz(**more: Any) -> float:
        made = infer(run_dir, poses, out, InferConfig(video=False), body_path=body_path, **more)
        return load_clip(made / "person_7" / "clip.npz").motion.fps_hz

    assert rate_hz() == 30.0
    write_text(config, "data: {type: video, frame_opts: {fps: 25}}\n")
    with pytest.raises(StaleOutput, match=r"values of inputs\.poses_config\."):
        rate_hz()
    assert rate_hz(run=Run(redo=True)) == 25.0
    info = run / slahmr.TRACK_INFO
    info.write_text(info.read_text().replace('"7"', '"8"'))
    with pytest.raises(StaleOutput, match=r"values of inputs\.poses_tracks\."):
        rate_hz()
    # A motion that lies there is read with no track.
    other = save_bare(poses.with_name("walk.npz"), small_body, motion)
    made = infer(run_dir, other, tmp_path / "other", InferConfig(video=False), body_path=body_path)
    assert read_json(made / "stage.json")["inputs"].keys() == {"body", "run", "poses_motion"}


def test_the_default_body_may_be_named(tmp_path, run_dir):
    """As every other function takes it: its name was taken for that of a file."""
    path = write_joblib(tmp_path / "v.pkl", {0: vibe_person(20)})
    out = infer(run_dir, path, tmp_path / "out", QUICK, body_path="anny")
    assert infer(run_dir, path, out, QUICK) == out
    made = FusedInputs.of(out / "person_0" / "clip.npz")
    assert made.files("anny") == made.files(None)


def test_redo_believes_no_remembered_hash(tmp_path, run_dir, body_path):
    path = write_joblib(tmp_path / "v.pkl", {0: vibe_person(20)})
    out = infer(run_dir, path, tmp_path / "out", QUICK, body_path=body_path)
    digest = store.sha256_of_file(path)
    write_joblib(path, {0: vibe_person(30)})
    known = store.KnownFile(digest, store.file_state(path)[1])
    store.InputsRecord(files={"poses_motion": known}).write(tmp_path / ".out.inputs")
    for redo, n_frames in ((False, 20), (True, 30)):
        infer(run_dir, path, out, QUICK, run=Run(redo=redo), body_path=body_path)
        assert load_clip(out / "person_0" / "clip.npz").motion.n_frames == n_frames


def test_the_verb_writes_a_video_and_a_table(tmp_path, run_dir, body_path, works, gmrdata):
    source = write_joblib(tmp_path / "v.pkl", {0: vibe_person(6)})
    out = tmp_path / "out"
    flags = ("--out", out, "--body", body_path, "--fps-hz", "30")
    answer = works("infer", source, "--network", run_dir, *flags)
    assert "person_0 6 0-5 0 30" in " ".join(answer.stdout.split())
    with av.open(str(out / "person_0" / "body.mp4")) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(frames) == 6 and frames[0].shape == (480, 640, 3)
    look = ("infer", source, "--network", run_dir, *flags, "--dry-run")
    assert works(*look).stdout.splitlines()[-1] == f"{out}: made"
    # It said "to predict" of any folder.
    stale = f"{out}: made with other values of config.level. Pass --redo"
    fails_cleanly(gmrdata(*look, "--level", "first_pose"), stale)
    anew = works(*look, "--level", "first_pose", "--redo").stdout
    assert anew.splitlines()[-1] == f"{out}: to make"
    assert works(*look).stdout.splitlines()[-1] == f"{out}: made"


def test_the_verb_says_what_is_wrong(tmp_path, run_dir, body_path, gmrdata):
    source, out = write_joblib(tmp_path / "v.pkl", {0: vibe_person(6)}), tmp_path / "out"
    flags = ("--network", run_dir, "--out", out, "--body", body_path, "--no-video")
    said = "v.pkl: does not say its frame rate. Give the video's with --fps-hz"
    fails_cleanly(gmrdata("infer", source, *flags), said)
    assert not out.exists()


def test_the_lines_of_python_run_as_they_stand(tmp_path, anny):
    """In a process of its own, in a folder with a `poses.pkl`, by public names alone; whatever
    number the file has for the person."""
    write_joblib(tmp_path / "poses.pkl", {7: vibe_person(40)})
    page = (Path(__file__).parents[2] / "docs" / "inference.md").read_text(encoding="utf-8")
    (lines,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert re.findall("^(?:from|import) .*", lines, re.MULTILINE) == ["import gmrdata"]
    asked = "for m in (world, at_10_fps): print(m.n_frames, m.fps_hz, m.pelvis_m.shape, m.body)"
    answer = subprocess.run(
        [sys.executable, "-c", lines + asked],
        cwd=tmp_path,
        env={"PYTHONPATH": str(Path(__file__).parents[2]), **_cache_env()},
        capture_output=True,
        text=True,
        check=False,
    )
    assert answer.returncode == 0, answer.stderr
    said = answer.stdout.splitlines()[-2:]
    assert said == [f"40 30.0 (40, 3) {anny.name}", f"14 10.0 (14, 3) {anny.name}"]


def _cache_env() -> dict[str, str]:
    return {key: os.environ[key] for key in ("HOME", "XDG_CACHE_HOME", "PATH") if key in os.environ}


def test_a_body_that_the_file_is_not_of_gets_its_mean_shape(tmp_path, run_dir, small_body, walk):
    path = save_bare(tmp_path / "walk.npz", small_body, walk(30.0, 20))
    save_body(tmp_path / "other.npz", replace(small_body, name="other"))
    out = tmp_path / "out"
    config = InferConfig(video=False)
    infer(run_dir, path, out, config, body_path=tmp_path / "other.npz")
    found = load_clip(out / "walk" / "clip.npz").motion
    assert found.body == "other" and not found.shape.any()


def test_each_key_of_the_record_is_needed(tmp_path):
    one = stage.InferredMotion(
        frames=3,
        fps_hz=30.0,
        first_frame=1,
        last_frame=3,
        filled_frames=0,
        path_m=0.5,
        level_sigma_deg=4.2,
        soles_above_m=0.01,
        source="s",
    )
    record = stage.InferRecord(
        poses="a.pkl",
        body="anny",
        model=stage.NetworkUsed(run="run", step=1, fps_hz=10.0),
        level="standing_feet",
        translation="pelvis",
        motions={"person_0": one},
        left_out={"person_1": "too short"},
    )
    assert_each_key_is_needed(record, tmp_path / "infer.json", ("motions", "left_out"))
