"""Lay out the real clips for `--clips`, from clones of the repositories that carry them.

    python benchmarks/real/layout.py CLONES CLIPS --shared ../shared/data

CLONES holds one clone per repository, named as below.  Nothing of it is committed here, and what is
not free for all uses is for measuring alone.  `PYTHONPATH=benchmarks` finds what the measurements
share.

dance: nerfstudio-project/viser, examples/assets/record3d_dance, here as `video/dance.tar`;
  Apache-2.0.  A dancer before a phone in the hand; ARKit's cameras.
kitti_1, kitti_2: niconielsen32/ComputerVision, VisualOdometry/KITTI_sequence_{1,2}, 51 frames each;
  KITTI, CC BY-NC-SA 3.0.  Drives.
kitchen: andyzeng/tsdf-fusion-python, data, the first 300 of 1000 frames of Microsoft's 7-Scenes;
  BSD-2-Clause, the data for non-commercial use.  A Kinect in the hand; KinectFusion's cameras.
  They drift: over 300 frames COLMAP's models are 3.2 to 3.6 % and 1.6 to 2.6 degrees from them,
  with the given lens or a freed one, but 0.6 % and 0.9 degrees from each other.  Only the first
  100 frames are solved, over which the two are near enough.
fox: NVlabs/instant-ngp, data/nerf/fox, 50 of 115 frames; NVIDIA's licence, non-commercial.  A phone
  that goes round a stuffed fox; COLMAP's cameras, in a unit of their own; its lens has k1 = 0.058.
static_people: `video/static_people`, MIT.  People before a phone that is held still.
dog: `video/dog.mp4`, Apache-2.0.  A camera that goes round a dog; true cameras not known.

To clone: `git clone https://github.com/<owner>/<name> CLONES/<name>`.
"""

import argparse
import json
import shutil
import tarfile
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from evo.core.trajectory import PoseTrajectory3D
from evo.tools import file_interface
from real.clips import CAMERAS_FILE, FACTS_FILE, FRAMES_FOLDER, Facts

HAND_M_PER_S, CAR_M_PER_S = 8.0, 40.0
KITCHEN_FRAMES = 300
OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


def main() -> None:
    """Lay out every clip whose source is there, and name those whose isn't."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clones", type=Path, help="folder of clones")
    parser.add_argument("clips", type=Path, help="folder to make")
    parser.add_argument("--shared", type=Path, required=True, help="folder with video/")
    given = parser.parse_args()
    video, odometry = given.shared / "video", given.clones / "ComputerVision" / "VisualOdometry"
    kitchen = given.clones / "tsdf-fusion-python" / "data"
    for name, source, lay_out in (
        ("dance", video / "dance.tar", lay_out_dance),
        ("kitti_1", odometry / "KITTI_sequence_1", lay_out_kitti),
        ("kitti_2", odometry / "KITTI_sequence_2", lay_out_kitti),
        ("kitchen", kitchen, lay_out_kitchen),
        ("fox", given.clones / "instant-ngp" / "data" / "nerf" / "fox", lay_out_fox),
        ("static_people", video / "static_people", lay_out_static_people),
        ("dog", video / "dog.mp4", lay_out_dog),
    ):
        if not source.exists():
            print(f"{name}: no {source}")  # noqa: T201
            continue
        shutil.rmtree(given.clips / name, ignore_errors=True)
        (given.clips / name / FRAMES_FOLDER).mkdir(parents=True)
        lay_out(source, given.clips / name)


def lay_out_dance(tar: Path, out_dir: Path) -> None:
    """A dancer before a phone; ARKit's cameras."""
    with tarfile.open(tar) as archive:
        archive.extractall(out_dir / "archive", filter="data")
    folder = out_dir / "archive" / "dance"
    facts = json.loads((folder / "metadata").read_text())
    poses = np.array(facts["poses"])
    _copy([folder / "rgbd" / f"{row}.jpg" for row in range(len(poses))], out_dir)
    shutil.rmtree(out_dir / "archive")
    k = facts["K"]
    _write_facts(
        out_dir,
        (k[0], k[4]),
        (k[6], k[7]),
        source="nerfstudio-project/viser@c300ea26 examples/assets/record3d_dance",
        licence="Apache-2.0",
        fps_hz=facts["fps"],
    )
    trajectory = PoseTrajectory3D(poses[:, 4:], poses[:, [3, 0, 1, 2]], np.arange(len(poses)))
    _write_cameras(out_dir, np.array(trajectory.poses_se3) @ OPENCV_FROM_OPENGL)


def lay_out_kitti(folder: Path, out_dir: Path) -> None:
    """A drive; KITTI's cameras by GPS and inertial sensors."""
    _copy(sorted((folder / "image_l").glob("*.png")), out_dir)
    first_line = (folder / "calib.txt").read_text().splitlines()[0]
    projection = np.array(first_line.split(), dtype=float).reshape(3, 4)
    _write_facts(
        out_dir,
        (projection[0, 0], projection[1, 1]),
        (projection[0, 2], projection[1, 2]),
        source=f"niconielsen32/ComputerVision@37b279fa VisualOdometry/{folder.name}",
        licence="KITTI: CC BY-NC-SA 3.0",
        fps_hz=10.0,
        max_speed_m_per_s=CAR_M_PER_S,
    )
    rows = np.loadtxt(folder / "poses.txt").reshape(-1, 3, 4)
    _write_cameras(out_dir, np.concatenate([rows, np.tile([[[0, 0, 0, 1]]], (len(rows), 1, 1))], 1))


