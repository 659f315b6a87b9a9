"""What renders start from and what they leave: people, cameras, and folders of frames."""

import json
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from gmrdata.film.blender_environment import blender_command, blender_variables
from gmrdata.film.camera_moves import look_at
from gmrdata.film.programmes import Circular, camera_path
from gmrdata.film.render import RenderConfig, render_clip
from gmrdata.film.render_outputs import read_depth
from gmrdata.read.body_file import save_body
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath, intrinsics_from_fov, project
from gmrdata.values.clip import camera_of, load_clip, save_clip
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import apply, rigid
from tests.motions import bare_clip

FACING_X = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Root rotation of someone upright who faces +x."""


class Job(NamedTuple):
    """What a render starts from."""

    clip_path: Path
    body_path: Path

    def render(self, out_dir: Path, config: RenderConfig, **more: Any) -> Path:
        return render_clip(*self, out_dir, config, **{"on_frame": lambda _: None} | more)


def facing_x(body: BodyModel, pelvis_m: Any, local_rotmats: np.ndarray | None = None) -> Motion:
    """Someone upright with the pelvis at (T, 3), in the T-pose unless told; 10 frames a second."""
    n_frames = len(pelvis_m)
    local = np.tile(np.eye(3), (n_frames, 23, 1, 1)) if local_rotmats is None else local_rotmats
    root, shape = np.tile(FACING_X, (n_frames, 1, 1)), np.zeros(body.n_shape)
    place_m = np.array(pelvis_m, dtype=float)
    return Motion(local, root, place_m, shape, 10.0, body.name, "neutral", "world", "a test")


def camera_at(centres_m: Any, targets_m: Any, size_px: tuple[int, int]) -> CameraPath:
    """A camera at (T, 3) that looks at (T, 3) and sees 60 degrees of width."""
    centres = np.array(centres_m, dtype=float)
    pose = rigid(look_at(centres, np.array(targets_m, dtype=float)), centres)
    intrinsics_px = intrinsics_from_fov(60.0, *size_px)
    return CameraPath(intrinsics_px, *size_px, pose, np.ones(len(centres), bool))


def circling(motion: Motion, size_px: tuple[int, int]) -> CameraPath:
    rng = np.random.default_rng(2)
    return camera_path(Circular(), motion.pelvis_m, motion.fps_hz, *size_px, 60.0, rng)


def save_job(
    folder: Path, body: BodyModel, motion: Motion, camera: CameraPath, valid: Any = None
) -> Job:
    """`clip.npz` and `body.npz` in a folder."""
    clip = replace(bare_clip("clip", motion, valid), camera=camera)
    save_clip(folder / "clip.npz", clip, body.rest_pelvis_m(motion.shape))
    save_body(folder / "body.npz", body)
    return Job(folder / "clip.npz", folder / "body.npz")


def mask_of(folder: Path, row: int) -> np.ndarray:
    """(H, W) bool: pixels of the person."""
    mask = cv2.imread(str(folder / f"masks/{row:05d}.png"), cv2.IMREAD_GRAYSCALE)
    assert mask is not None
    return np.asarray(mask > 0)


def grown(mask: np.ndarray, side_px: int) -> np.ndarray:
    """(H, W) bool: a mask dilated by a square."""
    return cv2.dilate(mask.astype(np.uint8), np.ones((side_px, side_px), np.uint8)) > 0


def shrunk(mask: np.ndarray, side_px: int) -> np.ndarray:
    return ~grown(~mask, side_px)


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    """Intersection over union."""
    return float((one & other).sum() / (one | other).sum())


def n_features(folder: Path, row: int) -> int:
    """SIFT features of a frame outside of the person."""
    frame = cv2.imread(str(folder / f"frames/{row:05d}.jpg"), cv2.IMREAD_GRAYSCALE)
    outside = np.where(grown(mask_of(folder, row), 5), 0, 255).astype(np.uint8)
    return len(cv2.SIFT.create().detect(frame, outside))


def unprojected(folder: Path, row: int) -> np.ndarray:
    """(H, W, 3) world points [m] of a frame's depth; NaN where nothing is seen."""
    camera = camera_of(load_clip(folder / "clip.npz"))
    depth_m = read_depth(folder / f"depth/{row:05d}.png")[..., None]
    x, y = np.meshgrid(*(np.arange(n) + 0.5 for n in (camera.width_px, camera.height_px)))
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(camera.intrinsics_px).T
    cam_m = np.where(np.isfinite(depth_m), depth_m, np.nan) * rays
    return apply(camera.world_from_cam[row], cam_m.reshape(-1, 3)).reshape(rays.shape)


def coverage(camera: CameraPath, body: BodyModel, vertices_m: np.ndarray, row: int) -> np.ndarray:
    """(H, W) share of each pixel that the projected mesh covers, drawn eight times as fine."""
    fine, size_px = 8, (camera.width_px, camera.height_px)
    points_px = project(camera.world_from_cam[row], vertices_m.astype(float), camera.intrinsics_px)
    canvas = np.zeros((size_px[1] * fine, size_px[0] * fine), np.uint8)
    for face in np.round((points_px * fine - 0.5) * 16).astype(np.int32)[body.faces]:
        cv2.fillConvexPoly(canvas, face, (255,), shift=4)
    return np.asarray(cv2.resize(canvas, size_px, interpolation=cv2.INTER_AREA) / 255)


def in_blender(
    what: str | Path, *words: object, check: bool = True, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Run a script, or a module, in Blender's environment."""
    command, variables = blender_command(what, *words), blender_variables()
    return subprocess.run(
        command, env=variables, capture_output=True, text=True, check=check, **options
    )


def ask_blender(script: str, *words: object) -> Any:
    """What one of the scripts beside this file prints behind ANSWER, run in its own process."""
    said = in_blender(Path(__file__).with_name(script), *words)
    return json.loads(said.stdout.split("\nANSWER ")[1])
