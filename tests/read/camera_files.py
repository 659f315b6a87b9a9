"""Files of people before the camera in VIBE's, WHAM's, GVHMR's, TRAM's and PHALP's layouts.

Each is made of a true motion as that system would have seen it at its best: the poses are true, and
the place before the camera is the one whose picture, by the system's own projection, is nearest to
the true picture.  VIBE and PHALP see crops, so their orientation is as along the crop's ray.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_joints_m
from gmrdata.world.compose import motion_in_camera
from tests.joblib_layout import joblib_bytes
from tests.read.system_files import SMPLX_PELVIS_M, rotvecs

N_BETAS = 10


@dataclass(frozen=True, eq=False)
class Seen:
    """One person in the true picture, over T frames."""

    motion: Motion  # in the camera's frame
    offsets_m: np.ndarray  # (T, 24, 3) joints from the pelvis, in the camera's axes
    joints_px: np.ndarray  # (T, 24, 2) as the lens shows them
    frames: np.ndarray  # (T,) numbers of the video's frames
    size_px: tuple[int, int]
    rest_pelvis_m: np.ndarray  # (3,) J0
    intrinsics_px: np.ndarray
    radial_k1: float

    def rays(self, image_px: np.ndarray) -> np.ndarray:
        """x / z and y / z (T, 2) of what is seen at pixels (T, 2)."""
        seen = (image_px - self.intrinsics_px[:2, 2]) / np.diag(self.intrinsics_px)[:2]
        rays = seen
        for _ in range(50):
            rays = seen / (1.0 + self.radial_k1 * (rays**2).sum(axis=-1, keepdims=True))
        return np.asarray(rays)

    @property
    def boxes_px(self) -> np.ndarray:
        """(T, 4) left, top, right, bottom of the person, head and hands included."""
        low, high = self.joints_px.min(axis=1), self.joints_px.max(axis=1)
        margin_px = 0.06 * (high - low).max(axis=1, keepdims=True)
        return np.concatenate([low - margin_px, high + margin_px], axis=1)


def seen_person(
    motion: Motion,
    camera: CameraPath,
    body: BodyModel,
    frames: np.ndarray | None = None,
    radial_k1: float = 0.0,
) -> Seen:
    """A motion in the world, as a lens with one term of distortion shows it."""
    seen = motion_in_camera(motion, camera.world_from_cam)
    joints_m = motion_joints_m(body, seen)
    flat = joints_m[..., :2] / joints_m[..., 2:]
    flat = flat * (1.0 + radial_k1 * (flat**2).sum(axis=-1, keepdims=True))
    focal_px, centre_px = np.diag(camera.intrinsics_px)[:2], camera.intrinsics_px[:2, 2]
    return Seen(
        motion=seen,
        offsets_m=joints_m - seen.pelvis_m[:, None],
        joints_px=flat * focal_px + centre_px,
        frames=np.arange(motion.n_frames) if frames is None else frames,
        size_px=(camera.width_px, camera.height_px),
        rest_pelvis_m=body.rest_pelvis_m(motion.shape),
        intrinsics_px=camera.intrinsics_px,
        radial_k1=radial_k1,
    )


def _best_places(
    offsets_m: np.ndarray, joints_px: np.ndarray, focal_px: np.ndarray, centre_px: np.ndarray
) -> np.ndarray:
    """Pelvis (T, 3) before a camera of (T,) focal lengths and (T, 2) middles, by least squares."""
    places = []
    for offsets, seen, f, centre in zip(offsets_m, joints_px, focal_px, centre_px, strict=True):

        def off(p: np.ndarray, offsets: Any = offsets, seen: Any = seen, f: Any = f) -> np.ndarray:
            depth = np.exp(p[2])
            xy = offsets[:, :2] + p[:2] * depth
            return np.asarray((f * xy / (offsets[:, 2:] + depth) - seen).ravel())

        height_px, height_m = np.ptp(seen[:, 1]), np.ptp(offsets[:, 1])
        depth_m = f * height_m / height_px
        at = (seen - centre).mean(axis=0) / f
        p = least_squares(off, [*at, np.log(depth_m)], args=(offsets, seen - centre, f)).x
        depth = np.exp(p[2])
        places.append([p[0] * depth, p[1] * depth, depth])
    return np.array(places)


def _diagonal(seen: Seen) -> tuple[np.ndarray, np.ndarray]:
    n = len(seen.frames)
    return np.full(n, np.hypot(*seen.size_px)), np.tile(np.divide(seen.size_px, 2), (n, 1))


def _betas(seen: Seen) -> np.ndarray:
    shape = seen.motion.shape[:N_BETAS]
    padded = np.pad(shape, (0, N_BETAS - len(shape)))
    return np.tile(padded, (len(seen.frames), 1)).astype(np.float32)


def _turns_to(rays: np.ndarray) -> np.ndarray:
    """(T, 3, 3) smallest turns from the z axis to rays (T, 2)."""
    directions = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    axes = np.cross([0.0, 0.0, 1.0], directions)
    sines = np.linalg.norm(axes, axis=1, keepdims=True)
    angles = np.arctan2(sines, directions[:, 2:])
    scaled = np.divide(axes * angles, sines, out=np.zeros_like(axes), where=sines > 1e-12)
    return np.asarray(Rotation.from_rotvec(scaled).as_matrix())


def _along_ray(seen: Seen, crop_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Root (T, 3, 3) and offsets (T, 24, 3) in the axes of a camera that looks at the crop."""
    ray_from_cam = np.swapaxes(_turns_to(seen.rays(crop_px)), 1, 2)
    return ray_from_cam @ seen.motion.root_rotmats, seen.offsets_m @ np.swapaxes(ray_from_cam, 1, 2)


