"""A batch of folders of images, some of which have times; and one folder solved again."""

import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from gmrdata import plan_videos, solve_video, solve_videos
from gmrdata.cameras.lens.intrinsics import (
    GivenIntrinsics,
    IntrinsicsConfig,
    load_intrinsics,
)
from gmrdata.people.sources import MasksConfig, PersonSource
from gmrdata.read.video import extract_video
from gmrdata.read.video_files import NamedVideo
from gmrdata.solve import videos as solving
from gmrdata.solve.request import INTRINSICS, PeopleBySystem, SolveConfig, SolveRequest
from gmrdata.solve.verdict import OVERLAY, PAGE, VERDICT_FILE, VIEW, VideoVerdict
from gmrdata.solve.videos import VideoBatch, Videos, _with_files
from gmrdata.stage.run import Run
from gmrdata.stage.store import run_stage
from gmrdata.values.errors import (
    BadIntrinsics,
    BadRecipe,
    MissingInput,
    StageFailed,
    StaleOutput,
)
from gmrdata.values.files import STAGE_FILE, read_json, write_json
from gmrdata.values.records import Config
from tests.film.set_kills import contents
from tests.frame_sets import grey_images
from tests.read import system_files
from tests.read.videos import make_video


def test_folders_that_were_extracted_from_videos_have_times(tmp_path):
    """A batch of them was refused with a rate, and without."""
    for name, rate_hz in (("a", 10), ("b", 20)):
        extract_video(make_video(tmp_path / f"{name}.mp4", rate_hz=rate_hz), tmp_path / name)
    grey_images(tmp_path / "c")

    def rates_hz(names: str, fps_hz: float | None = None) -> list[float | None]:
        record = solve_videos(
            [tmp_path / name for name in names],
            tmp_path / f"out_{names}",
            poses="none",
            fps_hz=fps_hz,
            config=SolveConfig(masks=None),
            run=Run(workers=1),
        )
        return [video.fps_hz for video in Videos.read(record).videos]

    assert rates_hz("ab") == pytest.approx([10.0, 20.0])
    assert rates_hz("ac", 30.0) == pytest.approx([10.0, 30.0])
    with pytest.raises(BadRecipe, match="c: a folder of images has no frame rate"):
        rates_hz("bc")
    with pytest.raises(BadRecipe, match=r"a: a video has its own times\. Leave --fps-hz out"):
        rates_hz("ab", 30.0)


@pytest.mark.parametrize("kind", [str, Path])
def test_a_folder_that_is_in_no_list_is_one_source(kind, tmp_path):
    """Its letters were sought as videos; a path could not be gone through."""
    (tmp_path / "clips").mkdir()
    walk = make_video(tmp_path / "clips" / "walk.mp4")
    assert plan_videos(kind(walk), poses="none").is_of_one
    planned = plan_videos(kind(walk.parent), poses="none", config=SolveConfig(masks=None))
    assert [row[0] for row in planned.rows] == ["walk", "all"]
    with pytest.raises(BadRecipe, match=r"walk\.mp4: is one video\. Use solve_video"):
        solve_videos(kind(walk), tmp_path / "out", poses="none")


def test_no_source_at_all_is_refused(tmp_path):
    """A pattern that fitted no file left an empty record, as if all were done."""
    with pytest.raises(BadRecipe, match=r"nothing given\. Name a video"):
        solve_videos([], tmp_path / "out", poses="none")
    with pytest.raises(BadRecipe, match=r"nothing given\. Name a video"):
        plan_videos([], poses="none")
    assert not (tmp_path / "out").exists()


def test_a_worker_in_another_folder_finds_the_networks(tmp_path, monkeypatch):
    """Each video failed there: the detector's path counted from where the worker ran."""
    monkeypatch.chdir(tmp_path)
    names = ("net.onnx", "net.tflite")
    for name in names:
        (tmp_path / name).touch()
    detector, landmarks = map(Path, names)
    source = PersonSource(model=detector, landmarks=landmarks)
    config = SolveConfig(masks=MasksConfig(sources=(source,)))
    video = NamedVideo("walk", tmp_path / "walk.mp4")
    batch = VideoBatch(tmp_path / "out", SolveRequest(Path(), PeopleBySystem()), config)
    found = _with_files([video], batch)
    own = [tmp_path / name for name in names]
    assert [*found.config.networks.values()] == [*found.own_files.values()] == own
    assert [*found.networks[True].values()] == own
    assert {*own, video.path} < {*found.inputs(video).values()}
    assert found.recipe(video) == batch.recipe(video)


def test_a_video_of_cameras_alone_is_the_same_beside_one_with_people(tmp_path):
    """It was refused as of another recipe, as soon as another video of the batch got poses."""
    (network := tmp_path / "net.onnx").touch()
    source = PersonSource(model=network, landmarks=network)
    config = SolveConfig(masks=MasksConfig(sources=(source,)))
    alone, other = (NamedVideo(name, tmp_path / f"{name}.mp4") for name in ("alone", "other"))
    posed = replace(other, poses_path=tmp_path / "other.pkl")
    batch = VideoBatch(tmp_path / "out", SolveRequest(Path()), config)
    first, then = (_with_files([alone, one], batch) for one in (other, posed))
    assert first.recipe(alone) == then.recipe(alone) != then.recipe(posed)
    assert first.inputs(alone) == then.inputs(alone)


