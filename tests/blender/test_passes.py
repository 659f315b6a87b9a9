"""A real render with everything that a recipe can add, against geometry worked out by itself."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.film.render import RenderConfig, frame_files
from gmrdata.film.render_outputs import read_flow, read_normals
from gmrdata.film.scene import SceneConfig
from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.camera import project, project_cam
from gmrdata.values.clip import camera_of, load_clip, load_joints
from gmrdata.values.errors import RenderFailed
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_joints_m, motion_vertices_m
from gmrdata.values.transforms import apply, invert
from tests.blender.jobs import (
    Job,
    circling,
    facing_x,
    grown,
    mask_of,
    save_job,
    shrunk,
    unprojected,
)
from tests.folders import bytes_of

N_FRAMES, WIDTH_PX, HEIGHT_PX = 3, 320, 180
PLAIN = RenderConfig(samples=1, scene=SceneConfig(seed=5))
FULL = PLAIN.model_copy(
    update={"joints": True, "depth": True, "normals": True, "flow": True, "video": True}
)


def striding(body: BodyModel) -> Motion:
    """Three frames of someone who swings a leg and goes along x."""
    local = np.tile(np.eye(3), (N_FRAMES, 23, 1, 1))
    swings = Rotation.from_euler("x", 0.3 * np.arange(N_FRAMES)[:, None])
    local[:, JOINT["left_hip"] - 1] = swings.as_matrix()
    return facing_x(body, [[0.1 * row + 3, -2.0, 0.95] for row in range(N_FRAMES)], local)


@pytest.fixture(scope="module")
def job(small_body, tmp_path_factory) -> Job:
    motion = striding(small_body)
    camera = circling(motion, (WIDTH_PX, HEIGHT_PX))
    return save_job(tmp_path_factory.mktemp("job"), small_body, motion, camera)


@pytest.fixture(scope="module")
def full(job, tmp_path_factory) -> Path:
    # Blender would fill in what stands in braces.
    out_dir = tmp_path_factory.mktemp("full") / "{stride} #1 %d"
    return job.render(out_dir, FULL)


class Seen(NamedTuple):
    """What rays through the centres of some pixels of the person meet, without Blender's help."""

    pixels: tuple[np.ndarray, np.ndarray]
    points_m: np.ndarray
    next_m: np.ndarray
    normals: np.ndarray
    sure: np.ndarray
    """False where two boxes share the surface, so that either may be the one that is seen."""


