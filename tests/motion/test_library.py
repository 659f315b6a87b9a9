"""Motion files into a manifest: AMASS's folders, many files at once, broken ones among them."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gmrdata.manifest.check import check_manifest
from gmrdata.manifest.current import Source
from gmrdata.manifest.read import load_clips
from gmrdata.motion.gait import embedded_motions
from gmrdata.motion.library import (
    FEW_FILES,
    clip_id,
    library_files,
    make_library,
    motion_table,
    plan_library,
)
from gmrdata.read.body_file import save_body
from gmrdata.read.source_motion import ReadConfig
from gmrdata.stage.run import Run
from gmrdata.values.errors import BadMotionFile, BadRecipe, MissingInput, NoWorkers
from tests.clip_manifests import clips_of
from tests.motions import save_bare

REPOSITORY = Path(__file__).resolve().parents[2]
NAMES = [
    "CMU/01/01_01_poses",
    "CMU/02/02_03_poses",
    "KIT/3/kick high 01_poses",
    "KIT/4/walk_poses",
    "SFU/0005/0005_Walk001_poses",
    "TotalCapture/s1/walk_poses",
    "HumanEva/S1/Box_1_poses",
    "ACCAD/Female1Walking_c3d/B3 - walk1_poses",
    "BMLrub/rub001/0000_treadmill_norm_poses",
    "EKUT/134/BAL01_poses",
]


def write_amass(root: Path, names: list[str], n_frames: int = 12, **changed: Any) -> None:
    """Small files of AMASS's SMPL+H release, with what else lies in its folders."""
    for number, name in enumerate(names):
        rng = np.random.default_rng(number)
        poses = 0.1 * rng.normal(size=(n_frames, 156))
        poses[:, 0] += np.pi / 2
        arrays = {
            "poses": poses,
            "trans": 0.01 * np.cumsum(rng.normal(size=(n_frames, 3)), axis=0) + [0, 0, 0.9],
            "betas": rng.normal(size=16),
            "dmpls": np.zeros((n_frames, 8)),
            "gender": "male",
            "mocap_framerate": 60.0,
        }
        path = root / f"{name}.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, **arrays | changed)
        np.savez(path.parent / "shape.npz", gender="male", betas=np.zeros(16))


def test_amass_in_worker_processes(tmp_path, body_path):
    """All clips, with data set, subject and trial; the same as read one by one; and not again."""
    assert len(NAMES) > FEW_FILES
    write_amass(tmp_path / "AMASS", NAMES)
    made = make_library(
        (tmp_path / "AMASS",), str(body_path), tmp_path / "many", run=Run(workers=2)
    )
    check_manifest(made)
    clips = clips_of(made)
    assert {clip.source.sequence for clip in clips} == set(NAMES)
    assert {clip.source.dataset for clip in clips} == {"AMASS"}
    assert "KIT.3.kick_high_01_poses" in [clip.id for clip in clips]
    assert {clip.n_frames for clip in clips} == {12}
    one = make_library(
        (tmp_path / "AMASS",), str(body_path), tmp_path / "many2", run=Run(workers=1)
    )
    assert [clip.arrays.sha256 for clip in clips_of(one)] == [clip.arrays.sha256 for clip in clips]
    written = {path: path.stat().st_mtime_ns for path in (tmp_path / "many").rglob("clip.npz")}
    assert make_library(
        (tmp_path / "AMASS",), str(body_path), tmp_path / "many", run=Run(workers=2)
    )
    assert {path: path.stat().st_mtime_ns for path in written} == written


def test_a_cluster_is_asked_for_a_few_files_too(tmp_path, body_path, no_scheduler):
    """With the OMP_NUM_THREADS=1 that a cluster wants all were read one by one, without a word."""
    write_amass(tmp_path / "AMASS", NAMES[:1])
    run = Run(scheduler=no_scheduler)
    with pytest.raises(NoWorkers, match=f"no Dask scheduler at {no_scheduler}"):
        make_library((tmp_path / "AMASS",), str(body_path), tmp_path / "out", run=run)


