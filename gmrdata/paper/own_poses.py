"""Stage: what the built-in estimator sees in the clips of a manifest, as the baselines take it.

    out/poses/<clip id>.npz      poses in the camera's frame, for `vibe_cam` and GMR
    out/keypoints/<clip id>/     the same landmarks in OpenPose's JSON, for `vibe_cam`
    out/features/<clip id>.npz   the landmark network's features, for `joint_train` and `joint`
    out/followed/<clip id>/      everybody's landmarks (`gmrdata.people.following`)
    out/seen/<clip id>/          everybody's poses (`gmrdata.people.local_poses`)
    out/own_poses.json           in how many frames each clip's person was seen

It stands where the paper has VIBE, STAF and VIBE's image features.  Where there are several people,
the clip's true motion says who is meant, and nothing else.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveInt

from gmrdata.gmr.runs import ClipFile, usable_files
from gmrdata.manifest.read import listed_path
from gmrdata.motion.resample import Between, between_known
from gmrdata.people.following import FollowConfig, Networks, Sightings, follow_people, load_tracks
from gmrdata.people.landmark_network import LANDMARKS, Square, open_landmark_features
from gmrdata.people.local_poses import LocalPosesConfig, local_poses
from gmrdata.read.bodies import ANNY_FILE
from gmrdata.read.body_file import read_body
from gmrdata.read.frames import read_color, read_frames
from gmrdata.score.camera_as_world import seen_motion
from gmrdata.stage.progress import track as with_bar
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import Resumable, run_stage
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import project_cam
from gmrdata.values.clip import Clip, camera_of, rows_of_numbers, save_clip
from gmrdata.values.errors import StageFailed
from gmrdata.values.files import write_json, write_npz
from gmrdata.values.frame_set import Filmed, FrameSet
from gmrdata.values.motion import Motion
from gmrdata.values.people import LocalPoses, load_local_poses
from gmrdata.values.records import Config, Record

POSES_FOLDER, KEYPOINTS_FOLDER, FEATURES_FOLDER, FOLLOWED_FOLDER, SEEN_FOLDER = (
    "poses", "keypoints", "features", "followed", "seen",
)  # fmt: skip
RECORD = "own_poses.json"
ESTIMATOR = "Fit"
"""What the tables call it."""
OPENPOSE_LANDMARKS: dict[int, tuple[str, ...]] = {
    0: ("nose",), 1: ("left_shoulder", "right_shoulder"),
    2: ("right_shoulder",), 3: ("right_elbow",), 4: ("right_wrist",),
    5: ("left_shoulder",), 6: ("left_elbow",), 7: ("left_wrist",),
    8: ("left_hip", "right_hip"),
    9: ("right_hip",), 10: ("right_knee",), 11: ("right_ankle",),
    12: ("left_hip",), 13: ("left_knee",), 14: ("left_ankle",),
}  # fmt: skip
"""Keypoint of BODY_25 -> the landmarks in whose middle it lies."""
N_KEYPOINTS = 25
HIPS = [LANDMARKS.index("left_hip"), LANDMARKS.index("right_hip")]


class OwnPosesConfig(Config):
    """How people are seen, and when a clip counts as seen."""

    follow: FollowConfig = FollowConfig()
    poses: LocalPosesConfig = LocalPosesConfig()
    near: float = Field(default=0.15, gt=0, le=1)
    """Distance of a track's hips from the clip's pelvis up to which it is the clip's person, in
    sides of the track's crop."""
    min_seen_share: float = Field(default=0.6, gt=0, le=1)
    """A clip whose person is seen in a smaller share of its rows is left out.  Rows between are
    filled, since the scores want all of them."""


class SeenClip(Config):
    """What the record says of a clip."""

    frames: PositiveInt
    seen: PositiveInt
    """Frames in which the network saw the person; the others are filled."""
    people: NonNegativeInt
    """Whom the estimator saw, the clip's person among them."""


class OwnPosesRecord(Record):
    """`own_poses.json`."""

    format: Literal["gmrdata-own-poses/1"] = "gmrdata-own-poses/1"
    estimator: str
    clips: Mapping[str, SeenClip]
    left_out: dict[str, str]
    """Why clips have nothing, by id."""


