"""Real videos: a camera that goes round a dog, and a phone that is held still."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.cameras.files import load_cameras, load_points, load_quality
from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.reconstruct import reconstruct
from gmrdata.people.sources import MasksConfig, OnnxSource, make_masks, masks_seconds
from gmrdata.read.frames import read_frames
from gmrdata.read.video import extract_video
from gmrdata.stage.store import stage_seconds
from gmrdata.values.camera import Lens

DOG_FOCAL_PX = 929.0
"""COLMAP's own calibration of the video at its full size."""
PHONE_FOCAL_PX = 900.0
"""The phone's is not known; a usual one serves, since a camera that stays needs no better."""
BACKGROUND_M = 8.0
"""About how far the middle of its background is: the people, a third of the width high, stand 5 m
away on the nearer part of it [m]."""


def measure_videos(video_dir: Path, model: Path, out_dir: Path) -> list[dict[str, Any]]:
    """Cameras of both real videos; a row for each.

    Args:
        video_dir: Folder with `dog.mp4` and `static_people/`.
        model: The ONNX detector.
        out_dir: Folder to make.
    """
    dog = extract_video(video_dir / "dog.mp4", out_dir / "dog" / "frames")
    phone = _numbered(video_dir / "static_people", out_dir / "static_people" / "frames")
    return [
        _row("dog", dog, DOG_FOCAL_PX, None, model, out_dir / "dog"),
        _row(
            "static_people", phone, PHONE_FOCAL_PX, BACKGROUND_M, model, out_dir / "static_people"
        ),
    ]


def _numbered(folder: Path, out_dir: Path) -> Path:
    """The frames under consecutive numbers: the folder holds every second one."""
    out_dir.mkdir(parents=True)
    for number, path in enumerate(sorted(folder.glob("*.jpg"))):
        shutil.copy(path, out_dir / f"{number:05d}.jpg")
    return out_dir


def _row(
    id: str,
    frames: Path,
    focal_px: float,
    background_m: float | None,
    model: Path,
    out_dir: Path,
) -> dict[str, Any]:
    """Cameras of one video; in metres only where the background's distance is known."""
    config = MasksConfig(sources=(OnnxSource(model=model),))
    taken = read_frames(frames)
    masks_dir = make_masks(taken, out_dir / "masks", config)
    lens = Lens.centred(focal_px, taken.size_px)
    sfm_dir = reconstruct(taken, masks_dir, lens, out_dir / "sfm", SfmConfig())
    quality = load_quality(sfm_dir)
    return {
        "id": id,
        "frames": quality.frames,
        "frames_with_camera": quality.frames_with_camera,
        "geometry": quality.geometry,
        "mean_reprojection_px": quality.mean_reprojection_px,
        "camera_extent_m": None if background_m is None else _extent_m(sfm_dir, background_m),
        "seconds": round(masks_seconds(masks_dir) + stage_seconds(sfm_dir), 2),
    }


def _extent_m(sfm_dir: Path, background_m: float) -> float:
    """Extent of the camera path where the background's middle is so far away [m]; 0 for a camera
    that only turns."""
    path = load_cameras(sfm_dir).path
    centres = path.centres_world_m[path.has_camera]
    points = load_points(sfm_dir)
    if not len(points):
        return 0.0
    distance = float(np.median(np.linalg.norm(points - centres.mean(axis=0), axis=1)))
    extent = float(np.linalg.norm(np.ptp(centres, axis=0)))
    return float(f"{background_m * extent / distance:.4g}")