def test_workers_get_absolute_paths(tmp_path, body_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    broken = tmp_path / "AMASS" / "KIT" / "walk_poses.npz"
    broken.parent.mkdir(parents=True)
    broken.write_bytes(b"PK\x03\x04 broken")
    with pytest.raises(BadMotionFile):
        make_library(("AMASS",), body_path.name, "out")
    (failed,) = (tmp_path / "out" / "failed").iterdir()
    assert failed.read_text().startswith(f"{broken}: not a readable .npz")


@pytest.mark.parametrize("workers", [1, 2])
def test_bad_files_are_listed_at_the_end(tmp_path, body_path, workers):
    root, out = tmp_path / "AMASS", tmp_path / "out"
    write_amass(root, NAMES)
    (root / "KIT/4/walk_poses.npz").write_bytes(b"PK\x03\x04 broken")
    write_amass(root, ["SFU/0005/0005_Walk001_poses"], poses=np.full((12, 156), np.nan))
    with pytest.raises(BadMotionFile) as refused:
        make_library((root,), str(body_path), out, run=Run(workers=workers))
    said = str(refused.value).splitlines()
    assert said[0].startswith("2 of 10 files could not be read; motions.yaml lists the others")
    assert "KIT/4/walk_poses.npz: not a readable .npz" in said[1]
    assert "0005_Walk001_poses.npz: poses is not finite at frame 0" in said[2]
    check_manifest(out / "motions.yaml")
    assert len(clips_of(out / "motions.yaml")) == 8
    assert len(list((out / "failed").glob("*.txt"))) == 2
    # Mended, they join the others.
    write_amass(root, NAMES)
    make_library((root,), str(body_path), out, run=Run(redo=True, workers=workers))
    assert len(clips_of(out / "motions.yaml")) == 10
    assert not list((out / "failed").glob("*.txt"))


def test_a_name_that_is_no_text_loses_no_other_file(tmp_path, body_path):
    """As zip files of Windows unpack it; what desktops leave beside files is no motion."""
    root = tmp_path / "AMASS"
    write_amass(root, NAMES[:2])
    named = root / f"{NAMES[0]}.npz"
    for folder in (named.parent, root / "__MACOSX", root / ".Trash-1000" / "files"):
        other = folder / (f"._{named.name}" if folder == named.parent else named.name)
        other.parent.mkdir(parents=True, exist_ok=True)
        other.write_bytes(b"\0\5\x16\7")
    named.rename(named.with_name("aufschw\udcfcnge_poses.npz"))
    with pytest.raises(BadMotionFile) as refused:
        make_library((root,), str(body_path), tmp_path / "out", run=Run(workers=1))
    said = str(refused.value).splitlines()
    assert said[0].startswith("1 of 2 files could not be read; motions.yaml lists the others")
    assert r"aufschw\xfcnge_poses.npz: the bytes of its name are no UTF-8. Rename it" in said[1]
    assert len(clips_of(tmp_path / "out" / "motions.yaml")) == 1
    assert motion_table((root,), str(body_path)).bad.encode()


def test_nothing_readable_leaves_no_manifest(tmp_path, body_path):
    (tmp_path / "walk.bvh").write_text("HIERARCHY")
    with pytest.raises(BadMotionFile, match=r"1 of 1 files could not be read; there is no manif"):
        make_library((tmp_path / "walk.bvh",), str(body_path), tmp_path / "out")
    assert not (tmp_path / "out" / "motions.yaml").exists()


def test_another_reading_of_files_that_are_there_is_said_as_such(tmp_path, body_path):
    """They "could not be read", and "there is no manifest", it said; the manifest stays."""
    write_amass(tmp_path / "AMASS", NAMES[:2])
    given = (tmp_path / "AMASS",), str(body_path), tmp_path / "out"
    before = make_library(*given).read_bytes()
    with pytest.raises(BadMotionFile) as refused:
        make_library(*given, fps_hz=50.0)
    said = str(refused.value).splitlines()
    what = "2 of 2 files were read in another way before; motions.yaml is that of before:"
    assert said[0] == what and "config.fps_hz. Pass --redo" in said[1]
    planned = plan_library(given[0], given[2], ReadConfig(fps_hz=50))
    assert [row[2] for row in planned] == 2 * ["read in another way before, needs --redo"]
    assert (tmp_path / "out" / "motions.yaml").read_bytes() == before


def test_another_body_at_the_same_place_is_read_anew(tmp_path, small_body, body_path):
    """One process took the body of its first run for all that came later."""
    write_amass(tmp_path, NAMES[:1])
    other = tmp_path / "other.npz"
    save_body(other, replace(small_body, name="other"))
    for body, name, redo in ((body_path, small_body.name, False), (other, "other", True)):
        made = make_library((tmp_path,), str(body), tmp_path / "out", run=Run(redo=redo))
        assert [clip.motion.body for clip in load_clips(made)] == [name]


def test_names_of_clips(tmp_path):
    for name in ("a/walk.bvh", "b/walk.bvh", "b/run.bvh", "02_03.bvh"):
        path = tmp_path / "files" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    write_amass(tmp_path / "files", ["CMU/02/02_03_poses"])
    found = {file.id: file.source for file in library_files((tmp_path / "files",))}
    assert sorted(found) == ["02_03", "CMU.02.02_03_poses", "a.walk", "b.walk", "run"]
    assert (found["02_03"].dataset, found["02_03"].sequence) == ("CMU", "02_03")
    amass = found["CMU.02.02_03_poses"]
    assert (amass.dataset, amass.sequence) == ("AMASS", "CMU/02/02_03_poses")
    # The same trial, from its data set's folder alone.
    (inside,) = library_files((tmp_path / "files" / "CMU",))
    assert inside.source == amass and inside.id == "02.02_03_poses"
    # Trainings leave out trials of CMU, whatever the folder is called that a link leads to.
    (tmp_path / "files" / "CMU").rename(tmp_path / "amass_cmu_smplh")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "CMU").symlink_to(tmp_path / "amass_cmu_smplh")
    (linked,) = library_files((tmp_path / "mine" / "CMU",))
    assert linked.source == amass
    (tmp_path / "amass_cmu_smplh").rename(tmp_path / "files" / "CMU")
    (alone,) = library_files((tmp_path / "files" / "b" / "run.bvh",))
    assert alone.id == "run" and alone.source.dataset == "file"
    again = library_files((tmp_path / "files", tmp_path / "files" / "b" / "run.bvh"))
    assert sorted(file.id for file in again) == sorted(found)
    with pytest.raises(BadRecipe, match="would both be clip walk"):
        library_files((tmp_path / "files" / "a", tmp_path / "files" / "b"))
    write_amass(tmp_path / "files" / "b", ["run"])
    with pytest.raises(
        BadRecipe, match=r"b/run\.bvh and .*b/run\.npz would both.*Leave one out, as"
    ):
        library_files((tmp_path / "files" / "b",))
    with pytest.raises(MissingInput, match="nothing given"):
        library_files(())
    (tmp_path / "empty").mkdir()
    with pytest.raises(MissingInput, match="holds no"):
        library_files((tmp_path / "empty",))


