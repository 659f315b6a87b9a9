"""`gmrdata export` as a person meets it, and what other programs read of what it wrote."""

import re
import shutil
import subprocess
import threading
from dataclasses import replace
from pathlib import Path
from typing import get_args

import cv2  # before pycolmap
import numpy as np
import pytest
import torch
from evo.tools import file_interface

import gmrdata
from gmrdata.cameras.files import load_quality
from gmrdata.cli.export import SAID
from gmrdata.export.export import Unit, _load, _sequences, _StandIns, _truths, _whole
from gmrdata.export.formats import FORMATS, FormatName
from gmrdata.export.sources import ExportedClip, UnreadClip, list_clips
from gmrdata.read.body_file import save_body
from gmrdata.read.systems.result import read_system
from gmrdata.values import transforms
from gmrdata.values.clip import camera_of, load_clip, save_clip
from gmrdata.values.errors import BadRecipe, MissingInput
from gmrdata.values.files import read_npz, write_npz
from tests.clip_manifests import write_clips
from tests.fixtures.command_line import fails_cleanly
from tests.pages.solved_video import solved_video
from tests.solve.test_doubts import video
from tests.write.takes import save_turned
from tests.write.test_colmap import models


@pytest.fixture
def manifest(walkers, small_body, tmp_path) -> Path:
    """A clip whose camera is known but in frame 5, one without a camera, and one in its frame."""
    first, second = walkers
    camera = camera_of(first)
    known = np.arange(camera.n_frames) != 5
    holed = np.where(known[:, None, None], camera.world_from_cam, np.nan)
    camera = replace(camera, world_from_cam=holed, has_camera=known)
    clips = [
        replace(first, id="holed", camera=camera),
        replace(second, id="alone", camera=None),
        replace(second, id="seen", motion=replace(second.motion, frame="camera"), camera=None),
    ]
    classes = ("circular", "none", "none")
    return write_clips(tmp_path / "in", small_body, clips, camera_motions=classes)


def test_what_can_be_written_is_and_the_rest_is_named(manifest, tmp_path, gmrdata):
    fails_cleanly(
        gmrdata("export", manifest, "--to", "tum", "kitti", "--out", tmp_path / "out"),
        "alone: no tum: has no camera",
        "holed: no kitti: clip holed: the camera of frame 5 is not known",
        "5 of 6 could not be written",
    )
    written = [path.relative_to(tmp_path / "out") for path in (tmp_path / "out").rglob("*.txt")]
    assert written == [Path("tum/holed.txt")]
    read = file_interface.read_tum_trajectory_file(tmp_path / "out/tum/holed.txt")
    camera = camera_of(load_clip(manifest.with_name("holed.npz")))
    rows = np.flatnonzero(camera.has_camera)
    np.testing.assert_allclose(read.timestamps, rows / 30, atol=1e-9)
    assert np.abs(np.array(read.poses_se3) - camera.world_from_cam[rows]).max() < 1e-9


def test_a_quiet_command_says_why_a_clip_was_left_out(manifest, tmp_path, gmrdata):
    arguments = ("export", manifest, "--to", "tum", "--clips", "alone", "--out", tmp_path / "out")
    answer = gmrdata(*arguments, "-q")
    assert answer.returncode == 1
    assert answer.stderr.splitlines() == [
        "gmrdata: 1 of 1 could not be written:",
        "  alone: no tum: has no camera",
    ]


def test_the_way_of_the_person(manifest, tmp_path, gmrdata):
    out = tmp_path / "out"
    said = gmrdata("export", manifest, "--to", "tum", "kitti", "--of", "person", "--out", out)
    # Frames 10 to 12 of `holed` are not valid either.
    fails_cleanly(said, "seen: no kitti: its motion is in the camera's frame, not in a world")
    motion = load_clip(manifest.with_name("alone.npz")).motion
    for read in (
        file_interface.read_tum_trajectory_file(out / "tum/alone.txt"),
        file_interface.read_kitti_poses_file(out / "kitti/alone.txt"),
    ):
        expected = transforms.rigid(motion.root_rotmats, motion.pelvis_m)
        assert np.abs(np.array(read.poses_se3) - expected).max() < 1e-9


