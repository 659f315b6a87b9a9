"""Stages and files that are complete when they exist; inputs that did not change."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from gmrdata.motion.cmu import Fetched, FetchedFile
from gmrdata.motion.emdb import EmdbAbout
from gmrdata.people.folder import MasksRecord
from gmrdata.people.following import FollowedRecord, PersonFacts
from gmrdata.people.linking import Detection
from gmrdata.people.onnx import DetectionsRecord, FrameRecord
from gmrdata.read.download import PartNote
from gmrdata.stage import store
from gmrdata.stage.run import Run
from gmrdata.stage.store import (
    FileState,
    InputsRecord,
    KnownFile,
    RecipeRecord,
    Resumable,
    StageRecord,
    run_stage,
    stage_seconds,
)
from gmrdata.threedpw.intrinsics_check import FocalEstimate
from gmrdata.threedpw.regenerate import SequenceVerdict, Verdicts
from gmrdata.threedpw.sequence import PeopleRecord
from gmrdata.values.errors import BadRecord, MissingInput, StaleOutput
from gmrdata.values.files import (
    atomic_path,
    host_word,
    read_json,
    remove_orphans,
    sha256_of_file,
    sha256_of_path,
    write_json,
    write_text,
)
from gmrdata.values.records import Config, Record
from tests.folders import wait_for
from tests.record_keys import assert_each_key_is_needed


class Inner(Config):
    radius_px: int = 3
    """Radius [px]."""


class Recipe(Config):
    seed: int = 0
    """Seed."""
    inner: Inner = Inner()
    """Part of a recipe."""


class Counter:
    """Work that counts how often it ran."""

    def __init__(self) -> None:
        self.runs = 0

    def __call__(self, partial: Path) -> None:
        self.runs += 1
        write_text(partial / "result.txt", f"run {self.runs}")


def made(
    out_dir: Path, work: Callable[[Path], None] | Resumable, config: Config | None = None, **more
) -> Path:
    return run_stage("test", out_dir, config or Recipe(), {}, work, **more)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def fail(partial: Path) -> None:
    """Work that ends in the middle."""
    (partial / "half.txt").write_text("half")
    raise ArithmeticError


def test_stage_is_complete_with_its_record(tmp_path):
    (tmp_path / "in.txt").write_text("in")
    out_dir = run_stage(
        "test", tmp_path / "a" / "out", Recipe(), {"text": tmp_path / "in.txt"}, Counter()
    )
    assert names(out_dir) == ["result.txt", "stage.json"]
    assert names(out_dir.parent) == ["out"]
    record = read_json(out_dir / "stage.json")
    assert record["config"] == {"seed": 0, "inner": {"radius_px": 3}}
    assert record["inputs"] == {"text": sha256_of_file(tmp_path / "in.txt")}
    assert record["packages"]["numpy"]
    assert stage_seconds(out_dir) == record["seconds"] >= 0


@pytest.mark.parametrize("redo", [False, True])
def test_same_recipe_does_nothing_even_with_redo(tmp_path, redo):
    work = Counter()
    for _ in range(3):
        made(tmp_path / "out", work, run=Run(redo=redo))
    assert work.runs == 1


def test_changed_recipe_names_the_key(tmp_path):
    made(tmp_path / "out", Counter())
    with pytest.raises(
        StaleOutput, match=r"out: made with other values of config\.inner\.radius_px\."
    ):
        made(tmp_path / "out", Counter(), Recipe(inner=Inner(radius_px=4)))


def test_changed_input_names_the_input(tmp_path):
    (tmp_path / "frames").mkdir()
    (tmp_path / "frames" / "0.jpg").write_bytes(b"a")
    inputs = {"frames": tmp_path / "frames"}
    run_stage("test", tmp_path / "out", Recipe(), inputs, Counter())
    (tmp_path / "frames" / "0.jpg").write_bytes(b"b")
    with pytest.raises(StaleOutput, match=r"inputs\.frames"):
        run_stage("test", tmp_path / "out", Recipe(), inputs, Counter())


def test_redo_replaces_the_result(tmp_path):
    work = Counter()
    made(tmp_path / "out", work)
    made(tmp_path / "out", work, Recipe(seed=1), run=Run(redo=True))
    assert (tmp_path / "out" / "result.txt").read_text() == "run 2"
    assert read_json(tmp_path / "out" / "stage.json")["config"]["seed"] == 1
    assert names(tmp_path) == ["out"]


def test_failed_redo_keeps_the_old_result(tmp_path):
    made(tmp_path / "out", Counter())
    with pytest.raises(ArithmeticError):
        made(tmp_path / "out", fail, Recipe(seed=1), run=Run(redo=True))
    assert (tmp_path / "out" / "result.txt").read_text() == "run 1"
    assert read_json(tmp_path / "out" / "stage.json")["config"]["seed"] == 0


@pytest.mark.parametrize("redo", [False, True])
def test_a_folder_that_no_stage_made_is_never_touched(tmp_path, redo):
    """`--out ~/photos --redo` must not delete photos."""
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "holiday.jpg").write_bytes(b"dear to someone")
    with pytest.raises(StaleOutput, match="no gmrdata stage made it"):
        made(tmp_path / "photos", Counter(), run=Run(redo=redo))
    assert (tmp_path / "photos" / "holiday.jpg").read_bytes() == b"dear to someone"


def test_a_file_in_the_way(tmp_path):
    (tmp_path / "out").write_text("notes")
    with pytest.raises(StaleOutput, match="no gmrdata stage made it"):
        made(tmp_path / "out", Counter(), run=Run(redo=True))
    assert (tmp_path / "out").read_text() == "notes"


def test_an_empty_folder_may_be_filled(tmp_path):
    (tmp_path / "out").mkdir()
    assert names(made(tmp_path / "out", Counter())) == ["result.txt", "stage.json"]


@pytest.mark.parametrize("there", [True, False])
def test_a_folder_behind_a_link_is_made_where_the_link_leads(there, tmp_path):
    """It took the link's place on the small disk, and the next redo ended after all its work."""
    disk, link = tmp_path / "disk", tmp_path / "out"
    disk.mkdir()
    link.symlink_to(disk / "out")
    if there:
        (disk / "out").mkdir()
    work = Counter()
    for seed in range(3):
        assert made(link, work, Recipe(seed=seed), run=Run(redo=True)) == link
        made(link, work, Recipe(seed=seed))
        assert link.is_symlink() and (disk / "out" / "result.txt").read_text() == f"run {seed + 1}"
    assert names(tmp_path) == ["disk", "out"] and names(disk) == ["out"]