def _squares(seen: Seen, rng: np.random.Generator | None) -> tuple[np.ndarray, np.ndarray]:
    """Middle (T, 2) and side (T,) of square boxes round the person, not quite steady."""
    boxes = seen.boxes_px
    sides_px = (boxes[:, 2:] - boxes[:, :2]).max(axis=1)
    middles_px = (boxes[:, 2:] + boxes[:, :2]) / 2
    if rng is not None:
        sides_px = sides_px * rng.normal(1.0, 0.02, len(sides_px))
        middles_px = middles_px + 0.01 * sides_px[:, None] * rng.normal(size=middles_px.shape)
    return middles_px, sides_px


def _crop_camera(
    seen: Seen, crop_px: np.ndarray, sides_px: np.ndarray, own_px: float
) -> tuple[np.ndarray, np.ndarray]:
    """Root (T, 3, 3), and s, tx, ty (T, 3) of a crop seen with 5000 px in a square of `own_px`."""
    roots, offsets_m = _along_ray(seen, crop_px)
    pelvis_m = _best_places(offsets_m, seen.joints_px, 5000.0 * sides_px / own_px, crop_px)
    transl_m = pelvis_m - seen.rest_pelvis_m
    weak = np.column_stack([2 * 5000.0 / (own_px * transl_m[:, 2]), transl_m[:, :2]])
    return roots, weak


def vibe_people(seen: Sequence[Seen], rng: np.random.Generator | None = None) -> dict[Any, Any]:
    found = {}
    for number, one in enumerate(seen):
        crop_px, sides_px = _squares(one, rng)
        # What VIBE calls the box is a tenth smaller than its crop.
        roots, weak = _crop_camera(one, crop_px, 1.1 * sides_px, 224.0)
        half_px = np.divide(one.size_px, 2)
        scales = weak[:, :1] * sides_px[:, None] / np.array(one.size_px)
        shifts = (crop_px - half_px) / half_px / scales + weak[:, 1:]
        found[number + 1] = {
            "pred_cam": weak.astype(np.float32),
            "orig_cam": np.concatenate([scales, shifts], axis=1),
            "verts": np.zeros((len(weak), 5, 3), np.float32),
            "pose": _pose(roots, one.motion),
            "betas": _betas(one),
            "joints2d": None,
            "bboxes": np.column_stack([crop_px, sides_px, sides_px]),
            "frame_ids": one.frames,
        }
    return found


def _pose(roots: np.ndarray, motion: Motion) -> np.ndarray:
    pose = np.concatenate([rotvecs(roots), rotvecs(motion.local_rotmats)], axis=1)
    return np.asarray(pose.astype(np.float32))


def wham_people(seen: Sequence[Seen]) -> dict[Any, Any]:
    found = {}
    for number, one in enumerate(seen):
        pelvis_m = _best_places(one.offsets_m, one.joints_px, *_diagonal(one))
        pose = _pose(one.motion.root_rotmats, one.motion)
        found[np.int64(number)] = {
            "pose": pose,
            "trans": (pelvis_m - one.rest_pelvis_m).astype(np.float32),
            "pose_world": pose,
            "trans_world": np.zeros_like(pelvis_m, dtype=np.float32),
            "betas": _betas(one),
            "verts": np.zeros((len(pose), 5, 3), np.float32),
            "frame_ids": one.frames,
        }
    return found