def test_nothing_is_overwritten_unless_told_so(manifest, tmp_path, gmrdata, works):
    out = tmp_path / "out"
    arguments = ("export", manifest, "--to", "tum", "--clips", "holed", "--out", out)
    works(*arguments)
    (out / "tum/holed.txt").write_text("mine")
    fails_cleanly(gmrdata(*arguments), "already there. Pass --redo")
    assert (out / "tum/holed.txt").read_text() == "mine"
    works(*arguments, "--redo")
    assert (out / "tum/holed.txt").read_text() != "mine"
    assert [path.name for path in (out / "tum").iterdir()] == ["holed.txt"]


def test_who_writes_a_file_that_another_writes_waits(tmp_path):
    path = tmp_path / "walk.glb"
    unit = Unit("glb", "walk", path, ())

    def again() -> None:
        with _whole(unit) as partial:
            partial.write_text("second")

    second = threading.Thread(target=again)
    with _whole(unit) as partial:
        partial.write_text("first")
        second.start()
        second.join(0.5)
        assert second.is_alive() and partial.read_text() == "first"
    second.join()
    assert path.read_text() == "second" and list(tmp_path.iterdir()) == [path]


def test_a_dry_run_lists_and_writes_nothing(manifest, tmp_path, works):
    said = works("export", manifest, "--to", "tum", "--out", tmp_path / "out", "--dry-run")
    assert not (tmp_path / "out").exists()
    assert "to write" in said.stdout and "left out: has no camera" in said.stdout


def test_a_dry_run_says_what_is_there_and_needs_redo(manifest, tmp_path, works):
    """`to replace`, it said, of what is refused."""
    command = (
        "export",
        manifest,
        "--to",
        "tum",
        "--out",
        tmp_path,
        "--of",
        "person",
        "--clips",
        "alone",
    )
    works(*command)
    assert "there, which needs --redo" in works(*command, "--dry-run").stdout
    assert "to replace" in works(*command, "--dry-run", "--redo").stdout


def test_a_truth_of_none_of_the_clips_is_refused(manifest, walkers, small_body, tmp_path):
    truth, out = tmp_path / "truth.npz", tmp_path / "out"
    save_clip(truth, walkers[1], small_body.rest_pelvis_m(walkers[1].motion.shape))
    with pytest.raises(MissingInput, match=r"has none of the clips; there are walk\.p1"):
        gmrdata.export(manifest, ["rrd"], out, truth=truth)
    assert not out.exists()


def test_a_truth_of_some_clips_is_not_filled_up_from_beside_the_others(
    walkers, small_body, tmp_path, capsys
):
    """It said "no truth for", and wrote that which lay beside the clip."""
    for name in ("pseudo_gt", "synthetic"):
        folder = tmp_path / name
        text = write_clips(folder, small_body, walkers).read_text()
        (tmp_path / f"{name}.yaml").write_text(text.replace("path: ", f"path: {name}/"))
    wanted, truth = list_clips(tmp_path), tmp_path / "synthetic/walk.p0.npz"
    found = []
    for given in (None, truth):
        truths = _truths(given, wanted)
        loaded = [_load(one, _StandIns(None, None, given), truths, True) for one in wanted]
        found.append([one.truth is not None for one in loaded if isinstance(one, ExportedClip)])
    assert found == [[True, True], [True, False]]
    assert "no truth for walk.p1" in capsys.readouterr().err


def test_a_format_that_there_is_not_is_named(manifest, tmp_path):
    with pytest.raises(
        BadRecipe, match=r"no format 'blv'; give a list of .*, onnx; did you mean 'bvh'"
    ):
        gmrdata.export(manifest, ["tum", "blv"], tmp_path / "out")


