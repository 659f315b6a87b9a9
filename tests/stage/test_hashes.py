"""Inputs that are as they were are not read again; any that may not be are."""

import os
from pathlib import Path

import pytest

from gmrdata.stage import store
from gmrdata.stage.run import Run
from gmrdata.stage.store import NotMade, run_stage
from gmrdata.values.errors import StaleOutput
from gmrdata.values.files import sha256_of_file, sha256_of_path
from gmrdata.values.records import Config


@pytest.fixture
def hashed(monkeypatch) -> list[str]:
    """Names of the files that are hashed; those just written count as old ones."""
    names: list[str] = []

    def counted(path: Path) -> str:
        names.append(path.name)
        return sha256_of_file(path)

    monkeypatch.setattr(store, "sha256_of_file", counted)
    monkeypatch.setattr(store, "FRESH_NS", -(10**12))
    monkeypatch.setattr(store, "_HASHED", {})
    return names


@pytest.fixture
def frames(tmp_path) -> Path:
    folder = tmp_path / "frames"
    folder.mkdir()
    for number in range(3):
        (folder / f"{number}.jpg").write_bytes(b"%d" % number)
    return folder


def stage(frames: Path, name: str = "out", **run: bool) -> Path:
    out_dir = frames.with_name(name)
    return run_stage("test", out_dir, Config(), {"frames": frames}, lambda _: None, run=Run(**run))


def forget() -> None:
    """As a new process."""
    store._HASHED.clear()


def test_each_file_is_hashed_once_by_all_stages_of_a_process(frames, hashed):
    for name in ("people", "masks", "sfm", "people"):
        stage(frames, name)
    assert hashed == ["0.jpg", "1.jpg", "2.jpg"]


@pytest.mark.parametrize("redo", [False, True])
def test_the_next_process_hashes_nothing_unless_all_is_made_again(frames, hashed, redo):
    stage(frames)
    forget()
    hashed.clear()
    stage(frames, redo=redo)
    assert hashed == (["0.jpg", "1.jpg", "2.jpg"] if redo else [])


def test_what_a_page_shows_is_made_anew_and_hashes_what_changed(frames, hashed):
    stage(frames)
    forget()
    hashed.clear()
    stage(frames, anew=True)
    assert hashed == []
    (frames / "1.jpg").write_bytes(b"99")
    stage(frames, anew=True)
    assert hashed == ["1.jpg"]
    stage(frames)


def test_a_change_of_the_same_size_and_time_is_noticed(frames, hashed):
    """Anybody can set a file's time, but not the system's own."""
    stage(frames)
    before = (frames / "1.jpg").stat()
    (frames / "1.jpg").write_bytes(b"9")
    os.utime(frames / "1.jpg", ns=(before.st_atime_ns, before.st_mtime_ns))
    hashed.clear()
    with pytest.raises(StaleOutput, match=r"inputs\.frames"):
        stage(frames)
    assert hashed == ["1.jpg"]


def test_a_file_that_was_just_written_is_hashed_again(frames, hashed, monkeypatch):
    """A second write within the clock's grain would leave no trace."""
    monkeypatch.setattr(store, "FRESH_NS", 10**12)
    stage(frames)
    stage(frames)
    assert hashed == 2 * ["0.jpg", "1.jpg", "2.jpg"]


def test_a_copy_elsewhere_is_hashed_and_remembered(frames, hashed):
    stage(frames)
    for path in frames.iterdir():
        path.with_suffix(".new").write_bytes(path.read_bytes())
        path.with_suffix(".new").replace(path)
    hashed.clear()
    forget()
    stage(frames)
    forget()
    stage(frames)
    assert hashed == ["0.jpg", "1.jpg", "2.jpg"]


def test_what_a_desktop_leaves_in_a_folder_is_no_other_content(frames):
    before = sha256_of_path(frames)
    (frames / ".DS_Store").write_bytes(b"Bud1")
    (frames / "._0.jpg").write_bytes(b"AppleDouble")
    (frames / ".git").mkdir()
    (frames / ".git" / "x").write_bytes(b"x")
    assert sha256_of_path(frames) == before
    (frames / "3.jpg").write_bytes(b"3")
    assert sha256_of_path(frames) != before


def test_results_may_lie_in_the_folder_of_frames(frames):
    """What one stage left there was another input to the next, and to itself a second time."""

    def made(*names: str) -> list[str]:
        done: list[str] = []

        def work(partial: Path) -> None:
            (partial / "a.txt").write_text("a")
            done.append(partial.stem)

        for name in names:
            run_stage("test", frames / name, Config(), {"images": frames}, work)
        return done

    assert made("masks", "sfm") == ["masks", "sfm"]
    assert made("masks", "sfm") == []
    (frames / "1.jpg").write_bytes(b"another")
    with pytest.raises(StaleOutput, match=r"inputs\.images"):
        made("masks")


def test_a_result_in_the_folder_that_it_is_of_is_no_part_of_that(tmp_path, frames, hashed):
    """Made, it refused to be there: its own files were another input."""
    for _ in range(2):
        run_stage(
            "test", frames / "out", Config(), {"poses": frames}, lambda at: (at / "a").touch()
        )
    assert hashed == ["0.jpg", "1.jpg", "2.jpg"]
    (frames / "more").mkdir()
    (frames / "more" / "3.jpg").touch()
    with pytest.raises(StaleOutput, match=r"inputs\.poses"):
        run_stage("test", frames / "out", Config(), {"poses": frames}, lambda _: None)


@pytest.mark.parametrize("content", ["", "{}", '{"format": "gmrdata-inputs/1", "files": {"a": 1}}'])
def test_a_broken_memory_costs_only_time(frames, hashed, content):
    stage(frames)
    forget()
    hashed.clear()
    frames.with_name(".out.inputs").write_text(content)
    stage(frames)
    assert hashed == ["0.jpg", "1.jpg", "2.jpg"]


def test_a_look_makes_nothing(frames, hashed):
    with pytest.raises(NotMade):
        stage(frames, only_look=True)
    assert [path.name for path in frames.parent.iterdir()] == ["frames"]
    assert hashed == []
    stage(frames)
    assert stage(frames, only_look=True) == frames.with_name("out")
    (frames / "3.jpg").write_bytes(b"3")
    with pytest.raises(StaleOutput):
        stage(frames, only_look=True)
    with pytest.raises(NotMade):
        stage(frames, only_look=True, redo=True)
