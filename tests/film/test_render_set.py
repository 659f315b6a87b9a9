"""A synthetic set, rendered for real; kill -9 of any of its processes leaves the same set."""

import re
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import psutil
import pytest

from gmrdata.film.programmes import Film, Static, plan_clip
from gmrdata.film.render import RenderConfig, RenderJob
from gmrdata.film.render_set import (
    DryRun,
    _licence,
    _write_listing,
    dry_run,
    frame_warnings,
    probe_clip,
    render_set,
    summary_lines,
    try_render_clips,
)
from gmrdata.film.scene import SceneConfig
from gmrdata.film.set_plan import SyntheticRecipe, select
from gmrdata.manifest.check import check_manifest
from gmrdata.manifest.current import Source
from gmrdata.manifest.read import load_clips, read_manifest
from gmrdata.motion.gait import make_gait
from gmrdata.motion.library import LICENCES, gait_source, licence_of
from gmrdata.pages.sets import write_set_pages
from gmrdata.stage.jobs import Job, OthersLeft
from gmrdata.stage.recipes import load_recipe
from gmrdata.stage.run import Run, Shard
from gmrdata.stage.workers import worker_pool
from gmrdata.values.clip import camera_of
from gmrdata.values.errors import BadRecipe, MissingInput, StageFailed, StaleOutput
from gmrdata.write.bvh import write_bvh
from tests.clip_manifests import clips_of
from tests.film.set_kills import VICTIMS, contents, kill_and_complete, leftovers, write_recipe
from tests.motions import save_bare

pytestmark = pytest.mark.slow

ROOM = {"kind": "room"}
"""The place that is painted soonest."""
PLAIN = {"samples": 1, "scene": ROOM}
RECIPE = SyntheticRecipe.model_validate(
    {
        "recipe": "synthetic",
        "name": "small",
        "seed": 3,
        "clips": [
            {"id": "run", "trial": "02_03", "programme": {"kind": "linear"}, "duration_s": 0.5},
            {"id": "step", "gait": "side_step", "programme": {"kind": "small"}},
            {"id": "gone", "trial": "99_99", "programme": {"kind": "static"}},
        ],
        "camera_off": True,
        "film": {"duration_s": 0.6, "fps_hz": 10, "width_px": 96, "height_px": 64},
        "render": PLAIN | {"joints": True, "depth": True, "flow": True, "video": True},
    }
)


@pytest.fixture(scope="module")
def rendered(tmp_path_factory, cmu_dir, anny) -> Path:
    recipe = RECIPE.model_copy(update={"workers": 1})
    manifest_path = render_set(recipe, tmp_path_factory.mktemp("set"), motions_dir=cmu_dir)
    write_set_pages(RECIPE, manifest_path.parent)
    return manifest_path


def test_the_manifest_is_good_and_lists_what_could_be_rendered(rendered):
    check_manifest(rendered)
    manifest = read_manifest(rendered)
    assert manifest.version == "1.0.0"
    assert [clip.id for clip in manifest.clips] == ["run", "run_off", "step", "step_off"]
    assert [clip.source.dataset for clip in manifest.clips] == ["CMU", "CMU", "gmrdata", "gmrdata"]
    assert [clip.camera_motion for clip in manifest.clips] == [
        "linear",
        "static",
        "small",
        "static",
    ]
    assert [clip.motion.n_frames for clip in load_clips(rendered)] == [5, 5, 6, 6]
    assert manifest.clips[0].recipe is not None
    for clip, n_frames in zip(manifest.clips, (5, 5, 6, 6), strict=True):
        assert clip.depth is not None and clip.depth.count == n_frames
        assert clip.flow is not None and clip.flow.count == n_frames - 1
        assert clip.joints is not None and clip.video is not None and clip.normals is None


def test_a_twin_has_the_motion_of_its_clip_and_a_camera_that_rests(rendered):
    clips = {clip.id: clip for clip in load_clips(rendered)}
    for id in ("run", "step"):
        clip, twin = clips[id], clips[f"{id}_off"]
        np.testing.assert_allclose(twin.motion.root_rotmats, clip.motion.root_rotmats, atol=1e-12)
        np.testing.assert_allclose(twin.motion.local_rotmats, clip.motion.local_rotmats, atol=1e-12)
        np.testing.assert_allclose(twin.motion.pelvis_m, clip.motion.pelvis_m, atol=1e-12)
        poses = camera_of(twin).world_from_cam
        np.testing.assert_array_equal(poses, np.tile(poses[0], (len(poses), 1, 1)))
        assert np.ptp(camera_of(clip).centres_world_m, axis=0).max() > 0.01


