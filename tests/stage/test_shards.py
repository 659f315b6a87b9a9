"""Shards: processes that share a folder do a batch together, once, whoever dies on the way."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.stage import claims
from gmrdata.stage.claims import ClaimRecord, owner
from gmrdata.stage.jobs import Job, Outcome, try_jobs, worker_pool
from gmrdata.stage.run import Run
from gmrdata.stage.shards import Marks, OthersLeft, Shard, shares
from gmrdata.stage.store import run_stage
from gmrdata.values.errors import BadFrames, BadRecipe, StageFailed
from gmrdata.values.records import Config


def make(out_dir: Path, log: Path, run: Run, wait_s: float = 0.0, poison: str = "") -> Path:
    """A job: a stage that notes each call, waits, and may fail or kill its process."""

    def work(partial_dir: Path) -> None:
        with log.open("a") as stream:
            stream.write(f"{out_dir.name}\n")
        time.sleep(wait_s)
        if poison == "fails":
            raise BadFrames(f"{out_dir.name}: not an image")
        if poison == "kills":
            os.kill(os.getpid(), signal.SIGKILL)
        (partial_dir / "a.txt").write_text(out_dir.name)

    return run_stage("test", out_dir, Config(), {}, work, run=run)


def batch(
    root: Path,
    shard: str,
    count: int = 6,
    wait_s: float = 0.0,
    poison: dict[str, str] | None = None,
) -> Outcome:
    """A whole batch of `count` jobs as one shard of it."""
    run = Run(shard=Shard.parse(shard))
    poison = poison or {}
    jobs = [
        Job(
            f"c{number}",
            make,
            {
                "out_dir": root / f"c{number}",
                "log": root / "log",
                "run": run,
                "wait_s": wait_s,
                "poison": poison.get(f"c{number}", ""),
            },
        )
        for number in range(count)
    ]
    with worker_pool(run) as pool:
        return try_jobs("making things", jobs, pool, root / "failed")


def child(root: Path, *arguments: object) -> subprocess.Popen[str]:
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
        "from pathlib import Path\nfrom test_shards import batch\n"
        "from gmrdata.stage.shards import OthersLeft\n"
        f"try:\n    batch(Path({str(root)!r}), *{arguments!r})\n    print('whole')\n"
        "except OthersLeft:\n    print('others left')\n"
    )
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)


def made(root: Path) -> list[str]:
    return sorted(path.parent.name for path in root.glob("*/stage.json"))


@given(
    st.dictionaries(st.text(max_size=8), st.floats(0.1, 100.0), max_size=60),
    st.integers(1, 9),
)
def test_shares_are_disjoint_whole_and_even(weights: dict[str, float], count: int) -> None:
    found = shares(weights, count)
    assert sorted(id for ids in found.values() for id in ids) == sorted(weights)
    loads = [sum(weights[id] for id in ids) for ids in found.values()]
    assert max(loads) - min(loads) <= max(weights.values(), default=0.0) + 1e-9
    assert found == shares(dict(reversed(weights.items())), count)


@pytest.mark.parametrize("text", ["", "2", "5/4", "1/0", "a/b", "-1/2", "1/2/3", "1.0/2", "١/٢x"])
def test_a_shard_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(BadRecipe, match="give it as 2/4"):
        Shard.parse(text)


def test_who_finishes_last_gets_the_whole(tmp_path: Path) -> None:
    for shard in ("2/3", "3/3"):
        with pytest.raises(OthersLeft, match=r"shard 1/3: 2 left, not begun"):
            batch(tmp_path, shard)
    outcome = batch(tmp_path, "1/3")
    assert list(outcome.results) == [f"c{number}" for number in range(6)]
    assert sorted((tmp_path / "log").read_text().split()) == list(outcome.results)
    assert not (tmp_path / "shards").exists() and not outcome.reasons
    # Any of them says so again, and works on nothing.
    assert batch(tmp_path, "2/3") == outcome
    assert len((tmp_path / "log").read_text().split()) == 6


def test_failures_of_other_shards_are_known_to_the_last(tmp_path: Path) -> None:
    poison = {"c0": "fails", "c5": "fails"}
    with pytest.raises(OthersLeft):
        batch(tmp_path, "1/2", poison=poison)
    outcome = batch(tmp_path, "2/2", poison=poison)
    assert list(outcome.results) == ["c1", "c2", "c3", "c4"]
    assert outcome.reasons == {id: f"{id}: not an image" for id in poison}
    # Mended, they are made by the shard that has them.
    for shard in ("1/2", "2/2"):
        try:
            outcome = batch(tmp_path, shard)
        except OthersLeft:
            continue
    assert len(outcome.results) == 6 and not outcome.reasons


def test_a_killed_shard_is_taken_over(tmp_path: Path) -> None:
    dies = child(tmp_path, "1/2", 6, 60.0)
    deadline_s = time.monotonic() + 30
    while not (tmp_path / "log").exists():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
    with pytest.raises(StageFailed, match=rf"worked on by another process \(process {dies.pid} on"):
        batch(tmp_path, "1/2")
    with pytest.raises(OthersLeft, match=f"shard 1/2: 3 left, process {dies.pid} on"):
        batch(tmp_path, "2/2")
    dies.kill()
    dies.wait()
    outcome = batch(tmp_path, "2/2")
    assert len(outcome.results) == 6
    assert made(tmp_path) == list(outcome.results)


def test_a_job_that_kills_who_works_on_it_fails_in_the_end(tmp_path: Path) -> None:
    """It must not take one shard after the other with it for ever."""
    for _ in range(3):
        assert child(tmp_path, "1/1", 3, 0.0, {"c1": "kills"}).wait() == -signal.SIGKILL
    outcome = batch(tmp_path, "1/1", 3, poison={"c1": "kills"})
    assert list(outcome.results) == ["c0", "c2"]
    assert outcome.reasons["c1"].startswith("3 processes died while they worked on it")


def test_a_shard_of_a_silent_machine_is_taken_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(claims, "SILENT_S", 0.5)
    folder = tmp_path / "shards" / "making-things"
    folder.mkdir(parents=True)
    ClaimRecord(
        token="f" * 32, host="0" * 12, machine="node7", pid=1, started="1", beats=3, deaths=0
    ).write(folder / ".1-of-2.claim")
    assert len(batch(tmp_path, "2/2").results) == 6


def test_two_processes_share_the_work(tmp_path: Path) -> None:
    both = [child(tmp_path, f"{index}/2", 8, 0.05) for index in (1, 2)]
    said = sorted(process.communicate(timeout=60)[0].strip() for process in both)
    assert said in (["others left", "whole"], ["whole", "whole"])
    assert sorted((tmp_path / "log").read_text().split()) == [f"c{n}" for n in range(8)]


def test_marks_may_go_while_one_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who sees that the last job is made takes all marks away, before its maker has made his."""
    replace_file = Path.replace

    def replace_late(self: Path, target: Path) -> Path:
        if target.suffix == ".done":
            shutil.rmtree(target.parent)
        return replace_file(self, target)

    monkeypatch.setattr(Path, "replace", replace_late)
    assert len(batch(tmp_path, "1/1").results) == 6
    assert not (tmp_path / "shards").exists()


