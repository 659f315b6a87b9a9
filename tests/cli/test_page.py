"""`gmrdata page`: the page of a solved video, and files that other programs open."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest
import trimesh

from gmrdata.cameras.files import load_cameras
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.reconstruct import IMAGES_FACT
from gmrdata.cli.video import leave_files_and_page
from gmrdata.export.export import write_files
from gmrdata.solve.verdict import VERDICT_FILE
from gmrdata.stage.store import run_stage
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import camera_of, load_clip
from gmrdata.values.files import STAGE_FILE, read_npz
from gmrdata.world.judge import load_record
from gmrdata.world.recipe import verdict_of
from gmrdata.write import cameras
from gmrdata.write.amass import write_amass
from tests.film.set_kills import contents
from tests.fixtures.command_line import fails_cleanly
from tests.pages.html_pages import Page
from tests.pages.solved_video import N_ROWS, camera_verdict, fuse_video, solved_video
from tests.write.test_colmap import models


def test_the_page_has_files_of_one_who_is_accepted_and_none_of_one_who_is_rejected(
    small_body, works, tmp_path
):
    folder = tmp_path / "out" / "sequences" / "walk"
    solved_video(folder, small_body)
    images = (folder / "frames").rename(tmp_path / "walk")
    kept = folder / "files" / "notes.txt"
    kept.parent.mkdir()
    kept.write_text("mine")
    said = works("page", folder, "--images", tmp_path)
    assert said.stdout.strip() == str((folder / "index.html").resolve())
    page = Page(folder / "index.html")
    assert all(file.is_file() for file in page.files) and page.tags.count("video") == 1
    names = [str(file.relative_to(folder)) for file in page.files]
    run = f"walk_00000-{N_ROWS - 1:05d}"
    for name in (f"bvh/walk/{run}.bvh", f"amass/walk/{run}.npz", "glb/walk.glb", "tum/walk.txt"):
        assert f"files/{name}" in names
    assert kept.read_text() == "mine"
    model = pycolmap.Reconstruction(str(folder / "files/colmap/walk/sparse/0"))
    assert model.num_images() == N_ROWS and model.num_points3D() > 20
    scene = trimesh.load(folder / "files/glb/walk.glb", process=False)
    assert len(next(iter(scene.geometry.values())).vertices) == len(small_body.template_m)
    assert np.loadtxt(folder / "files/tum/walk.txt").shape == (N_ROWS, 8)
    record = load_record(folder / "pseudo_gt")
    rejected = verdict_of("walk", False, ("it floats",), [""] * N_ROWS)
    record = record.model_copy(update={"people": (rejected,)})
    record.write(folder / "pseudo_gt" / "quality.json")
    works("page", folder, "--images", images)
    words = Page(folder / "index.html").words
    assert "it floats" in words and "files are written of what is accepted" in words
    assert [path.name for path in kept.parent.iterdir()] == [kept.name]


def test_files_are_of_the_network_s_motions_where_these_are_there(small_body, run_dir, tmp_path):
    folder, last = tmp_path / "walk", N_ROWS - 1
    solved_video(folder, small_body, lost=[9, 10, 11])
    assert write_files(folder) == []
    assert _files(folder, "bvh") == ["walk_00000-00008.bvh", f"walk_00012-{last:05d}.bvh"]
    before = contents(folder / "pseudo_gt")
    fused = load_clip(fuse_video(folder, run_dir) / "person_0.npz").motion
    assert write_files(folder) == []
    assert _files(folder, "bvh") == [f"walk_00000-{last:05d}.bvh"]
    assert _files(folder, "amass") == [f"walk_00000-{last:05d}.npz"]
    write_amass(tmp_path / "fused.npz", fused, small_body)
    wanted = read_npz(tmp_path / "fused.npz")["trans"]
    made = read_npz(folder / "files" / "amass" / "walk" / f"walk_00000-{last:05d}.npz")
    np.testing.assert_allclose(made["trans"], wanted, atol=1e-6)
    cameras = np.loadtxt(folder / "files" / "tum" / "walk.txt")
    assert len(cameras) == N_ROWS - 3
    assert contents(folder / "pseudo_gt") == before


def files_hold_kept(path: CameraPath, files: Path, tum: str, colmap: str) -> None:
    """A TUM path and a COLMAP model have all cameras but those of the rows 1 and 2."""
    kept = np.delete(np.arange(N_ROWS), [1, 2])
    written = np.loadtxt(files / "tum" / f"{tum}.txt")
    np.testing.assert_allclose(written[:, 0], kept / 10, atol=1e-9)
    np.testing.assert_allclose(written[:, 1:4], path.centres_world_m[kept], atol=1e-9)
    for model in models(files / "colmap" / colmap):
        assert sorted(image - 1 for image in model.images) == kept.tolist()
        assert model.num_points3D() > 20


def test_frames_that_the_verdict_drops_are_in_no_file_of_cameras_alone(small_body, tmp_path):
    """Where the camera jumps, say: they stood there as the others do."""
    folder = tmp_path / "walk"
    solved_video(folder, small_body, person=False)
    camera_verdict("", "the camera jumps", "the camera jumps").write(folder / VERDICT_FILE)
    assert write_files(folder) == []
    files_hold_kept(load_cameras(folder / "sfm").path, folder / "files", "camera", "")


def test_a_model_of_cameras_alone_is_whole_or_not_there(small_body, tmp_path, monkeypatch):
    """On a full disk half of it stayed, where that of people was taken away."""
    folder = tmp_path / "walk"
    solved_video(folder, small_body, person=False)
    camera_verdict().write(folder / VERDICT_FILE)

    def full(*_: object) -> None:
        raise OSError("the disk is full")

    with monkeypatch.context() as disk:
        disk.setattr(cameras, "_require_whole", full)
        with pytest.raises(OSError, match="full"):
            write_files(folder)
    assert not list((folder / "files").rglob("*.bin"))
    (folder / "files" / "colmap").mkdir(exist_ok=True)
    (folder / "files" / "colmap" / "notes.txt").write_text("mine")
    assert write_files(folder) == []
    assert len(models(folder / "files/colmap")[0].images) == N_ROWS
    assert (folder / "files" / "colmap" / "notes.txt").read_text() == "mine"
    there = sorted(path.name for path in (folder / "files").iterdir())
    assert there == ["colmap", "tum"]


def test_frames_that_the_verdict_drops_are_in_no_file_of_a_camera_that_films_people(
    small_body, tmp_path, works
):
    """They were left out of the files of cameras alone.  Where none can be left out it is said."""
    folder = tmp_path / "walk"
    solved_video(folder, small_body)
    camera_verdict("", "the camera jumps", "the camera jumps").write(folder / VERDICT_FILE)
    assert write_files(folder) == []
    path = camera_of(load_clip(folder / "pseudo_gt" / "person_0.npz"))
    files_hold_kept(path, folder / "files", "walk", "walk")
    said = works("export", folder, "--to", "kitti", "tum", "--out", tmp_path / "exported").stderr
    assert said.count("the verdict drops the cameras of 2 frames, which kitti has") == 1


def test_a_verdict_on_other_frames_is_named(small_body, tmp_path):
    """Of cameras alone the reason was that "operands could not be broadcast together"."""
    for person, wanted in ((False, ["all formats"]), (True, ["colmap of walk", "tum of walk"])):
        folder = tmp_path / str(person) / "walk"
        solved_video(folder, small_body, person=person)
        said = camera_verdict()
        short = verdict_of("camera", True, (), 5 * [""])
        said.model_copy(update={"camera": short}).write(folder / VERDICT_FILE)
        left_out = write_files(folder)
        assert [what for what, _ in left_out] == wanted
        assert all(f"of 5 frames, not {N_ROWS}" in why for _, why in left_out)


def test_what_others_made_beside_a_colmap_model_stays(small_body, tmp_path):
    folder = tmp_path / "walk"
    solved_video(folder, small_body)
    model = folder / "files" / "colmap" / "walk"
    assert write_files(folder) == []
    written = contents(model)
    dense = model / "dense" / "fused.ply"
    dense.parent.mkdir()
    dense.write_text("hours of work")
    (model / "text" / "cameras.txt").write_text("of another verdict")
    assert write_files(folder) == []
    assert contents(model).items() > written.items()
    assert contents(model).keys() - written.keys() == {"dense/fused.ply"}
    rejected = verdict_of("walk", False, ("it floats",), [""] * N_ROWS)
    record = load_record(folder / "pseudo_gt").model_copy(update={"people": (rejected,)})
    record.write(folder / "pseudo_gt" / "quality.json")
    assert write_files(folder) == []
    assert list(contents(folder / "files")) == ["colmap/walk/dense/fused.ply"]


def test_what_others_put_beside_the_files_stays_and_what_a_page_wrote_does_not(
    small_body, works, tmp_path
):
    """The folders of formats were cleared whole.  An earlier solution had a second person."""
    folder = tmp_path / "out" / "sequences" / "walk"
    solved_video(folder, small_body)
    files = folder / "files"
    mine = ("bvh/walk/walk_00000-00029_edited.bvh", "bvh/best/walk_00000-00029.bvh", "glb/mine.glb",
            "amass/notes.txt", "tum/best.txt", "colmap/mine/sparse/0/cameras.bin")  # fmt: skip
    stale = ("bvh/second/second_00000-00008.bvh", "glb/second.glb", "bvh/walk/walk_00000-00003.bvh",
             "tum/camera.txt", "colmap/old/sparse/0/cameras.bin", "colmap/old/text/cameras.txt",
             "tum/old.txt")  # fmt: skip
    for name in mine + stale:
        (files / name).parent.mkdir(parents=True, exist_ok=True)
        (files / name).write_text("as it was")
    assert write_files(folder) == []
    left = contents(files)
    assert left.keys() >= {*mine, "glb/walk.glb", "tum/walk.txt"} and not left.keys() & {*stale}
    export = ("export", folder, "--to", "bvh", "glb", "--out", files)
    works(*export, "--redo")
    assert contents(files).keys() == left.keys()
    record = load_record(folder / "pseudo_gt")
    rejected = verdict_of("walk", False, ("it floats",), [""] * N_ROWS)
    record.model_copy(update={"people": (rejected,)}).write(folder / "pseudo_gt" / "quality.json")
    assert write_files(folder) == []
    assert contents(files).keys() == {*mine}


def test_frames_outside_of_the_folder_are_those_that_are_given_and_no_record_leads_there(
    small_body, gmrdata, works, tmp_path
):
    """The page of a folder of images, written again without them, lost its overlay and the colours
    of COLMAP's points; cameras alone had these from wherever a record said."""
    folder, model = tmp_path / "walk", tmp_path / "walk/files/colmap/sparse/0"
    solved_video(folder, small_body, person=False)
    images = (folder / "frames").rename(tmp_path / "images")
    verdict = camera_verdict(images_dir=str(images))
    verdict.write(folder / "verdict.json")
    leave_files_and_page(folder, verdict)
    left = contents(folder)
    assert Page(folder / "index.html").tags.count("video") == 1 and _colours(model).any()
    fails_cleanly(gmrdata("page", folder), f"with --images {images}")
    assert contents(folder) == left
    works("page", folder, "--images", images)
    assert contents(folder) == left
    assert write_files(folder) == [] and not _colours(model).any()
    # What an older gmrdata lacks, or a broken record, costs the files and not the page.
    (folder / "sfm" / "tracks.npz").unlink()
    works("page", folder, "--images", images)
    assert "Not writtenall formats: " in (words := Page(folder / "index.html").words)
    assert "tracks.npz: an older gmrdata kept no tracks" in words.split("Not written")[1]
    (folder / "verdict.json").write_text("{")
    works("page", folder, "--images", images)
    assert "verdict.json: not JSON" in Page(folder / "index.html").words.split("Not written")[1]


