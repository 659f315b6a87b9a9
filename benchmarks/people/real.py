"""Real people whose truth something else measured: a man before four cameras, and a dancer.

`../shared/data/real/README.md` says what each file is.  People are followed once for each network
and kept in the output folder, so that poses can be measured again at no cost.
"""

import tarfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gmrdata.people.following import FollowConfig, Networks, follow_people, load_tracks
from gmrdata.people.landmark_body import HIPS, SeenLandmarks
from gmrdata.people.local_poses import seen_landmarks
from gmrdata.read.frames import read_frames
from gmrdata.read.video import as_frames
from gmrdata.values.camera import Lens
from gmrdata.values.files import write_bytes
from gmrdata.values.frame_set import FrameSet
from gmrdata.values.transforms import apply, rigid

VIEWS = ("cam01", "cam02", "cam03", "cam04")
TWELVE_25B = list(range(5, 17))
"""Shoulders, elbows, wrists, hips, knees, ankles of OpenPose's BODY_25B."""
TWELVE = [16, 17, 18, 19, 20, 21, 1, 2, 4, 5, 7, 8]
"""The same joints of SMPL's tree."""
VIEW_HZ, DANCE_HZ = 60.0, 30.0
OFF_PERSON_M = 0.5
"""Distance of the hips' landmarks from the true hips up to which a track is the man's."""


@dataclass(frozen=True, eq=False)
class View:
    """The man before one camera."""

    name: str
    lens: Lens
    true_m: np.ndarray  # (T, 12, 3) before the camera


@dataclass(frozen=True, eq=False)
class Dance:
    """The dancer's LiDAR, every 4th frame."""

    lens: Lens
    rows: np.ndarray  # (N,) frames
    depth_m: np.ndarray  # (N, 256, 192); NaN where LiDAR is unsure or off the shirt


def view_of(real_dir: Path, name: str) -> View:
    """One camera's truth."""
    with np.load(real_dir / "pose2sim" / "reference3d.npz") as file:
        truth = dict(file)
    n = VIEWS.index(name)
    size_px = (1080, 1920) if n < 2 else (1088, 1920)
    radial = float(truth["D"][n][0]), float(truth["D"][n][1])
    cam_from_world = rigid(truth["R"][n], truth["T"][n])
    return View(
        name,
        Lens.of_matrix(truth["K"][n], size_px, radial),
        apply(cam_from_world, truth["X"][:, TWELVE_25B]),
    )


def dance_of(real_dir: Path) -> Dance:
    """The dancer's truth."""
    with np.load(real_dir / "dance_lidar.npz") as file:
        truth = dict(file)
    shirt = np.unpackbits(truth["shirt_px"], axis=-1).astype(bool)
    sure = shirt & (truth["depth_confidence"] == 2) & (truth["depth_mm"] > 0)
    lens = Lens((717.06, 717.06), (359.24, 485.18), (720, 960))
    return Dance(lens, truth["depth_frames"], np.where(sure, truth["depth_mm"] / 1000, np.nan))


def frames_of(data_dir: Path, name: str, work_dir: Path) -> FrameSet:
    """Frames of a view, or of the dancer (`dance`)."""
    if name != "dance":
        video = data_dir / "real" / "pose2sim" / f"{name}.mp4"
        return as_frames(video, work_dir / name / "frames").with_rate(None)
    folder = work_dir / name / "frames"
    if not folder.is_dir():
        with tarfile.open(data_dir / "video" / "dance.tar") as tar:
            for member in tar:
                if member.name.endswith(".jpg") and (content := tar.extractfile(member)):
                    path = folder / f"{int(Path(member.name).stem):05d}.jpg"
                    path.parent.mkdir(parents=True, exist_ok=True)
                    write_bytes(path, content.read())
    return read_frames(folder).with_rate(DANCE_HZ)


def tracks_of(
    data_dir: Path, name: str, work_dir: Path, lens: Lens, network: str
) -> list[tuple[SeenLandmarks, np.ndarray]]:
    """Everybody's landmarks and frames, as a network (`heavy`) sees them."""
    frames = frames_of(data_dir, name, work_dir)
    models = data_dir / "models"
    networks = Networks(models / "yolox_nano.onnx", models / f"pose_landmark_{network}.tflite")
    followed = follow_people(
        frames, work_dir / name / f"followed_{network}", FollowConfig(), networks
    )
    return [
        (seen_landmarks(track, frames.numbers, frames, lens), track.image_numbers)
        for track in load_tracks(followed)
    ]


def on_the_man(
    tracks: list[tuple[SeenLandmarks, np.ndarray]], true_m: np.ndarray
) -> tuple[SeenLandmarks, np.ndarray]:
    """The track that is on the man in most frames."""

    def frames_on(one: tuple[SeenLandmarks, np.ndarray]) -> int:
        seen, rows = one
        hips_m = true_m[rows][:, 6:8].mean(axis=1)
        off = seen.rays[:, HIPS].mean(axis=1) - hips_m[:, :2] / hips_m[:, 2:]
        return int((np.linalg.norm(off, axis=1) * hips_m[:, 2] < OFF_PERSON_M).sum())

    return max(tracks, key=frames_on)
