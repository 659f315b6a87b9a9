"""One clip's local poses against its truth."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from networks import networks_in
from training.calibration import TrueTrack, true_track
from video.clips import CLIP_FILE, FACTS_FILE, FRAMES_FOLDER, VideoFacts

from gmrdata.cameras.lens.intrinsics import load_intrinsics
from gmrdata.people.following import FollowConfig, follow_people, load_tracks
from gmrdata.people.landmark_body import LEG_M, landmark_offsets_m, landmarks_on
from gmrdata.people.landmark_network import LANDMARKS
from gmrdata.people.local_poses import LocalPosesConfig, poses_of, seen_landmarks
from gmrdata.read.bodies import load_body
from gmrdata.read.frames import read_frames
from gmrdata.score.metrics import aligned_errors_mm, segment_errors_mm
from gmrdata.solve.request import FOLLOWED, INTRINSICS
from gmrdata.values.body import BodyModel, leg_length_m
from gmrdata.values.clip import load_clip
from gmrdata.values.skinning import posed_joints_m
from gmrdata.values.transforms import fit_similarities

TWELVE = [
    LANDMARKS.index(f"{side}_{part}")
    for side in ("left", "right")
    for part in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
]
LARGEST_SHIFT = 0.5
"""Distance of the hips' landmarks from the true hips up to which a track is the person's, in the
true person's size."""


@dataclass(frozen=True)
class PoseRow:
    """What was found of one clip's person; errors are means over frames and joints."""

    clip: str
    frames: int
    of_frames: int
    focal_ratio: float
    """The focal length that was taken, over the true one."""
    raw_mm: float
    """PA-MPJPE of the landmark network's metres, over its 12 landmarks of limbs."""
    fit_mm: float
    """PA-MPJPE over 24 joints."""
    root_deg: float
    """Median angle of the root in the camera."""
    depth_ratio: float
    """Median distance over the true one, for a person of mean size."""
    leg_ratio: float
    """Mean legs over the person's own: what the distance is short of for the size alone."""


def pose_row(clip_dir: Path, work_dir: Path, models_dir: Path) -> PoseRow:
    """Poses of a clip whose lens is not told; `work_dir` is a solved video's."""
    facts = VideoFacts.read(clip_dir / FACTS_FILE)
    images_dir, clip = clip_dir / FRAMES_FOLDER, load_clip(clip_dir / CLIP_FILE)
    body, intrinsics = load_body("anny"), load_intrinsics(work_dir / INTRINSICS)
    frames = read_frames(images_dir).with_rate(facts.fps_hz)
    networks = networks_in(models_dir)
    followed_dir = follow_people(frames, work_dir / FOLLOWED, FollowConfig(), networks)
    found = []
    for track in load_tracks(followed_dir):
        seen = seen_landmarks(track, frames.numbers, frames, intrinsics.lens)
        found.append(true_track(track, seen, clip, body))
    truth = max(found, key=_frames_on_the_person)
    errors = _errors(truth, body)
    true_m = landmarks_on(
        truth.joints_m, truth.turned, landmark_offsets_m() * (truth.leg_m / LEG_M)
    )
    return PoseRow(
        clip=facts.name,
        frames=len(truth.rows),
        of_frames=clip.motion.n_frames,
        focal_ratio=float(intrinsics.focal_px / facts.focal_px),
        raw_mm=float(aligned_mm(truth.seen.world_m[:, TWELVE], true_m[:, TWELVE]).mean()),
        fit_mm=errors["mm"],
        root_deg=errors["root_deg"],
        depth_ratio=errors["depth_ratio"],
        leg_ratio=leg_length_m(body.rest_joints_m(np.zeros(body.n_shape))) / truth.leg_m,
    )


def _frames_on_the_person(truth: TrueTrack) -> int:
    hips = truth.seen.rays[:, [23, 24]].mean(1)
    pelvis = truth.joints_m[:, 0]
    apart_m = np.linalg.norm(hips - pelvis[:, :2] / pelvis[:, 2:], axis=1) * pelvis[:, 2]
    return int((apart_m < LARGEST_SHIFT).sum())


def _errors(truth: TrueTrack, body: BodyModel) -> dict[str, float]:
    numbers = np.arange(len(truth.rows))
    found = poses_of(truth.seen, numbers, body, LocalPosesConfig())
    rotmats = np.concatenate([found.root_rotmats[:, None], found.local_rotmats], axis=1)
    rest_joints_m = body.rest_joints_m(np.zeros(body.n_shape))
    joints_m, _ = posed_joints_m(rest_joints_m, rotmats, found.pelvis_m)
    cosines = (np.einsum("tij,tij->t", found.root_rotmats, truth.rotmats[:, 0]) - 1) / 2
    return {
        "mm": float(aligned_mm(joints_m, truth.joints_m).mean()),
        "root_deg": float(np.median(np.rad2deg(np.arccos(cosines.clip(-1, 1))))),
        "depth_ratio": float(np.median(found.pelvis_m[:, 2] / truth.joints_m[:, 0, 2])),
    }


def aligned_mm(found_m: np.ndarray, true_m: np.ndarray) -> np.ndarray:
    """PA-MPJPE of each frame (T,): mean distance of points (T, J, 3) after its own similarity."""
    return aligned_errors_mm(found_m, true_m, fit_similarities(true_m, found_m))


def wa_mpjpe_mm(found_m: np.ndarray, true_m: np.ndarray) -> float:
    """WA-MPJPE of a whole path (T, J, 3): the mean after one similarity."""
    whole = [(0, len(found_m))]
    return float(segment_errors_mm(found_m, true_m, whole, first_frames=None, scale=True)[0].mean())


def means(rows: list[PoseRow]) -> dict[str, Any]:
    """Figures over clips, each of which counts alike."""
    numbers = [{k: v for k, v in asdict(row).items() if k != "clip"} for row in rows]
    return {key: float(np.mean([row[key] for row in numbers])) for key in numbers[0]}