def test_files_whose_names_have_no_plain_letter_in_common(tmp_path):
    """Two names of one word each in another script would both be clip `_`."""
    for name in ("走", "跑", "turn"):
        (tmp_path / f"{name}.bvh").touch()
    ids = {file.path.stem: file.id for file in library_files((tmp_path,))}
    assert ids["turn"] == "turn" and ids["走"] != ids["跑"]
    assert all(re.fullmatch("__[0-9a-f]{8}", ids[name]) for name in ("走", "跑"))
    (tmp_path / "跑.bvh").unlink()
    assert [file.id for file in library_files((tmp_path,))] == ["turn", "_"]


def test_frames_that_a_clip_drops_stay_dropped(tmp_path, small_body, body_path):
    """A fused motion has poses where nobody saw the person, which are not for training."""
    motion = embedded_motions(small_body, np.random.default_rng(0), count=1, duration_s=1)[0]
    valid = np.arange(30) >= 10
    path = save_bare(tmp_path / "walk.npz", small_body, motion, valid)
    path = make_library([path], str(body_path), tmp_path / "out")
    (found,) = load_clips(path)
    assert np.array_equal(found.valid, valid)


def test_a_library_below_its_source_does_not_read_its_own_clips(tmp_path, body_path, monkeypatch):
    """`gmrdata motions . --out lib`; motions of others in a folder `clips` of it are read."""
    monkeypatch.chdir(tmp_path)
    write_amass(tmp_path / "lib" / "clips", ["walk_poses", "KIT/kick_poses"])
    first = make_library(["."], body_path.name, "lib").read_bytes()
    files = library_files((Path(),))
    assert sorted(file.path.name for file in files) == ["kick_poses.npz", "walk_poses.npz"]
    written = finished(tmp_path / "lib")
    assert make_library(["."], body_path.name, "lib").read_bytes() == first
    assert finished(tmp_path / "lib") == written and len(written) == 2
    assert [row[2] for row in plan_library((Path(),), Path("lib"), ReadConfig())] == [
        "there",
        "there",
    ]


def test_what_gmrdata_made_keeps_its_source_and_is_not_imported_twice(tmp_path, body_path, capsys):
    """As `file: clip` it was trained on, of Table 8 or not, and AMASS's licence was lost."""
    write_amass(tmp_path / "AMASS", ["CMU/02/02_03_poses"])
    make_library((tmp_path / "AMASS",), str(body_path), tmp_path / "lib")
    clip = tmp_path / "lib" / "clips" / "CMU.02.02_03_poses" / "clip.npz"
    for given in (clip, clip.parent, tmp_path / "lib"):
        (again,) = library_files((given,))
        assert again.path == clip
        assert again.source == Source(dataset="AMASS", sequence="CMU/02/02_03_poses")
    assert "made by gmrdata" in capsys.readouterr().err
    shutil.copytree(tmp_path / "lib", tmp_path / "AMASS" / "lib")
    (file,) = library_files((tmp_path / "AMASS",))
    assert file.id == "CMU.02.02_03_poses"
    assert "AMASS/lib/clips/CMU.02.02_03_poses/clip.npz: left out" in capsys.readouterr().err


