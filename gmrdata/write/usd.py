"""People and their camera as a USD scene (OpenUSD; its schemas UsdSkel and UsdGeom).

Blender, Houdini, Maya, Unreal and Omniverse open it.  z is up, a unit is a metre, and time code i
is row i of the clip:

    /World/<person>            SkelRoot; invisible in frames without a pose
    /World/<person>/skeleton   Skeleton: the 24 joints of SMPL's tree
    /World/<person>/motion     SkelAnimation: a sample for each frame with a pose
    /World/<person>/body       Mesh, bound to the joints with all of its skin weights
    /World/camera              Camera; invisible in frames without one, where it has no sample

Between samples, and so across gaps, a program moves things straight from one to the next.
The bulges that SMPL adds to bent joints are not in it.  Needs usd-core: the extra `export`.
"""

from errno import EIO
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.values.body import JOINT_NAMES, PARENTS, WORLD_FROM_REST, BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.errors import MissingExtra
from gmrdata.values.files import atomic_path
from gmrdata.values.transforms import rigid
from gmrdata.write.take import Performer, Take, check_take, quaternions_xyzw

SKIN_COLOUR = (0.55, 0.67, 0.83)
SENSOR_WIDTH_M = 0.036
APERTURES_PER_M = 10.0  # USD's apertures and focal lengths are in tenths of the scene's unit
CLIPPING_M = (0.01, 10000.0)
OPENCV_FROM_USD = np.diag([1.0, -1.0, -1.0, 1.0])
"""A camera of USD looks along -z and has y up."""


def write_usd(path: Path, take: Take) -> None:
    """Write a take to a `.usdc` (binary), `.usda` (text) or `.usd` file."""
    check_take(take)
    try:
        from pxr import Tf, Usd, UsdGeom, UsdSkel
    except ImportError as error:
        raise MissingExtra(f"USD files need usd-core ({error}): pip install usd-core") from None

    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(take.fps_hz)
    stage.SetFramesPerSecond(take.fps_hz)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(take.n_frames - 1)
    stage.GetRootLayer().documentation = f"gmrdata: {take.people[0].motion.source}"
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    used = {"camera"}
    for person in take.people:
        name = Tf.MakeValidIdentifier(person.name)  # "a.b" and "a-b" are both a_b
        while name in used:
            name += "_"
        used.add(name)
        _hide(UsdSkel.Root.Define(stage, f"/World/{name}"), person.shown)
        _write_skeleton(stage, f"/World/{name}", person)
        _write_animation(stage, f"/World/{name}", person)
        _write_body(stage, f"/World/{name}", person.body, person.motion.shape)
    if take.camera is not None:
        _write_camera(stage, "/World/camera", take.camera)
    with atomic_path(path) as temporary:
        try:
            stage.GetRootLayer().Export(str(temporary))
        except Tf.ErrorException:
            raise OSError(EIO, "can't be written; is the disk full?", str(path)) from None


def _hide(prim: Any, shown: np.ndarray) -> None:
    """Make a prim invisible where `shown` (T,) is False; a value holds until the next one."""
    if shown.all():
        return
    visibility = prim.CreateVisibilityAttr()
    changes = np.flatnonzero(np.diff(shown, prepend=not shown[0]))
    for row in changes.tolist():
        visibility.Set("inherited" if shown[row] else "invisible", row)


def _joint_paths() -> list[str]:
    """ "pelvis", "pelvis/left_hip", ...: a joint's place in the tree, in SMPL's order."""
    paths: list[str] = []
    for name, parent in zip(JOINT_NAMES, PARENTS, strict=True):
        paths.append(name if parent < 0 else f"{paths[parent]}/{name}")
    return paths


def _write_skeleton(stage: Any, path: str, person: Performer) -> None:
    """The rest pose stands upright: W turns the body's rest axes to the z-up world."""
    from pxr import UsdSkel, Vt

    rest_joints_m = person.body.rest_joints_m(person.motion.shape)
    bind = rigid(WORLD_FROM_REST, rest_joints_m @ WORLD_FROM_REST.T)
    local = rigid(np.eye(3), rest_joints_m - rest_joints_m[[0, *PARENTS[1:]]])
    local[0] = bind[0]
    skeleton = UsdSkel.Skeleton.Define(stage, f"{path}/skeleton")
    skeleton.CreateJointsAttr(_joint_paths())
    skeleton.CreateBindTransformsAttr(Vt.Matrix4dArray.FromNumpy(_rows_of(bind)))
    skeleton.CreateRestTransformsAttr(Vt.Matrix4dArray.FromNumpy(_rows_of(local)))
    binding = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    binding.CreateAnimationSourceRel().SetTargets([f"{path}/motion"])


