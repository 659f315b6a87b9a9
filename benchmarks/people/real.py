"""Real people whose truth something else measured: a man before four cameras, and a dancer.

`../shared/data/real/README.md` says what each file is.  Cameras are solved and people are followed
once and kept in the output folder, so that poses and worlds can be measured again at little cost.
"""

import shutil
import tarfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from networks import networks_in, own_people
from poses.world import WORLD

from gmrdata.cameras.lens.intrinsics import GivenIntrinsics
from gmrdata.people.following import load_tracks
from gmrdata.people.landmark_body import HIPS, SeenLandmarks
from gmrdata.people.local_poses import seen_landmarks
from gmrdata.read.frames import read_frames
from gmrdata.solve.request import FOLLOWED, FRAMES, OWN_POSES
from gmrdata.solve.videos import solve_video
from gmrdata.values.camera import Lens
from gmrdata.values.files import write_bytes
from gmrdata.values.transforms import apply, invert, rigid

VIEWS = ("cam01", "cam02", "cam03", "cam04")
TWELVE_25B = list(range(5, 17))
"""Shoulders, elbows, wrists, hips, knees, ankles of OpenPose's BODY_25B."""
TWELVE = [16, 17, 18, 19, 20, 21, 1, 2, 4, 5, 7, 8]
"""The same joints of SMPL's tree."""
DANCE = "dance"
VIEW_HZ, DANCE_HZ = 60.0, 30.0
OFF_PERSON_M = 0.5
"""Distance of the hips' landmarks from the true hips up to which a track is the man's."""


@dataclass(frozen=True, eq=False)
class View:
    """The man before one camera."""

    name: str
    lens: Lens
    up: np.ndarray  # (3,) in the camera's axes
    level_from_cam: np.ndarray  # (4, 4) to the true world, z up and the floor at z = 0
    true_m: np.ndarray  # (T, 12, 3) before the camera


@dataclass(frozen=True, eq=False)
class Dance:
    """The dancer's cameras, and LiDAR, every 4th frame."""

    lens: Lens
    world_from_cam: np.ndarray  # (T, 4, 4)
    up: np.ndarray  # (3,) of that world
    floor_m: float  # its height along it
    shirt_m: np.ndarray  # (T, 3) the middle of the shirt's surface there; NaN where it is hidden
    rows: np.ndarray  # (N,) frames
    depth_m: np.ndarray  # (N, 256, 192); NaN where LiDAR is unsure or off the shirt


def view_of(real_dir: Path, name: str, *, beside: bool = False) -> View:
    """One camera's truth, also of `Demo_MultiPerson`, which has somebody rendered beside him."""
    with np.load(real_dir / "pose2sim" / "reference3d.npz") as file:
        truth = dict(file)
    n = VIEWS.index(name)
    size_px = (1080, 1920) if n < 2 and not beside else (1088, 1920)
    radial = float(truth["D"][n][0]), float(truth["D"][n][1])
    cam_from_world = rigid(truth["R"][n], truth["T"][n])
    return View(
        name,
        Lens.of_matrix(truth["K"][n], size_px, radial),
        truth["R"][n][:, 2],
        invert(cam_from_world),
        apply(cam_from_world, truth["X"][:, TWELVE_25B]),
    )


def dance_of(real_dir: Path) -> Dance:
    """The dancer's truth."""
    with np.load(real_dir / "dance_lidar.npz") as file:
        truth = dict(file)
    shirt = np.unpackbits(truth["shirt_px"], axis=-1).astype(bool)
    sure = shirt & (truth["depth_confidence"] == 2) & (truth["depth_mm"] > 0)
    lens = Lens((717.06, 717.06), (359.24, 485.18), (720, 960))
    return Dance(
        lens=lens,
        world_from_cam=truth["world_from_cam"],
        up=truth["up"] / np.linalg.norm(truth["up"]),
        floor_m=float(truth["floor_height_m"]),
        shirt_m=truth["shirt_world_m"],
        rows=truth["depth_frames"],
        depth_m=np.where(sure, truth["depth_mm"] / 1000, np.nan),
    )


def solved(
    data_dir: Path,
    name: str,
    out_dir: Path,
    height_m: float | None = None,
    beside_dir: Path | None = None,
) -> Path:
    """What `gmrdata video` leaves of a view, whose lens is told, or of the dancer.

    People's world is made anew, and their poses unless it is for another height.  `beside_dir` has
    the views of `Demo_MultiPerson`.
    """
    config = own_people(networks_in(data_dir / "models"))
    for made in (*WORLD, *([OWN_POSES] if height_m is None else [])):
        shutil.rmtree(out_dir / made, ignore_errors=True)
    if name == DANCE:
        source, lens = _dance_frames(data_dir, out_dir), None
    else:
        source = (beside_dir or data_dir / "real" / "pose2sim") / f"{name}.mp4"
        view = view_of(data_dir / "real", name, beside=beside_dir is not None)
        lens = GivenIntrinsics(file=_calibration(data_dir, view, out_dir))
    fps_hz = DANCE_HZ if name == DANCE else None
    solve_video(
        source, out_dir, poses="own", lens=lens, fps_hz=fps_hz, height_m=height_m, config=config
    )
    return out_dir


def write_lens(path: Path, size_px: tuple[int, int], numbers: Iterable[float]) -> Path:
    """A lens as COLMAP writes it: focal lengths, principal point, k1, k2, p1 and p2."""
    text = " ".join(f"{number:.12g}" for number in numbers)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(path, f"1 OPENCV {size_px[0]} {size_px[1]} {text}\n".encode())
    return path


def _calibration(data_dir: Path, view: View, out_dir: Path) -> Path:
    """A view's lens."""
    with np.load(data_dir / "real" / "pose2sim" / "reference3d.npz") as file:
        matrix_px, bent = file["K"][VIEWS.index(view.name)], file["D"][VIEWS.index(view.name)]
    numbers = [matrix_px[0, 0], matrix_px[1, 1], *matrix_px[:2, 2], *bent.ravel()[:4]]
    path = out_dir.with_name(f"{out_dir.name}_lens") / "cameras.txt"
    return write_lens(path, view.lens.size_px, numbers)


def _dance_frames(data_dir: Path, out_dir: Path) -> Path:
    folder = out_dir.with_name("dance_frames")
    if not folder.is_dir():
        with tarfile.open(data_dir / "video" / "dance.tar") as tar:
            for member in tar:
                if member.name.endswith(".jpg") and (content := tar.extractfile(member)):
                    path = folder / f"{int(Path(member.name).stem):05d}.jpg"
                    path.parent.mkdir(parents=True, exist_ok=True)
                    write_bytes(path, content.read())
    return folder


def tracks_of(solved_dir: Path, lens: Lens) -> list[tuple[SeenLandmarks, np.ndarray]]:
    """Everybody's landmarks and frames."""
    own = solved_dir / FRAMES
    frames = read_frames(own if own.is_dir() else solved_dir.with_name("dance_frames"))
    frames = frames.with_rate(None if own.is_dir() else DANCE_HZ)
    return [
        (seen_landmarks(track, frames.numbers, frames, lens), track.image_numbers)
        for track in load_tracks(solved_dir / FOLLOWED)
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