def test_a_claim_is_made_though_its_folder_goes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    link, folder = os.link, tmp_path / "shards"

    def link_late(source: str, target: Path, **options: int | None) -> None:
        if "/proc/self/fd" in source:
            folder.rmdir()
        link(source, target, **options)

    folder.mkdir()
    monkeypatch.setattr(os, "link", link_late)
    claim = claims.try_claim(folder / ".1-of-2.claim")
    assert claim is not None and owner(claim.path) == claim.record


def test_nothing_is_shared_by_nobody(tmp_path: Path) -> None:
    """Shard 0 merges: it works on nothing, and takes over nothing."""
    with pytest.raises(OthersLeft, match="6 of 6 are left"):
        batch(tmp_path, "0/2")
    with pytest.raises(OthersLeft):
        batch(tmp_path, "1/2")
    with pytest.raises(OthersLeft, match="3 of 6 are left"):
        batch(tmp_path, "0/2")
    batch(tmp_path, "2/2")
    assert len(batch(tmp_path, "0/2").results) == 6


def of_node(number: int, path: Path) -> ClaimRecord:
    """A claim of a process on another machine that shows no life."""
    record = ClaimRecord(
        token=f"{number:032x}", host=f"{number:012x}", machine=f"node{number}", pid=1, started="1",
        beats=3, deaths=0,
    )  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    record.write(path)
    return record


def test_many_silent_machines_are_waited_for_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(claims, "SILENT_S", 3.0)
    for number in range(1, 6):
        of_node(number, tmp_path / "shards" / "making-things" / f".{number}-of-6.claim")
    begin_s = time.monotonic()
    assert len(batch(tmp_path, "6/6").results) == 6
    assert time.monotonic() - begin_s < 12.0  # one after another: 15


