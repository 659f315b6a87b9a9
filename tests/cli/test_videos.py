"""The verb video for many: each as if it were alone, whoever makes it, and failures by name."""

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from gmrdata.cli.shards import COMMAND_FILE
from gmrdata.solve.videos import Videos
from tests.film.set_kills import contents, leftovers
from tests.filming import CAMERAS_ALONE, INTRINSICS_PX

Gmrdata = Callable[..., subprocess.CompletedProcess[str]]


def test_a_record_and_an_index_say_what_became_of_each(solved_videos: Path) -> None:
    broken, still, walk = Videos.read(solved_videos / "videos.json").videos
    assert (broken.name, broken.state, broken.frames) == ("broken", "failed", 0)
    assert "broken.mov: no video" in broken.reasons[0]
    assert (still.name, still.state, still.frames) == ("still", "rejected", 4)
    assert still.reasons[0].startswith("frames: 0 features per frame")
    assert (walk.name, walk.state, walk.frames, walk.kept_frames) == ("walk", "accepted", 12, 12)
    assert walk.focal_px == pytest.approx(INTRINSICS_PX[0, 0], abs=1e-3)
    assert walk.focal_from == "given"
    assert (walk.people, walk.fps_hz) == (0, pytest.approx(10.0))
    page = (solved_videos / "index.html").read_text()
    for name in ("still", "walk"):
        link = f"videos/{name}/index.html"
        assert f'href="{link}"' in page and (solved_videos / link).is_file()
    assert 'href="failed/broken.txt"' in page and still.reasons[0] in page


def test_two_shards_leave_the_bytes_of_one_process(
    solved_videos: Path, clips: Path, gmrdata: Gmrdata, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    command = ("video", clips, "--out", out, *CAMERAS_ALONE, "--workers", "1", "--shard")
    first = gmrdata(*command, "2/2")
    assert first.returncode == 0 and "shard 1/2: broken, walk\n" in first.stderr, first.stderr
    assert not (out / "videos.json").exists()
    left = gmrdata("merge", out)
    assert left.returncode == 1 and "shard 1/2: " in left.stderr
    last = gmrdata(*command, "1/2")
    assert last.returncode == 1 and "solving videos: 1 of 3 failed" in last.stderr
    assert "broken.mov: no video" in last.stderr and "1 accepted, 1 rejected" in last.stdout
    (out / COMMAND_FILE).unlink()
    assert contents(out) == contents(solved_videos)
    assert leftovers(out) == leftovers(solved_videos)


def test_the_same_again_makes_what_is_missing_alone(
    solved_videos: Path, clips: Path, gmrdata: Gmrdata, tmp_path: Path
) -> None:
    """A rejected video is not solved again."""
    mended, out = shutil.copytree(clips, tmp_path / "clips"), tmp_path / "out"
    (mended / "broken.mov").unlink()
    shutil.copytree(solved_videos, out)
    shutil.rmtree(out / "videos" / "walk" / "files")
    made_ns = (out / "entries" / "still" / "stage.json").stat().st_mtime_ns
    command = ("video", mended, "--out", out, *CAMERAS_ALONE)
    again = gmrdata(*command)
    assert again.returncode == 0 and "1 accepted, 1 rejected, 0 failed" in again.stdout
    assert contents(out / "videos") == contents(solved_videos / "videos")
    assert (out / "entries" / "still" / "stage.json").stat().st_mtime_ns == made_ns
    assert gmrdata(*command, "--shard", "1/1").stdout == again.stdout
    strict = gmrdata(*command, "--strict")
    assert strict.returncode == 1 and "1 of 2 videos were rejected" in strict.stderr
    other = gmrdata(*command, "--seed", "1")
    assert other.returncode == 1 and "other values of config.solve.sfm.seed" in other.stderr


def test_a_dry_run_lists_the_videos_and_does_nothing(
    clips: Path, gmrdata: Gmrdata, tmp_path: Path
) -> None:
    said = gmrdata("video", clips, "--out", tmp_path / "out", *CAMERAS_ALONE, "--dry-run")
    assert said.returncode == 1 and "1 of 3 videos can't be read" in said.stderr
    rows = {words[0]: words[1:3] for line in said.stdout.splitlines() if (words := line.split())}
    assert rows["walk"] == ["12", "320x180"] and rows["still"] == ["4", "64x48"]
    assert rows["all"][0] == "16" and rows["broken"] == ["-", "-"]
    assert "broken.mov: no video" in said.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("names", "flags", "said"),
    [
        (("walk.mp4",), ("--shard", "1/2"), "are for several videos"),
        (("walk.mp4",), ("--workers", "2"), "Leave them out for one"),
        ((), (), "nothing given. Name a video"),
        ((".",), ("--fps-hz", "10"), "videos have their own times"),
        ((".",), ("--masks", "."), "a folder of masks is of one video"),
        ((".",), ("--poses", "walk.mp4"), "Give that, or one video alone"),
        (("walk.mp4", "../clips/walk.mp4"), (), "would both be video walk"),
        (("walk.mp4", "gone.mp4"), (), "gone.mp4: no such video"),
    ],
)
def test_wrong_flags_name_the_remedy(
    names: tuple[str, ...],
    flags: tuple[str, ...],
    said: str,
    clips: Path,
    gmrdata: Gmrdata,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(clips)
    masks = () if "--masks" in flags else CAMERAS_ALONE[:2]
    ended = gmrdata("video", *names, "--out", tmp_path / "out", *masks, *flags)
    assert ended.returncode == 1 and said in " ".join(ended.stderr.split()), ended.stderr
    assert not (tmp_path / "out").exists()
