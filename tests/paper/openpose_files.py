"""Writing OpenPose's and STAF's JSON for tests."""

import json
from pathlib import Path

import numpy as np

from gmrdata.film.render_outputs import project_joints
from gmrdata.read.openpose import PAIRS
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip


def person(points_px: np.ndarray, confidence: float, track: int = -1, n: int = 25) -> dict:
    """One person of a frame, from (24, 2) joints [px]; keypoints without a joint lie far off."""
    keypoints = np.tile([9.0, 9.0, 0.99], (n, 1))
    for keypoint, joint in PAIRS.items():
        keypoints[keypoint] = [*points_px[joint], confidence]
    return {"person_id": [track], "pose_keypoints_2d": keypoints.ravel().tolist()}


def write_frame(folder: Path, number: int, people: list[dict]) -> Path:
    """The file of one frame, named as OpenPose does for a video."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"clip_{number:012d}_keypoints.json"
    path.write_text(json.dumps({"version": 1.3, "people": people}))
    return path


def write_frames(
    folder: Path,
    clip: Clip,
    body: BodyModel,
    *,
    noise_px: float = 0.0,
    rng: np.random.Generator | None = None,
    n: int = 25,
) -> None:
    """All frames of a clip as a detector would see its person."""
    points_px = project_joints(clip, body).image_px
    if noise_px:
        assert rng is not None
        points_px = points_px + rng.normal(0.0, noise_px, points_px.shape)
    for number, frame_px in zip(clip.image_numbers.tolist(), points_px, strict=True):
        write_frame(folder, number, [person(frame_px, 0.8, n=n)])