def test_every_clip_has_the_whole_person_in_frame_as_its_masks_say(rendered):
    for clip in clips_of(rendered):
        assert clip.quality is not None
        figures = clip.quality.figures
        assert (figures["in_frame_share"], figures["clear_sight_share"]) == (1.0, 1.0)
        assert figures["camera_clearance_m"] > 0.5 and figures["person_clearance_m"] > 0.5
        for path in (rendered.parent / "render" / clip.id / "masks").glob("*.png"):
            mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            assert mask is not None and mask.max() == 255
            assert not (mask[[0, -1]].any() or mask[:, [0, -1]].any())
    assert not (rendered.parent / "warnings.txt").exists()


def test_the_index_shows_every_clip(rendered):
    page = (rendered.parent / "index.html").read_text()
    pictures = re.findall(r'<img src="([^"]+)"', page)
    assert len(pictures) == 8
    for name in pictures:
        assert (rendered.parent / name).is_file()
    sheet = cv2.imread(str(rendered.parent / "sheets" / "step" / "contact.jpg"))
    assert sheet is not None and sheet.shape == (2 * 64 + 4, 3 * 96 + 2 * 4, 3)


def test_once_more_does_nothing_and_another_seed_is_refused(rendered, cmu_dir):
    before = rendered.read_bytes()
    frame = rendered.parent / "render" / "run" / "frames" / "00000.jpg"
    made_ns = frame.stat().st_mtime_ns
    render_set(RECIPE, rendered.parent, motions_dir=cmu_dir)
    assert (rendered.read_bytes(), frame.stat().st_mtime_ns) == (before, made_ns)
    with pytest.raises(StaleOutput, match="config.seed"):
        render_set(RECIPE.model_copy(update={"seed": 4}), rendered.parent, motions_dir=cmu_dir)


def test_a_dry_run_says_what_is_done_and_what_is_missing(rendered, cmu_dir):
    before = sorted(rendered.parent.rglob("*"))
    found = dry_run(RECIPE, rendered.parent, motions_dir=cmu_dir)
    assert [row[-1] for row in found.rows] == ["done"] * 4 + ["no motion file"]
    assert [row[3] for row in found.rows] == ["5", "5", "6", "6", ""]
    assert (found.clips_to_do, found.frames_to_do, found.probe) == (0, 0, None)
    assert sorted(rendered.parent.rglob("*")) == before
    finer = RECIPE.model_copy(deep=True, update={"seed": 4})
    again = dry_run(finer, rendered.parent, motions_dir=cmu_dir, probe=False)
    assert [row[-1] for row in again.rows[:4]] == ["made with other values, needs --redo"] * 4
    assert (again.clips_to_do, again.frames_to_do) == (4, 22)
    assert sorted(rendered.parent.rglob("*")) == before


def test_a_dry_run_measures_two_frames(rendered, cmu_dir, tmp_path):
    out_dir = tmp_path / "out"
    found = dry_run(RECIPE, out_dir, motions_dir=cmu_dir)
    assert not out_dir.exists()
    assert (found.clips_to_do, found.frames_to_do, found.workers) == (4, 22, 2)
    assert found.probe is not None and found.seconds is not None and found.size_bytes is not None
    assert found.probe.frame_cpu_s > 0 and found.probe.clip_cpu_s > 0
    per_worker_s = (4 * found.probe.clip_cpu_s + 22 * found.probe.frame_cpu_s) / 2
    assert found.seconds == pytest.approx(per_worker_s)
    # What the set really took, JPEG and PNG.
    real = sum(p.stat().st_size for p in (rendered.parent / "render").rglob("0*.*g"))
    assert real / 2 < found.size_bytes < 2 * real
    assert any("22 frames" in line for line in summary_lines(found))
    assert dry_run(RECIPE, out_dir, motions_dir=cmu_dir, probe=False).seconds is None


