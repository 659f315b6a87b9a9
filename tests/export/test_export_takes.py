"""`gmrdata export` to scenes, recordings and videos: one clip with a gap, opened by others."""

import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
import trimesh
from pxr import Usd, UsdGeom

from gmrdata.read.body_file import save_body
from gmrdata.values import transforms
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, save_clip
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_joints_m
from tests.write.rerun_files import Recorded
from tests.write.takes import HIDDEN, N_FRAMES, SIZE_PX, make_take

Gmrdata = Callable[..., subprocess.CompletedProcess[str]]
TRUE_FROM_WORLD = np.array([[0.0, -1, 0, 5], [1, 0, 0, -2], [0, 0, 1, 0.3], [0, 0, 0, 1]])


@pytest.fixture
def clip(walk: Callable[..., Motion], small_body: BodyModel) -> Clip:
    """Someone without a pose in two frames, and a camera without one of them."""
    take = make_take(walk, small_body)
    person = take.people[1]
    return Clip("walk", person.motion, person.shown, np.arange(N_FRAMES), take.camera)


@pytest.fixture
def folder(clip: Clip, small_body: BodyModel, tmp_path: Path) -> Path:
    """The clip with frames, masks and an extra as a rendered one has them; its truth beside it.

    The truth is of another world, begins two frames later and has no gap.
    """
    folder, rest_pelvis_m = tmp_path / "walk", small_body.rest_pelvis_m(clip.motion.shape)
    save_clip(folder / "clip.npz", clip, rest_pelvis_m)
    save_body(tmp_path / "body" / "body.npz", small_body)
    for row in range(N_FRAMES):
        for name, value in (("frames", 40), ("masks", 255)):
            (folder / name).mkdir(exist_ok=True)
            pixels = np.full((SIZE_PX[1], SIZE_PX[0]), value, np.uint8)
            cv2.imwrite(str(folder / name / f"{row:05d}.png"), pixels)
    turned = TRUE_FROM_WORLD[:3, :3] @ clip.motion.root_rotmats
    moved_m = transforms.apply(TRUE_FROM_WORLD, clip.motion.pelvis_m)
    motion = replace(clip.motion, root_rotmats=turned, pelvis_m=moved_m).take(slice(2, None))
    valid, numbers = clip.valid[2:], clip.image_numbers[2:]
    truth = Clip("walk", motion, valid, numbers, None)
    save_clip(tmp_path / "truth.npz", truth, rest_pelvis_m)
    passer_by = replace(clip, id="walk_passer_by_1")
    save_clip(folder / "extras" / "passer_by_1.npz", passer_by, rest_pelvis_m)
    return folder


def test_one_clip_in_all_of_these_formats(
    folder: Path, clip: Clip, small_body: BodyModel, gmrdata: Gmrdata
) -> None:
    out, formats = folder.parent / "out", ("amass", "bvh", "glb", "usd", "rrd", "mp4")
    truth = folder.parent / "truth.npz"
    said = gmrdata("export", folder, "--to", *formats, "--truth", truth, "--out", out)
    assert said.returncode == 0, said.stderr
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


def test_the_truth_stands_where_the_result_does(
    folder: Path, clip: Clip, small_body: BodyModel, gmrdata: Gmrdata
) -> None:
    out, truth = folder.parent / "out", folder.parent / "truth.npz"
    said = gmrdata("export", folder, "--to", "rrd", "--truth", truth, "--out", out)
    assert said.returncode == 0, said.stderr
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