@pytest.mark.parametrize(
    ("format", "setting", "why"),
    [
        ("tum", {"of": "Camera"}, "--of: 'Camera' is none of camera, person"),
        ("colmap", {"observations": "ALL"}, "'ALL' is none of keyframes, all, none"),
        ("onnx", {"which": "Best"}, "--which: 'Best' is none of latest, best"),
    ],
)
def test_a_setting_that_there_is_not_is_named(format, setting, why, manifest, tmp_path):
    """A misspelt camera gave the person's path in its place."""
    with pytest.raises(BadRecipe, match=why):
        gmrdata.export(manifest, [format], tmp_path / "out", **setting)


def test_formats_and_clips_are_looked_at_more_than_once(manifest, tmp_path):
    """Of a generator nothing was written, and nothing was said."""
    formats, clips = (one for one in ["tum"]), (one for one in ["alone"])
    made = gmrdata.export(manifest, formats, tmp_path / "out", clips=clips, of="person")
    assert [(one.unit.format, one.unit.ids, one.left_out) for one in made] == [
        ("tum", ("alone",), "")
    ]
    with pytest.raises(MissingInput, match="no clip nobody; there are "):
        gmrdata.export(manifest, ["tum"], tmp_path / "out", clips="nobody", of="person")


def test_a_broken_clip_does_not_stop_the_others(manifest, tmp_path, gmrdata):
    broken = manifest.with_name("holed.npz")
    broken.write_bytes(broken.read_bytes()[:500])
    arguments = ("--of", "person", "--clips", "holed", "alone", "--out", tmp_path / "out")
    said = gmrdata("export", manifest, "--to", "tum", *arguments)
    fails_cleanly(said, "holed: no tum: ")
    assert "holed.npz: not a readable .npz" in said.stderr.replace("\n", "")
    assert (tmp_path / "out/tum/alone.txt").is_file()


@pytest.mark.parametrize(
    ("key", "row", "value", "why"),
    [
        ("trans", 3, np.nan, "arrays.trans: NaN or infinite in kept row 3"),
        ("poses", 3, np.nan, "arrays.poses: NaN or infinite in kept row 3"),
        ("world_from_cam", 3, 0.0, "arrays.world_from_cam: no proper rotation in row 3"),
        ("camera_size_px", 0, 0, "arrays.camera_size_px: not above zero"),
    ],
)
def test_numbers_that_can_not_be_used_are_in_no_format(
    key, row, value, why, walkers, small_body, tmp_path
):
    """BVH and AMASS had NaN in them, and other formats ended in a traceback."""
    write_clips(tmp_path / "in", small_body, walkers[:1], camera_motions=["circular"])
    path = tmp_path / "in" / f"{walkers[0].id}.npz"
    arrays = read_npz(path)
    arrays[key][row] = value
    write_npz(path, arrays)
    save_body(tmp_path / "body.npz", small_body)
    body = str(tmp_path / "body.npz")
    made = gmrdata.export(path, [*FORMATS], tmp_path / "out", body=body)
    assert len(made) == len(FORMATS) and all(why in one.left_out for one in made)


def test_a_broken_file_or_a_missing_body_does_not_stop_the_other_clips_of_a_folder(
    walkers, small_body, tmp_path
):
    """The one raised where the folder was listed, the other where a remark looked at the body."""
    source, clip = tmp_path / "in", replace(walkers[0], id="far")
    motion = replace(clip.motion, body="smpl-female")
    rest_pelvis_m = small_body.rest_pelvis_m(motion.shape)
    save_clip(source / "far.npz", replace(clip, motion=motion), rest_pelvis_m)
    save_clip(source / "near.npz", replace(clip, id="near"), rest_pelvis_m)
    (source / "cut.npz").write_bytes((source / "near.npz").read_bytes()[:500])
    save_body(source / "body" / "body.npz", small_body)
    made = gmrdata.export(source, ["amass", "bvh"], tmp_path / "out")
    left_out = {f"{one.unit.format} {one.unit.name}": one.left_out for one in made}
    assert {name for name, why in left_out.items() if not why} == {"amass near", "bvh near"}
    assert all("needs the body smpl-female" in left_out[f"{one} far"] for one in ("amass", "bvh"))
    assert all("cut.npz: not a readable" in left_out[f"{one} cut"] for one in ("amass", "bvh"))