def test_a_clip_that_no_probe_can_be_made_of_does_not_end_a_dry_run(cmu_dir, tmp_path, monkeypatch):
    """It ended in the first one's reason, without its name and without the table."""
    extras = {"passers_by": 1, "hold_s": 60.0, "motions": [cmu_dir / "bvh/02_03.bvh"]}
    odd = {
        "gone": {"character": {"path": tmp_path / "gone.glb"}},
        "late": {"scene": ROOM | {"extras": extras}},
        "fine": {},
    }
    clip = {"gait": "side_step", "programme": {"kind": "small"}}
    clips = [clip | {"id": id} | said for id, said in odd.items()]
    recipe = RECIPE.model_dump() | {"clips": clips, "camera_off": False, "render": PLAIN}
    found = dry_run(SyntheticRecipe.model_validate(recipe), tmp_path / "out")
    gone, late, fine = (row[-1] for row in found.rows)
    assert gone == f"can't be filmed: {tmp_path / 'gone.glb'}: no such file"
    assert re.search(r"no probe could be rendered: .*02_03\.bvh lasts \d.* takes 60\.10 s", late)
    assert fine == "to do" and found.probe is not None and found.clips_to_do == 2
    monkeypatch.setenv("GMRDATA_BLENDER_GIB", "0.3")
    alone = SyntheticRecipe.model_validate(recipe | {"clips": clips[2:]})
    ((*_, fine),) = dry_run(alone, tmp_path / "out").rows
    assert fine.startswith("no probe could be rendered: Blender asked for more memory than the 307")


def test_a_saved_scene_is_counted_once_for_a_clip(small_body, body_path, tmp_path, monkeypatch):
    """A clip of 48 frames, whose scene is saved once, was to take 24 scenes."""
    motion = make_gait("walk", 1.0, 10.0, small_body, np.random.default_rng(0))
    clip = plan_clip("a", motion, Static(), Film(), np.random.default_rng(0))
    sizes = {"frames/%05d.jpg": 3000, "masks/%05d.png": 100}
    of_clip = {"scene/scene.blend": 9_000_000, "scene/person.pc2": 4 * 500, "extras/car_1.npz": 50}

    def rendered(_clip: Path, _body: Path, out: Path, _config: RenderConfig, **said: Any) -> Path:
        files = {name % row: size for row in range(2) for name, size in sizes.items()} | of_clip
        for name, size in files.items():
            (out / name).parent.mkdir(parents=True, exist_ok=True)
            (out / name).write_bytes(bytes(size))
        said["on_frame"](1)
        return out

    monkeypatch.setattr("gmrdata.film.render_set.render_clip", rendered)
    probe = probe_clip(clip, body_path, RenderConfig(blend=True), tmp_path)
    assert (probe.frame_bytes, probe.clip_bytes) == (3600.0, 9_001_050.0)
    plan = DryRun([], 2, 2, 96, 96, 1, probe)
    assert plan.size_bytes == 2 * 9_001_050 + 96 * 3600
    _, line = summary_lines(plan)
    assert "18.3 MB" in line and "4 kB a frame and 9001 kB a clip" in line


def test_a_warning_names_the_key_that_the_camera_goes_by(rendered):
    """A circular camera with a radius_m does not heed its distance_m."""
    (warning, *_) = frame_warnings(clips_of(rendered), 1.1).values()
    assert "more distance_m (of a circular one: radius_m), or leave that out" in warning


def test_a_clip_that_cannot_be_filmed_leaves_the_others(tmp_path, anny):
    recipe = RECIPE.model_dump()
    near = {"id": "near", "gait": "walk", "programme": {"kind": "small", "distance_m": 1.5}}
    away = {"kind": "linear", "speed_m_per_s": 100}
    far = {"id": "far", "gait": "walk", "programme": away}
    recipe |= {"camera_off": False, "clips": [far, near], "render": PLAIN, "workers": 1}
    found = dry_run(SyntheticRecipe.model_validate(recipe), tmp_path, probe=False)
    assert found.rows[0][-1].startswith("can't be filmed: a linear camera can't keep the subject")
    with pytest.raises(StageFailed, match=r"1 of 2 failed(.|\n)*far: a linear camera can't keep"):
        render_set(SyntheticRecipe.model_validate(recipe), tmp_path)
    assert "can't keep the subject in frame" in (tmp_path / "failed" / "far.txt").read_text()
    manifest_path = tmp_path / "synthetic.yaml"
    assert read_manifest(manifest_path).version == "1.0.0-incomplete"
    (clip,) = clips_of(manifest_path)
    check_manifest(manifest_path)
    assert clip.id == "near" and clip.quality is not None
    assert clip.quality.figures["in_frame_share"] == 0.0
    assert (
        (tmp_path / "warnings.txt").read_text().startswith("clip near: the whole person is in 0%")
    )
    write_set_pages(SyntheticRecipe.model_validate(recipe), tmp_path)
    assert "whole person is in 0%" in (tmp_path / "index.html").read_text()
    far["programme"] = {"kind": "static"}
    manifest_path = render_set(SyntheticRecipe.model_validate(recipe), tmp_path)
    assert read_manifest(manifest_path).version == "1.0.0"
    assert [clip.id for clip in read_manifest(manifest_path).clips] == ["far", "near"]
    assert not (tmp_path / "failed" / "far.txt").exists()