def test_the_record_of_cameras_names_the_frames_of_a_sequence(small_body, gmrdata, tmp_path):
    """`gmrdata sfm` left no word of where its frames lay: its page, written again, lost them."""
    folder = tmp_path / "walk"
    solved_video(folder, small_body)
    images = (folder / "frames").rename(tmp_path / "images")
    facts = {IMAGES_FACT: str(images)}
    made = run_stage("sfm", tmp_path / "made", SfmConfig(), {}, lambda _: facts)
    (made / STAGE_FILE).rename(folder / "sfm" / STAGE_FILE)
    fails_cleanly(gmrdata("page", folder), f"with --images {images}")


def _colours(model: Path) -> np.ndarray:
    """(N, 3) RGB of the points of a COLMAP model."""
    return np.array([point.color for point in pycolmap.Reconstruction(model).points3D.values()])


def _files(folder: Path, format: str) -> list[str]:
    return sorted(path.name for path in (folder / "files" / format / "walk").iterdir())


def test_several_and_none(gmrdata, tmp_path):
    """Files of the same names in a folder of something else were taken away."""
    mine = tmp_path / "files" / "tum" / "camera.txt"
    mine.parent.mkdir(parents=True)
    mine.write_text("mine")
    fails_cleanly(gmrdata("page", tmp_path), "nothing of a video was solved there")
    assert mine.read_text() == "mine"
    fails_cleanly(gmrdata("page"), "a folder of a solved video")