def test_a_folder_without_a_name_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(StaleOutput, match=r"^\.: a folder without a name .*another --out"):
        made(Path(), Counter())


def test_a_cut_off_record_is_stale(tmp_path):
    made(tmp_path / "out", Counter())
    record = tmp_path / "out" / "stage.json"
    record.write_text(record.read_text()[:20])
    with pytest.raises(StaleOutput, match=r"stage\.json: not JSON .*--redo to make it again"):
        made(tmp_path / "out", Counter())
    with pytest.raises(BadRecord, match=r"stage\.json: not JSON"):
        stage_seconds(tmp_path / "out")


def test_missing_input(tmp_path):
    with pytest.raises(MissingInput, match=r"nothing: no such file"):
        run_stage("test", tmp_path / "out", Recipe(), {"x": tmp_path / "nothing"}, Counter())
    assert names(tmp_path) == []


def test_an_exception_leaves_no_result(tmp_path):
    with pytest.raises(ArithmeticError):
        made(tmp_path / "out", fail)
    assert not [path for path in tmp_path.iterdir() if path.name.startswith("out")]
    assert names(made(tmp_path / "out", Counter())) == ["result.txt", "stage.json"]


def test_a_full_disk_is_one_whoever_says_so(tmp_path):
    """COLMAP's database raises a RuntimeError, which ended with a traceback."""

    def work(partial: Path) -> None:
        raise RuntimeError("[database_sqlite.cc:1362] SQLite error: database or disk is full")

    with pytest.raises(OSError) as caught:
        store.run_stage("part", tmp_path / "out", Recipe(), {}, work)
    assert caught.value.errno == errno.ENOSPC
    assert caught.value.filename == str(tmp_path / "out.partial")


