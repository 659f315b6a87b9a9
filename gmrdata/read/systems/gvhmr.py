"""GVHMR's `hmr4d_results.pt`: one person, with a row for every frame (zju3dv/GVHMR; torch.save).

By tools/demo/demo.py and hmr4d/model/gvhmr/gvhmr_pl_demo.py, a dict of

`smpl_params_global`   SMPL-X in the world, y up: `body_pose` (T, 63), axis-angle of its 21 body
                       joints, `global_orient` (T, 3) [rad], `transl` (T, 3) [m], `betas` (T, 10)
`smpl_params_incam`    the same before the camera; the same `body_pose`
`K_fullimg` (T, 3, 3)  that camera [px]: in its demo the picture's diagonal round its middle

The body joints are SMPL's first; its two hand joints stay straight.  The betas are SMPL-X's, which
mean something else on SMPL, and are not used.  People save the dict again as a numpy pickle, for
Blender (its issue 10): without K_fullimg there is no camera.

gmrdata's own export (`gmrdata.write.systems`) has `valid` (T,) bool besides, the rows that
may be used; it is of the video's own camera.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gmrdata.read.systems.entries import (
    N_SMPLX_BODY,
    SMPLX_REST_PELVIS_M,
    Z_UP_FROM_Y_UP,
    Entry,
    implied_camera,
    rotmats_of,
    smplx_local,
    turned,
)
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.people import (
    EstimatedPeople,
    EstimatedPerson,
    InCamera,
    InWorld,
    Pinhole,
    System,
)

NAME = "person_0"
MOTION_KEYS = ("global_orient", "transl")


@dataclass(frozen=True)
class Layout:
    """How a system of GVHMR's kin writes its one person."""

    system: System
    world: str  # key of the person in the world, y up
    camera: str  # and before the camera
    n_joints: int  # of `body_pose`
    local_from_pose: Callable[[np.ndarray], np.ndarray]  # (T, 3 n_joints) to SMPL's (T, 23, 3, 3)
    rest_pelvis_m: np.ndarray  # (3,) J0: pelvis = transl + J0
    file: str  # as its program names it


GVHMR = Layout(
    "gvhmr", "smpl_params_global", "smpl_params_incam", N_SMPLX_BODY, smplx_local,
    SMPLX_REST_PELVIS_M, "GVHMR's hmr4d_results.pt",
)  # fmt: skip


def read_gvhmr(content: Mapping[Any, Any], path: Path, layout: Layout = GVHMR) -> EstimatedPeople:
    whole = Entry(content, NAME, path)
    world, seen = (Entry(content.get(key), NAME, path) for key in (layout.world, layout.camera))
    posed = next((one for one in (world, seen) if one.has("body_pose")), None)
    if posed is None:
        has = ", ".join(map(str, content))[:200]
        what = f"has no body_pose in {layout.world} or {layout.camera} (it has {has})"
        raise BadMotionFile(f"{path}: {what}. Give {layout.file}")
    poses = posed.array("body_pose", None, 3 * layout.n_joints)
    rows, in_camera, in_world = _rows(whole, len(poses)), None, None
    camera_lacks = whole.lacking(layout.camera, "K_fullimg") or seen.lacking(*MOTION_KEYS)
    if seen.has("body_pose"):
        seen.array("body_pose", *poses.shape)
    if not camera_lacks:
        in_camera = InCamera(*_placed(seen, len(poses), rows), *_camera(whole, len(poses), rows))
    world_lacks = whole.lacking(layout.world) or world.lacking(*MOTION_KEYS)
    if not world_lacks:
        in_world = _in_world(world, seen, len(poses), rows)
    person = EstimatedPerson(
        name=NAME,
        frame_numbers=rows,
        local_rotmats=layout.local_from_pose(poses[rows]),
        in_camera=in_camera,
        in_world=in_world,
        rest_pelvis_m=layout.rest_pelvis_m,
        lacks={"camera": camera_lacks, "world": world_lacks},
    )
    return EstimatedPeople(layout.system, (path,), (person,), len(poses))


def _rows(whole: Entry, n_rows: int) -> np.ndarray:
    """(T,) rows that may be used: all, or those of `valid`."""
    valid = whole.values.get("valid")
    if valid is None:
        return np.arange(n_rows)
    if not isinstance(valid, np.ndarray) or valid.dtype != bool or valid.shape != (n_rows,):
        raise whole.fault(f"`valid` is not ({n_rows},) bool")
    if not valid.any():
        raise whole.fault(f"`valid` names no frames of its {n_rows}")
    return np.flatnonzero(valid)


def _placed(params: Entry, n_rows: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Root (T, 3, 3) and transl (T, 3) of some rows; the others may hold NaN."""
    orient, transl_m = (params.array(key, n_rows, 3, rows=rows) for key in MOTION_KEYS)
    return rotmats_of(orient)[:, 0], transl_m


def _camera(
    whole: Entry, n_rows: int, rows: np.ndarray
) -> tuple[Pinhole | Literal["own"], tuple[float, float] | None]:
    """The camera by row, and the size of the pictures by its principal point."""
    matrices_px = whole.array("K_fullimg", n_rows, 3, 3)[rows]
    whole.positive("the focal length in K_fullimg", matrices_px[:, 0, 0])
    if whole.has("valid"):  # of a lens that may bend pictures, which K_fullimg does not say
        return "own", None
    width_px, height_px = 2.0 * np.median(matrices_px[:, :2, 2], axis=0)
    pinhole = Pinhole(matrices_px[:, 0, 0], matrices_px[:, :2, 2])
    return pinhole, (float(width_px), float(height_px))


def _in_world(world: Entry, seen: Entry, n_rows: int, rows: np.ndarray) -> InWorld:
    roots, transl_m = _placed(world, n_rows, rows)
    z_up, camera = turned(Z_UP_FROM_Y_UP, len(rows)), None
    if seen.has("global_orient"):
        cam_rotmats = rotmats_of(seen.array("global_orient", n_rows, 3, rows=rows))[:, 0]
        camera = implied_camera(z_up, roots, cam_rotmats)
    return InWorld(roots, transl_m, z_up, camera)
