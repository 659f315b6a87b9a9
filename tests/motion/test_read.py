"""Finding motions in folders, and reading all real ones."""

import os
from pathlib import Path

import numpy as np
import pytest

from gmrdata.motion.files import find_motions, read_motion
from gmrdata.motion.library import make_library
from gmrdata.values.errors import BadMotionFile, BadRecipe, MissingInput


def _touch(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("x")
    return path


def test_find_motions_takes_each_trial_once(tmp_path):
    folder = tmp_path / "motions"
    for name in ("bvh/02_03.bvh", "bvh/02_04.bvh", "bvh/walk.bvh", "amc/02_03.amc", "amc/walk.amc",
                 "amc/02.asf", "notes.txt", "one/run.bvh", "one/run.AMC"):  # fmt: skip
        _touch(folder / name)
    np.savez(folder / "02_03_poses.npz", poses=np.zeros(3))
    np.savez(folder / "shape.npz", poses=np.zeros(3))
    np.savez(folder / "02_03_stagei.npz", poses=np.zeros(3))
    np.savez(folder / "cameras.npz", world_from_cam=np.zeros(3))
    _touch(folder / "broken.npz")
    found = [path.relative_to(folder).as_posix() for path in find_motions(folder)]
    assert found == [
        "02_03_poses.npz", "amc/02_03.amc", "amc/walk.amc", "broken.npz", "bvh/02_04.bvh",
        "bvh/walk.bvh", "one/run.AMC",
    ]  # fmt: skip


def test_find_motions_stays_in_the_folder(tmp_path):
    outside = _touch(tmp_path / "outside" / "secret.bvh")
    folder = tmp_path / "motions"
    inside = _touch(folder / "a.bvh")
    (folder / "file_link.bvh").symlink_to(outside)
    (folder / "folder_link").symlink_to(outside.parent)
    (folder / "loop").symlink_to(folder)
    (folder / "dangling.bvh").symlink_to(folder / "nothing.bvh")
    (folder / "itself.bvh").symlink_to(folder / "itself.bvh")
    (folder / "folder.bvh").mkdir()
    os.mkfifo(folder / "pipe.bvh")
    assert find_motions(folder) == [inside]
    with pytest.raises(MissingInput, match="no such folder"):
        find_motions(tmp_path / "nowhere")


def test_find_motions_leaves_out_what_gmrdata_made(tmp_path, capsys):
    """A solved video's person was there as its clip and in both forms of its files, a rejected one
    as its clip alone."""
    for name in ("walk/files/bvh/p/p_0-9.bvh", "own/bvh/p/q.bvh", "inferred/person_0/motion.bvh",
                 "walk/pseudo_gt/person_0.npz", "walk/files/amass/p/p_0-9.npz",
                 "demo/motions.partial/training/a.npz", "own.partial/b.npz"):  # fmt: skip
        _touch(tmp_path / name)
    for name in ("inferred/stage.json", "walk/pseudo_gt/stage.json", "recipe.json",
                 "demo/motions.partial/recipe.json"):  # fmt: skip
        _touch(tmp_path / name)
    found = [path.relative_to(tmp_path).as_posix() for path in find_motions(tmp_path)]
    assert found == ["own/bvh/p/q.bvh", "own.partial/b.npz", "walk/files/amass/p/p_0-9.npz"]
    first = tmp_path / "demo" / "motions.partial" / "training" / "a.npz"
    assert capsys.readouterr().err == f"{first} and 2 more: left out, as gmrdata made it\n"
    # Named itself, it is taken.
    alone = tmp_path / "walk" / "pseudo_gt"
    assert find_motions(alone) == [alone / "person_0.npz"]
    said = f"{alone / 'person_0.npz'}: made by gmrdata, which may have rejected it\n"
    assert capsys.readouterr().err == said
    (tmp_path / "link").symlink_to(tmp_path / "inferred" / "person_0")
    assert find_motions(tmp_path / "link") == [tmp_path / "link" / "motion.bvh"]


def test_other_suffixes_are_refused(tmp_path, small_body):
    with pytest.raises(BadMotionFile, match=r"a\.fbx: no known motion format"):
        read_motion(_touch(tmp_path / "a.fbx"), small_body)
    for name in ("a.bvh", "a.amc", "a.npz"):
        with pytest.raises(MissingInput, match="no such file"):
            read_motion(tmp_path / name, small_body)


@pytest.mark.parametrize(
    "options",
    [{"unit_m": 0.0}, {"up": "w"}, {"unit_m": -1.0}, {"unit_m": np.nan}, {"shape": np.zeros(3)},
     {"shape": np.full(10, np.nan)}],
)  # fmt: skip
def test_wrong_options(tmp_path, small_body, options):
    with pytest.raises(BadRecipe, match=r"a\.bvh"):
        read_motion(_touch(tmp_path / "a.bvh"), small_body, **options)
    if "shape" not in options:
        with pytest.raises(BadRecipe, match=r"out: `(up|unit_m)` is wrong"):
            make_library([tmp_path], "anny", tmp_path / "out", **options)
        assert not (tmp_path / "out").exists()


def test_a_motion_that_is_read_twice_is_the_same(cmu_dir, small_body):
    path, skeleton = cmu_dir / "amc" / "05_01.amc", str(cmu_dir / "amc" / "05.asf")
    first, second = (read_motion(path, small_body, asf_path=asf) for asf in (None, skeleton))
    np.testing.assert_array_equal(first.local_rotmats, second.local_rotmats)
    np.testing.assert_array_equal(first.pelvis_m, second.pelvis_m)
    assert first.source == second.source
    assert first.source.startswith("05_01.amc: skeleton 05.asf, 120 Hz (CMU's index), 0.0564444 m")


@pytest.mark.slow
def test_every_real_file_is_read(cmu_dir, small_body):
    files = sorted((cmu_dir / "bvh").glob("*.bvh")) + sorted((cmu_dir / "amc").glob("*.amc"))
    assert len(files) == 256
    frames = {}
    for file in files:
        motion = read_motion(file, small_body)
        frames[file.stem] = motion.n_frames
        assert motion.fps_hz == 120.0
        rotmats = motion.rotmats
        unit = rotmats.swapaxes(-1, -2) @ rotmats - np.eye(3)
        assert np.abs(unit).max() < 1e-9, file
        assert np.isfinite(motion.pelvis_m).all(), file
        # A person's pelvis stays within 3 m of the floor and does not leap (01_07 has one step
        # of 0.2 m, as recorded).
        assert motion.pelvis_m[:, 2].min() > -0.5 and motion.pelvis_m[:, 2].max() < 3.0, file
        steps_m = np.linalg.norm(np.diff(motion.pelvis_m, axis=0), axis=1)
        assert steps_m.max() < 0.25, file
    # Without the added T-pose; 09_10 also lacks 4 rows without data.
    assert (frames["02_03"], frames["08_02"], frames["08_04"], frames["08_05"]) == (
        173,
        309,
        484,
        298,
    )
    assert frames["09_10"] == 128