def test_what_is_read_is_never_replaced(tmp_path):
    """A network that is scored into its own folder with --redo would be gone."""
    run_dir = made(tmp_path / "run", Counter())
    for read in (run_dir, run_dir / "result.txt"):
        with pytest.raises(StaleOutput, match="which is read. Pass another --out"):
            run_stage("score", run_dir, Config(), {"run": read}, Counter(), run=Run(redo=True))
    assert names(run_dir) == ["result.txt", "stage.json"]
    run_stage("score", run_dir / "scores", Config(), {"run": run_dir / "result.txt"}, Counter())


class Steps:
    """Resumable work of four files that dies once before the third."""

    def __init__(self) -> None:
        self.written: list[int] = []
        self.dies = True

    def __call__(self, partial: Path) -> None:
        for step in range(4):
            if (partial / f"{step}.txt").exists():
                continue
            if step == 2 and self.dies:
                self.dies = False
                raise KeyboardInterrupt
            write_text(partial / f"{step}.txt", str(step))
            self.written.append(step)


@pytest.fixture
def steps(tmp_path) -> Steps:
    """Such work that died in `out`."""
    begun = Steps()
    with pytest.raises(KeyboardInterrupt):
        made(tmp_path / "out", Resumable(begun))
    return begun


def test_resumable_work_goes_on(tmp_path, steps):
    # What a kill in the middle of `atomic_path` leaves must not become part of the result.
    (tmp_path / "out.partial" / ".2.txt.123-4.tmp.txt").write_text("ha")
    made(tmp_path / "out", Resumable(steps))
    assert steps.written == [0, 1, 2, 3]
    assert names(tmp_path / "out") == ["0.txt", "1.txt", "2.txt", "3.txt", "stage.json"]


@pytest.mark.parametrize(("seed", "resumable"), [(1, True), (0, False)])
def test_other_work_starts_anew(tmp_path, steps, seed, resumable):
    work = Resumable(steps) if resumable else steps
    made(tmp_path / "out", work, Recipe(seed=seed))
    assert steps.written == [0, 1, 0, 1, 2, 3]


def test_what_another_recipe_began_is_thrown_away_when_that_is_asked_for(tmp_path, steps):
    with pytest.raises(StaleOutput, match=r"out\.partial: begun with other values of config\.seed"):
        made(tmp_path / "out", Resumable(steps, costly=True), Recipe(seed=1))
    assert (tmp_path / "out.partial" / "1.txt").exists()
    made(tmp_path / "out", Resumable(steps, costly=True), Recipe(seed=1), run=Run(redo=True))
    assert steps.written == [0, 1, 0, 1, 2, 3]


CHILD = """
import sys, time
from pathlib import Path
from gmrdata.values.records import Config
from gmrdata.stage.store import run_stage
from gmrdata.values.files import write_text
root = Path(sys.argv[1])
def work(partial):
    with (root / "runs.txt").open("a") as stream:
        stream.write("run\\n")
    write_text(partial / "first.txt", "first")
    (partial / "half.bin").write_bytes(b"half")
    (root / "working").touch()
    time.sleep(float(sys.argv[2]))
    (partial / "half.bin").write_bytes(b"whole")
run_stage("test", root / "out", Config(), {}, work)
"""


def child(root: Path, sleep_s: float) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-c", CHILD, str(root), str(sleep_s)])


def test_kill_9_leaves_no_result(tmp_path):
    process = child(tmp_path, 60)
    wait_for(tmp_path / "working", process)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert not (tmp_path / "out").exists()
    assert (tmp_path / "out.partial" / "half.bin").read_bytes() == b"half"
    assert child(tmp_path, 0).wait(timeout=30) == 0
    assert names(tmp_path / "out") == ["first.txt", "half.bin", "stage.json"]
    assert (tmp_path / "out" / "half.bin").read_bytes() == b"whole"
    assert names(tmp_path) == ["out", "runs.txt", "working"]


def test_two_processes_at_once_work_once(tmp_path):
    first = child(tmp_path, 1.0)
    wait_for(tmp_path / "working", first)
    second = child(tmp_path, 1.0)
    assert (first.wait(timeout=30), second.wait(timeout=30)) == (0, 0)
    assert (tmp_path / "runs.txt").read_text() == "run\n"