def test_images_of_one_sequence_are_not_taken_for_those_of_another(
    manifest, tmp_path, gmrdata, works
):
    (tmp_path / "images/holed").mkdir(parents=True)
    (tmp_path / "images/holed/00000.png").touch()
    arguments = ("export", manifest, "--to", "colmap", "--out", tmp_path, "--images")
    said = gmrdata(*arguments, tmp_path / "images")
    assert f"alone: no colmap: {tmp_path}/images/alone: no such folder of images" in said.stderr
    assert (tmp_path / "colmap/holed/sparse/0/images.bin").is_file()
    said = gmrdata(*arguments, tmp_path / "images/holed", "--redo")
    assert "holed/holed: no such folder of images" in said.stderr
    alone = ("--clips", "holed", "--redo")
    works(*arguments, tmp_path / "images/holed", *alone)


def test_a_rendered_clip_becomes_a_model_without_points(
    walkers, small_body, tmp_path, gmrdata, works
):
    clip = walkers[0]
    save_clip(tmp_path / "in/clip.npz", clip, small_body.rest_pelvis_m(clip.motion.shape))
    (tmp_path / "in/frames").mkdir()
    for number in range(20):
        (tmp_path / f"in/frames/{number:05d}.png").touch()
    works("export", tmp_path / "in", "--to", "colmap", "--out", tmp_path)
    for model in models(tmp_path / "colmap/walk.p0"):
        names = sorted(image.name for image in model.images.values())
        assert names == [f"{number:05d}.png" for number in range(20)]
        assert model.num_points3D() == 0
    shutil.rmtree(tmp_path / "in/frames")
    said = gmrdata("export", tmp_path / "in", "--to", "colmap", "--out", tmp_path / "without")
    fails_cleanly(said, "has no images. Give their folder")
    assert not list((tmp_path / "without").rglob("*.*"))


def test_images_that_exif_turns_are_named_and_give_no_colours(small_body, tmp_path, works):
    """COLMAP takes their pixels as they are stored, so that points had the colours of others."""
    solved_video(tmp_path / "walk", small_body)
    coloured = []
    for turned in (False, True):
        for path in (tmp_path / "walk/frames").iterdir() if turned else ():
            save_turned(path)
        out = tmp_path / str(turned)
        said = works("export", tmp_path / "walk", "--to", "colmap", "--out", out)
        assert ("turned by EXIF" in said.stderr) == turned
        (model, _) = models(out / "colmap/walk")
        coloured.append(any((point.color > 0).any() for point in model.points3D.values()))
    assert coloured == [True, False]


@pytest.mark.parametrize(
    ("kind", "why"),
    [
        ("renamed", "has none of the model's images"),
        ("halved", r"images of \(\d+, \d+\) px, and the model's are \(\d+, \d+\)"),
    ],
)
def test_images_that_are_not_the_model_s_are_named_and_give_no_colours(
    kind, why, small_body, tmp_path, capsys
):
    """Without a word all points were black, or had the colours of other places."""
    solved_video(tmp_path / "walk", small_body)
    for path in (tmp_path / "walk/frames").iterdir():
        if kind == "halved":
            cv2.imwrite(str(path), cv2.imread(str(path))[::2, ::2])
        else:
            path.rename(path.with_suffix(".png"))
    gmrdata.export(tmp_path / "walk", ["colmap"], tmp_path / "out")
    for model in models(tmp_path / "out/colmap/walk"):
        assert model.num_points3D() and not any(p.color.any() for p in model.points3D.values())
    said = " ".join(capsys.readouterr().err.split())
    assert re.search(f"{why}. Points have no colours", said)


