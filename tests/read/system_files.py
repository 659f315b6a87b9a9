"""Files of people as VIBE, WHAM, GVHMR, TRAM, PHALP and SLAHMR write them, one way for each system.

Of a true motion in the world, by what their scripts do, each in its own axes: y up in WHAM, GVHMR
and TRAM, the camera's in VIBE, the first camera's in SLAHMR.  Of a person in a picture (`Seen`), as
that system would have seen it at its best: the poses are true, and the place before the camera is
the one whose picture, by the system's own projection, is nearest to the true picture; VIBE and
PHALP see crops, so their orientation is as along the crop's ray.  And of some poses, of nobody.
"""

import json
import zlib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from gmrdata.values.body import N_LOCAL, BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_joints_m
from gmrdata.values.transforms import invert
from gmrdata.world.compose import motion_in_camera
from tests.joblib_layout import joblib_bytes

Y_UP_FROM_Z_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
Y_DOWN_FROM_Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
SMPLX_PELVIS_M = np.array([0.0031, -0.3514, 0.0120])
N_BETAS = 10


def write_joblib(path: Path, content: Mapping[Any, Any] | list[Any]) -> Path:
    """VIBE's and WHAM's files; PHALP packs its own."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(joblib_bytes(content))
    return path


def write_torch(path: Path, content: Mapping[Any, Any]) -> Path:
    """GVHMR's file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    torch.save(content, path)
    return path


def rotvecs(rotmats: np.ndarray) -> np.ndarray:
    """(T, ..., 3, 3) -> (T, ... * 3)."""
    found = Rotation.from_matrix(rotmats.reshape(-1, 3, 3)).as_rotvec()
    return np.asarray(found.reshape(len(rotmats), -1))


def rotmats(poses: np.ndarray) -> np.ndarray:
    """(T, 3 * J) -> (T, J, 3, 3)."""
    flat = Rotation.from_rotvec(poses.reshape(-1, 3).astype(np.float64)).as_matrix()
    return flat.reshape(len(poses), -1, 3, 3)


def pose_of(roots: np.ndarray, motion: Motion) -> np.ndarray:
    """(T, 72) axis-angle of a motion under other roots [rad]."""
    return np.concatenate([rotvecs(roots), rotvecs(motion.local_rotmats)], axis=1)


def padded_betas(motion: Motion) -> np.ndarray:
    """(T, N_BETAS) the motion's shape in each row."""
    shape = motion.shape[:N_BETAS]
    return np.tile(np.pad(shape, (0, N_BETAS - len(shape))), (motion.n_frames, 1))


def some_poses(n_frames: int, n_joints: int = 24, seed: int = 0) -> np.ndarray:
    """(T, 3 * n_joints) float32 axis-angle that changes smoothly [rad]."""
    rng = np.random.default_rng(seed)
    start, step = rng.normal(0, 0.3, (2, 3 * n_joints))
    times = np.arange(n_frames)[:, None] / 30
    return (start + 0.5 * np.sin(2 * times + step)).astype(np.float32)


