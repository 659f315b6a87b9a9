"""USD scenes, opened again by OpenUSD itself and by Blender's importer."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdSkel
from scipy.spatial.transform import Rotation

from gmrdata.values.body import JOINT_NAMES
from gmrdata.values.camera import project
from gmrdata.values.errors import BadMotionFile, MissingExtra
from gmrdata.values.skinning import global_rotmats, motion_joints_m, motion_vertices_m
from gmrdata.write.usd import PARENTS, write_usd
from tests.write.takes import HIDDEN, N_FRAMES, SIZE_PX


@pytest.fixture(scope="module")
def path(take, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("usd") / "take.usdc"
    write_usd(path, take)
    return path


@pytest.fixture(scope="module")
def stage(path) -> Usd.Stage:
    return Usd.Stage.Open(str(path))


def test_the_stage_says_its_units_and_frames(stage):
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 29.97
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, N_FRAMES - 1)
    assert stage.GetDefaultPrim().GetPath() == "/World"


@pytest.mark.parametrize("number", [0, 1])
def test_joints_turn_and_stand_as_the_motion_does(stage, take, number):
    person = take.people[number]
    cache = UsdSkel.Cache()
    root = UsdSkel.Root.Get(stage, f"/World/{person.name}")
    cache.Populate(root, Usd.PrimDefaultPredicate)
    query = cache.GetSkelQuery(UsdSkel.Skeleton.Get(stage, f"/World/{person.name}/skeleton"))
    assert [str(joint).split("/")[-1] for joint in query.GetJointOrder()] == list(JOINT_NAMES)
    joints_m = motion_joints_m(person.body, person.motion)
    rotmats = global_rotmats(PARENTS, person.motion.rotmats)
    for row in np.flatnonzero(person.shown).tolist():
        time = UsdGeom.XformCache(row)
        found = np.array(query.ComputeJointWorldTransforms(time)).swapaxes(-1, -2)
        np.testing.assert_allclose(found[:, :3, 3], joints_m[row], atol=1e-6)
        turned = Rotation.from_matrix(found[:, :3, :3] @ rotmats[row].swapaxes(-1, -2))
        assert np.rad2deg(turned.magnitude()).max() < 1e-4
    visible = [root.ComputeVisibility(row) == "inherited" for row in range(N_FRAMES)]
    assert visible == person.shown.tolist()


def test_the_skin_follows(stage, take, small_body):
    cache = UsdSkel.Cache()
    cache.Populate(UsdSkel.Root.Get(stage, "/World/person"), Usd.PrimDefaultPredicate)
    skeleton = cache.GetSkelQuery(UsdSkel.Skeleton.Get(stage, "/World/person/skeleton"))
    mesh = UsdGeom.Mesh.Get(stage, "/World/person/body")
    skinning = cache.GetSkinningQuery(mesh.GetPrim())
    vertices_m = motion_vertices_m(small_body, take.people[0].motion)
    for row in (0, 7):
        points = mesh.GetPointsAttr().Get()
        skinning.ComputeSkinnedPoints(skeleton.ComputeSkinningTransforms(row), points, row)
        np.testing.assert_allclose(np.array(points), vertices_m[row], atol=2e-6)
    assert np.array_equal(
        np.reshape(mesh.GetFaceVertexIndicesAttr().Get(), (-1, 3)), small_body.faces
    )


def test_the_camera_sees_what_ours_sees(stage, take):
    """Through the frustum that OpenUSD makes of apertures, offsets and focal length."""
    film, camera = UsdGeom.Camera.Get(stage, "/World/camera"), take.camera
    assert camera is not None
    points_m = take.people[0].motion.pelvis_m[0] + np.random.default_rng(0).normal(0, 0.4, (20, 3))
    half_px = np.array(SIZE_PX) / 2
    for row in range(N_FRAMES):
        assert (film.ComputeVisibility(row) == "inherited") == camera.has_camera[row]
        if not camera.has_camera[row]:
            continue
        frustum = film.GetCamera(row).frustum
        clip = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
        ndc = np.array([clip.Transform(Gf.Vec3d(*point)) for point in points_m.tolist()])[:, :2]
        found_px = half_px + ndc * half_px * [1, -1]
        expected_px = project(camera.world_from_cam[row], points_m, camera.intrinsics_px)
        np.testing.assert_allclose(found_px, expected_px, atol=1e-4)
    samples = UsdGeom.Xformable(film).GetOrderedXformOps()[0].GetTimeSamples()
    assert samples == [row for row in range(N_FRAMES) if row != HIDDEN[-1]]


def test_people_whose_names_usd_makes_one_stay_two(take, tmp_path):
    names = ("a.b", "a-b", "camera")
    people = [take.people[0]._replace(name=name) for name in names]
    write_usd(tmp_path / "three.usda", replace(take, people=tuple(people)))
    stage = Usd.Stage.Open(str(tmp_path / "three.usda"))
    found = {
        str(prim.GetName()): str(prim.GetTypeName())
        for prim in stage.GetDefaultPrim().GetChildren()
    }
    people_found = [name for name, kind in found.items() if kind == "SkelRoot"]
    assert people_found == ["a_b", "a_b_", "camera_"] and found["camera"] == "Camera"


def test_the_same_take_gives_the_same_bytes(take, path, tmp_path):
    write_usd(tmp_path / "again.usdc", take)
    assert (tmp_path / "again.usdc").read_bytes() == path.read_bytes()
    assert [file.name for file in tmp_path.iterdir()] == ["again.usdc"]


def test_what_cannot_be_written_is_said(take, tmp_path, monkeypatch):
    first, second = take.people
    in_camera = first._replace(motion=replace(first.motion, frame="camera"))
    broken = second._replace(shown=np.ones(N_FRAMES, dtype=bool))
    nobody = second._replace(shown=np.zeros(N_FRAMES, dtype=bool))
    short = second._replace(motion=first.motion.take(slice(5)))
    assert take.camera is not None
    skewed = take.camera.intrinsics_px + np.array([[0, 1, 0], [0, 0, 0], [0, 0, 0]])
    for bad, why in (
        (replace(take, people=()), "nobody"),
        (replace(take, people=(in_camera,)), "camera's frame"),
        (replace(take, people=(first, broken)), "second: NaN"),
        (replace(take, people=(first, nobody)), "no valid frame"),
        (replace(take, people=(first, short)), "5 frames"),
        (replace(take, people=(first, first)), "two people have one name"),
        (replace(take, camera=take.camera.at_rows(slice(3))), "3 cameras"),
        (replace(take, camera=replace(take.camera, intrinsics_px=skewed)), "skewed"),
    ):
        with pytest.raises(BadMotionFile, match=why):
            write_usd(tmp_path / "bad.usdc", bad)
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(MissingExtra, match="pip install usd-core"):
        write_usd(tmp_path / "bad.usdc", take)
    assert list(tmp_path.iterdir()) == []
