"""The verb video for many: each as if it were alone, whoever makes it, and failures by name."""

import subprocess
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.cli import main
from gmrdata.world.videos import Videos
from tests.film.set_kills import contents, leftovers
from tests.filming import INTRINSICS_PX, Filmed
from tests.read.videos import make_video
from tests.sharing import made_once

Gmrdata = Callable[..., subprocess.CompletedProcess[str]]
ASKED = ("--masks", "none", "--focal", str(float(INTRINSICS_PX[0, 0])), "--no-check-lens")


@pytest.fixture(scope="module")
def clips(dolly: Filmed, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a walk, a video in which nothing moves, and a file that is broken."""
    folder = tmp_path_factory.mktemp("videos") / "clips"
    folder.mkdir()
    images = [cv2.imread(str(path))[..., ::-1] for path in sorted(dolly.images_dir.iterdir())]
    make_video(folder / "walk.mp4", list(map(np.ascontiguousarray, images)),
               rate_hz=10, options={"crf": "4"})  # fmt: skip
    make_video(folder / "still.MP4", [np.full((48, 64, 3), 90, np.uint8)] * 4, rate_hz=10)
    (folder / "broken.mov").write_bytes(b"\x00\x00\x00\x18ftypmp42" + bytes(4000))
    (folder / "notes.txt").write_text("mine")
    return folder


@pytest.fixture(scope="module")
def solved(clips: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that one process leaves of them."""

    def make(out: Path) -> None:
        with pytest.raises(SystemExit, match="1"):
            main([*map(str, ("video", clips, "--out", out, "--workers", 1)), *ASKED])

    return made_once(tmp_path_factory, "solved_videos", make)


def test_a_record_and_an_index_say_what_became_of_each(solved: Path) -> None:
    broken, still, walk = Videos.read(solved / "videos.json").videos
    assert (broken.name, broken.state, broken.frames) == ("broken", "failed", 0)
    assert "broken.mov: no video" in broken.reasons[0]
    assert (still.name, still.state, still.frames) == ("still", "rejected", 4)
    assert still.reasons[0].startswith("frames: 0 features per frame")
    assert (walk.name, walk.state, walk.frames, walk.kept_frames) == ("walk", "accepted", 12, 12)
    assert walk.focal_px == pytest.approx(INTRINSICS_PX[0, 0], abs=1e-3)
    assert walk.focal_from == "given"
    assert (walk.people, walk.fps_hz) == (0, pytest.approx(10.0))
    page = (solved / "index.html").read_text()
    for name in ("still", "walk"):
        link = f"videos/{name}/index.html"
        assert f'href="{link}"' in page and (solved / link).is_file()
    assert 'href="failed/broken.txt"' in page and still.reasons[0] in page


def test_each_folder_is_that_of_the_video_alone(
    solved: Path, clips: Path, gmrdata: Gmrdata, tmp_path: Path
) -> None:
    alone = gmrdata("video", clips / "walk.mp4", "--out", tmp_path / "walk", *ASKED)
    assert alone.returncode == 0 and alone.stdout.startswith("accepted\n"), alone.stderr
    assert contents(tmp_path / "walk") == contents(solved / "videos" / "walk")


def test_two_shards_leave_the_bytes_of_one_process(
    solved: Path, clips: Path, gmrdata: Gmrdata, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    first = gmrdata("video", clips, "--out", out, *ASKED, "--shard", "2/2")
    assert first.returncode == 0 and "shard 1/2: 1 left, not begun" in first.stderr, first.stderr
    assert not (out / "videos.json").exists()
    left = gmrdata("merge", out)
    assert left.returncode == 1 and "shard 1/2: " in left.stderr
    last = gmrdata("video", clips, "--out", out, *ASKED, "--shard", "1/2")
    assert last.returncode == 1 and "solving videos: 1 of 3 failed" in last.stderr
    assert "broken.mov: no video" in last.stderr and "1 accepted, 1 rejected" in last.stdout
    assert contents(out) == contents(solved)
    assert leftovers(out) == leftovers(solved)