def test_each_format_is_described_in_the_help_and_on_the_page(gmrdata):
    page = (Path(__file__).parents[2] / "docs/export.md").read_text(encoding="utf-8")
    described = re.sub(r"[\s│]+", " ", gmrdata("export", "--help").stdout)
    for name, says in SAID.items():
        assert f" {name}: {says}." in described
        assert f"\n| `{name}` | " in page, name
    assert {*FORMATS, "onnx"} == {*get_args(FormatName), "onnx"} == set(SAID)


def test_people_of_a_sequence_share_the_file_of_their_one_camera(walkers, small_body, tmp_path):
    for number, walker in enumerate(walkers):
        path = tmp_path / f"walk/pseudo_gt/person_{number}.npz"
        save_clip(path, walker, small_body.rest_pelvis_m(walker.motion.shape))
    names = {"camera": ["walk.txt"], "person": ["walk.p0.txt", "walk.p1.txt"]}
    for of in ("camera", "person"):
        made = gmrdata.export(str(tmp_path / "walk"), ["tum"], tmp_path / of, of=of)
        assert [one.unit.path.name for one in made if not one.left_out] == names[of]
        assert sorted(path.name for path in (tmp_path / of / "tum").iterdir()) == names[of]


def test_folders_whose_names_become_one_are_two_sequences():
    """The people of `a b` and of `a_b` went into one scene."""
    paths = [Path(f"{name}/pseudo_gt/person_0.npz") for name in ("a b", "a_b")]
    files = [UnreadClip(f"walk_{n}", "a_b", path) for n, path in enumerate(paths)]
    assert _sequences(files) == [[files[0]], [files[1]]]


PERSON = "walk/pseudo_gt/person_0.npz"


@pytest.mark.parametrize("without_image", [[], [3], [0, 1, 28, 29]])
def test_times_are_those_of_the_video(without_image, walkers, small_body, tmp_path, capsys):
    """Whose part was solved, and which stopped for a second: as those of cameras alone are.  With a
    row without an image, all times began at 0, at the usual rate, or several had the same time."""
    clip, rows = walkers[0], np.arange(walkers[0].motion.n_frames)
    numbers = np.where(np.isin(rows, without_image), -1, clip.image_numbers)
    clip = replace(clip, image_numbers=numbers)
    save_clip(tmp_path / PERSON, clip, small_body.rest_pelvis_m(clip.motion.shape))
    times_s = 4.0 + rows / 30 + (rows > 20)
    video(times_s.tolist()).write(tmp_path / "walk/frames/video.json")
    gmrdata.export(tmp_path / "walk", ["tum", "glb", "bvh"], tmp_path)
    (written,) = (tmp_path / "tum").iterdir()
    np.testing.assert_allclose(np.loadtxt(written)[:, 0], times_s, atol=1e-9)
    said = " ".join(capsys.readouterr().err.split())
    assert "frames are up to 1.00 s off a steady" in said
    assert "which glb has" in said and "which bvh has" in said
    clip = replace(clip, valid=rows != 21)  # so that each file of a BVH has one pace
    save_clip(tmp_path / PERSON, clip, small_body.rest_pelvis_m(clip.motion.shape))
    gmrdata.export(tmp_path / "walk", ["glb", "bvh"], tmp_path, redo=True)
    said = " ".join(capsys.readouterr().err.split())
    assert "which glb has" in said and "which bvh has" not in said