def seen_by_rays(full: Path, body: BodyModel, row: int) -> Seen:
    """Nearest hit of each ray with the posed triangles (Möller and Trumbore 1997)."""
    clip = load_clip(full / "clip.npz")
    camera = camera_of(clip)
    y, x = np.nonzero(shrunk(mask_of(full, row), 5))
    pixels = np.c_[x + 0.5, y + 0.5, np.ones(len(x))]
    world_from_cam = camera.world_from_cam[row]
    rays = pixels @ np.linalg.inv(camera.intrinsics_px).T @ world_from_cam[:3, :3].T
    vertices_m = motion_vertices_m(body, clip.motion).astype(np.float64)
    now, later = vertices_m[row][body.faces], vertices_m[min(row + 1, N_FRAMES - 1)][body.faces]
    side_a, side_b = now[:, 1] - now[:, 0], now[:, 2] - now[:, 0]
    p = np.cross(rays[:, None], side_b)
    det = (p * side_a).sum(axis=-1)
    from_corner = world_from_cam[:3, 3] - now[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (p * from_corner).sum(axis=-1) / det
        q = np.cross(from_corner, side_a)
        v = rays @ q.T / det
        depth_m = (q * side_b).sum(axis=-1) / det
    hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (depth_m > 0)
    depth_m = np.where(hit, depth_m, np.inf)
    face, nearest_m = depth_m.argmin(axis=1), np.sort(depth_m, axis=1)
    there = np.arange(len(face))
    assert hit[there, face].all() and len(face) > 300
    weights = np.c_[1 - u[there, face] - v[there, face], u[there, face], v[there, face]][..., None]
    normals = np.cross(side_a, side_b)[face]
    return Seen(
        (y, x),
        (weights * now[face]).sum(axis=1),
        (weights * later[face]).sum(axis=1),
        normals / np.linalg.norm(normals, axis=1, keepdims=True),
        nearest_m[:, 1] - nearest_m[:, 0] > 1e-3,
    )


def test_passes_come_on_top_and_change_nothing_else(full, job, tmp_path):
    plain = bytes_of(job.render(tmp_path / "plain", PLAIN))
    more = bytes_of(full)
    assert {name: data for name, data in more.items() if name in plain} == plain
    added = {f"{d}/{row:05d}.png" for d in ("depth", "normals") for row in range(N_FRAMES)}
    added |= {f"flow/{row:05d}.png" for row in range(N_FRAMES - 1)}
    assert set(more) - set(plain) == added | {"joints.npz", "video.mp4"}


def test_unprojected_depth_is_the_surface_within_5_mm(full, small_body):
    for row in range(N_FRAMES):
        seen = seen_by_rays(full, small_body, row)
        off_m = np.linalg.norm(unprojected(full, row)[seen.pixels] - seen.points_m, axis=1)
        assert off_m.max() < 0.005, f"row {row}: {off_m.max():.5f} m"


def ground(full: Path, row: int) -> np.ndarray:
    """(H, W) bool: pixels whose depth says that they are on the yard's floor."""
    outside = ~grown(mask_of(full, row), 5)
    return outside & (np.abs(unprojected(full, row)[..., 2]) < 0.005)


def test_the_floor_is_flat_and_the_sky_has_no_depth(full):
    for row in range(N_FRAMES):
        points_m = unprojected(full, row)
        assert ground(full, row).sum() > 5000
        assert np.nanmin(points_m[..., 2]) > -0.02  # nothing is below the floor
        sky = np.isnan(points_m).any(axis=-1)
        assert (read_normals(full / f"normals/{row:05d}.png")[sky] == 0).all()


def test_normals_are_those_of_the_surface_in_camera_axes(full, small_body):
    camera = camera_of(load_clip(full / "clip.npz"))
    for row in range(N_FRAMES):
        normals = read_normals(full / f"normals/{row:05d}.png")
        up_cam = camera.world_from_cam[row, :3, :3].T @ (0.0, 0.0, 1.0)
        on_ground = normals[ground(full, row)]
        assert np.mean(np.abs(on_ground - up_cam).max(axis=1) < 1e-3) > 0.95
        seen = seen_by_rays(full, small_body, row)
        expected = seen.normals @ camera.world_from_cam[row, :3, :3]
        # Shading is smooth over the boxes' edges, so that normals lean by up to 55 degrees.
        assert ((normals[seen.pixels] * expected).sum(axis=1) > 0.55).all()


def test_flow_leads_to_where_the_surface_is_in_the_next_frame(full, small_body):
    camera = camera_of(load_clip(full / "clip.npz"))
    for row in range(N_FRAMES - 1):
        flow_px = read_flow(full / f"flow/{row:05d}.png")
        seen = seen_by_rays(full, small_body, row)
        y, x = seen.pixels
        next_px = project(camera.world_from_cam[row + 1], seen.next_m, camera.intrinsics_px)
        expected_px = next_px - np.c_[x + 0.5, y + 0.5]
        off_px = np.abs(flow_px[seen.pixels] - expected_px)[seen.sure]
        assert len(off_px) > 1000 and off_px.max() < 0.01
        assert np.abs(expected_px).max() > 2
        y, x = np.nonzero(ground(full, row))
        points_m = unprojected(full, row)[y, x]
        next_px = project(camera.world_from_cam[row + 1], points_m, camera.intrinsics_px)
        assert np.abs(flow_px[y, x] - (next_px - np.c_[x + 0.5, y + 0.5])).max() < 0.2


def test_joints_are_the_bodys_own_projected(full, small_body):
    clip, joints = load_clip(full / "clip.npz"), load_joints(full / "joints.npz")
    camera = camera_of(clip)
    world_m = motion_joints_m(small_body, clip.motion)
    np.testing.assert_allclose(joints.world_m, world_m, atol=1e-7)  # body files: float32
    np.testing.assert_allclose(
        joints.camera_m, apply(invert(camera.world_from_cam), world_m), atol=1e-7
    )
    expected_px = project(camera.world_from_cam, world_m, camera.intrinsics_px)
    np.testing.assert_allclose(joints.image_px, expected_px, atol=1e-4)
    np.testing.assert_allclose(
        project_cam(joints.camera_m, camera.intrinsics_px), joints.image_px, atol=1e-9
    )
    assert joints.in_frame.all() and joints.visible.all()  # arms wide, nothing in the way


@pytest.mark.slow
def test_a_frame_with_a_file_missing_is_made_again(full, job, tmp_path):
    """Blender is stopped after its first frame; of that, a pass is lost."""
    out_dir = tmp_path / "stride"
    partial = out_dir.with_name("stride.partial")

    def stop(_: int) -> None:
        raise RenderFailed("stopped by the test")

    with pytest.raises(RenderFailed, match="stopped"):
        job.render(out_dir, FULL, on_frame=stop)
    first = frame_files(partial, FULL, 0, N_FRAMES)
    assert set(first) == {"frames", "masks", "depth", "normals", "flow"}
    first["flow"].unlink()
    job.render(out_dir, FULL, threads=2)
    assert bytes_of(out_dir) == bytes_of(full)