def lay_out_kitchen(folder: Path, out_dir: Path) -> None:
    """A Kinect that is held before a kitchen; KinectFusion's cameras."""
    images = sorted(folder.glob("frame-*.color.jpg"))[:KITCHEN_FRAMES]
    _copy(images, out_dir)
    _write_facts(
        out_dir,
        # The usual ones of the Kinect's colour camera; those in the folder are its depth camera's.
        (525.0, 525.0),
        (320.0, 240.0),
        source="andyzeng/tsdf-fusion-python@3f22a940 data",
        licence="BSD-2-Clause; 7-Scenes: non-commercial",
        fps_hz=30.0,
    )
    names = [image.name.replace("color.jpg", "pose.txt") for image in images]
    _write_cameras(out_dir, np.array([np.loadtxt(folder / name) for name in names]))


def lay_out_fox(folder: Path, out_dir: Path) -> None:
    """A phone that goes round a stuffed fox; its lens has the distortion that nobody is told."""
    facts = json.loads((folder / "transforms.json").read_text())
    # The list names more frames than the folder holds.
    there = [frame for frame in facts["frames"] if (folder / frame["file_path"]).is_file()]
    frames = sorted(there, key=lambda frame: str(frame["file_path"]))
    _copy([folder / frame["file_path"] for frame in frames], out_dir)
    _write_facts(
        out_dir,
        (facts["fl_x"], facts["fl_y"]),
        (facts["cx"], facts["cy"]),
        source="NVlabs/instant-ngp@abe236e data/nerf/fox",
        licence="NVIDIA Source Code License, non-commercial",
        fps_hz=10.0,
        max_speed_m_per_s=CAR_M_PER_S,
    )
    poses = np.array([frame["transform_matrix"] for frame in frames])
    _write_cameras(out_dir, poses @ OPENCV_FROM_OPENGL)


def lay_out_static_people(folder: Path, out_dir: Path) -> None:
    """People before a phone that is held still; its focal length is a usual one."""
    images = sorted(folder.glob("*.jpg"))
    _copy(images, out_dir)
    _write_facts(
        out_dir, (900.0, 900.0), _middle(images), source="static_people", licence="MIT",
        fps_hz=15.0, still=True,
    )  # fmt: skip


def lay_out_dog(video: Path, out_dir: Path) -> None:
    """A camera that goes round a dog; COLMAP's own focal length."""
    capture = cv2.VideoCapture(str(video))
    images: list[Path] = []
    while True:
        more, picture = capture.read()
        if not more:
            break
        images.append(out_dir / FRAMES_FOLDER / f"{len(images):05d}.jpg")
        cv2.imwrite(str(images[-1]), picture, [cv2.IMWRITE_JPEG_QUALITY, 98])
    _write_facts(
        out_dir, (929.0, 929.0), _middle(images), source="dog.mp4", licence="Apache-2.0",
        fps_hz=30.0,
    )  # fmt: skip


def _copy(images: Sequence[Path], out_dir: Path) -> None:
    for row, image in enumerate(images):
        shutil.copyfile(image, out_dir / FRAMES_FOLDER / f"{row:05d}{image.suffix}")


def _middle(images: Sequence[Path]) -> tuple[float, float]:
    height_px, width_px = np.asarray(cv2.imread(str(images[0]))).shape[:2]
    return width_px / 2, height_px / 2


def _write_facts(
    out_dir: Path,
    focal_px: tuple[float, float],
    centre_px: tuple[float, float],
    *,
    source: str,
    licence: str,
    fps_hz: float,
    max_speed_m_per_s: float = HAND_M_PER_S,
    still: bool = False,
) -> None:
    Facts(
        focal_px=focal_px,
        centre_px=centre_px,
        fps_hz=fps_hz,
        max_speed_m_per_s=max_speed_m_per_s,
        still=still,
        source=source,
        licence=licence,
    ).write(out_dir / FACTS_FILE)


def _write_cameras(out_dir: Path, world_from_cam: np.ndarray) -> None:
    trajectory = PoseTrajectory3D(
        timestamps=np.arange(len(world_from_cam), dtype=float),
        poses_se3=[_orthonormal(pose) for pose in world_from_cam],
    )
    file_interface.write_tum_trajectory_file(out_dir / CAMERAS_FILE, trajectory)


def _orthonormal(pose: np.ndarray) -> np.ndarray:
    """Files keep few digits; evo asks for rotations."""
    u, _, vt = np.linalg.svd(pose[:3, :3])
    return np.block([[u @ vt, pose[:3, 3:]], [np.zeros((1, 3)), np.ones((1, 1))]])


if __name__ == "__main__":
    main()