def test_an_exported_clip_of_amass_is_still_amass(tmp_path):
    """Its name says what it is of; its licence was lost, and its subject."""
    names = {
        "KIT.3.kick_poses_00000-00171": ("AMASS", "KIT/3/kick_poses"),
        "x.AMASS.CMU.02.02_03_stageii": ("AMASS", "CMU/02/02_03_stageii"),
        "CMU.smplh.02.02_03_poses_00010-00171": ("AMASS", "CMU/02/02_03_poses"),
        "02.02_03_poses_00010-00171": ("file", "02.02_03_poses_00010-00171"),
        "walk_00000-00171": ("file", "walk_00000-00171"),
    }
    for name in names:
        (tmp_path / f"{name}.bvh").touch()
    found = {file.path.stem: file.source for file in library_files((tmp_path,))}
    assert {name: (s.dataset, s.sequence) for name, s in found.items()} == names


def test_a_file_that_was_changed_is_named_and_the_manifest_stays(tmp_path, body_path):
    """The error was that the manifest has other content, and told of no file."""
    write_amass(tmp_path / "AMASS", NAMES[:2])
    given = (tmp_path / "AMASS",), str(body_path), tmp_path / "out"
    before = make_library(*given).read_bytes()
    named = tmp_path / "AMASS" / f"{NAMES[1]}.npz"
    named.write_bytes(named.read_bytes()[:2000])
    with pytest.raises(BadMotionFile) as refused:
        make_library(*given)
    said = str(refused.value).splitlines()
    assert said[0].endswith("; motions.yaml is that of before:") and "02_03_poses" in said[1]
    assert (tmp_path / "out" / "motions.yaml").read_bytes() == before
    with pytest.raises(BadMotionFile, match="1 of 2 .*lists the others"):
        make_library(*given, run=Run(redo=True))
    assert len(clips_of(tmp_path / "out" / "motions.yaml")) == 1


def test_clip_ids_have_plain_letters():
    assert clip_id("B3 - walk1 (ü)_poses") == "B3_-_walk1__poses"
    assert clip_id("-x") == "_-x"
    assert len(clip_id("a" * 500)) == 150


def test_the_table_of_a_folder(tmp_path, body_path):
    write_amass(tmp_path / "AMASS", NAMES[:2])
    folder = tmp_path / "AMASS"
    table = motion_table((folder,), str(body_path))
    assert table.headings[:4] == ("file", "frames", "rate [Hz]", "from") and not table.bad
    assert [row[:4] for row in table.rows] == [
        ("01/01_01_poses.npz", "12", "60", "file"),
        ("02/02_03_poses.npz", "12", "60", "file"),
    ]
    (folder / "walk.bvh").write_text("HIERARCHY\n")
    again = motion_table((folder,), str(body_path))
    assert again.rows[0][0] == "CMU/01/01_01_poses.npz" and len(again.rows) == 2
    assert again.bad.startswith("1 of 3 files could not be read; the others are listed:\n")
    assert "walk" in again.bad


def finished(out: Path) -> dict[Path, int]:
    """Clips that are there as a whole, and when they were written."""
    paths = [path for path in out.glob("clips/*/clip.npz") if path.parent.suffix != ".partial"]
    return {path: path.stat().st_mtime_ns for path in paths}


@pytest.mark.slow
def test_a_killed_import_goes_on(tmp_path, body_path):
    root, out = tmp_path / "AMASS", tmp_path / "out"
    write_amass(root, [f"KIT/{n}/walk_poses" for n in range(40)], n_frames=60)
    command = [sys.executable, "-m", "gmrdata", "motions", str(root), "--out", str(out)]
    command += ["--body", str(body_path), "--workers", "2"]
    process = subprocess.Popen(
        command, cwd=REPOSITORY, stderr=subprocess.DEVNULL, start_new_session=True
    )
    while len(finished(out)) < 5:
        assert process.poll() is None, "ended before it could be killed"
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    done = finished(out)
    assert 5 <= len(done) < 40 and not (out / "motions.yaml").exists()
    assert subprocess.run(command, cwd=REPOSITORY, capture_output=True).returncode == 0
    assert {path: path.stat().st_mtime_ns for path in done} == done
    check_manifest(out / "motions.yaml")
    assert len(clips_of(out / "motions.yaml")) == 40
