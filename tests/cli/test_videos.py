"""Many videos, shards and merge: the bytes of one process, and failures by name."""

import json
import shutil
import subprocess

import pytest

from gmrdata.cli.answers import as_loud
from gmrdata.cli.shards import COMMAND_FILE, CommandRecord, merging, share
from gmrdata.solve.videos import Videos
from gmrdata.stage.jobs import OthersLeft
from gmrdata.stage.progress import console
from gmrdata.values.errors import BadRecord
from tests.film.set_kills import contents, leftovers
from tests.filming import CAMERAS_ALONE, INTRINSICS_PX
from tests.fixtures.command_line import fails_cleanly


@pytest.mark.slow
def test_a_record_and_an_index_say_what_became_of_each(solved_videos):
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
    assert "camera to use" in page  # a dropped frame may have a camera
    for name in ("still", "walk"):
        link = f"videos/{name}/index.html"
        assert f'href="{link}"' in page and (solved_videos / link).is_file()
    assert 'href="failed/broken.txt"' in page and still.reasons[0] in page


@pytest.mark.slow
def test_two_shards_leave_the_bytes_of_one_process(solved_videos, clips, gmrdata, works, tmp_path):
    out = tmp_path / "out"
    command = ("video", clips, "--out", out, *CAMERAS_ALONE, "--workers", "1", "--shard")
    first = works(*command, "2/2")
    assert "shard 1/2: broken, walk\n" in first.stderr
    assert not (out / "videos.json").exists()
    fails_cleanly(gmrdata("merge", out), "shard 1/2: ")
    last = gmrdata(*command, "1/2")
    fails_cleanly(last, "solving videos: 1 of 3 failed", "broken.mov: no video")
    assert "1 accepted, 1 rejected" in last.stdout
    (out / COMMAND_FILE).unlink()
    assert contents(out) == contents(solved_videos)
    assert leftovers(out) == leftovers(solved_videos)


def test_the_same_again_makes_what_is_missing_alone(solved_videos, clips, gmrdata, works, tmp_path):
    """A rejected video is not solved again."""
    mended, out = shutil.copytree(clips, tmp_path / "clips"), tmp_path / "out"
    (mended / "broken.mov").unlink()
    shutil.copytree(solved_videos, out)
    shutil.rmtree(out / "videos" / "walk" / "files")
    made_ns = (out / "entries" / "still" / "stage.json").stat().st_mtime_ns
    command = ("video", mended, "--out", out, *CAMERAS_ALONE)
    again = works(*command)
    assert "1 accepted, 1 rejected, 0 failed" in again.stdout
    assert contents(out / "videos") == contents(solved_videos / "videos")
    assert (out / "entries" / "still" / "stage.json").stat().st_mtime_ns == made_ns
    assert gmrdata(*command, "--shard", "1/1").stdout == again.stdout
    fails_cleanly(gmrdata(*command, "--strict"), "1 of 2 videos were rejected")
    told = json.loads(gmrdata(*command, "--json").stdout)
    assert told["videos"] == json.loads((out / "videos.json").read_text())["videos"]
    assert told["page"] == str(out / "index.html")
    fails_cleanly(gmrdata(*command, "--seed", "1"), "other values of config.solve.sfm.seed")


def test_what_failed_is_said_where_nothing_is_there_to_show(clips, gmrdata, tmp_path, no_scheduler):
    """That `videos.json` is missing was said instead."""
    command = ("video", clips, "--out", tmp_path / "out", *CAMERAS_ALONE)
    failed = gmrdata(*command, "--scheduler", no_scheduler)
    fails_cleanly(failed, no_scheduler)
    assert "videos.json" not in failed.stderr


def test_an_old_result_is_not_printed_where_no_worker_is_reached(
    clips, gmrdata, tmp_path, no_scheduler
):
    """A script read it as that of the videos that it had given."""
    out = tmp_path / "out"
    out.mkdir()
    Videos(videos=()).write(out / "videos.json")
    before = contents(out)
    command = ("video", clips, "--out", out, *CAMERAS_ALONE, "--json")
    failed = gmrdata(*command, "--scheduler", no_scheduler)
    fails_cleanly(failed, f"no Dask scheduler at {no_scheduler}")
    assert failed.stdout == "" and contents(out) == before


