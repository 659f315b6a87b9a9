"""The verb video: pictures and another system's people to a world motion, and cameras alone."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest

from gmrdata.cli import main
from gmrdata.cli.video import leave_files
from gmrdata.read.body_file import save_body
from gmrdata.read.frames import write_gray
from gmrdata.solve.plan import VideoPlan
from gmrdata.solve.request import SequenceConfig
from gmrdata.solve.solve import solve_sequence
from gmrdata.solve.verdict import VideoVerdict, unsolved
from gmrdata.solve.videos import Videos
from gmrdata.twins.pseudo_gt_error import compare_clips
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.people import PersonFiles
from tests.film.set_kills import contents
from tests.filming import INTRINSICS_PX, write_pictures
from tests.fixtures.command_line import fails_cleanly
from tests.fixtures.filmed_sets import HEIGHT_PX, N_FRAMES, WIDTH_PX
from tests.read import system_files
from tests.read.videos import make_video
from tests.sharing import made_once

FOCAL_PX = str(float(INTRINSICS_PX[0, 0]))


@pytest.fixture(scope="module")
def vibe_file(filmed_set, neutral, tmp_path_factory) -> Path:
    """VIBE's people of the arc: one in all frames, the other not in the middle ones."""
    truths = filmed_set.truth["arc_00"]
    some = np.r_[0:14, 20:N_FRAMES]
    seen = []
    for clip, rows in zip(truths, (np.arange(N_FRAMES), some), strict=True):
        motion = replace(clip.motion.take(rows), body=neutral.name)
        seen.append(system_files.seen_person(motion, camera_of(clip).at_rows(rows), neutral, rows))
    people = system_files.vibe_people(seen, np.random.default_rng(1))
    return system_files.write_joblib(tmp_path_factory.mktemp("vibe") / "vibe_output.pkl", people)


@pytest.fixture(scope="module")
def solved(filmed_set, vibe_file, neutral, tmp_path_factory) -> Path:
    """The folder that the verb leaves of the arc."""

    def make(out: Path) -> None:
        body_path = vibe_file.with_name("body.npz")
        save_body(body_path, neutral)
        frames = filmed_set.root / "imageFiles" / "arc_00"
        main(arguments(frames, out, "--fps-hz", "30", "--poses", vibe_file, "--body", body_path))

    return made_once(tmp_path_factory, "solved_video", make)


def arguments(source: Path, out: Path, *more: Any) -> list[str]:
    masks = () if "--masks" in more else ("--masks", "none")
    given = ("video", source, "--out", out, *masks, "--focal", FOCAL_PX)
    people = () if "--poses" in more else ("--poses", "none")
    return [*map(str, given), "--no-check-lens", *people, *map(str, more)]


@pytest.mark.slow
def test_people_of_vibe_move_in_the_world_as_they_did(solved, filmed_set):
    verdict = VideoVerdict.read(solved / "verdict.json")
    assert (
        verdict.accepted
        and verdict.camera.accepted
        and any("was not checked" in note for note in verdict.notes)
    )
    assert [person.id for person in verdict.people] == ["person_1", "person_2"]
    for number, true in enumerate(filmed_set.truth["arc_00"]):
        found = load_clip(solved / "pseudo_gt" / f"person_{number}.npz")
        error = compare_clips(found, true)
        assert error.ome_deg < 0.3 and error.tme_mm < 15, (error.ome_deg, error.tme_mm)
    gap = np.flatnonzero(~found.valid)
    np.testing.assert_array_equal(gap, np.arange(14, 20))
    assert np.isfinite(found.motion.pelvis_m).all()
    assert "nobody there" in verdict.people[1].dropped[0].reason


def test_files_and_a_page_lie_beside_the_motion(solved):
    formats = {path.name for path in (solved / "files").iterdir()}
    assert formats == {"colmap", "tum", "bvh", "glb", "amass"}
    page = (solved / "index.html").read_text()
    assert "files/bvh/" in page and "person_1" in page
    (model,) = (solved / "files" / "colmap").glob("*/sparse/0")
    assert pycolmap.Reconstruction(str(model)).num_reg_images() == N_FRAMES


def test_the_same_again_does_nothing_and_other_poses_need_redo(
    solved, filmed_set, vibe_file, gmrdata, works
):
    frames, before = filmed_set.root / "imageFiles" / "arc_00", _times(solved)
    given = ("--fps-hz", "30", "--body", vibe_file.with_name("body.npz"))
    said = works(*arguments(frames, solved, *given, "--poses", vibe_file))
    assert _times(solved) == before
    assert said.stdout.startswith("accepted\n")
    answer = gmrdata(*arguments(frames, solved, "--fps-hz", "30"))
    fails_cleanly(answer, "holds people, and now cameras alone")
    assert _times(solved) == before