def redone(root: Path, shard: str, wanted: str, *, redo: bool = True) -> Outcome:
    run = Run(shard=Shard.parse(shard), redo=redo)
    jobs = [
        Job(f"c{n}", remake, {"out_dir": root / f"c{n}", "wanted": wanted, "run": run})
        for n in range(6)
    ]
    with worker_pool(run) as pool:
        return try_jobs("making things", jobs, pool, root / "failed")


class Wanted(Config):
    text: str


def remake(out_dir: Path, wanted: str, run: Run) -> Path:
    def work(partial_dir: Path) -> None:
        (partial_dir / "a.txt").write_text(wanted)
        with (out_dir.parent / "log").open("a") as stream:
            stream.write(f"{wanted} {out_dir.name}\n")

    return run_stage("test", out_dir, Wanted(text=wanted), {}, work, run=run)


def test_a_shard_that_redoes_does_its_own_share_alone(tmp_path: Path) -> None:
    """What others made by the old recipe does not count as done."""
    for shard in ("1/2", "2/2"):
        try:
            redone(tmp_path, shard, "old")
        except OthersLeft:
            continue
    with pytest.raises(OthersLeft, match="shard 1/2: 3 left, not begun"):
        redone(tmp_path, "2/2", "new")
    outcome = redone(tmp_path, "1/2", "new")
    assert len(outcome.results) == 6 and not outcome.reasons
    assert {(tmp_path / f"c{n}" / "a.txt").read_text() for n in range(6)} == {"new"}
    lines = (tmp_path / "log").read_text().split("\n")
    assert sorted(line for line in lines if line[:3] == "new") == [f"new c{n}" for n in range(6)]


def test_shards_of_two_recipes_make_no_whole(tmp_path: Path) -> None:
    """One restarted with another recipe, without --redo: the last says which shard to run again."""
    with pytest.raises(OthersLeft):
        redone(tmp_path, "1/2", "old", redo=False)
    with pytest.raises(OthersLeft, match=r"shard 1/2: 3 left, made with other settings"):
        redone(tmp_path, "2/2", "new", redo=False)


def test_a_failure_of_an_earlier_run_is_past_once_its_shard_runs_again(tmp_path: Path) -> None:
    with pytest.raises(OthersLeft):
        batch(tmp_path, "1/2", poison={f"c{n}": "fails" for n in range(6)})
    again = child(tmp_path, "1/2", 6, 60.0)
    deadline_s = time.monotonic() + 30
    while (tmp_path / "log").read_text().count("\n") < 4:
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
    with pytest.raises(OthersLeft, match=f"shard 1/2: 3 left, process {again.pid} on"):
        batch(tmp_path, "2/2")
    again.kill()
    again.wait()
    assert len(batch(tmp_path, "2/2").results) == 6
    assert not list((tmp_path / "failed").iterdir())


def test_shares_by_other_weights_are_other_shares(tmp_path: Path) -> None:
    """Else a job is in nobody's share when files change their length between two starts."""
    sides = [
        Marks(tmp_path / "shards" / "x", Shard(1, 2), dict.fromkeys("abcd", 1.0) | {"a": weight})
        for weight in (1.0, 9.0)
    ]
    with sides[0].working() as shares_:
        list(shares_)
    assert sides[0].is_done(1) and not sides[1].is_done(1)


def test_a_shard_that_lost_its_share_leaves_the_mark_to_who_has_it(tmp_path: Path) -> None:
    marks = Marks(tmp_path / "shards" / "x", Shard(1, 2), dict.fromkeys("abcd", 1.0))
    path = tmp_path / "shards" / "x" / ".1-of-2.claim"
    with marks.working() as found:
        next(found)
        other = of_node(7, path)  # as a process does that saw this one silent
        with pytest.raises(StopIteration):
            next(found)
    assert not marks.is_done(1) and owner(path) == other


def test_a_batch_that_was_ended_by_another_process_can_still_be_worked_on(tmp_path: Path) -> None:
    """Its marks are gone then; a process that was taken for dead goes on without an error."""
    run = Run(shard=Shard(1, 1))
    jobs = [Job(f"c{n}", taking_away, {"root": tmp_path}) for n in range(3)]
    with worker_pool(run) as pool:
        outcome = try_jobs("making things", jobs, pool, tmp_path / "failed")
    assert len(outcome.results) == 3 and not (tmp_path / "shards").exists()


def taking_away(root: Path) -> None:
    shutil.rmtree(root / "shards")
