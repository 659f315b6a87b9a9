"""Rendered people who sit, who are down on the floor, and who are half hidden by a board.

Parts of CMU's trials 14_31 and 127_31, and clips of `make bench-poses` with the board drawn in.
"""

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from video.clips import CLIP_FILE, FACTS_FILE, FRAMES_FOLDER, HAND, Take, render_clips

from gmrdata.read.bodies import load_body
from gmrdata.read.frames import list_images
from gmrdata.values.camera import project_cam
from gmrdata.values.clip import camera_of, load_clip
from gmrdata.values.skinning import motion_joints_m
from gmrdata.world.compose import motion_in_camera

LOW: dict[str, tuple[str, str, tuple[float, float]]] = {
    "room_sit": ("wide", "14_31", (2.6, 6.2)),
    "courtyard_floor": ("usual", "127_31", (0.9, 4.2)),
}
"""Lens, trial and its part [s] of each clip."""
HIDDEN = ("courtyard_walk", "park_walk")
CMU_HZ, SEED, DURATION_S = 120, 23, 2.6
ROUND: dict[str, Any] = {"kind": "circular", "rate_deg_per_s": 15.0} | HAND
BOARD_BGR = (95, 105, 110)
HALF_WIDTH_M, BELOW_HIPS_M, BELOW_FEET_M = 0.45, 0.05, 0.12


def make_low_clips(folder: Path, shared_data: Path, pose_clips: Path) -> list[Path]:
    """Render and draw what is not there yet; the clips' folders."""
    motions = folder / "motions"
    for name, (lens, trial, part_s) in LOW.items():
        if not (folder / name / FACTS_FILE).is_file():
            _cut(shared_data, folder / "whole", motions, trial, part_s)
            take = Take(name, "trial", SEED, DURATION_S, motions)
            render_clips({name: (lens, trial, ROUND)}, folder, folder / "rendered" / name, take)
    for name in HIDDEN:
        if not (folder / f"{name}_hidden" / FACTS_FILE).is_file():
            _hide_legs(pose_clips / name, folder / f"{name}_hidden")
    return [folder / name for name in (*LOW, *(f"{name}_hidden" for name in HIDDEN))]


def _cut(
    shared_data: Path, whole: Path, motions: Path, trial: str, part_s: tuple[float, float]
) -> None:
    """A part of an AMC file, beside its skeleton, and not beside the whole one."""
    for what in ([], ["more"]):
        subprocess.run([str(shared_data / "unpack"), str(whole), *what], check=True)
    amc = next(whole.rglob(f"{trial}.amc"))
    head, *rest = re.split(r"^(?=\d+\s*$)", amc.read_text(), flags=re.MULTILINE)
    frames = rest[round(part_s[0] * CMU_HZ) : round(part_s[1] * CMU_HZ)]
    motions.mkdir(parents=True, exist_ok=True)
    (motions / amc.name).write_text(head + "".join(frames))
    shutil.copy(amc.with_name(f"{trial.split('_')[0]}.asf"), motions)


def _hide_legs(clip_dir: Path, out_dir: Path) -> None:
    """The clip with a board before the person's legs."""
    shutil.copytree(clip_dir, out_dir, ignore=shutil.ignore_patterns(FACTS_FILE))
    clip = load_clip(out_dir / CLIP_FILE)
    camera = camera_of(clip)
    seen = motion_in_camera(clip.motion, camera.world_from_cam)
    joints_m = motion_joints_m(load_body("anny"), seen)
    joints_px = project_cam(joints_m, camera.intrinsics_px)
    per_m = camera.intrinsics_px[0, 0] / joints_m[:, 0, 2]
    top = joints_px[:, 1:3, 1].mean(axis=1) + BELOW_HIPS_M * per_m
    bottom = joints_px[:, 7:12, 1].max(axis=1) + BELOW_FEET_M * per_m
    middle, half = joints_px[:, 0, 0], HALF_WIDTH_M * per_m
    corners = np.stack([middle - half, top, middle + half, bottom], axis=-1).round().astype(int)
    images = list_images(out_dir / FRAMES_FOLDER)
    for path, (left, over, right, under) in zip(images, corners.tolist(), strict=True):
        image = cv2.imread(str(path))
        assert image is not None
        cv2.rectangle(image, (left, over), (right, under), BOARD_BGR, cv2.FILLED)
        cv2.imwrite(str(path), image, [cv2.IMWRITE_JPEG_QUALITY, 92])
    shutil.copy(clip_dir / FACTS_FILE, out_dir)