def test_the_origin_of_motions_and_what_is_odd_in_them_is_kept(tmp_path, anny):
    walk = make_gait(
        "walk", 2.0, 30.0, anny, np.random.default_rng(0), shape=np.zeros(anny.n_shape)
    )
    (tmp_path / "motions").mkdir()
    write_bvh(tmp_path / "motions" / "fast.bvh", replace(walk, fps_hz=120.0), anny)
    save_bare(tmp_path / "motions" / "KIT" / "3" / "kick_poses.npz", anny, walk)
    clips = [
        {"id": trial, "trial": trial, "duration_s": 0.5, "programme": {"kind": "small"}}
        for trial in ("fast", "kick_poses")
    ]
    passing = {"passers_by": 1, "motions": [str(tmp_path / "motions" / "fast.bvh")]}
    clips[1] |= {
        "programme": {"kind": "static", "distance_m": 8.0},
        "scene": {"kind": "room", "extras": passing},
    }
    changes = {"clips": clips, "camera_off": False, "render": PLAIN, "workers": 1}
    recipe = SyntheticRecipe.model_validate(RECIPE.model_dump() | changes)
    manifest_path = render_set(recipe, tmp_path / "out", motions_dir=tmp_path / "motions")
    fast, kick = clips_of(manifest_path)
    assert (fast.source.dataset, fast.source.sequence) == ("file", "fast")
    assert (kick.source.dataset, kick.source.sequence) == ("AMASS", "KIT/3/kick_poses")
    assert kick.licence == f"{LICENCES['AMASS']}; passers-by: {fast.licence}"
    line, passer_by = (tmp_path / "out" / "warnings.txt").read_text().splitlines()
    assert line.startswith("clip fast: walks at ") and line.endswith("the keys of `read`)")
    assert passer_by == line.replace("clip fast", f"passer-by {passing['motions'][0]}")


def test_a_clip_has_the_terms_of_its_passers_by_too(tmp_path):
    gait, trial = gait_source("walk"), Source(dataset="CMU", sequence="02_03")
    kick, odd = tmp_path / "KIT/3/kick_poses.npz", Path("/walk.bvh")
    assert _licence(gait, ()) == LICENCES["gmrdata"]
    both = f"{LICENCES['gmrdata']}; passers-by: {LICENCES['CMU']}"
    assert _licence(gait, (tmp_path / "02_01.amc", tmp_path / "02_02.amc")) == both
    assert _licence(trial, (tmp_path / "02_01.amc",)) == LICENCES["CMU"]
    known = f"{LICENCES['CMU']}; passers-by: {LICENCES['AMASS']}"
    own = licence_of(Source(dataset="file", sequence="walk"))
    assert _licence(trial, (kick, odd)) == f"{known}; passers-by: {own}"


def test_where_a_clip_fails_a_complete_manifest_stays(tmp_path, anny):
    path = tmp_path / "synthetic.yaml"
    _write_listing(RECIPE, [], tmp_path, anny, Run(), False)
    before = path.read_bytes()
    _write_listing(RECIPE, [], tmp_path, anny, Run(), True)
    assert path.read_bytes() == before
    _write_listing(RECIPE, [], tmp_path, anny, Run(redo=True), True)
    assert read_manifest(path).version == "1.0.0-incomplete"