def test_a_dry_run_lists_the_videos_and_does_nothing(clips, gmrdata, tmp_path):
    said = gmrdata("video", clips, "--out", tmp_path / "out", *CAMERAS_ALONE, "--dry-run")
    fails_cleanly(said, "1 of 3 videos can't be read", "broken.mov: no video")
    rows = {words[0]: words[1:3] for line in said.stdout.splitlines() if (words := line.split())}
    assert rows["walk"] == ["12", "320x180"] and rows["still"] == ["4", "64x48"]
    assert rows["all"][0] == "16" and rows["broken"] == ["-", "-"]
    assert "up to 0.9 GB of memory for each at work" in " ".join(said.stdout.split())
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("names", "flags", "said"),
    [
        (("walk.mp4",), ("--shard", "1/2"), "are for several videos"),
        (("walk.mp4",), ("--workers", "2"), "Leave them out for one"),
        ((), (), "nothing given. Name a video"),
        ((".",), ("--fps-hz", "10"), "a video has its own times. Leave --fps-hz out"),
        ((".",), ("--masks", "."), "a folder of masks is of one video"),
        ((".",), ("--poses", "walk.mp4"), "Give that, or one video alone"),
        (("walk.mp4", "../clips/walk.mp4"), (), "would both be video walk"),
        (("walk.mp4", "gone.mp4"), (), "gone.mp4: no such file or folder"),
    ],
)
def test_wrong_flags_name_the_remedy(names, flags, said, clips, gmrdata, tmp_path, monkeypatch):
    monkeypatch.chdir(clips)
    masks = () if "--masks" in flags else CAMERAS_ALONE[:2]
    fails_cleanly(gmrdata("video", *names, "--out", tmp_path / "out", *masks, *flags), said)
    assert not (tmp_path / "out").exists()


@pytest.fixture
def command(tmp_path, walks_command) -> tuple[object, ...]:
    """Five motion files, of which one can't be read."""
    arguments = walks_command(4)
    (tmp_path / "motions" / "broken.bvh").write_text("HIERARCHY\n")
    return arguments


def test_shards_and_merge_leave_the_bytes_of_one_process(command, gmrdata, tmp_path):
    alone, shared = tmp_path / "a" / "out", tmp_path / "b" / "out"
    fails_cleanly(gmrdata(*command, "--out", alone), "broken.bvh")

    def shard(share: str) -> subprocess.CompletedProcess[str]:
        return gmrdata(*command, "--out", shared, "--workers", "1", f"--shard={share}")

    fails_cleanly(gmrdata("merge", shared), f"{shared}: no such file or folder")
    second = shard("2/3")
    assert second.returncode == 0, second.stderr
    assert "shard 1/3: broken, walk3\n  shard 3/3: walk2\n" in second.stderr
    fails_cleanly(shard("1/3"), "broken.bvh", "reading motions: 1 of 5 are left")
    left = gmrdata("merge", shared)
    fails_cleanly(left, "shard 3/3: walk2\n")
    assert "shard 1/3" not in left.stderr
    last = shard("3/3")
    assert last.returncode == 0 and "shard 1/3: broken\n" in last.stderr
    assert not (shared / "motions.yaml").exists()
    fails_cleanly(gmrdata("merge", shared), "1 of 5 files could not be read")
    assert contents(shared).keys() - contents(alone).keys() == {COMMAND_FILE}
    assert contents(alone).items() <= contents(shared).items()
    assert leftovers(shared) == leftovers(alone) == []
    # Without the file that can't be read a shard finds everything made, and merge says where.
    (tmp_path / "motions" / "broken.bvh").unlink()
    assert shard("2/3").returncode == 0
    for _ in range(2):
        merged = gmrdata("merge", shared)
        assert merged.returncode == 0 and merged.stdout == f"{shared / 'motions.yaml'}\n"