def _times(folder: Path) -> dict[str, int]:
    stages = ("sfm", "bodies", "pseudo_gt")
    return {name: (folder / name / "stage.json").stat().st_mtime_ns for name in stages}


def test_in_a_batch_it_is_the_same_folder(solved, filmed_set, vibe_file, tmp_path, works):
    """Poses are found by the video's name; one without ends in cameras alone."""
    batch, poses, still = tmp_path / "out", tmp_path / "poses", tmp_path / "still"
    folder = shutil.copytree(solved, batch / "videos" / "arc_00")  # which need not be made again
    for name in ("arc_00", "nobody"):
        (poses / name).mkdir(parents=True)
        shutil.copy(vibe_file, poses / name / "vibe_output.pkl")
    write_pictures(still, [np.full((90, 160, 3), 90, np.uint8)] * 3)
    frames, body = filmed_set.root / "imageFiles" / "arc_00", vibe_file.with_name("body.npz")
    given = arguments(frames, batch, "--workers", "1", "--fps-hz", "30", "--poses", poses)
    said = works(given[0], still, *given[1:], "--body", body).stderr.replace("\n", " ")
    assert "1 of 2 videos have no poses and end in cameras alone: still" in said
    assert "poses that belong to no video: nobody" in said
    arc, other = Videos.read(batch / "videos.json").videos
    assert (arc.name, arc.accepted, arc.people, arc.accepted_people) == ("arc_00", True, 2, 2)
    assert (other.name, other.state, other.people) == ("still", "rejected", 0)
    for part in ("sfm", "bodies", "pseudo_gt", "overlay", "files/glb"):
        made = contents(folder / part)
        assert made and made == contents(solved / part)


@pytest.mark.slow
def test_cameras_alone_come_with_a_model_a_path_and_a_verdict(
    clips, solved_videos, dolly, tmp_path, works
):
    """And the same video in a batch leaves the same folder."""
    out = tmp_path / "walk"
    said = works(*arguments(clips / "walk.mp4", out, "--strict"))
    assert said.stdout.splitlines()[0] == "accepted" and "12 of 12 frames" in said.stderr
    assert said.stdout.splitlines()[-1] == str(out / "index.html")
    verdict = VideoVerdict.read(out / "verdict.json")
    assert verdict.fps_hz == pytest.approx(10.0) and not verdict.people
    model = pycolmap.Reconstruction(str(out / "files" / "colmap" / "sparse" / "0"))
    assert model.num_reg_images() == 12 and model.num_points3D() > 50
    rows = np.loadtxt(out / "files" / "tum" / "camera.txt")
    np.testing.assert_allclose(rows[:, 0], np.arange(12) / 10, atol=1e-6)
    path = rows[:, 1:4]
    true = dolly.world_from_cam[:, :3, 3]
    scale = np.linalg.norm(true[-1] - true[0]) / np.linalg.norm(path[-1] - path[0])
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1) * scale
    np.testing.assert_allclose(steps, np.linalg.norm(np.diff(true, axis=0), axis=1), rtol=0.1)
    assert contents(out) == contents(solved_videos / "videos" / "walk")


def test_a_wrong_file_of_people_is_said_before_cameras_are_sought(dolly, tmp_path, gmrdata):
    """It was after all of them had been solved, and a dry run said nothing."""
    out, broken = tmp_path / "out", tmp_path / "wham_output.pkl"
    broken.write_bytes(b"\x80")
    for poses, said in ((tmp_path / "gone.pkl", "no such file"), (broken, broken.name)):
        given = arguments(dolly.images_dir, out, "--fps-hz", "10", "--poses", poses)
        fails_cleanly(gmrdata(*given, "--dry-run"), said)
        fails_cleanly(gmrdata(*given), said)
    assert not (out / "sfm").exists()


def test_a_video_without_a_camera_path_is_rejected_with_the_reason(tmp_path, gmrdata, works):
    greys = (np.full((90, 160, 3), 9 * number, np.uint8) for number in range(6))
    write_pictures(tmp_path / "frames", greys)
    given = arguments(tmp_path / "frames", tmp_path / "out", "--fps-hz", "10")
    said = works(*given)
    assert said.stdout.startswith("rejected\n  ")
    assert "Traceback" not in said.stderr
    verdict = VideoVerdict.read(tmp_path / "out" / "verdict.json")
    assert not verdict.accepted and not verdict.camera.accepted and verdict.reasons
    assert not (tmp_path / "out" / "files").exists() and (tmp_path / "out" / "index.html").is_file()
    fails_cleanly(gmrdata(*given, "--strict"), "rejected")