ALONE: dict[str, Any] = {
    "poses": "none",
    "fps_hz": 30,
    "lens": GivenIntrinsics(focal_px=60.0),
    "config": SolveConfig(masks=None, intrinsics=IntrinsicsConfig(look_in_frames=False)),
}
SHOWN = {PAGE, VIEW, OVERLAY}


@pytest.mark.parametrize(
    ("lens", "said"),
    [
        ({"focal_px": 1.0}, r"length of 1 px was given\. No camera sees that of 64x48 px"),
        ({"file": "odd.txt"}, r"odd\.txt: can't be read as intrinsics"),
    ],
)
def test_a_lens_that_none_can_be_is_refused_before_anything_is_made(
    lens, said, tmp_path, monkeypatch
):
    """Masks were made first, for hours maybe, and a dry run said nothing of it."""
    monkeypatch.chdir(tmp_path)
    Path("odd.txt").write_text("x")
    frames, asked = grey_images(tmp_path / "frames"), ALONE | {"lens": GivenIntrinsics(**lens)}
    with pytest.raises(BadIntrinsics, match=said):
        plan_videos(frames, **asked)
    with pytest.raises(BadIntrinsics, match=said):
        solve_video(frames, "out", **asked)
    assert not Path("out").exists()


def test_a_dry_run_refuses_the_body_and_the_gravity_that_a_run_does(tmp_path):
    frames, asked = grey_images(tmp_path / "frames"), ALONE | {"poses": tmp_path / "wham.pkl"}
    system_files.write_joblib(tmp_path / "wham.pkl", system_files.some_wham({0: 3}))
    with pytest.raises(MissingInput, match=r"gone\.pkl: no such body file"):
        plan_videos(frames, **asked, body="gone.pkl")
    gravity = tmp_path / "gravity.csv"
    for said, text in (
        ("no gravity can be read", "frame,x,y\n0,0,1\n"),
        ("has gravity up to frame 9, and there are 3", "frame,x,y,z\n0,0,1,0\n1,0,1,0\n9,0,1,0\n"),
    ):
        gravity.write_text(text)
        for find in (plan_videos, partial(solve_video, out_dir=tmp_path / "out")):
            with pytest.raises(BadIntrinsics, match=rf"gravity\.csv: {said}"):
                find(frames, **asked, gravity=gravity)


FILES = ("notes.txt", "tum/camera.txt", "bvh/person_0/person_0_00000-00003.bvh", "glb/person_0.glb")


def with_page(frames: Path, out: Path) -> dict[Path, int]:
    """The verdict on a folder of images and what shows it, with the time of each."""
    verdict_path = solve_video(frames, out, **ALONE)
    for name in (PAGE, VIEW):
        (out / name).write_text("rejected")
    run_stage("overlay", out / OVERLAY, Config(), {}, lambda _: None)
    for name in FILES:
        (out / "files" / name).parent.mkdir(parents=True, exist_ok=True)
        (out / "files" / name).write_text("of the first verdict")
    return {path: path.stat().st_mtime_ns for path in (verdict_path, *map(out.joinpath, SHOWN))}


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@pytest.mark.parametrize("is_other", [True, False])
def test_a_page_of_another_verdict_is_not_left(tmp_path, is_other):
    """It called a rejected video accepted, and showed the cameras of the one before.  Files for
    other programs stayed until the verb wrote others, and from Python for good."""
    frames, out = grey_images(tmp_path / "a"), tmp_path / "out"
    made_ns = with_page(frames, out)
    solve_video(frames, out, **ALONE, run=Run(redo=True))
    assert {path: path.stat().st_mtime_ns for path in made_ns} == made_ns
    assert contents(out / "files").keys() == {*FILES}
    # Of a copy elsewhere all stages stay, and the verdict says where it is.
    other = grey_images(tmp_path / "b", 4) if is_other else shutil.copytree(frames, tmp_path / "b")
    solve_video(other, out, **ALONE, run=Run(redo=is_other))
    assert not names(out) & SHOWN and VERDICT_FILE in names(out)
    assert contents(out / "files").keys() == {"notes.txt"}


def test_a_verdict_names_the_images_folder_alike_from_any_working_directory(tmp_path):
    """From another one it was another verdict, which took the page and the files with it."""
    frames, out = grey_images(tmp_path / "a"), tmp_path / "out"
    for same in (frames, out / ".." / "a"):
        verdict = VideoVerdict.read(solve_video(same, out, **ALONE))
        assert verdict.images_dir == str(frames)


def test_a_page_that_is_no_verdicts_stays(tmp_path):
    out = tmp_path / "out"
    (out / OVERLAY).mkdir(parents=True)
    (out / PAGE).write_text("mine")
    solve_video(grey_images(tmp_path / "a"), out, **ALONE)
    assert (out / PAGE).read_text() == "mine"
    solve_video(grey_images(tmp_path / "b", 4), out, **ALONE, run=Run(redo=True))
    assert OVERLAY in names(out)


