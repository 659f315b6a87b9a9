"""`gmrdata export` to scenes, recordings, videos, other systems' results and ONNX."""

import json
import pickle  # noqa: TID251  The oracle: what others open the files with.
import shutil
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import onnxruntime
import pytest
import torch
import trimesh
from pxr import Usd, UsdGeom

from gmrdata.cameras.files import QUALITY_FILE, Distortion, load_quality
from gmrdata.export.export import export
from gmrdata.export.formats import FORMATS
from gmrdata.gmr.predict import load_gmr, predict_deltas
from gmrdata.motion.emdb import ABOUT_FILE, EmdbAbout
from gmrdata.read.body_file import save_body
from gmrdata.read.emdb import read_emdb
from gmrdata.read.threedpw_files import read_sequence_file
from gmrdata.values import transforms
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.values.skinning import motion_joints_m
from gmrdata.world.judge import load_record
from tests.clip_manifests import write_clips
from tests.filming import write_pictures
from tests.fixtures.command_line import fails_cleanly
from tests.pages.solved_video import solved_video
from tests.write.rerun_files import Recorded
from tests.write.takes import HIDDEN, N_FRAMES, SIZE_PX, make_take


@pytest.fixture
def manifest(walkers, small_body, tmp_path) -> Path:
    """A woman on SMPL's body: a clip from image 0 on, one from image 5 on, one not valid at all."""
    first = walkers[0]
    body = replace(small_body, name="smpl-female")
    named = replace(first, motion=replace(first.motion, body=body.name, gender="female"))
    n = np.arange(first.motion.n_frames)
    clips = [
        replace(named, id="P1_14_outdoor_climb", image_numbers=n),
        replace(named, id="late", image_numbers=n + 5),
        replace(named, id="rejected", valid=n < 0),
    ]
    folder = tmp_path / "in"
    save_body(folder / "body" / "body.npz", body)
    return write_clips(folder, body, clips, camera_motions=["circular"] * 3)


def test_files_where_others_look_for_them(manifest, tmp_path, gmrdata):
    out, name = tmp_path / "out", "P1_14_outdoor_climb"
    about = EmdbAbout(emdb1=True, emdb2=False, reasons=[""] * 30)
    about.write(manifest.parent / ABOUT_FILE)
    layouts = ("emdb", "wham", "gvhmr", "3dpw", "gem-x")
    answer = gmrdata("export", manifest, "--to", *layouts, "--out", out)
    files = sorted(str(path.relative_to(out)) for path in out.rglob("*") if path.is_file())
    assert files == [
        f"3dpw/sequenceFiles/test/{name}.pkl",
        f"emdb/P1/14_outdoor_climb/{name}_data.pkl",
        f"gem-x/{name}/preprocess/camera.pt",
        "gem-x/rejected/preprocess/camera.pt",
        f"gvhmr/{name}/hmr4d_results.pt",
        f"wham/{name}/wham_output.pkl",
        "wham/late/wham_output.pkl",
    ]
    emdb = read_emdb(out / "emdb" / "P1" / "14_outdoor_climb" / f"{name}_data.pkl")
    assert (emdb.name, emdb.gender, emdb.emdb1, emdb.emdb2) == (name, "female", True, False)
    late = pickle.loads((out / "wham" / "late" / "wham_output.pkl").read_bytes())[0]
    assert late["frame_ids"].tolist() == [n + 5 for n in range(30) if n not in (10, 11, 12)]
    whole = torch.load(out / "gvhmr" / name / "hmr4d_results.pt", weights_only=True)
    assert np.flatnonzero(~whole["valid"].numpy()).tolist() == [10, 11, 12]
    fails_cleanly(
        answer,
        "late: no emdb: clip late: row 0 is image 5",
        "late: no 3dpw: clip late: row 0 is image 5",
        "late: no gvhmr: row 0 is frame 5 of the video",
        "late: no gem-x: row 0 is frame 5 of the video",
        "rejected: no wham: has no valid frame",
        "rejected: no 3dpw: has no valid frame",
        "rejected: no gvhmr: has no valid frame",
    )