def _write_animation(stage: Any, path: str, person: Performer) -> None:
    from pxr import UsdSkel, Vt

    motion, rows = person.motion, np.flatnonzero(person.shown)
    quaternions = quaternions_xyzw(motion.rotmats[rows]).astype(np.float32)
    rest_joints_m = person.body.rest_joints_m(motion.shape)
    places_m = np.tile(rest_joints_m - rest_joints_m[[0, *PARENTS[1:]]], (len(rows), 1, 1))
    places_m[:, 0] = motion.pelvis_m[rows]
    animation = UsdSkel.Animation.Define(stage, f"{path}/motion")
    animation.CreateJointsAttr(_joint_paths())
    animation.CreateScalesAttr(Vt.Vec3hArray(len(PARENTS), (1.0, 1.0, 1.0)))
    rotations, translations = animation.CreateRotationsAttr(), animation.CreateTranslationsAttr()
    for row, turned, places in zip(
        rows.tolist(), quaternions, places_m.astype(np.float32), strict=True
    ):
        rotations.Set(Vt.QuatfArray.FromNumpy(turned), row)  # x, y, z, w in memory
        translations.Set(Vt.Vec3fArray.FromNumpy(places), row)


def _write_body(stage: Any, path: str, body: BodyModel, shape: np.ndarray) -> None:
    import trimesh
    from pxr import Gf, UsdGeom, UsdSkel, Vt

    vertices_m = body.rest_vertices_m(shape) @ WORLD_FROM_REST.T
    normals = trimesh.Trimesh(vertices_m, body.faces, process=False).vertex_normals
    mesh = UsdGeom.Mesh.Define(stage, f"{path}/body")
    mesh.CreatePointsAttr(_vectors(vertices_m))
    mesh.CreateNormalsAttr(_vectors(normals))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(body.faces), 3))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(body.faces.ravel().astype(np.int32)))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr(_vectors(np.stack([vertices_m.min(axis=0), vertices_m.max(axis=0)])))
    mesh.CreateDisplayColorAttr([SKIN_COLOUR])
    per_vertex = int((body.skin_weights > 0).sum(axis=1).max())
    joints = np.argsort(-body.skin_weights, axis=1, kind="stable")[:, :per_vertex]
    weights = np.take_along_axis(body.skin_weights, joints, axis=1)
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    indices = binding.CreateJointIndicesPrimvar(False, per_vertex)
    indices.Set(Vt.IntArray.FromNumpy(joints.ravel().astype(np.int32)))
    shares = binding.CreateJointWeightsPrimvar(False, per_vertex)
    shares.Set(Vt.FloatArray.FromNumpy(weights.ravel().astype(np.float32)))
    binding.CreateGeomBindTransformAttr(Gf.Matrix4d(1.0))
    binding.CreateSkeletonRel().SetTargets([f"{path}/skeleton"])


def _write_camera(stage: Any, path: str, camera: CameraPath) -> None:
    """Apertures and focal length have one scale, and the offsets move the principal point."""
    from pxr import Gf, UsdGeom

    (fx_px, _, cx_px), (_, fy_px, cy_px), _ = camera.intrinsics_px
    width_px, height_px = camera.width_px, camera.height_px
    across = SENSOR_WIDTH_M * APERTURES_PER_M / width_px  # of a pixel
    down = across * fx_px / fy_px
    film = UsdGeom.Camera.Define(stage, path)
    film.CreateFocalLengthAttr(fx_px * across)
    film.CreateHorizontalApertureAttr(width_px * across)
    film.CreateVerticalApertureAttr(height_px * down)
    film.CreateHorizontalApertureOffsetAttr((width_px / 2 - cx_px) * across)
    film.CreateVerticalApertureOffsetAttr((cy_px - height_px / 2) * down)
    film.CreateClippingRangeAttr(Gf.Vec2f(*CLIPPING_M))
    film.GetPrim().SetCustomDataByKey("width_px", width_px)
    film.GetPrim().SetCustomDataByKey("height_px", height_px)
    _hide(film, camera.has_camera)
    transform = film.AddTransformOp()
    for row in np.flatnonzero(camera.has_camera).tolist():
        world_from_usd = camera.world_from_cam[row] @ OPENCV_FROM_USD
        transform.Set(Gf.Matrix4d(*world_from_usd.T.ravel().tolist()), row)


def _rows_of(transforms: np.ndarray) -> np.ndarray:
    """Transforms (N, 4, 4) as USD has them: a point is a row, on their left."""
    return np.ascontiguousarray(transforms.swapaxes(-1, -2))


def _vectors(points: np.ndarray) -> Any:
    from pxr import Vt

    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(points, dtype=np.float32))
