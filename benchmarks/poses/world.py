"""One clip's person in the world, as `gmrdata video` makes it, against the truth.

Nobody tells the lens.  A clip is one window: others take world errors over 100 frames at 30 Hz, and
no clip lasts longer.  The result and what it is held against are scored over the same frames, those
in which the person has a pose and the camera a place, whatever the verdict says.
"""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from networks import networks_in, own_people
from poses.score import wa_mpjpe_mm
from video.clips import CLIP_FILE, FACTS_FILE, FRAMES_FOLDER, VideoFacts

from gmrdata.cameras.lens.intrinsics import load_intrinsics
from gmrdata.people.following import load_tracks
from gmrdata.people.landmark_body import SeenLandmarks, landmarks_about
from gmrdata.people.local_poses import POSES_FOLDER, seen_landmarks
from gmrdata.read.bodies import load_body
from gmrdata.read.frames import read_frames
from gmrdata.score.metrics import root_errors_percent
from gmrdata.solve.request import FOLLOWED, INTRINSICS, LINES, OWN_POSES
from gmrdata.solve.verdict import VideoVerdict
from gmrdata.solve.videos import solve_video
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, load_clip
from gmrdata.values.frame_set import FrameSet
from gmrdata.values.motion import Motion
from gmrdata.values.people import BODIES, FUSED, PSEUDO_GT, load_local_poses, person_file
from gmrdata.values.skinning import motion_joints_m
from gmrdata.values.transforms import apply, invert
from gmrdata.world.judge import load_record

STANDS = ("static",)
"""Programmes whose camera does not move."""
LARGEST_OFF_M = 0.5
"""Distance between a ray of somebody's pelvis and the true pelvis up to which it is the person."""


@dataclass(frozen=True)
class WorldRow:
    """World errors of one clip: of the result, and of what it is held against."""

    clip: str
    programme: str
    accepted: bool
    """By the verdict on the person."""
    frames: int
    of_frames: int
    path_m: float
    """Length of the true pelvis's path."""
    size_ratio: float
    """Median distance from the camera over the true one: the size of the world that was found."""
    wa_mm: float
    """WA-MPJPE over 24 joints, one similarity for the clip."""
    rte_percent: float
    """Distance of the pelvis after one rigid transform, of the path."""
    wa_static_mm: float
    """With the camera taken as static."""
    rte_static_percent: float
    wa_placed_mm: float
    """With each frame's place from that frame alone, before the recovered cameras."""
    rte_placed_percent: float
    wa_unfused_mm: float
    """With places smoothed over time, and without the network's motions."""
    rte_unfused_percent: float

    @property
    def moves(self) -> bool:
        """Whether the camera does."""
        return self.programme not in STANDS


WORLD = (LINES, BODIES, PSEUDO_GT, FUSED)
"""What is made of poses: people's world."""


def solve(clip_dir: Path, work_dir: Path, models_dir: Path) -> VideoVerdict:
    """What `gmrdata video --poses own` leaves of a clip's frames; people's world is made anew."""
    for made in (OWN_POSES, *WORLD):
        shutil.rmtree(work_dir / made, ignore_errors=True)
    facts = VideoFacts.read(clip_dir / FACTS_FILE)
    config = own_people(networks_in(models_dir))
    frames_dir = clip_dir / FRAMES_FOLDER
    return VideoVerdict.read(
        solve_video(frames_dir, work_dir, poses="own", fps_hz=facts.fps_hz, config=config)
    )


def world_row(clip_dir: Path, work_dir: Path, verdict: VideoVerdict) -> WorldRow | None:
    """Score what `solve` left; None where nobody is in the world."""
    facts, truth = VideoFacts.read(clip_dir / FACTS_FILE), load_clip(clip_dir / CLIP_FILE)
    if not (work_dir / PSEUDO_GT).is_dir():
        return None
    body = load_body("anny")
    number = of_truth(work_dir, truth)
    seen = load_clip(work_dir / BODIES / person_file(number))
    unfused = load_clip(work_dir / PSEUDO_GT / person_file(number))
    fused_path = work_dir / FUSED / person_file(number)
    result = load_clip(fused_path) if fused_path.is_file() else unfused
    rows = np.flatnonzero(seen.valid & camera_of(unfused).has_camera)
    frames = read_frames(clip_dir / FRAMES_FOLDER).with_rate(facts.fps_hz)
    placed = _placed_alone(work_dir, unfused, body, frames)
    shown = (result.motion, seen.motion, placed, unfused.motion)
    (wa, rte), (wa_static, rte_static), (wa_placed, rte_placed), (wa_unfused, rte_unfused) = (
        _errors(one, truth, rows, body) for one in shown
    )
    return WorldRow(
        clip=facts.name,
        programme=facts.programme,
        accepted=verdict.people[number].accepted,
        frames=len(rows),
        of_frames=truth.motion.n_frames,
        path_m=float(np.linalg.norm(np.diff(truth.motion.pelvis_m[rows], axis=0), axis=1).sum()),
        size_ratio=_size_ratio(seen, truth, rows),
        wa_mm=wa,
        rte_percent=rte,
        wa_static_mm=wa_static,
        rte_static_percent=rte_static,
        wa_placed_mm=wa_placed,
        rte_placed_percent=rte_placed,
        wa_unfused_mm=wa_unfused,
        rte_unfused_percent=rte_unfused,
    )