@pytest.mark.parametrize(("every", "first"), [(2, 0), (1, 60)])
def test_frames_are_those_of_the_whole_video(walkers, small_body, tmp_path, every, first):
    """WHAM's `frame_ids` counted the images of a video of which every second frame was taken, or a
    part, and our own reader put the person on other frames."""
    clip, n = walkers[0], walkers[0].motion.n_frames
    clip = replace(clip, image_numbers=np.arange(n) + first)
    save_clip(tmp_path / PERSON, clip, small_body.rest_pelvis_m(clip.motion.shape))
    numbers = tuple(range(first, first + every * n, every))
    record = video((np.arange(n) / 30).tolist(), every=every)
    record = record.model_copy(update={"numbers": numbers, "n_decoded": numbers[-1] + 1})
    record.write(tmp_path / "walk/frames/video.json")
    made = gmrdata.export(tmp_path / "walk", ["wham", "gvhmr"], tmp_path)
    assert "frame" in made[1].left_out
    (path,) = (tmp_path / "wham").rglob("*.pkl")
    (found,) = read_system(path, "world").people
    assert found.frame_numbers.tolist() == np.array(numbers)[clip.valid].tolist()


@pytest.mark.parametrize(("last", "is_said"), [(0.0, False), (0.3, True)])
def test_more_betas_than_wham_has_are_said(walkers, small_body, tmp_path, capsys, last, is_said):
    motion = replace(walkers[0].motion, body="smpl-neutral", shape=np.append(np.zeros(15), last))
    clip = replace(walkers[0], id="walk", motion=motion)
    save_clip(tmp_path / PERSON, clip, small_body.rest_pelvis_m(walkers[0].motion.shape))
    gmrdata.export(tmp_path / PERSON, ["wham"], tmp_path)
    said = " ".join(capsys.readouterr().err.split())
    assert ("walk has 16 shape coefficients in wham, WHAM's own files 10" in said) is is_said


def test_a_frame_alone_is_no_file(walkers, small_body, tmp_path, capsys):
    """One was written, which our own reader refuses: `motions` on the folder ended in an error."""
    clip = walkers[0]
    for name, rows, files in (
        ("gap", [0, 1, 2, 4, 6, 7], {"gap_00000-00002", "gap_00006-00007"}),
        ("alone", [2, 4], set[str]()),
    ):
        valid = np.isin(np.arange(clip.motion.n_frames), rows)
        rest_pelvis_m = small_body.rest_pelvis_m(clip.motion.shape)
        path, out = tmp_path / f"{name}.npz", tmp_path / name
        save_clip(path, replace(clip, id=name, valid=valid), rest_pelvis_m)
        save_body(tmp_path / "body/body.npz", small_body)
        made = gmrdata.export(path, ["amass", "bvh"], out)
        for one, suffix in zip(made, (".npz", ".bvh"), strict=True):
            assert {file.name for file in out.rglob(f"*{suffix}")} == {f + suffix for f in files}
            assert ("no two valid frames in a row" in one.left_out) == (not files)
            for file in out.rglob(f"*{suffix}"):
                gmrdata.read_motion(file, small_body)
    said = "clip gap: 1 valid frames stand alone, in no .npz: one is no motion"
    assert said in " ".join(capsys.readouterr().err.split())


@pytest.fixture(scope="module")
def solved(made_set, filmed_set, tmp_path_factory) -> Path:
    """A regenerated set as COLMAP models and GEM-X's files; tests leave them as they are."""
    from gmrdata.cli import main

    out = tmp_path_factory.mktemp("exported")
    images = str(filmed_set.root / "imageFiles")
    flags = ["--to", "colmap", "gem-x", "--images", images, "--out", str(out)]
    main(["export", str(made_set), *flags])
    return out


@pytest.mark.slow
def test_pycolmap_finds_the_stages_reprojection_error(made_set, solved):
    stage = load_quality(made_set / "sequences/arc_00/sfm")
    for model in models(solved / "colmap/arc_00"):
        assert model.num_reg_images() == stage.frames
        assert {image.name for image in model.images.values()} >= {"image_00000.jpg"}
        model.update_point_3d_errors()
        error_px = model.compute_mean_reprojection_error()
        assert error_px == pytest.approx(stage.mean_reprojection_px, rel=0.01)
        assert any((point.color > 0).any() for point in model.points3D.values())


