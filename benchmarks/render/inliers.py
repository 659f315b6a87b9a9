"""How many background points of each rendered frame the COLMAP stage is sure of."""

from pathlib import Path
from typing import Any

import numpy as np
from render.clips import MOVING, walk_clip
from render.scale import Scale

from gmrdata.cameras.files import load_cameras, load_quality
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.match.matches import match_frames
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.reconstruct import reconstruct
from gmrdata.film.render import RenderConfig, render_clip
from gmrdata.film.scene import SceneConfig
from gmrdata.read.frames import read_frames
from gmrdata.stage.jobs import Job, run_jobs
from gmrdata.stage.run import Run
from gmrdata.stage.workers import worker_pool
from gmrdata.values.clip import camera_of, load_clip


def measure_inliers(root: Path, body_path: Path, scale: Scale) -> list[dict[str, Any]]:
    """Render every place with every moving programme, and find the cameras again."""
    names = [(place, name) for place in scale.sfm_places for name in scale.sfm_programmes]
    jobs = []
    for place, name in names:
        folder = root / f"{place}_{name}"
        folder.mkdir(parents=True)
        walk_clip(folder / "clip.npz", body_path, MOVING[name], scale.sfm_frames, scale.sfm_size_px)
        arguments = {"folder": folder, "place": place, "body_path": body_path}
        jobs.append(Job(folder.name, _render_and_reconstruct, arguments))
    with worker_pool(Run(workers=2)) as pool:
        results = run_jobs("structure from motion", jobs, pool, root / "failed")
    return [
        {"place": place, "programme": name} | results[f"{place}_{name}"] for place, name in names
    ]


def _render_and_reconstruct(folder: Path, place: str, body_path: Path) -> dict[str, Any]:
    config = RenderConfig(scene=SceneConfig.model_validate({"kind": place, "seed": 1}))
    out_dir = render_clip(
        folder / "clip.npz", body_path, folder / "render", config, on_frame=lambda _: None
    )
    lens = camera_of(load_clip(out_dir / "clip.npz")).lens
    frames = read_frames(out_dir / "frames")
    sfm_dir = reconstruct(frames, out_dir / "masks", lens, folder / "sfm", SfmConfig())
    quality = load_quality(sfm_dir)
    if quality.geometry == "full":
        inliers = np.array(quality.inliers_per_frame)
    else:  # there each pair of frames counts for itself, and a point many times
        inliers = _turning_points(out_dir, sfm_dir, lens.matrix_px, folder / "matches")
    return {
        "geometry": quality.geometry,
        "frames": quality.frames,
        "frames_with_camera": quality.frames_with_camera,
        "inliers_median": float(np.median(inliers)),
        "inliers_least": int(inliers.min()),
        "reprojection_px": quality.median_reprojection_px,
    }


def _turning_points(
    rendered: Path, sfm_dir: Path, intrinsics_px: np.ndarray, work_dir: Path
) -> np.ndarray:
    """(T,) features of each frame with a match that agrees with the solved rotations."""
    taken = read_frames(rendered / "frames")
    images = list(taken.paths)
    work_dir.mkdir()
    frames = Frames(images, rendered / "masks", intrinsics_px, taken.size_px)
    matches = match_frames(frames, work_dir, SfmConfig())
    rotations = load_cameras(sfm_dir).path.world_from_cam[:, :3, :3]
    found: list[set[int]] = [set() for _ in images]
    for pair in matches.pairs:
        second_from_first = rotations[pair.second].T @ rotations[pair.first]
        turn_px = intrinsics_px @ second_from_first @ np.linalg.inv(intrinsics_px)
        first_px = matches.keypoints_px[pair.first][pair.features[:, 0]]
        there = np.c_[first_px, np.ones(len(first_px))] @ turn_px.T
        second_px = matches.keypoints_px[pair.second][pair.features[:, 1]]
        residuals_px = np.linalg.norm(there[:, :2] / there[:, 2:] - second_px, axis=1)
        agree = pair.features[residuals_px < SfmConfig().rotation_only_inlier_px]
        found[pair.first].update(agree[:, 0].tolist())
        found[pair.second].update(agree[:, 1].tolist())
    return np.array([len(features) for features in found])