def test_a_dry_run_leaves_out_what_the_run_does(manifest, walkers, small_body, tmp_path, capsys):
    """Of a clip that lacks a camera, a pose, an image or its body it said `to write`."""
    one, without = walkers[0], np.arange(30) != 5
    camera = camera_of(one)
    camera = replace(camera, has_camera=without)
    pelvis_m = np.where(without[:, None], one.motion.pelvis_m, np.nan)
    holed = replace(one, id="holed", valid=without, camera=camera)
    holed = replace(holed, motion=replace(one.motion, pelvis_m=pelvis_m))
    classes = {"camera_motions": ["circular"]}
    other = write_clips(tmp_path / "other", small_body, [holed], **classes)
    for source in (manifest, other):
        planned, done = (
            [(each.unit.format, each.unit.name, each.left_out) for each in made]
            for made in (
                export(source, [*FORMATS], tmp_path / "out", dry_run=True),
                export(source, [*FORMATS], tmp_path / "out"),
            )
        )
        said = capsys.readouterr().err.splitlines()
        assert planned == done and any(left_out for *_, left_out in done)
        assert any(not left_out for *_, left_out in done)
        shutil.rmtree(tmp_path / "out")
        remarks = [line for line in said if not line.startswith("exporting")]
        assert remarks[: len(remarks) // 2] == remarks[len(remarks) // 2 :]


def test_3dpw_of_another_body_is_said(walkers, small_body, tmp_path, works):
    """Twins come back by it, but other loaders put the shape and the path on SMPL's body."""
    woman = replace(walkers[0], motion=replace(walkers[0].motion, gender="female"))
    manifest = write_clips(tmp_path / "in", small_body, [woman], camera_motions=["circular"])
    save_body(tmp_path / "in" / "body" / "body.npz", small_body)
    answer = works("export", manifest, "--to", "3dpw", "--out", tmp_path / "out")
    said = " ".join(answer.stderr.split())
    assert "of the body small, and all but gmrdata take them for SMPL's" in said


def test_of_a_sequence_s_folder_no_frame_of_a_rejected_person_is_valid(small_body, tmp_path, works):
    folder = tmp_path / "walk"
    solved_video(folder, small_body)
    clip = load_clip(folder / "pseudo_gt/person_0.npz")
    motion = replace(clip.motion, gender="female", fps_hz=30.0)
    clip = replace(clip, motion=motion, image_numbers=np.arange(motion.n_frames))
    for number in range(2):
        path = folder / f"pseudo_gt/person_{number}.npz"
        save_clip(path, replace(clip, id=f"p{number}"), small_body.rest_pelvis_m(motion.shape))
    record = load_record(folder / "pseudo_gt")
    rejected = replace(record.people[0], accepted=False, reasons=("it floats",))
    both = {name: 2 * getattr(record, name) for name in ("distance_sigmas", "picture_fits")}
    both["people"] = (*record.people, rejected)
    record.model_copy(update=both).write(folder / "pseudo_gt/quality.json")
    answer = works("export", folder, "--to", "3dpw", "--out", tmp_path / "out")
    assert "clip p1 has no valid frame: campose_valid is 0 in all frames" in answer.stderr
    (path,) = (tmp_path / "out").rglob("*.pkl")
    valid = [person.campose_valid for person in read_sequence_file(path).people]
    assert valid[0].sum() == clip.valid.sum() > 0 and not valid[1].any()
    # Other formats have no place for a verdict, and wrote both without a word.
    bodies = ("--to", "bvh", "tum", "--of", "person", "--out", tmp_path / "out")
    said = " ".join(works("export", folder, *bodies).stderr.split())
    for name in ("bvh", "tum"):
        assert said.count(f"p1 is rejected, which {name} does not show: it floats") == 1
    assert "p0 is rejected" not in said
    cameras = works("export", folder, "--to", "tum", "--out", tmp_path / "cameras")
    assert "rejected" not in cameras.stderr


def test_two_clips_that_would_be_one_file_are_refused(walkers, small_body, tmp_path, gmrdata):
    body = replace(small_body, name="smpl-neutral")
    motion = replace(walkers[0].motion, body=body.name, fps_hz=30.0)
    clips = [replace(walkers[0], id=name, motion=motion) for name in ("P0_walk", "walk")]
    save_body(tmp_path / "in" / "body" / "body.npz", body)
    manifest = write_clips(tmp_path / "in", body, clips, camera_motions=["circular"] * 2)
    for layout, said in (
        ("emdb", "P0_walk and walk would be this. Write one"),
        ("3dpw", "the body is neutral, and 3DPW has female and male"),
    ):
        out = tmp_path / layout
        fails_cleanly(gmrdata("export", manifest, "--to", layout, "--out", out), said)
    assert not (tmp_path / "emdb").exists()


def test_two_clips_that_would_be_one_file_on_some_disks_are_refused(
    walkers, small_body, tmp_path, gmrdata
):
    clips = [replace(walkers[0], id=name) for name in ("walk", "Walk")]
    save_body(tmp_path / "in" / "body" / "body.npz", small_body)
    manifest = write_clips(tmp_path / "in", small_body, clips)
    answer = gmrdata("export", manifest, "--to", "bvh", "--out", tmp_path / "out")
    fails_cleanly(answer, "Walk and walk would be this. Write one")
    assert not (tmp_path / "out").exists()


def test_a_network(run_dir, walk, tmp_path, gmrdata, works):
    out = tmp_path / "out"
    path, command = out / "onnx" / "run.onnx", ("export", run_dir, "--to", "onnx", "--out", out)
    works(*command, "--dry-run")
    assert not out.exists()
    works(*command)
    local_rotmats = walk(10.0, 12).local_rotmats
    session = onnxruntime.InferenceSession(path)
    found = session.run(None, {"local_rotmats": local_rotmats[None].astype(np.float32)})
    for one, wanted in zip(found, predict_deltas(load_gmr(run_dir), local_rotmats), strict=True):
        assert np.abs(one[0] - wanted).max() < 1e-5
    fails_cleanly(gmrdata(*command), "already there. Pass --redo")
    works(*command, "--redo")


def test_the_packages_own_network_goes_by_its_word(tmp_path, works, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = works("export", "bundled", "--to", "onnx", "--out", "out", "--dry-run").stdout
    assert "out/onnx/bundled.onnx" in said and "to write" in said


def test_what_is_no_network_is_refused(run_dir, manifest, tmp_path, gmrdata):
    def refused(said: str, source: Path, *more: str) -> None:
        command = ("export", source, "--out", tmp_path / "out", "--to", "onnx", *more)
        fails_cleanly(gmrdata(*command), said)
        assert not (tmp_path / "out").exists()

    refused("Export it alone", run_dir, "tum")
    refused("no trained model there", manifest.parent)
    refused("no best weights", run_dir, "--which", "best")
    (state_path,) = run_dir.glob("checkpoints/step_*/state.json")
    state_path.write_text(json.dumps({"format": "gmrdata-joint/2", "step": 1, "body": "anny"}))
    refused("gmrdata-joint/2", run_dir)


def test_one_without_a_valid_frame_is_left_out_and_named(
    walkers, small_body, tmp_path, gmrdata, works
):
    folder = tmp_path / "walk"
    save_body(folder / "body" / "body.npz", small_body)
    for number, walker in enumerate(walkers):
        kept = replace(walker, valid=walker.valid & (number > 0))
        path = folder / "pseudo_gt" / f"person_{number}.npz"
        save_clip(path, kept, small_body.rest_pelvis_m(walker.motion.shape))
    camera = camera_of(walkers[0])
    (folder / "frames").mkdir()
    for number in walkers[0].image_numbers:
        frame = np.zeros((camera.height_px, camera.width_px), np.uint8)
        cv2.imwrite(str(folder / "frames" / f"{number:05d}.png"), frame)
    said = works("export", folder, "--to", "usd", "rrd", "mp4", "--out", tmp_path)
    assert said.stderr.count("clip walk.p0 has no valid frame: left out") == 3
    stage = Usd.Stage.Open(str(tmp_path / "usd/walk.usdc"))
    names = [prim.GetName() for prim in stage.GetDefaultPrim().GetChildren()]
    assert names == ["walk_p1", "camera"]
    alone = ("--clips", "walk.p0", "--out", tmp_path / "alone")
    said = gmrdata("export", folder, "--to", "usd", "--dry-run", *alone)
    assert "left out: has no valid frame" in said.stdout


def test_bodies_lie_over_the_frames_as_the_lens_shows_them(small_body, tmp_path, gmrdata, works):
    """A pinhole would show them beside the people, away from the middle."""
    folder, shown = tmp_path / "walk", []
    solved_video(folder, small_body)
    quality = load_quality(folder / "sfm")
    for name, lens in (("pinhole", None), ("lens", Distortion(-0.9, 0.0, 0.1))):
        quality.model_copy(update={"lens": lens}).write(folder / "sfm" / QUALITY_FILE)
        said = works("export", folder, "--to", "mp4", "--out", tmp_path / name)
        (video,) = (tmp_path / name / "mp4").iterdir()
        with av.open(str(video)) as container:
            frame = next(container.decode(video=0)).to_ndarray(format="rgb24").astype(int)
        shown.append(frame[..., 2] - frame[..., 0] > 40)  # the body is blue
    high, low = (np.flatnonzero(body.any(axis=1))[[0, -1]] for body in shown)
    assert np.ptp(low) < np.ptp(high) - 5
    said = gmrdata("export", folder, "--to", "glb", "colmap", "--out", tmp_path / "pinhole_alone")
    remarks = " ".join(said.stderr.split())
    assert "glb holds a camera without it" in remarks and "colmap holds" not in remarks


TRUE_FROM_WORLD = np.array([[0.0, -1, 0, 5], [1, 0, 0, -2], [0, 0, 1, 0.3], [0, 0, 0, 1]])


@pytest.fixture
def clip(walk, small_body) -> Clip:
    """Someone without a pose in two frames, and a camera without one of them."""
    take = make_take(walk, small_body)
    person = take.people[1]
    return Clip("walk", person.motion, person.shown, np.arange(N_FRAMES), take.camera)


@pytest.fixture
def folder(clip, small_body, tmp_path) -> Path:
    """The clip with frames, masks and an extra as a rendered one has them; its truth beside it.

    The truth is of another world, begins two frames later and has no gap.
    """
    folder, rest_pelvis_m = tmp_path / "walk", small_body.rest_pelvis_m(clip.motion.shape)
    save_clip(folder / "clip.npz", clip, rest_pelvis_m)
    save_body(tmp_path / "body" / "body.npz", small_body)
    for name, value in (("frames", 40), ("masks", 255)):
        write_pictures(folder / name, [np.full(SIZE_PX[::-1], value, np.uint8)] * N_FRAMES)
    turned = TRUE_FROM_WORLD[:3, :3] @ clip.motion.root_rotmats
    moved_m = transforms.apply(TRUE_FROM_WORLD, clip.motion.pelvis_m)
    motion = replace(clip.motion, root_rotmats=turned, pelvis_m=moved_m).take(slice(2, None))
    valid, numbers = clip.valid[2:], clip.image_numbers[2:]
    truth = Clip("walk", motion, valid, numbers, None)
    save_clip(tmp_path / "truth.npz", truth, rest_pelvis_m)
    passer_by = replace(clip, id="walk_passer_by_1")
    save_clip(folder / "extras" / "passer_by_1.npz", passer_by, rest_pelvis_m)
    return folder


def test_one_clip_in_all_of_these_formats(folder, clip, small_body, works):
    out, formats = folder.parent / "out", ("amass", "bvh", "glb", "usd", "rrd", "mp4")
    truth = folder.parent / "truth.npz"
    works("export", folder, "--to", *formats, "--truth", truth, "--out", out)
    runs = ("walk_00000-00003", "walk_00006-00011")
    written = sorted(str(path.relative_to(out)) for path in out.rglob("*") if path.is_file())
    folders = [f"{to}/walk/{run}.{to}" for to in ("amass", "bvh") for run in runs]
    files = [f"{to}/walk.{to}" for to in ("glb", "mp4", "rrd")]
    assert written == sorted(
        [name.replace(".amass", ".npz") for name in folders] + files + ["usd/walk.usdc"]
    )
    with np.load(out / "amass/walk/walk_00006-00011.npz") as arrays:
        assert arrays["poses"].shape == (6, 156) and arrays["mocap_framerate"] == 29.97
    assert "Frames: 4" in (out / "bvh/walk/walk_00000-00003.bvh").read_text()
    scene = trimesh.load(out / "glb/walk.glb", process=False)
    (mesh,) = scene.geometry.values()
    assert mesh.vertices.shape == small_body.template_m.shape
    stage = Usd.Stage.Open(str(out / "usd/walk.usdc"))
    centre_m = UsdGeom.XformCache(7).GetLocalToWorldTransform(stage.GetPrimAtPath("/World/camera"))
    people = [str(prim.GetName()) for prim in stage.GetDefaultPrim().GetChildren()]
    assert people == ["walk", "walk_passer_by_1", "camera"]
    assert clip.camera is not None
    np.testing.assert_allclose(
        centre_m.ExtractTranslation(), clip.camera.centres_world_m[7], atol=1e-9
    )
    with av.open(str(out / "mp4/walk.mp4")) as container:
        assert len(list(container.decode(video=0))) == N_FRAMES


def test_the_truth_stands_where_the_result_does(folder, clip, small_body, works):
    out, truth = folder.parent / "out", folder.parent / "truth.npz"
    works("export", folder, "--to", "rrd", "--truth", truth, "--out", out)
    recorded = Recorded(out / "rrd/walk.rrd")
    placed = recorded.transforms("world/truth")[None]
    np.testing.assert_allclose(placed, transforms.invert(TRUE_FROM_WORLD), atol=1e-6)
    result = recorded.values("world/result/walk/joints", "Points3D:positions")
    true = recorded.values("world/truth/walk/joints", "Points3D:positions")
    assert sorted(result) == np.flatnonzero(clip.valid).tolist()
    assert sorted(true) == [row for row in range(2, N_FRAMES) if row not in HIDDEN]
    joints_m = motion_joints_m(small_body, clip.motion)
    for row, points_m in true.items():
        np.testing.assert_allclose(result[row], joints_m[row], atol=1e-6)
        moved_m = transforms.apply(placed, np.array(points_m))
        np.testing.assert_allclose(moved_m, joints_m[row], atol=1e-5)
    entity = "world/result/camera/image"
    assert len(recorded.values(entity, "EncodedImage:blob")) == N_FRAMES
    assert len(recorded.values(f"{entity}/mask", "SegmentationImage:buffer")) == N_FRAMES