def world_figures(rows: Sequence[WorldRow]) -> dict[str, float]:
    """Means over clips; a ratio is that of the two means, the larger one of WA-MPJPE's and RTE's.
    RTE and ratios are of cameras that move."""
    moving = [row for row in rows if row.moves]

    def mean(key: str, of: Sequence[WorldRow] = moving) -> float:
        return float(np.mean([getattr(row, key) for row in of]))

    def ratio(to: str) -> float:
        wa = mean("wa_mm") / mean(f"wa_{to}_mm")
        return max(wa, mean("rte_percent") / mean(f"rte_{to}_percent"))

    return {
        "wa_mpjpe_mm": mean("wa_mm", rows),
        "rte_percent": mean("rte_percent"),
        "static_camera_ratio": ratio("static"),
        "placement_ratio": ratio("placed"),
        "wa_mpjpe_static_mm": mean("wa_static_mm"),
        "wa_mpjpe_placed_mm": mean("wa_placed_mm"),
        "rte_static_percent": mean("rte_static_percent"),
        "rte_placed_percent": mean("rte_placed_percent"),
        "wa_mpjpe_unfused_mm": mean("wa_unfused_mm", rows),
        "rte_unfused_percent": mean("rte_unfused_percent"),
    }


def of_truth(work_dir: Path, truth: Clip) -> int:
    """The number of the person who is on the true one's rays in most frames."""
    pelvis_m = _before_camera(truth)
    best, most = 0, -1
    for number in range(len(load_record(work_dir / PSEUDO_GT).people)):
        seen = load_clip(work_dir / BODIES / person_file(number))
        found_m = seen.motion.pelvis_m
        off = found_m[:, :2] / found_m[:, 2:] - pelvis_m[:, :2] / pelvis_m[:, 2:]
        near = seen.valid & (np.linalg.norm(off, axis=1) * pelvis_m[:, 2] < LARGEST_OFF_M)
        if near.sum() > most:
            best, most = number, int(near.sum())
    return best


def _before_camera(truth: Clip) -> np.ndarray:
    """The true pelvis (T, 3) in the camera's axes [m]."""
    cam_from_world = invert(camera_of(truth).world_from_cam)
    return apply(cam_from_world, truth.motion.pelvis_m[:, None])[:, 0]


def _size_ratio(seen: Clip, truth: Clip, rows: np.ndarray) -> float:
    return float(np.median(seen.motion.pelvis_m[rows, 2] / _before_camera(truth)[rows, 2]))


def _placed_alone(work_dir: Path, clip: Clip, body: BodyModel, frames: FrameSet) -> Motion:
    """The clip's motion with each frame's pelvis from that frame's landmarks alone."""
    lens = load_intrinsics(work_dir / INTRINSICS)
    camera, motion = camera_of(clip), clip.motion
    _, people = load_local_poses(work_dir / OWN_POSES / POSES_FOLDER)
    number = int(clip.id.removeprefix("person_"))
    poses = people[number]
    track = load_tracks(work_dir / FOLLOWED)[number]
    track = track.take(np.isin(track.image_numbers, poses.frame_numbers))
    seen = seen_landmarks(
        track, clip.image_numbers, frames, replace(camera.lens, radial=(lens.radial_k1, 0.0))
    )
    rotmats = np.concatenate([poses.root_rotmats[:, None], poses.local_rotmats], axis=1)
    pelvis_m = motion.pelvis_m.copy()
    alone_m = _places(seen, landmarks_about(rotmats, body.rest_joints_m(motion.shape)))
    rows = poses.frame_numbers
    pelvis_m[rows] = apply(camera.world_from_cam[rows], alone_m[:, None])[:, 0]
    return replace(motion, pelvis_m=pelvis_m)


def _places(seen: SeenLandmarks, about_m: np.ndarray) -> np.ndarray:
    """The pelvis (T, 3) that lays each frame's landmarks (T, 33, 3) nearest to their rays."""
    ones, zeros = np.ones(seen.weights.shape), np.zeros(seen.weights.shape)
    by_x = np.stack([ones, zeros, -seen.rays[..., 0]], axis=-1)
    by_y = np.stack([zeros, ones, -seen.rays[..., 1]], axis=-1)
    design = np.concatenate([by_x, by_y], axis=1)
    off_m = seen.rays * about_m[..., 2:] - about_m[..., :2]
    target_m = np.concatenate([off_m[..., 0], off_m[..., 1]], axis=1)
    weights = np.concatenate([seen.weights, seen.weights], axis=1)
    normal = np.einsum("tn,tni,tnj->tij", weights, design, design)
    right = np.einsum("tn,tni,tn->ti", weights, design, target_m)
    return np.asarray(np.linalg.solve(normal, right[..., None])[..., 0])


def _errors(found: Motion, truth: Clip, rows: np.ndarray, body: BodyModel) -> tuple[float, float]:
    """WA-MPJPE [mm] and RTE [%] over the rows."""
    found_m, true_m = (motion_joints_m(body, one)[rows] for one in (found, truth.motion))
    rte = root_errors_percent(found_m[:, 0], true_m[:, 0], [(0, len(rows))])
    return wa_mpjpe_mm(found_m, true_m), float(rte.mean())