def turned(motion: Motion, rotmat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Root (T, 3, 3) and pelvis (T, 3) in other axes."""
    return rotmat @ motion.root_rotmats, motion.pelvis_m @ rotmat.T


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


# VIBE


def vibe_entry(
    frames: np.ndarray, pose: np.ndarray, betas: np.ndarray, **cameras: np.ndarray
) -> dict[str, Any]:
    """One person of `vibe_output.pkl`; `cameras` are pred_cam, orig_cam, bboxes, else of ones."""
    n = len(frames)
    widths = {"pred_cam": 3, "orig_cam": 4, "bboxes": 4}
    ones = {key: np.ones((n, width), np.float32) for key, width in widths.items()}
    verts = np.zeros((n, 5, 3), np.float32)
    more = {"pose": pose, "betas": betas, "verts": verts, "joints2d": None, "frame_ids": frames}
    return ones | cameras | more


def vibe_person(n_frames: int, frame_ids: Sequence[int] | None = None, seed: int = 0) -> dict:
    """One person of `vibe_output.pkl` with some poses."""
    frames = np.arange(n_frames) if frame_ids is None else np.asarray(frame_ids)
    betas = np.linspace(0, 1, N_BETAS * n_frames, dtype=np.float32).reshape(n_frames, N_BETAS)
    return vibe_entry(frames, some_poses(n_frames, seed=seed), betas)


def vibe_people(seen: Sequence[Seen], rng: np.random.Generator | None = None) -> dict[Any, Any]:
    found = {}
    for number, one in enumerate(seen):
        crop_px, sides_px = _squares(one, rng)
        # What VIBE calls the box is a tenth smaller than its crop.
        roots, weak = _crop_camera(one, crop_px, 1.1 * sides_px, 224.0)
        half_px = np.divide(one.size_px, 2)
        scales = weak[:, :1] * sides_px[:, None] / np.array(one.size_px)
        shifts = (crop_px - half_px) / half_px / scales + weak[:, 1:]
        found[number + 1] = vibe_entry(
            one.frames,
            pose_of(roots, one.motion).astype(np.float32),
            padded_betas(one.motion).astype(np.float32),
            pred_cam=weak.astype(np.float32),
            orig_cam=np.concatenate([scales, shifts], axis=1),
            bboxes=np.column_stack([crop_px, sides_px, sides_px]),
        )
    return found


def write_vibe(
    path: Path, motion: Motion, camera: CameraPath, frames: np.ndarray, rest_pelvis_m: np.ndarray
) -> Path:
    """The weak-perspective camera that puts SMPL's origin where it is before the camera: of a crop,
    and in the whole image as VIBE has it, by a box that is a tenth smaller than the crop."""
    seen = motion_in_camera(motion, camera.world_from_cam)
    origin_m = seen.pelvis_m - rest_pelvis_m
    centre_px, half_px = camera.intrinsics_px[:2, 2], np.array([camera.width_px, camera.height_px])
    px_per_m, half_px = camera.intrinsics_px[0, 0] / origin_m[:, 2:], half_px / 2
    middles_px = centre_px + px_per_m * (origin_m[:, :2] + [0.1, -0.2])
    sides_px = 1.8 * px_per_m
    crop = np.concatenate(
        [2 * px_per_m / (1.1 * sides_px), np.tile([-0.1, 0.2], (len(frames), 1))], 1
    )
    scales = crop[:, :1] * sides_px / (2 * half_px)
    person = vibe_entry(
        frames,
        pose_of(seen.root_rotmats, seen),
        np.tile(motion.shape, (len(frames), 1)),
        pred_cam=crop,
        orig_cam=np.c_[scales, (middles_px - half_px) / half_px / scales + crop[:, 1:]],
        bboxes=np.c_[middles_px, sides_px, sides_px],
    )
    return write_joblib(path, {1: person})


# WHAM


def wham_entry(frames: np.ndarray, betas: np.ndarray, **arrays: np.ndarray) -> dict[str, Any]:
    """One person of `wham_output.pkl`; `arrays` are pose, trans, pose_world, trans_world."""
    verts = np.zeros((len(frames), 5, 3), np.float32)
    return {**arrays, "betas": betas, "verts": verts, "frame_ids": frames}


def some_wham(people: Mapping[int, int]) -> dict[Any, Any]:
    """People with so many frames of some poses: a defaultdict, numpy's ints as keys."""
    results: defaultdict[Any, dict[str, Any]] = defaultdict(dict)
    for person, n in people.items():
        pose, zeros = some_poses(n, seed=person), np.zeros((n, 3), np.float32)
        world = pose.copy()
        world[:, :3] += 0.5
        results[np.int64(person)] |= wham_entry(
            np.arange(n),
            np.full((n, N_BETAS), person, np.float32),
            pose=pose,
            trans=zeros,
            pose_world=world,
            trans_world=zeros,
        )
    return results


def write_wham(
    path: Path, people: dict[int, tuple[Motion, np.ndarray]], rest_pelvis_m: np.ndarray
) -> Path:
    """Each person's motion in the world, and the frames that its rows are."""
    found = {}
    for number, (motion, frames) in people.items():
        roots, pelvis_m = turned(motion, Y_UP_FROM_Z_UP)
        found[np.int64(number)] = wham_entry(
            frames,
            padded_betas(motion),
            pose_world=pose_of(roots, motion),
            trans_world=pelvis_m - rest_pelvis_m,
        )
    return write_joblib(path, found)


def wham_people(seen: Sequence[Seen]) -> dict[Any, Any]:
    found = {}
    for number, one in enumerate(seen):
        pelvis_m = _best_places(one.offsets_m, one.joints_px, *_diagonal(one))
        pose = pose_of(one.motion.root_rotmats, one.motion).astype(np.float32)
        found[np.int64(number)] = wham_entry(
            one.frames,
            padded_betas(one.motion).astype(np.float32),
            pose=pose,
            trans=(pelvis_m - one.rest_pelvis_m).astype(np.float32),
            pose_world=pose,
            trans_world=np.zeros_like(pelvis_m, dtype=np.float32),
        )
    return found


# GVHMR


def gvhmr_params(
    body_pose: np.ndarray, orient: np.ndarray, transl_m: np.ndarray
) -> dict[str, torch.Tensor]:
    arrays = {"body_pose": body_pose, "global_orient": orient, "transl": transl_m}
    tensors = {key: torch.from_numpy(np.asarray(one)) for key, one in arrays.items()}
    return tensors | {"betas": torch.ones(len(body_pose), N_BETAS)}


def gvhmr_content(
    world: dict[str, Any], seen: dict[str, torch.Tensor], size_px: tuple[int, int]
) -> dict[str, Any]:
    """`hmr4d_results.pt` with the camera that the demo takes for pictures of a size."""
    n, matrix = len(world["body_pose"]), torch.eye(3)
    matrix[0, 0] = matrix[1, 1] = float(np.hypot(*size_px))
    matrix[0, 2], matrix[1, 2] = size_px[0] / 2, size_px[1] / 2
    return {
        "smpl_params_global": world,
        "smpl_params_incam": seen,
        "K_fullimg": matrix.repeat(n, 1, 1),
        "net_outputs": {"pred_cam": torch.ones(1, n, 3)},
    }


def some_gvhmr(n_frames: int, n_joints: int = 21) -> dict[str, Any]:
    zeros = np.zeros((n_frames, 3), np.float32)
    params = gvhmr_params(some_poses(n_frames, n_joints), zeros, zeros)
    return gvhmr_content(params | {"left_hand_pose": None}, dict(params), (640, 480))


def write_gvhmr(path: Path, motion: Motion, cam_rotmats: np.ndarray) -> Path:
    """`cam_rotmats` (T, 3, 3): cam_from_world of the camera that saw it."""
    roots, pelvis_m = turned(motion, Y_UP_FROM_Z_UP)
    poses, transl_m = rotvecs(motion.local_rotmats)[:, :63], pelvis_m - SMPLX_PELVIS_M
    world = gvhmr_params(poses, rotvecs(roots), transl_m)
    seen = gvhmr_params(poses, rotvecs(cam_rotmats @ motion.root_rotmats), transl_m)
    return write_torch(path, gvhmr_content(world, seen, (640, 480)))


def gvhmr_result(seen: Seen, n_frames: int | None = None) -> dict[str, Any]:
    """One person in every frame; the frames before and after those that are seen repeat them."""
    pelvis_m = _best_places(seen.offsets_m, seen.joints_px, *_diagonal(seen))
    n_frames = int(seen.frames[-1]) + 1 if n_frames is None else n_frames
    rows = np.clip(np.searchsorted(seen.frames, np.arange(n_frames)), 0, len(seen.frames) - 1)
    params = gvhmr_params(
        rotvecs(seen.motion.local_rotmats)[rows, :63].astype(np.float32),
        rotvecs(seen.motion.root_rotmats)[rows].astype(np.float32),
        (pelvis_m - SMPLX_PELVIS_M)[rows].astype(np.float32),
    )
    return gvhmr_content(params, params, seen.size_px)


# PromptHMR


def write_prompthmr(path: Path, motion: Motion, camera: CameraPath, frames: np.ndarray) -> Path:
    """As pipeline/pipeline.py saves it without masks; its `Twc` is not where the camera is."""
    seen, n = motion_in_camera(motion, camera.world_from_cam), int(frames.max()) + 1
    body = rotvecs(motion.local_rotmats)[:, :63]
    world_from_cam = np.tile(np.eye(4), (n, 1, 1))
    world_from_cam[frames, :3, :3] = Y_UP_FROM_Z_UP @ camera.world_from_cam[:, :3, :3]
    world_from_cam[frames, :3, 3] = camera.centres_world_m @ Y_UP_FROM_Z_UP.T
    cam_from_world, (roots, pelvis_m) = invert(world_from_cam), turned(motion, Y_UP_FROM_Z_UP)
    lens = {
        "img_focal": np.float32(camera.intrinsics_px[0, 0]),
        "img_center": np.array([camera.width_px, camera.height_px]) / 2,
    }
    shape = padded_betas(motion).astype(np.float32)
    person = {
        "track_id": 1,
        "frames": frames,
        "bboxes": np.ones((len(frames), 4)),
        "smplx_cam": {
            "pose": np.concatenate([rotvecs(seen.root_rotmats), body, 0 * body[:, :9]], axis=1),
            "shape": torch.from_numpy(shape),
            "trans": seen.pelvis_m - SMPLX_PELVIS_M,
        },
        "smplx_world": {
            "pose": np.concatenate([rotvecs(roots), body, np.zeros((len(body), 99))], axis=1),
            "shape": shape,
            "trans": pelvis_m - SMPLX_PELVIS_M,
        },
    }
    cameras = {"Rcw": cam_from_world[:, :3, :3], "Tcw": cam_from_world[:, :3, 3]}
    content = {
        "camera": {"pred_cam_R": cameras["Rcw"]} | lens,
        "people": {1: person},
        "timings": {},
        "has_tracks": True,
        "spec_calib": {"first_frame": {"pitch": 0.1}},
        "contact_joint_ids": [7, 10, 8, 11, 20, 21],
        "camera_world": cameras | lens | {"Twc": np.full((n, 3), 9.0), "viz_scale": 2.0},
    }
    return write_joblib(path, content)


# TRAM


def _tram(
    folder: Path,
    tracks: Sequence[tuple[Motion, np.ndarray, np.ndarray]],
    world_from_cam: np.ndarray,
    focal_px: float,
    centre_px: np.ndarray,
) -> Path:
    """`camera.npy`, and a track for each motion before it, with its transl [m] and frames."""
    (folder / "hps").mkdir(parents=True, exist_ok=True)
    for number, (seen, transl_m, frames) in enumerate(tracks):
        people = {
            "pred_cam": torch.ones(len(frames), 3),
            "pred_pose": torch.zeros(len(frames), 144),
            "pred_shape": torch.from_numpy(padded_betas(seen)),
            "pred_rotmat": torch.from_numpy(seen.rotmats),
            "pred_trans": torch.from_numpy(transl_m)[:, None],
            "frame": torch.from_numpy(frames),
        }
        np.save(folder / "hps" / f"hps_track_{number}.npy", people)  # type: ignore[arg-type]
    cameras = {
        "pred_cam_R": np.tile(np.eye(3), (len(world_from_cam), 1, 1)),
        "pred_cam_T": np.zeros((len(world_from_cam), 3)),
        "world_cam_R": world_from_cam[:, :3, :3],
        "world_cam_T": world_from_cam[:, :3, 3],
        "img_focal": np.float64(focal_px),
        "img_center": centre_px,
        "spec_focal": 1000.0,
    }
    np.save(folder / "camera.npy", cameras)  # type: ignore[arg-type]  # as TRAM does
    return folder


def write_tram(
    folder: Path, motion: Motion, camera: CameraPath, frames: np.ndarray, rest_pelvis_m: np.ndarray
) -> Path:
    """One track; the camera's frames are numbered from 0, and its world is its own."""
    seen = motion_in_camera(motion, camera.world_from_cam)
    world_from_cam = np.tile(np.eye(4), (int(frames.max()) + 1, 1, 1))
    world_from_cam[frames, :3, :3] = Y_UP_FROM_Z_UP @ camera.world_from_cam[:, :3, :3]
    world_from_cam[frames, :3, 3] = camera.centres_world_m @ Y_UP_FROM_Z_UP.T + [3.0, 1.0, 2.0]
    centre_px = np.array([camera.width_px, camera.height_px]) / 2
    track = seen, seen.pelvis_m - rest_pelvis_m, frames
    return _tram(folder, [track], world_from_cam, 1000.0, centre_px)


def write_seen_tram(folder: Path, seen: Sequence[Seen], n_frames: int) -> Path:
    """A track for each; TRAM's own focal length is off by a tenth."""
    focal_px = 1.1 * float(seen[0].intrinsics_px[0, 0])
    centre_px, tracks = np.divide(seen[0].size_px, 2), []
    for one in seen:
        n = len(one.frames)
        lens = np.full(n, focal_px), np.tile(centre_px, (n, 1))
        pelvis_m = _best_places(one.offsets_m, one.joints_px, *lens)
        tracks.append((one.motion, pelvis_m - one.rest_pelvis_m, one.frames))
    return _tram(folder, tracks, np.tile(np.eye(4), (n_frames, 1, 1)), focal_px, centre_px)


# PHALP


def phalp_frame(
    time: int, poses: Mapping[int, np.ndarray], unseen: Sequence[int] = (), shot: int = 0
) -> dict[str, Any]:
    """One frame of PHALP's file: each track's rotations (23, 3, 3), and which are not seen."""
    return {
        "time": time,
        "shot": shot,
        "frame_path": f"img/{time + 1:06d}.jpg",
        "tid": list(poses),
        "bbox": [np.ones(4) for _ in poses],
        "tracked_ids": [track for track in poses if track not in unseen],
        "tracked_bbox": [np.ones(4) for track in poses if track not in unseen],
        "tracked_time": [3 if track in unseen else 0 for track in poses],
        "conf": [np.float32(0.9) for _ in poses],
        "class_name": [np.int64(0) for _ in poses],
        "annotations": [[] for _ in poses],
        "mask": [[{"size": [4, 4], "counts": "04L3"}] for _ in poses],
        "size": [[480, 640] for _ in poses],
        "smpl": [
            {
                "global_orient": np.eye(3, dtype=np.float32)[None],
                "body_pose": pose.astype(np.float32),
                "betas": np.full(10, 0.5, np.float32),
            }
            for pose in poses.values()
        ],
    }


def write_phalp(path: Path, frames: Sequence[dict[str, Any]]) -> Path:
    """PHALP's results: packed with zlib."""
    content = {frame["frame_path"]: frame for frame in frames}
    path.write_bytes(zlib.compress(joblib_bytes(content), 3))
    return path


def phalp_poses(n_frames: int, seed: int = 0) -> np.ndarray:
    """(T, 23, 3, 3)."""
    return rotmats(some_poses(n_frames, N_LOCAL, seed))


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
    betas = padded_betas(seen.motion).astype(np.float32)
    off_px = (crop_px - np.divide(seen.size_px, 2)) * ratio
    cameras = np.column_stack([weak[:, 1:] + off_px * depths_m[:, None] / 5000.0, depths_m])
    return [
        {
            "smpl": {
                "global_orient": roots[row][None].astype(np.float32),
                "body_pose": seen.motion.local_rotmats[row].astype(np.float32),
                "betas": betas[row],
            },
            "camera": cameras[row].astype(np.float32),
            "camera_bbox": weak[row].astype(np.float32),
            "center": crop_px[row],
            "scale": np.array([0.75, 1.0]) * sides_px[row],
            "size": [height_px, width_px],
        }
        for row in range(len(seen.frames))
    ]


# SLAHMR, and AMASS's keys


def write_slahmr(
    folder: Path,
    people: dict[int, Motion],
    camera: CameraPath,
    rest_pelvis_m: np.ndarray,
    *,
    first_image: int = 0,
    before: int = 0,
) -> Path:
    """A run: `track_info.json`, and `motion_chunks` with results of two steps.

    The rows begin `before` images after the first one of SLAHMR's interval, which is `first_image`.
    """
    rows = [turned(motion, Y_DOWN_FROM_Z_UP) for motion in people.values()]
    n_frames = len(rows[0][0])
    axes = np.eye(4)
    axes[:3, :3] = Y_DOWN_FROM_Z_UP
    cam_from_world = invert(axes @ camera.world_from_cam)
    shapes = [np.pad(motion.shape, (0, 16 - len(motion.shape))) for motion in people.values()]
    arrays = {
        "trans": np.stack([pelvis_m - rest_pelvis_m for _, pelvis_m in rows]),
        "root_orient": np.stack([rotvecs(roots) for roots, _ in rows]),
        "pose_body": np.stack([rotvecs(one.local_rotmats)[:, :63] for one in people.values()]),
        "betas": np.stack(shapes),
        "cam_R": np.stack([cam_from_world[:, :3, :3]] * len(rows)),
        "cam_t": np.stack([cam_from_world[:, :3, 3]] * len(rows)),
        "world_scale": np.ones((1, 1)),
        "floor_plane": np.array([[0.0, -1.0, 0.0]]),
    }
    (folder / "motion_chunks").mkdir(parents=True, exist_ok=True)
    for step, name in ((20, "world"), (40, "world"), (40, "prior")):
        shown = arrays | ({"trans": 0 * arrays["trans"]} if step == 20 else {})
        path = folder / "motion_chunks" / f"x_{step:06d}_{name}_results.npz"
        np.savez(path, **shown)  # type: ignore[arg-type]
    seen = [False] * before + [True] * n_frames
    info: dict[str, Any] = {
        "tracks": {str(id): {"index": n, "vis_mask": seen} for n, id in enumerate(people)},
        "meta": {
            "seq_interval": [before, before + n_frames],
            "data_interval": [first_image, first_image + before + n_frames],
        },
    }
    (folder / "track_info.json").write_text(json.dumps(info))
    return folder


def write_amass(path: Path, motion: Motion, rest_pelvis_m: np.ndarray, **more: Any) -> Path:
    roots = motion.root_rotmats
    path.parent.mkdir(parents=True, exist_ok=True)
    arrays = {
        "poses": np.concatenate([rotvecs(roots), rotvecs(motion.local_rotmats)], axis=1),
        "trans": motion.pelvis_m - rest_pelvis_m,
        "betas": motion.shape,
        "gender": "neutral",
        "mocap_framerate": motion.fps_hz,
    }
    np.savez(path, **arrays | more)
    return path
