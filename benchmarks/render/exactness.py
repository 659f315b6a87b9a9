"""Stored cameras against Blender's own projection, and masks against the projected mesh."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from render.clips import PROGRAMMES, walk_clip
from render.scale import Scale
from render.timing import run_in_blender

from gmrdata.film.render import RenderConfig, RenderJob
from gmrdata.film.render_set import render_clips
from gmrdata.film.scene import SceneConfig
from gmrdata.read.body_file import read_body
from gmrdata.stage.run import Run
from gmrdata.stage.workers import worker_pool
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import project
from gmrdata.values.clip import Clip, camera_of, load_clip
from gmrdata.values.skinning import motion_joints_m, motion_vertices_m

HERE = Path(__file__).parent
FINE = 64
"""Rows and columns that a pixel is divided into when the projected mesh is drawn.  OpenCV
draws every sample that an edge touches, so the mesh is half a sample too large all round."""
SHIFT_BITS = 4
EVERY = 10
"""The frames are so many apart in takes of 5 s, filmed from as far away as such takes are."""


def measure_exactness(root: Path, body_path: Path, scale: Scale) -> list[dict[str, Any]]:
    """Each programme at each size: largest distance [px] and smallest IoU over the frames."""
    clips, sizes = {}, {}
    (root / "clips").mkdir(parents=True)
    for size_px in scale.exact_sizes_px:
        for name in scale.exact_programmes:
            clip_id = f"{name}_{size_px[0]}"
            path = root / "clips" / f"{clip_id}.npz"
            clips[clip_id] = walk_clip(
                path, body_path, PROGRAMMES[name], scale.exact_frames, size_px, every=EVERY
            )
            sizes[clip_id] = (name, size_px)
    config = RenderConfig(scene=SceneConfig(kind="room", seed=1), blend=True)
    jobs = {
        id: RenderJob(
            clip_path=path, body_path=body_path, out_dir=root / "render" / id, config=config
        )
        for id, path in clips.items()
    }
    with worker_pool(Run(workers=2)) as pool:
        render_clips(jobs, pool, root / "failed")
    body, rows = read_body(body_path), []
    for clip_id, (name, size_px) in sizes.items():
        folder = root / "render" / clip_id
        clip = load_clip(folder / "clip.npz")
        rows.append(
            {
                "programme": name,
                "size_px": list(size_px),
                "projection_px_max": _largest_distance_px(clip, body, folder, root),
                "mask_iou_min": min(mask_ious(clip, body, folder / "masks")),
            }
        )
    return rows


def _largest_distance_px(clip: Clip, body: BodyModel, folder: Path, root: Path) -> float:
    """24 joints through the stored camera against Blender's projection in the saved scene."""
    joints_m, camera = motion_joints_m(body, clip.motion), camera_of(clip)
    np.save(root / "points.npy", joints_m)
    blend, points, answer = folder / "scene/scene.blend", root / "points.npy", root / "answer.npy"
    run_in_blender(HERE / "views.py", blend, points, answer)
    ours_px = project(camera.world_from_cam, joints_m, camera.intrinsics_px)
    return float(np.linalg.norm(np.load(answer) - ours_px, axis=-1).max())


def mask_ious(clip: Clip, body: BodyModel, masks_dir: Path) -> list[float]:
    """IoU of each stored mask with the posed mesh, drawn through the stored camera."""
    camera, ious = camera_of(clip), []
    size_px = (camera.width_px, camera.height_px)
    for row, vertices_m in enumerate(motion_vertices_m(body, clip.motion)):
        points_px = project(
            camera.world_from_cam[row], vertices_m.astype(np.float64), camera.intrinsics_px
        )
        expected = coverage(points_px, body.faces, size_px) >= 0.5
        path = masks_dir / f"{row:05d}.png"
        mask = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)) > 0
        ious.append(float((mask & expected).sum() / (mask | expected).sum()))
    return ious


def coverage(points_px: np.ndarray, faces: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    """(H, W) share of each pixel that a projected mesh covers, from FINE x FINE samples.

    Args:
        points_px: (V, 2) vertices in the image, all in front of the camera [px].
        faces: (F, 3) vertex indices.
        size_px: (width, height).
    """
    # Only the part of the image that the mesh may touch is drawn so finely.
    low = np.clip(np.floor(points_px.min(axis=0)).astype(int) - 1, 0, size_px)
    high = np.clip(np.ceil(points_px.max(axis=0)).astype(int) + 1, low, size_px)
    width, height = high - low
    fine = np.zeros((height * FINE, width * FINE), np.uint8)
    # cv2's (0, 0) is the centre of the first sample, ours its outer corner.
    corners = np.rint(((points_px - low) * FINE - 0.5) * (1 << SHIFT_BITS)).astype(np.int32)
    for triangle in corners[faces]:
        cv2.fillConvexPoly(fine, triangle, [1], lineType=cv2.LINE_8, shift=SHIFT_BITS)
    shares = np.zeros(size_px[::-1])
    counted = fine.reshape(height, FINE, width, FINE).mean(axis=(1, 3))
    shares[low[1] : high[1], low[0] : high[0]] = counted
    return shares