def test_one_shard_of_one_is_merged_and_a_dry_run_is_none(walks_command, gmrdata, works, tmp_path):
    out = tmp_path / "out"
    command = (*walks_command(1), "--out", out, "--shard", "1/1", "--workers", "1")
    said = works(*command, "--dry-run").stderr
    assert "--dry-run is of the whole batch, whatever --shard says" in said
    assert not out.exists()
    out.mkdir()
    fails_cleanly(gmrdata("merge", out), "nothing to merge: no shard ended here")
    works(*command)
    works(*command, "--dry-run")
    assert works("merge", out).stdout == f"{out / 'motions.yaml'}\n"


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("fetch", "--out", "out", "--shard", "1/2"),
        ("render", "--out", "elsewhere", "--shard", "1/2"),
        ("render", "--out", "out"),
        ("render", "--shard", "1/2"),
        ("render", "--shard", "1/2", "--out"),
    ],
)
def test_a_record_with_another_command_is_refused(arguments, tmp_path):
    record = CommandRecord(arguments=arguments, folder=str(tmp_path))
    with pytest.raises(BadRecord, match="not a command of shards .* --shard 0/N"):
        merging(tmp_path / COMMAND_FILE, record, tmp_path / "out")


def test_a_record_of_a_folder_that_is_not_here_is_refused(tmp_path):
    """Only that there is no such folder was said."""
    arguments, gone = ("render", "--out", str(tmp_path), "--shard", "1/2"), tmp_path / "gone"
    with pytest.raises(BadRecord, match=f"not a command of shards of .* in {gone}.* --shard 0/N"):
        merging(
            tmp_path / COMMAND_FILE,
            CommandRecord(arguments=arguments, folder=str(gone)),
            tmp_path,
        )


@pytest.mark.parametrize(
    ("typed", "out", "merges"),
    [
        (
            ("render", "set.yaml", "--out", "out", "--shard", "2/40", "--redo"),
            "out",
            ["render", "set.yaml", "--out", "out", "--shard", "0/40", "--redo"],
        ),
        (
            ("motions", "a=1/walk.bvh", "--out", "b=2", "--shard", "1/2", "--fps-hz", "30"),
            "b=2",
            ["motions", "a=1/walk.bvh", "--out", "b=2", "--shard", "0/2", "--fps-hz", "30"],
        ),
        (  # of flags that stand twice the last one counts, as for the shard itself
            ("render", "--out", "a", "--shard", "1/3", "--out", "out", "--shard", "2/4"),
            "out",
            ["render", "--out", "a", "--shard", "1/3", "--out", "out", "--shard", "0/4"],
        ),
    ],
)
def test_the_recorded_command_works_on_nothing(typed, out, merges, tmp_path):
    record = CommandRecord(arguments=typed, folder=str(tmp_path))
    assert merging(tmp_path / COMMAND_FILE, record, tmp_path / out) == merges


def test_flags_are_recorded_as_they_are_meant(tmp_path):
    flags = (f"--out={tmp_path}/b=2", "--shard=1/2", "--fps_hz=30", "--up=-y")
    typed = ("motions", "a=1/walk.bvh", *flags)
    with share(typed):
        raise OthersLeft("one is left", failed=False)
    assert CommandRecord.read(tmp_path / "b=2" / COMMAND_FILE).arguments == (
        "motions", "a=1/walk.bvh", "--out", f"{tmp_path}/b=2", "--shard", "1/2", "--fps-hz", "30",
        "--up=-y",
    )  # fmt: skip


def test_a_verb_in_a_quiet_one_is_quiet():
    with as_loud(quiet=True, verbose=False), as_loud(quiet=False, verbose=False):
        assert console.quiet
    assert not console.quiet


@pytest.mark.parametrize("flag", ["--print-slurm", "--print_slurm=2", "--print-kubernetes"])
def test_flags_that_are_gone_name_the_page(flag, gmrdata, tmp_path):
    answer = gmrdata("motions", tmp_path, "--out", tmp_path / "out", flag, "2")
    fails_cleanly(answer, "docs/scale.md, Slurm and Kubernetes", code=2)
    assert not (tmp_path / "out").exists()


def test_what_is_not_shared_says_so(gmrdata, tmp_path):
    """Each shard would do the whole work, and a cluster none of it."""
    recipe = tmp_path / "gmr.yaml"
    recipe.write_text("recipe: gmr\n")
    train = ("run", recipe, "--out", tmp_path / "out")
    commands = (
        (*train, "--shard", "1/2"),
        (*train, "--workers", "2"),
        (*train, "--scheduler", "tcp://127.0.0.1:9"),
        ("motions", tmp_path, "--shard", "1/2"),
        ("motions", tmp_path, "--layout", "emdb", "--out", tmp_path / "out", "--shard", "1/2"),
    )
    for command in commands:
        fails_cleanly(gmrdata(*command), "eave ")
    assert not (tmp_path / "out").exists()