def test_poses_of_another_video_are_refused(filmed_set, neutral, solved, tmp_path, gmrdata):
    """By their frames, by a dry run and before hours of masks and cameras; or by the size of their
    images."""
    out = tmp_path / "out"
    out.mkdir()
    (out / "sfm").symlink_to(solved / "sfm")  # which need not be made again
    frames, clip = filmed_set.root / "imageFiles" / "arc_00", filmed_set.truth["arc_00"][0]
    given = arguments(frames, out, "--fps-hz", "30", "--body", solved / "body" / "body.npz")
    for content, said in (
        (_shifted(clip, neutral, 20), "is of 56 frames or more, and the video has 36"),
        (_shifted(clip, neutral, 400), "another video's, or rate. If it was made of every n-th"),
    ):
        path = system_files.write_joblib(tmp_path / "wham_output.pkl", content)
        for dry_run in ([], ["--dry-run"]):
            fails_cleanly(gmrdata(*given, "--poses", path, *dry_run), said)
    seen = system_files.seen_person(clip.motion, camera_of(clip), neutral)
    half = system_files.write_torch(tmp_path / "a.pt", system_files.gvhmr_result(seen, 18))
    said = "is of 18 frames, and the video has 36, about every 2th"
    fails_cleanly(gmrdata(*given, "--poses", half), said)
    large = replace(seen, size_px=(HEIGHT_PX, WIDTH_PX))
    turned = system_files.write_torch(tmp_path / "b.pt", system_files.gvhmr_result(large))
    for dry_run in ([], ["--dry-run"]):
        fails_cleanly(gmrdata(*given, "--poses", turned, *dry_run), "a turned one's")
    assert not (out / "intrinsics").exists()  # said before lens, masks and cameras were sought


def _shifted(clip: Clip, body: BodyModel, by: int) -> dict[Any, Any]:
    frames = np.arange(N_FRAMES) + by
    return system_files.wham_people(
        [system_files.seen_person(clip.motion, camera_of(clip), body, frames)]
    )


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (("--focal", "0"), "--focal 0.0: Input should be greater than 0"),
        (("--fov", "60"), "give one of --focal, --fov and --intrinsics"),
        (("--masks", "silhouette"), "Use person"),
        (("--height-m", "tall"), "Give metres, as 1.78 or person_0=1.78"),
        (("--height-m", "person_0=178"), "it is in metres, from 0.5 to 2.5"),
        (("--height-m", "1.78", "1.65"), "1.65: everybody has a height already. Name each person"),
        (("--height-m", "person_0=1.7", "person_0=1.6"), "person_0 has a height already"),
        (("--every", "2", "--fps-hz", "30"), "are for a video file"),
        ((), "has no frame rate. Give it with --fps-hz"),
        (("--masks", "person", "--detector", "gone.onnx"), "--masks none goes without"),
        (("--fps-hz", "0"), "--fps-hz 0: images per second are from 0.05 to 2000"),
        (("--fps-hz=-30",), "--fps-hz -30: images per second are from 0.05 to 2000"),
        (("--fps-hz", "nan"), "--fps-hz nan: images per second are from 0.05 to 2000"),
        (("--fps-hz", "1e9"), "--fps-hz 1e+09: images per second are from 0.05 to 2000"),
        (("--fps-hz", "30", "--gravity", __file__), "--gravity is for people; leave it out"),
        (("--fps-hz", "30", "--height-m", "1.78"), "--height-m is for people; leave it out"),
    ],
)
@pytest.mark.parametrize("dry_run", [(), ("--dry-run",)])
def test_wrong_flags_name_the_remedy(flags, said, dry_run, dolly, tmp_path, gmrdata):
    out = tmp_path / "out"
    fails_cleanly(gmrdata(*arguments(dolly.images_dir, out, *flags, *dry_run)), said)
    assert not out.exists()