def test_a_kill_between_the_two_renames_is_mended(tmp_path):
    """A redo retires the old result by a rename; what is left of it is not in the way later."""
    made(tmp_path / "out", Counter())
    (tmp_path / "out").rename(tmp_path / ".out.old")
    made(tmp_path / "out", Counter(), Recipe(seed=1))
    assert names(tmp_path) == ["out"]


FULL_DISK = """
import resource, sys
from pathlib import Path
import numpy as np
from gmrdata.values.files import atomic_path, write_npz
resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
path, arrays = Path(sys.argv[1]), {"a": np.zeros(100_000)}
try:
    if sys.argv[2] == "write_npz":
        write_npz(path, arrays)
    else:
        with atomic_path(path) as temporary, temporary.open("wb") as stream:
            np.savez(stream, **arrays)
except OSError as error:
    sys.exit(error.errno)
"""


@pytest.mark.parametrize("by", ["atomic_path", "write_npz"])
@pytest.mark.parametrize("old", [None, b"the old content"])
def test_no_space_leaves_the_old_file_or_none(tmp_path, old, by):
    """A size limit ends a write in the middle as a full disk does.  Of arrays zipfile used to print
    a traceback of its own when it was thrown away."""
    path = tmp_path / "a.npz"
    if old is not None:
        path.write_bytes(old)
    command = [sys.executable, "-c", FULL_DISK, str(path), by]
    done = subprocess.run(command, check=False, capture_output=True)
    assert done.returncode == 27  # EFBIG
    assert by != "write_npz" or done.stdout == done.stderr == b""
    assert names(tmp_path) == ([] if old is None else ["a.npz"])
    assert old is None or path.read_bytes() == old


def test_atomic_path_cleans_up_after_an_exception(tmp_path):
    with pytest.raises(ArithmeticError), atomic_path(tmp_path / "a.txt") as temporary:
        temporary.write_text("half")
        raise ArithmeticError
    assert names(tmp_path) == []


def test_atomic_path_keeps_the_suffix(tmp_path):
    """Writers such as OpenCV choose the format by the suffix."""
    with atomic_path(tmp_path / "a.png") as temporary:
        assert temporary.suffix == ".png"
        temporary.write_bytes(b"x")
    assert names(tmp_path) == ["a.png"]


def test_json_is_whole_sorted_and_finite(tmp_path):
    write_json(tmp_path / "a.json", {"b": 1, "a": "ü"})
    assert list(json.loads((tmp_path / "a.json").read_text())) == ["a", "b"]
    with pytest.raises(ValueError, match="Out of range float"):
        write_json(tmp_path / "a.json", {"a": float("nan")})
    assert read_json(tmp_path / "a.json") == {"a": "ü", "b": 1}
    with pytest.raises(MissingInput, match=r"b\.json"):
        read_json(tmp_path / "b.json")


def test_hash_of_a_folder_follows_names_and_contents_only(tmp_path):
    folder = tmp_path / "a"
    write_text(folder / "x" / "1.txt", "one")
    before = sha256_of_path(folder)
    (folder / "stage.json").write_text("{}")
    (folder / ".x.lock").touch()
    os.utime(folder / "x" / "1.txt", (0, 0))
    assert sha256_of_path(folder) == before
    (folder / "x" / "1.txt").rename(folder / "x" / "2.txt")
    renamed = sha256_of_path(folder)
    assert renamed != before
    write_text(folder / "x" / "2.txt", "two")
    assert sha256_of_path(folder) != renamed