def test_a_blender_process_that_is_killed_is_started_again(tmp_path, anny):
    plain = RenderConfig.model_validate(PLAIN)
    changes = {"clips": (RECIPE.clips[1],), "camera_off": False, "render": plain, "workers": 1}
    recipe = RECIPE.model_copy(update=changes)
    killed: list[int] = []

    def kill_the_first() -> None:
        until_s = time.monotonic() + 60
        while not killed and time.monotonic() < until_s:
            for process in psutil.process_iter(["cmdline"]):
                command = process.info["cmdline"] or []
                ours = any(part.startswith(str(tmp_path)) for part in command)
                if ours and "blender" in command:
                    process.kill()
                    killed.append(process.pid)
                    return
            time.sleep(0.05)

    killer = threading.Thread(target=kill_the_first)
    killer.start()
    manifest_path = render_set(recipe, tmp_path)
    killer.join()
    assert killed
    check_manifest(manifest_path)
    assert not list((tmp_path / "failed").glob("*"))


def test_a_share_looks_into_its_own_clips_alone(tmp_path):
    """The others may be ten thousand, on a shared disk; here one that is not there."""
    paths = {"clip_path": tmp_path / "clip.npz", "body_path": tmp_path / "body.npz"}
    job = RenderJob(**paths, out_dir=tmp_path / "walk", config=RenderConfig())
    left = pytest.raises(OthersLeft, match="rendering frames: 1 of 1 are left")
    with worker_pool(Run(shard=Shard(0, 2))) as pool, left:
        try_render_clips({"walk": job}, pool, tmp_path / "failed")


def test_workers_get_absolute_paths(tmp_path, monkeypatch):
    """In another folder a worker did not find the sky.  The record is as the recipe has it."""
    monkeypatch.chdir(tmp_path)
    config = RenderConfig(scene=SceneConfig(hdri_path=Path("sky.hdr")))
    paths = {"clip_path": Path("clip.npz"), "body_path": Path("body.npz"), "out_dir": Path("walk")}
    asked: list[Job] = []
    monkeypatch.setattr(
        "gmrdata.stage.jobs.try_jobs", lambda _, jobs, *__, **___: asked.extend(jobs)
    )
    with worker_pool(Run(shard=Shard(0, 2))) as pool:
        try_render_clips({"walk": RenderJob(**paths, config=config)}, pool, tmp_path / "failed")
    job, recorded = (asked[0].arguments[name] for name in ("job", "recorded"))
    assert (job.config.scene.hdri_path, job.out_dir) == (tmp_path / "sky.hdr", tmp_path / "walk")
    assert recorded == config


def test_ids_that_collide_with_twins_are_refused():
    step = RECIPE.clips[1]
    clips = (step, step.model_copy(update={"id": "step_off"}))
    with pytest.raises(BadRecipe, match="repeated: step_off;"):
        select(RECIPE.model_copy(update={"clips": clips}), None)


def test_nothing_to_render_is_an_error(tmp_path):
    trial = RECIPE.clips[0]
    with pytest.raises(MissingInput, match=r"--motions(.|\n)*gmrdata fetch cmu 02_03 --out FOLDER"):
        render_set(RECIPE.model_copy(update={"clips": (trial,)}), tmp_path)
    with pytest.raises(BadRecipe, match="no clips"):
        render_set(RECIPE.model_copy(update={"clips": ()}), tmp_path)


def test_three_kills_change_nothing(tmp_path, anny):
    recipe, undisturbed = tmp_path / "recipe.yaml", tmp_path / "undisturbed"
    write_recipe(recipe, n_clips=2, n_frames=5)
    begin_s = time.monotonic()
    loaded = load_recipe(recipe, SyntheticRecipe)
    render_set(loaded, undisturbed, run=Run(workers=1))
    write_set_pages(loaded, undisturbed)
    whole_s = time.monotonic() - begin_s
    killed = tmp_path / "killed"
    kills = kill_and_complete(recipe, killed, VICTIMS, whole_s / 2, np.random.default_rng(1))
    assert [kill.victim for kill in kills] == list(VICTIMS)
    expected = contents(undisturbed)
    assert "synthetic.yaml" in expected and "index.html" in expected
    for folder in (path for path in tmp_path.glob("killed*") if path.is_dir()):
        assert contents(folder) == expected
        assert leftovers(folder) == []
        check_manifest(folder / "synthetic.yaml")