@pytest.mark.slow
def test_the_model_lies_in_the_world_of_the_clip(made_set, filmed_set, solved):
    camera = camera_of(load_clip(made_set / "sequences/arc_00/pseudo_gt/person_0.npz"))
    model, _ = models(solved / "colmap/arc_00")
    found = [model.image(row + 1).cam_from_world().matrix() for row in range(camera.n_frames)]
    expected = transforms.invert(camera.world_from_cam)[:, :3]
    assert np.abs(np.array(found) - expected).max() < 1e-9
    # The room's walls are 3 m and more away: the points are metric, like the cameras.
    places_m = np.array([point.xyz for point in model.points3D.values()])
    assert 2 < np.median(np.linalg.norm(places_m - camera.centres_world_m[0], axis=1)) < 8
    cameras = torch.load(solved / "gem-x/arc_00/preprocess/camera.pt", weights_only=True)
    assert np.abs(cameras.numpy()[:, :3] - expected).max() < 1e-6


@pytest.mark.slow
def test_a_camera_that_only_turns_has_no_points(made_set, solved):
    for model in models(solved / "colmap/pan_00"):
        assert model.num_reg_images() == 36 and model.num_points3D() == 0


@pytest.mark.slow
def test_all_observations_none_and_an_older_folder(made_set, filmed_set, solved, tmp_path, gmrdata):
    source = tmp_path / "arc_00"
    shutil.copytree(made_set / "sequences/arc_00", source)
    keyframes, _ = models(solved / "colmap/arc_00")

    def export(observations: str, out: Path, *flags: object) -> subprocess.CompletedProcess[str]:
        chosen = ("--observations", observations, "--out", out)
        return gmrdata("export", source, "--to", "colmap", *chosen, *flags)

    assert export("all", tmp_path / "all").returncode == 0
    everything, _ = models(tmp_path / "all/colmap/arc_00")
    assert everything.compute_num_observations() > 1.2 * keyframes.compute_num_observations()
    (source / "sfm/tracks.npz").unlink()
    fails_cleanly(export("keyframes", tmp_path / "older"), "kept no tracks")
    assert not list((tmp_path / "older").rglob("*.bin"))
    images = filmed_set.root / "imageFiles/arc_00"
    assert export("none", tmp_path / "none", "--images", images).returncode == 0
    bare, _ = models(tmp_path / "none/colmap/arc_00")
    assert bare.compute_num_observations() == 0
    assert bare.num_points3D() >= keyframes.num_points3D() and bare.num_reg_images() == 36


@pytest.mark.slow
def test_a_model_without_a_metric_scale_keeps_its_own_world(made_set, small_body, tmp_path, works):
    source = tmp_path / "arc_00"
    shutil.copytree(made_set / "sequences/arc_00/sfm", source / "sfm")
    clip = load_clip(made_set / "sequences/arc_00/pseudo_gt/person_0.npz")
    camera = camera_of(clip)
    world_from_cam = camera.world_from_cam.copy()
    world_from_cam[:, :3, 3] = world_from_cam[0, :3, 3]
    still = replace(clip, camera=replace(camera, world_from_cam=world_from_cam))
    path = source / "pseudo_gt/person_0.npz"
    save_clip(path, still, small_body.rest_pelvis_m(clip.motion.shape))
    said = works("export", source, "--to", "colmap", "--out", tmp_path)
    assert "its scale is not known" in said.stderr
    stage = load_quality(source / "sfm")
    for model in models(tmp_path / "colmap" / "arc_00.p0"):
        error_px = model.compute_mean_reprojection_error()
        assert error_px == pytest.approx(stage.mean_reprojection_px, rel=0.01)