def write_joblib(path: Path, content: dict[Any, Any]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(joblib_bytes(content))
    return path


def gvhmr_result(seen: Seen, n_frames: int | None = None) -> dict[str, Any]:
    """One person in every frame; the frames before and after those that are seen repeat them."""
    pelvis_m = _best_places(seen.offsets_m, seen.joints_px, *_diagonal(seen))
    n_frames = int(seen.frames[-1]) + 1 if n_frames is None else n_frames
    rows = np.clip(np.searchsorted(seen.frames, np.arange(n_frames)), 0, len(seen.frames) - 1)
    shared = {
        "body_pose": torch.from_numpy(rotvecs(seen.motion.local_rotmats)[rows, :63]).float(),
        "betas": torch.ones(n_frames, N_BETAS),
        "global_orient": torch.from_numpy(rotvecs(seen.motion.root_rotmats)[rows]).float(),
        "transl": torch.from_numpy((pelvis_m - SMPLX_PELVIS_M)[rows]).float(),
    }
    matrix = torch.eye(3)
    matrix[0, 0] = matrix[1, 1] = float(np.hypot(*seen.size_px))
    matrix[0, 2], matrix[1, 2] = seen.size_px[0] / 2, seen.size_px[1] / 2
    return {
        "smpl_params_global": shared,
        "smpl_params_incam": shared,
        "K_fullimg": matrix.repeat(n_frames, 1, 1),
        "net_outputs": {"pred_cam": torch.ones(1, n_frames, 3)},
    }


def write_gvhmr(path: Path, content: dict[str, Any]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    torch.save(content, path)
    return path


def write_tram(
    folder: Path, seen: Sequence[Seen], n_frames: int, focal_factor: float = 1.1
) -> Path:
    """`camera.npy` and a track for each; TRAM's own focal length is off by a factor."""
    focal_px = focal_factor * float(seen[0].intrinsics_px[0, 0])
    centre_px = np.divide(seen[0].size_px, 2)
    (folder / "hps").mkdir(parents=True, exist_ok=True)
    for number, one in enumerate(seen):
        n = len(one.frames)
        places = np.full(n, focal_px), np.tile(centre_px, (n, 1))
        pelvis_m = _best_places(one.offsets_m, one.joints_px, *places)
        people = {
            "pred_cam": torch.ones(n, 3),
            "pred_pose": torch.zeros(n, 144),
            "pred_shape": torch.from_numpy(_betas(one)),
            "pred_rotmat": torch.from_numpy(one.motion.rotmats).float(),
            "pred_trans": torch.from_numpy(pelvis_m - one.rest_pelvis_m)[:, None].float(),
            "frame": torch.from_numpy(one.frames),
        }
        np.save(folder / "hps" / f"hps_track_{number}.npy", people)  # type: ignore[arg-type]
    cameras = {
        "pred_cam_R": np.tile(np.eye(3), (n_frames, 1, 1)),
        "pred_cam_T": np.zeros((n_frames, 3)),
        "world_cam_R": np.tile(np.eye(3), (n_frames, 1, 1)),
        "world_cam_T": np.zeros((n_frames, 3)),
        "img_focal": np.float64(focal_px),
        "img_center": centre_px,
        "spec_focal": 1000.0,
    }
    np.save(folder / "camera.npy", cameras)  # type: ignore[arg-type]
    return folder


def phalp_frames(
    seen: Sequence[Seen], n_frames: int, rng: np.random.Generator | None = None
) -> dict[str, Any]:
    """An entry for each frame, with the people that are seen in it, and the last pose of others."""
    people = [_phalp_rows(one, rng) for one in seen]
    frames: dict[str, Any] = {}
    for frame in range(n_frames):
        lists: dict[str, list[Any]] = {key: [] for key in (*_PHALP_KEYS, "tid", "tracked_time")}
        for number, (one, rows) in enumerate(zip(seen, people, strict=True)):
            before = np.flatnonzero(one.frames <= frame)
            if not len(before) or frame - one.frames[before[-1]] > 3:
                continue
            lists["tid"].append(number + 1)
            lists["tracked_time"].append(int(frame - one.frames[before[-1]]))
            for key in _PHALP_KEYS:
                lists[key].append(rows[before[-1]][key])
        frames[f"img/{frame:06d}.jpg"] = {"time": frame, "shot": 0, "frame_path": "", **lists}
    return frames


_PHALP_KEYS = ("smpl", "camera", "camera_bbox", "center", "scale", "size")


def _phalp_rows(seen: Seen, rng: np.random.Generator | None) -> list[dict[str, Any]]:
    crop_px, sides_px = _squares(seen, rng)
    roots, weak = _crop_camera(seen, crop_px, sides_px, 256.0)
    width_px, height_px = seen.size_px
    ratio = 256.0 / max(seen.size_px)
    depths_m = 2 * 5000.0 / (weak[:, 0] * sides_px * ratio)
    off_px = (crop_px - np.divide(seen.size_px, 2)) * ratio
    cameras = np.column_stack([weak[:, 1:] + off_px * depths_m[:, None] / 5000.0, depths_m])
    return [
        {
            "smpl": {
                "global_orient": roots[row][None].astype(np.float32),
                "body_pose": seen.motion.local_rotmats[row].astype(np.float32),
                "betas": _betas(seen)[row],
            },
            "camera": cameras[row].astype(np.float32),
            "camera_bbox": weak[row].astype(np.float32),
            "center": crop_px[row],
            "scale": np.array([0.75, 1.0]) * sides_px[row],
            "size": [height_px, width_px],
        }
        for row in range(len(seen.frames))
    ]