def test_a_killed_redo_leaves_no_verdict_of_the_video_before(tmp_path, monkeypatch):
    """It stayed beside the new cameras, and `gmrdata page` said that these were accepted."""
    frames, out = grey_images(tmp_path / "a"), tmp_path / "out"
    made_ns = with_page(frames, out)

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(solving, "judge_video", stop)
    with pytest.raises(KeyboardInterrupt):
        solve_video(frames, out, **ALONE, run=Run(redo=True))
    assert {path: path.stat().st_mtime_ns for path in made_ns} == made_ns
    with pytest.raises(KeyboardInterrupt):
        solve_video(grey_images(tmp_path / "b", 4), out, **ALONE, run=Run(redo=True))
    assert not names(out) & {VERDICT_FILE, *SHOWN}


def test_a_batch_and_a_video_alone_are_not_in_one_folder(tmp_path):
    """The video's page took the place of the batch's."""
    paths, out = [grey_images(tmp_path / name) for name in "ab"], tmp_path / "out"
    solve_videos(paths, out, **ALONE, run=Run(workers=1))
    before = names(out)
    with pytest.raises(StaleOutput, match=r"out: holds a batch\. Pass one of its videos' folders"):
        solve_video(paths[0], out, **ALONE)
    assert names(out) == before
    solve_video(paths[0], out / "videos" / "a", **ALONE)
    with pytest.raises(StaleOutput, match="a: holds one video's result. Pass another --out"):
        solve_videos(paths, out / "videos" / "a", **ALONE, run=Run(workers=1))
    assert "videos" not in names(out / "videos" / "a")


@pytest.mark.parametrize("told", [{"fps_hz": 60}, {"lens": GivenIntrinsics(focal_px=77.0)}])
def test_a_video_of_a_batch_that_was_solved_alone_has_a_line_of_its_own(tmp_path, told):
    """Its line stayed that of the batch's settings, with --redo too."""
    paths, out = [grey_images(tmp_path / name) for name in "ab"], tmp_path / "out"
    before = Videos.read(solve_videos(paths, out, **ALONE, run=Run(workers=1))).videos
    solve_video(paths[0], out / "videos" / "a", **(ALONE | told), run=Run(redo=True))
    if "lens" in told:
        with pytest.raises(StageFailed, match=r"intrinsics: made with other values.*--redo"):
            solve_videos(paths, out, **ALONE, run=Run(workers=1))
        assert Videos.read(out / "videos.json").in_state("failed")
    again = solve_videos(paths, out, **ALONE, run=Run(workers=1, redo=True))
    assert Videos.read(again).videos == before
    verdict = VideoVerdict.read(out / "videos" / "a" / VERDICT_FILE)
    lens = load_intrinsics(out / "videos" / "a" / INTRINSICS)
    assert (verdict.fps_hz, lens.focal_px) == (before[0].fps_hz, before[0].focal_px) == (30.0, 60.0)


def test_a_line_that_says_not_of_what_it_was_written_is_written_again(tmp_path):
    """Of an earlier version: the stages are as they were."""
    paths, out = [grey_images(tmp_path / name) for name in "ab"], tmp_path / "out"
    solve_videos(paths, out, **ALONE, run=Run(workers=1))
    path = out / "entries" / "a" / STAGE_FILE
    stages = {stage: stage.stat().st_mtime_ns for stage in out.glob(f"videos/a/*/{STAGE_FILE}")}
    left = read_json(path)
    assert {*left["facts"]} == {VERDICT_FILE, "intrinsics/intrinsics.json"}
    write_json(path, left | {"facts": {}})
    solve_videos(paths, out, **ALONE, run=Run(workers=1))
    assert read_json(path)["facts"] == left["facts"]
    assert stages and {stage: stage.stat().st_mtime_ns for stage in stages} == stages


def leave_view(out: Path, _: VideoVerdict) -> None:
    (out / VIEW).write_text("of " + out.name)


def test_a_view_that_was_lost_is_made_again(tmp_path):
    """The page's link to it led nowhere, and a batch was said to be whole."""
    paths, out = [grey_images(tmp_path / name) for name in "ab"], tmp_path / "out"
    solve_videos(paths, out, **ALONE, after=leave_view, run=Run(workers=1))
    before = contents(out)
    (out / "videos" / "b" / VIEW).unlink()
    solve_videos(paths, out, **ALONE, after=leave_view, run=Run(workers=1))
    assert contents(out) == before


def test_a_folder_among_the_images_of_a_batch_is_not_read(tmp_path):
    """As --out of masks: the batch was refused as of other inputs, and one video alone was not."""
    paths, out = [grey_images(tmp_path / name) for name in "ab"], tmp_path / "out"
    solve_videos(paths, out, **ALONE, run=Run(workers=1))
    before = contents(out)
    (paths[0] / "masks").mkdir()
    (paths[0] / "masks" / "00000.png").write_bytes(b"as a stage leaves there")
    solve_videos(paths, out, **ALONE, run=Run(workers=1))
    assert contents(out) == before