@pytest.mark.parametrize(("poses", "network"), [("none", "lite"), ("own", "heavy")])
def test_the_network_that_is_used_is_asked_for(
    poses, network, dolly, tmp_path, monkeypatch, gmrdata
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    flags = ["--poses", poses, "--masks", "person", "--detector", __file__]
    said = f"pose_landmark_{network}.tflite: no such model file"
    fails_cleanly(gmrdata(*arguments(dolly.images_dir, tmp_path / "out", *flags)), said)


@pytest.mark.parametrize("dry_run", [(), ("--dry-run",)])
@pytest.mark.parametrize("verb", [("masks",), ("sfm", "--camera-body", __file__)])
def test_masks_without_their_network_are_refused_before_frames_are_taken(
    verb, dry_run, tmp_path, monkeypatch, gmrdata
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    source, out = make_video(tmp_path / "walk.mp4"), tmp_path / "out"
    answer = gmrdata(*verb, source, "--out", out, "--masks", "onnx", *dry_run)
    fails_cleanly(answer, "yolox_nano.onnx: no such model file")
    assert not out.exists()


@pytest.mark.parametrize("dry_run", [(), ("--dry-run",)])
@pytest.mark.parametrize("verb", [("video", "--poses", "none"), ("masks",)])
def test_a_folder_of_masks_of_another_size_is_refused_before_others_are_made(
    verb, dry_run, tmp_path, gmrdata
):
    """A dry run took it, and a run made those of people first, for an hour."""
    source, out, masks = make_video(tmp_path / "walk.mp4"), tmp_path / "out", tmp_path / "masks"
    for number in range(8):
        write_gray(masks / f"{number:05d}.png", np.zeros((24, 32), np.uint8))
    network = ("--detector", __file__)
    command = (*verb, source, "--out", out, "--masks", "onnx", masks, *network, *dry_run)
    fails_cleanly(gmrdata(*command), "00000.png: 32x24 px, its frame is 64x48 px")
    (masks / "00000.png").unlink()
    fails_cleanly(gmrdata(*command), f"{masks}: no mask for 00000.jpg")
    assert not (out / "masks_by").exists()


@pytest.mark.parametrize("dry_run", [(), ("--dry-run",)])
def test_a_body_that_is_not_before_the_camera_is_refused_before_frames_are_taken(
    dry_run, walkers, small_body, tmp_path, gmrdata
):
    """A dry run took it, and sfm made the masks of a folder or a detector first."""
    source, out, clip_path = make_video(tmp_path / "walk.mp4"), tmp_path / "out", tmp_path / "w.npz"
    save_clip(clip_path, walkers[0], small_body.rest_pelvis_m(walkers[0].motion.shape))
    given = (source, "--out", out, "--masks", "silhouette", *dry_run)
    for verb in ("sfm", "masks"):
        answer = gmrdata(verb, *given, "--camera-body", clip_path)
        fails_cleanly(answer, "w.npz: no camera-frame motion with intrinsics")
    fails_cleanly(gmrdata("masks", *given), "a clip in the camera's frame: pass --camera-body")
    person = PersonFiles(clip_path, clip_path)
    with pytest.raises(BadMotionFile, match=r"w\.npz: no camera-frame motion"):
        solve_sequence(source, (person,), out, SequenceConfig(masks=None))
    assert not out.exists()


@pytest.mark.parametrize("dry_run", [(), ("--dry-run",)])
def test_a_video_with_a_rate_is_refused_before_its_frames_are_taken(dry_run, tmp_path, gmrdata):
    source, out = make_video(tmp_path / "walk.mp4"), tmp_path / "out"
    said = f"{source}: a video has its own times. Leave --fps-hz out"
    fails_cleanly(gmrdata(*arguments(source, out, "--fps-hz", "30", *dry_run)), said)
    assert not out.exists()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "empty file (0 bytes)"),
        (b"#EXTM3U\n/etc/passwd\n", "no video"),
        (b"\x00\x00\x00\x18ftypmp42" + bytes(4000), "no video"),
    ],
)
def test_what_is_no_video_is_refused_by_name_and_leaves_nothing(content, said, tmp_path, gmrdata):
    source, out = tmp_path / "walk.mp4", tmp_path / "out"
    source.write_bytes(content)
    fails_cleanly(gmrdata(*arguments(source, out)), f"{source}: {said}")
    assert not (out / "frames").exists() and not (out / "verdict.json").exists()


def test_a_dry_run_says_how_much_there_is_to_do(dolly, tmp_path, works):
    source = make_video(tmp_path / "a.mp4", rate_hz=10)
    for given, rate, said in (
        (dolly.images_dir, ("--fps-hz", "10"), "12 images of 320x180"),
        (source, (), "8 images of 64x48"),
    ):
        printed = works(*arguments(given, tmp_path / "out", *rate), "--dry-run").stdout
        assert f"{said} px, about 0.9 GB of memory" in printed
        assert "sfm" in printed and "page" in printed
    assert not (tmp_path / "out").exists()
    long = VideoPlan(18_780, (1280, 720), {}, 14.23).summary(source)
    assert long.endswith(" GB of memory and 14.2 GB of disk")


def test_files_that_can_not_be_written_are_said_without_a_page(tmp_path, capsys):
    camera = unsolved("no two frames show the same place", 3)
    verdict = VideoVerdict(
        images_dir="frames", fps_hz=10.0, accepted=False, reasons=camera.reasons, camera=camera,
        people=(), notes=(),
    )  # fmt: skip
    (tmp_path / "pseudo_gt").mkdir()
    leave_files(tmp_path, verdict)
    said = " ".join(capsys.readouterr().err.split())
    assert "all formats not written" in said and "quality.json" in said