@dataclass(frozen=True, eq=False)
class _Sources:
    """Networks and body."""

    networks: Networks
    body_path: Path

    def inputs(self) -> dict[str, Path]:
        """Their files, by role."""
        return {"body": self.body_path} | self.networks._asdict()


def own_poses(
    manifest_path: Path,
    out_dir: Path,
    config: OwnPosesConfig | None = None,
    *,
    body_path: Path | None = None,
    networks: Networks | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """See the person of each clip that has images and a camera; the record names the others.

    Poses are those of a body of mean shape; `body_path` is that body, None the default one.
    The usual networks are those of `gmrdata fetch models`.  A run that was stopped goes
    on.  StageFailed where nobody is seen in any clip; other errors are those of `follow_people` and
    `local_poses`.
    """
    config = config or OwnPosesConfig()
    files, left_out, _ = usable_files(manifest_path)
    sources = _Sources(networks or Networks.find(), ANNY_FILE if body_path is None else body_path)
    filmed = [file for file in files if file.entry.images is not None]
    left_out |= {file.entry.id: "it has no images" for file in files if file not in filmed}

    def work(partial_dir: Path) -> None:
        viewer, seen = _Viewer(sources, config, partial_dir), {}
        for file in with_bar(filmed, "the estimator's poses", total=len(filmed)):
            answer = viewer.see(file)
            if isinstance(answer, str):
                left_out[file.entry.id] = answer
            else:
                seen[file.entry.id] = answer
        if not seen:
            reasons = "; ".join(f"{id}: {why}" for id, why in sorted(left_out.items()))
            raise StageFailed(f"own_poses: nobody is seen in any clip. {reasons}")
        record = OwnPosesRecord(estimator=ESTIMATOR, clips=seen, left_out=left_out)
        record.write(partial_dir / RECORD)

    inputs = {"manifest": manifest_path} | sources.inputs()
    inputs |= {f"images_{file.entry.id}": _images_dir(file) for file in filmed}
    return run_stage("own-poses", out_dir, config, inputs, Resumable(work), run=run)


def _images_dir(file: ClipFile) -> Path:
    assert file.entry.images is not None
    folder = file.entry.images.folder
    return listed_path(file.manifest_path, file.entry, "images.folder", folder)


class _Viewer:
    """The estimator, before the images of one clip after the other."""

    def __init__(self, sources: _Sources, config: OwnPosesConfig, out_dir: Path) -> None:
        self._sources, self._config, self._out_dir = sources, config, out_dir
        self._body = read_body(sources.body_path)
        self._look = open_landmark_features(sources.networks.landmarks)

    def see(self, file: ClipFile) -> SeenClip | str:
        """One clip's files, or why there are none."""
        clip = file.load()
        if clip.camera is None:
            return "it has no camera"
        frames = read_frames(_images_dir(file))
        images = dict(zip(frames.numbers.tolist(), frames.paths, strict=True))
        if not set(clip.image_numbers.tolist()) <= images.keys():
            return "not every frame has an image"
        tracks, people = self._followed(clip, frames)
        person = the_person(tracks, clip, self._config.near)
        if person is None:
            return "its person is not seen"
        # Frames that may be seen from the wrong side have no pose.
        track, poses = tracks[person], people[person]
        track = track.take(np.isin(track.image_numbers, poses.frame_numbers))
        rows = rows_of_numbers(clip.image_numbers, track.image_numbers)
        n_frames, n_seen = clip.motion.n_frames, int((rows >= 0).sum())
        if n_seen < self._config.min_seen_share * n_frames:
            return f"its person is seen in {n_seen} of {n_frames} frames"
        between = rows_between(rows, n_frames)
        posed = posed_clip(clip, poses, between, self._body)
        path = self._out_dir / POSES_FOLDER / f"{clip.id}.npz"
        save_clip(path, posed, self._body.rest_pelvis_m(posed.motion.shape))
        write_keypoints(self._out_dir / KEYPOINTS_FOLDER / clip.id, clip, track, between)
        crops = crops_between(track.crops, between)
        features = [
            self._look(read_color(images[number]), Square(crop[:2], crop[2], crop[3]))
            for number, crop in zip(clip.image_numbers.tolist(), crops, strict=True)
        ]
        arrays = {"features": np.stack(features)}
        write_npz(self._out_dir / FEATURES_FOLDER / f"{clip.id}.npz", arrays)
        return SeenClip(frames=n_frames, seen=n_seen, people=len(tracks))

    def _followed(self, clip: Clip, frames: FrameSet) -> tuple[list[Sightings], list[LocalPoses]]:
        """Everybody who is in a clip's images, and their poses."""
        numbers, rate_hz = frames.numbers, clip.motion.fps_hz
        times_s = numbers / rate_hz
        frames = replace(frames, frame_numbers=numbers, times_s=times_s, rate_hz=rate_hz)
        followed_dir = follow_people(
            frames,
            self._out_dir / FOLLOWED_FOLDER / clip.id,
            self._config.follow,
            self._sources.networks,
        )
        folder = local_poses(
            followed_dir,
            Filmed(frames, camera_of(clip).lens),
            self._sources.body_path,
            self._out_dir / SEEN_FOLDER / clip.id,
            self._config.poses,
        )
        return load_tracks(followed_dir), load_local_poses(folder)[1]


def the_person(tracks: list[Sightings], clip: Clip, near: float) -> int | None:
    """Which track is the clip's person in most frames; None where none is in any."""
    motion, has_pose = seen_motion(clip)
    pelvis_px = project_cam(motion.pelvis_m, camera_of(clip).intrinsics_px)
    counts = []
    for track in tracks:
        rows = rows_of_numbers(clip.image_numbers, track.image_numbers)
        off_px = np.linalg.norm(track.image_px[:, HIPS].mean(axis=1) - pelvis_px[rows], axis=1)
        known = (rows >= 0) & has_pose[rows]
        counts.append(int((known & (off_px < near * track.crops[:, 2])).sum()))
    best = int(np.argmax(counts)) if counts else 0
    return best if counts and counts[best] else None


def rows_between(rows: np.ndarray, n_rows: int) -> Between:
    """Rows that a track's frames are of (N,), -1 for none, to all rows of the clip."""
    frames = np.flatnonzero(rows >= 0)
    between = between_known(rows[frames], np.arange(n_rows))
    return replace(between, before=frames[between.before], after=frames[between.after])


def crops_between(crops: np.ndarray, between: Between) -> np.ndarray:
    """Crops (N, 4) of a track at all rows; from 179 to -179 degrees they turn by 2."""
    return between.placed(np.column_stack([crops[:, :3], np.unwrap(crops[:, 3])]))


def posed_clip(clip: Clip, poses: LocalPoses, between: Between, body: BodyModel) -> Clip:
    """The estimator's poses at a clip's rows, in the camera's frame, on a body of mean shape."""
    seen = Motion(
        local_rotmats=poses.local_rotmats,
        root_rotmats=poses.root_rotmats,
        pelvis_m=poses.pelvis_m,
        shape=np.zeros(body.n_shape),
        fps_hz=clip.motion.fps_hz,
        body=body.name,
        gender="neutral",
        frame="camera",
        source=f"{ESTIMATOR}, of the images of {clip.id}",
    )
    everywhere = np.ones(clip.motion.n_frames, bool)
    return Clip(clip.id, between.moved(seen), everywhere, clip.image_numbers, camera=None)


def write_keypoints(folder: Path, clip: Clip, track: Sightings, between: Between) -> None:
    """OpenPose's JSON of each of a clip's images.  What lies outside the picture is not seen."""
    camera = camera_of(clip)
    size_px = np.array([camera.width_px, camera.height_px])
    points_px, visibility = between.placed(track.image_px), between.placed(track.visibility)
    inside = ((points_px >= 0) & (points_px <= size_px)).all(axis=-1)
    seen = np.dstack([points_px, visibility * inside])
    keypoints = np.zeros((len(seen), N_KEYPOINTS, 3))
    for keypoint, names in OPENPOSE_LANDMARKS.items():
        of = seen[:, [LANDMARKS.index(name) for name in names]]
        keypoints[:, keypoint, :2] = of[..., :2].mean(axis=1)
        keypoints[:, keypoint, 2] = of[..., 2].min(axis=1)
    for number, frame in zip(clip.image_numbers.tolist(), keypoints, strict=True):
        person = {"person_id": [-1], "pose_keypoints_2d": frame.ravel().round(4).tolist()}
        write_json(folder / f"{number:012d}_keypoints.json", {"version": 1.3, "people": [person]})
