"""Real clips with known cameras, as `--clips FOLDER` holds them and `layout.py` lays them out.

    FOLDER/<clip>/clip.json        what `Facts` lists
                  frames/          00000.jpg, 00001.jpg, ... of one size
                  cameras.tum      frame, x y z [m], quaternion x y z w of world_from_cam (OpenCV)

`cameras.tum` is missing where the true cameras are not known.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from evo.tools import file_interface

from gmrdata.read.frames import list_images
from gmrdata.values.records import Record

FACTS_FILE, CAMERAS_FILE, FRAMES_FOLDER = "clip.json", "cameras.tum", "frames"
CLIPS = ("dance", "kitti_1", "kitti_2", "kitchen", "fox", "static_people", "dog")
FEWEST_CLIPS = 5


class Facts(Record):
    """`clip.json`."""

    format: Literal["gmrdata-bench-clip/1"] = "gmrdata-bench-clip/1"
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    fps_hz: float
    max_speed_m_per_s: float
    """What a camera of its kind does at most: 8 in a hand, more on a car."""
    still: bool
    """Whether the camera is known to stay in place."""
    source: str
    """Repository, commit and path."""
    licence: str


@dataclass(frozen=True)
class RealClip:
    """One clip."""

    folder: Path
    """Its folder."""

    @cached_property
    def facts(self) -> Facts:
        """What is known of it."""
        return Facts.read(self.folder / FACTS_FILE)

    @cached_property
    def images(self) -> list[Path]:
        """T frames in order."""
        return list_images(self.folder / FRAMES_FOLDER)

    @property
    def intrinsics_px(self) -> np.ndarray:
        """(3, 3) calibration matrix [px]."""
        (fx, fy), (cx, cy) = self.facts.focal_px, self.facts.centre_px
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])

    @cached_property
    def world_from_cam(self) -> np.ndarray:
        """(T, 4, 4) true cameras [m]; NaN where they are not known."""
        cameras, path = np.full((len(self.images), 4, 4), np.nan), self.folder / CAMERAS_FILE
        if self.facts.still:
            cameras[:] = np.eye(4)
        elif path.is_file():
            trajectory = file_interface.read_tum_trajectory_file(path)
            cameras[trajectory.timestamps.astype(int)] = trajectory.poses_se3
        return cameras


def missing_clips(folder: Path) -> list[str]:
    """Names of the clips that a folder lacks."""
    return [name for name in CLIPS if not (folder / name / FACTS_FILE).is_file()]