def test_sha256_is_the_known_one(tmp_path):
    (tmp_path / "abc").write_bytes(b"abc")
    assert sha256_of_file(tmp_path / "abc") == (
        "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    )


def test_commit_without_git(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    store.git_commit.cache_clear()
    made(tmp_path / "out", Counter())
    store.git_commit.cache_clear()
    assert read_json(tmp_path / "out" / "stage.json")["git_commit"] is None
    assert store.STAGE_FILE == "stage.json"


def test_only_what_killed_processes_left_is_removed(tmp_path):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    orphan = tmp_path / f".index.html.{host_word()}-{dead.pid}-140.tmp.html"
    written_now = tmp_path / f".index.html.{host_word()}-{os.getpid()}-140.tmp.html"
    elsewhere = tmp_path / f".index.html.{'0' * 12}-{dead.pid}-140.tmp.html"
    given_up_elsewhere = tmp_path / f".index.html.{'1' * 12}-{os.getpid()}-140.tmp.html"
    users_own = tmp_path / ".notes.tmp"
    for path in (orphan, written_now, elsewhere, given_up_elsewhere, users_own):
        path.write_text("half a fi")
    two_days_ago_s = time.time() - 2 * 86400
    os.utime(given_up_elsewhere, (two_days_ago_s, two_days_ago_s))
    remove_orphans(tmp_path)
    assert names(tmp_path) == sorted([written_now.name, elsewhere.name, users_own.name])
    elsewhere.unlink()
    remove_orphans(tmp_path / "not there")
    # The name is the one that a killed process leaves.
    with pytest.raises(KeyboardInterrupt), atomic_path(tmp_path / "a.txt") as temporary:
        temporary.write_text("half")
        (tmp_path / temporary.name.replace(f"-{os.getpid()}-", f"-{dead.pid}-")).write_text("half")
        raise KeyboardInterrupt
    remove_orphans(tmp_path)
    assert names(tmp_path) == sorted([written_now.name, users_own.name])


VERDICT = SequenceVerdict("a_00", "test", True, (), "panning", 0.5, None, None)
FOCAL = FocalEstimate(1.0, 0.1, (0.0, 0.0), 2.0, 500)
RECIPE = RecipeRecord(stage="test", config={"seed": 1}, inputs={"a": "0" * 64})
FOUND: Detection = {"box_px": [0.0, 0.0, 2.0, 1.0], "score": 0.5, "class": 3}
SEEN = PersonFacts(images=2, seen=((0, 1),), may_be=(), unsure_from=())
RECORDS: tuple[Record, ...] = (
    RECIPE,
    StageRecord(
        **RECIPE.model_dump(exclude={"format", "host"}),
        facts={},
        gmrdata="1",
        git_commit=None,
        python="3",
        packages={},
        seconds=1.5,
    ),
    InputsRecord(files={"a": KnownFile("0" * 64, FileState(1, 2, 3, 4))}),
    PeopleRecord(bodies=(0,), genders=("female",), left_out=(), problems=(), focal=FOCAL),
    Verdicts(sequences=(VERDICT,)),
    MasksRecord(sources=("a",), masked_share={"0": {"a": 0.5}}, covered=(), unmasked=()),
    FollowedRecord(
        size_px=(4, 2), images=(0,), detections=([FOUND],), people=(SEEN,), left_out=(3,)
    ),
    DetectionsRecord(frames={"0": FrameRecord([FOUND], [0], [[0.0, 0.0, 4.0, 2.0]])}),
    EmdbAbout(emdb1=True, emdb2=False, reasons=["", "good_frames_mask is False"]),
    Fetched(files={"02": FetchedFile(url="http://a/02.asf", size_bytes=3, sha256="ab")}),
    PartNote(url="http://a/02.asf", validator='"x"', size=None),
)


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: type(record).__name__)
def test_each_key_of_a_record_is_needed(record, tmp_path):
    names = ("inputs", "packages", "config", "masked_share", "masked_share.0", "files", "frames")
    assert_each_key_is_needed(record, tmp_path / "record.json", names)


def test_a_folder_of_an_older_version_asks_for_redo(tmp_path):
    out_dir = run_stage("test", tmp_path / "out", Config(), {}, lambda _: None)
    record = read_json(out_dir / "stage.json")
    del record["format"], record["facts"]
    write_json(out_dir / "stage.json", record)
    with pytest.raises(StaleOutput, match=r"stage\.json: has no `format`, .*older gmrdata.*--redo"):
        run_stage("test", out_dir, Config(), {}, lambda _: None)
    run_stage("test", out_dir, Config(), {}, lambda _: None, run=Run(redo=True))
    assert StageRecord.of(out_dir).facts == {}
