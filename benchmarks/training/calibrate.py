"""Make `landmark_body.json` again, from rendered clips.

    python -m training.calibrate OUT MODELS CLIP...

A CLIP is a folder with frames/ and clip.npz, as `render_set` and `video/clips.py` leave it, and
clip.json where a lens bends it.  MODELS holds the two networks.  People are kept in
OUT/followed and found once.  Those that ship were made of poses/clips.py's courtyard_walk,
room_scoop, street_stride, park_walk, room_wash and street_strike as BlazePose GHUM heavy saw them,
twice each.  Across and forward the landmarks of limbs, hands and feet stay as they are, joints but
for fingers and feet: a real man's lie there, and shoulders and hips of people seen from the side
are drawn together.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from networks import networks_in
from render.tables import show
from training.calibration import TrueTrack, measure_offsets, true_track
from video.clips import CLIP_FILE, FACTS_FILE, FRAMES_FOLDER, VideoFacts

from gmrdata.people.following import (
    FollowConfig,
    Sightings,
    follow_people,
    load_tracks,
)
from gmrdata.people.landmark_body import (
    BODY_FILE,
    LandmarkBodyRecord,
    SeenLandmarks,
    landmark_offsets_m,
)
from gmrdata.people.landmark_network import LANDMARKS
from gmrdata.read.bodies import load_body
from gmrdata.read.frames import read_frames
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import straightened
from gmrdata.values.clip import Clip, camera_of, load_clip, rows_of_numbers

RATE_HZ = 15.0
LARGEST_OFF_M = 0.35
"""Distance of the hips' landmarks from the true hips up to which they are the person's."""
FEWEST_FRAMES = 5


def true_tracks(clips: Sequence[Path], work_dir: Path, models_dir: Path) -> dict[str, TrueTrack]:
    """The rendered person of each clip in frames in which the network saw it, by the clip's name;
    clips in which it did not are left out."""
    body, found = load_body("anny"), {}
    for clip_dir in clips:
        clip = load_clip(clip_dir / CLIP_FILE)
        followed_dir = follow_people(
            read_frames(clip_dir / FRAMES_FOLDER),
            work_dir / clip_dir.name,
            FollowConfig(),
            networks_in(models_dir),
        )
        tracks = [
            _of_person(track, clip, _bend(clip_dir), body) for track in load_tracks(followed_dir)
        ]
        longest = max(tracks, key=lambda one: len(one.rows), default=None)
        if longest is not None and len(longest.rows) >= FEWEST_FRAMES:
            found[clip_dir.name] = longest
    return found


def _bend(clip_dir: Path) -> float:
    facts = clip_dir / FACTS_FILE
    return VideoFacts.read(facts).radial_k1 if facts.is_file() else 0.0


def _of_person(track: Sightings, clip: Clip, radial_k1: float, body: BodyModel) -> TrueTrack:
    """The frames of a track, at `RATE_HZ`, in which it is the rendered person's."""
    matrix_px, fps_hz = camera_of(clip).intrinsics_px, clip.motion.fps_hz
    bent = (track.image_px - matrix_px[:2, 2]) / np.diag(matrix_px)[:2]
    rows = rows_of_numbers(clip.image_numbers, track.image_numbers)
    rays = straightened(bent, radial_k1)
    seen = SeenLandmarks(rows / fps_hz, rays, track.world_m, track.visibility)
    whole = true_track(track, seen, clip, body)
    pelvis_m = whole.joints_m[:, 0]
    off = whole.seen.rays[:, [23, 24]].mean(1) - pelvis_m[:, :2] / pelvis_m[:, 2:]
    near = np.linalg.norm(off, axis=1) * pelvis_m[:, 2] < LARGEST_OFF_M
    return _kept(whole, near & (whole.rows % max(1, round(fps_hz / RATE_HZ)) == 0))


def _kept(whole: TrueTrack, kept: np.ndarray) -> TrueTrack:
    return TrueTrack(
        whole.seen.take(kept),
        whole.rows[kept],
        whole.joints_m[kept],
        whole.turned[kept],
        whole.rotmats[kept],
        whole.leg_m,
    )


HEAD = slice(0, LANDMARKS.index("left_shoulder"))


def calibrate(clips: Sequence[Path], models_dir: Path, out_dir: Path) -> None:
    """Write the file into a folder."""
    tracks = true_tracks(clips, out_dir / "followed", models_dir)
    offsets_m = measure_offsets(list(tracks.values())).round(4)
    kept_m = landmark_offsets_m()
    kept_m[HEAD], kept_m[:, 1] = offsets_m[HEAD], offsets_m[:, 1]
    rounded = {
        name: (float(x), float(y), float(z))
        for name, (x, y, z) in zip(LANDMARKS, kept_m, strict=True)
    }
    made_from = "rendered people of the Anny body; of limbs, hands and feet up and down alone"
    LandmarkBodyRecord(made_from=made_from, offsets_m=rounded).write(out_dir / BODY_FILE.name)
    rows = [
        {"clip": name, "seconds": round(len(one.rows) / RATE_HZ, 1)} for name, one in tracks.items()
    ]
    show(f"Clips behind {out_dir}", rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("models", type=Path)
    parser.add_argument("clips", type=Path, nargs="+")
    given = parser.parse_args()
    calibrate(given.clips, given.models, given.out)
