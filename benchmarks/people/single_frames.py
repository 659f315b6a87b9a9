"""Other real people with motion-captured joints: one picture each of Human3.6M and MPI-INF-3DHP.

They lie in `tests/data` of open-mmlab/mmpose (Apache-2.0; pictures by the terms of their data sets)
with joints before the camera and calibrations.  Each is shown as a video of one picture, so nothing
but the picture tells of the person.
"""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from networks import networks_in, own_people
from people.real import TWELVE, write_lens
from poses.score import aligned_mm

from gmrdata.cameras.lens.intrinsics import GivenIntrinsics
from gmrdata.read.frames import read_color
from gmrdata.read.safe_pickle import load_plain
from gmrdata.solve.videos import solve_video
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import camera_of, load_clip
from gmrdata.values.people import BODIES, PSEUDO_GT, person_file
from gmrdata.values.skinning import motion_joints_m
from gmrdata.values.transforms import angles_deg
from gmrdata.world.judge import load_record

COPIES, FPS_HZ = 12, 30.0
TWELVE_H36M = [11, 14, 12, 15, 13, 16, 4, 1, 5, 2, 6, 3]
TWELVE_3DHP = [5, 2, 6, 3, 7, 4, 11, 8, 12, 9, 13, 10]
"""Limbs, left before right, in mmpose's orders of the two data sets."""


@dataclass(frozen=True, eq=False)
class SingleFrame:
    """A picture, its camera's calibration, and its person."""

    name: str
    image: Path
    camera: dict[str, Any]
    up: np.ndarray | None  # (3,) in the camera's axes; None where nobody says
    true_m: np.ndarray  # (12, 3) before the camera


@dataclass(frozen=True)
class FrameRow:
    """What was found of one picture's person; joints are the 12 of limbs."""

    name: str
    accepted: bool | None
    """None where nobody was seen."""
    pa_mm: float | None = None
    mpjpe_mm: float | None = None
    distance_ratio: float | None = None
    """Of the hips' depth over the true one: people are of any size."""
    level_deg: float | None = None
    said_deg: float | None = None


def single_frames(folder: Path) -> Iterator[SingleFrame]:
    """The pictures of mmpose's `tests/data`."""
    h36m, hp = folder / "h36m", folder / "mpi_inf_3dhp"
    cameras = load_plain(h36m / "cameras.pkl")
    with np.load(h36m / "test_h36m_body3d.npz") as file:
        for name, joints in zip(file["imgname"], file["S"], strict=True):
            subject, number = name.split("/")[0], name.split("/")[1].split(".")[1]
            camera = cameras[subject, number]
            true_m = joints[TWELVE_H36M, :3]
            yield SingleFrame(
                f"h36m_{subject}", h36m / name, camera, np.ravel(camera["R"][2]), true_m
            )
    for part in ("train", "test"):
        cameras = load_plain(hp / f"cameras_{part}.pkl")
        with np.load(hp / f"test_3dhp_{part}.npz") as file:
            for name, joints in zip(file["imgname"], file["S"], strict=True):
                camera = cameras["_".join(name.split("_")[:-1])]
                up = np.ravel(camera["R"][1]) if "R" in camera else None
                subject = f"3dhp_{name.split('_')[0]}"
                yield SingleFrame(subject, hp / name, camera, up, joints[TWELVE_3DHP, :3])


def frame_row(one: SingleFrame, out_dir: Path, models_dir: Path, body: BodyModel) -> FrameRow:
    """Solve a picture's video, which is made anew, and hold its person against the truth."""
    shutil.rmtree(out_dir, ignore_errors=True)
    frames = out_dir / "frames"
    frames.mkdir(parents=True)
    for number in range(COPIES):
        shutil.copyfile(one.image, frames / f"{number:05d}{one.image.suffix}")
    solved = out_dir / "solved"
    solve_video(
        frames,
        solved,
        poses="own",
        lens=GivenIntrinsics(file=_calibration(one, out_dir / "cameras.txt")),
        fps_hz=FPS_HZ,
        config=own_people(networks_in(models_dir)),
    )
    if not (solved / PSEUDO_GT).is_dir():
        return FrameRow(one.name, None)
    quality = load_record(solved / PSEUDO_GT)
    hips_m = one.true_m[6:8].mean(axis=0)

    def joints_m(number: int) -> np.ndarray:
        clip = load_clip(solved / BODIES / person_file(number))
        return motion_joints_m(body, clip.motion)[COPIES // 2, TWELVE]

    def apart(number: int) -> float:
        found_m = joints_m(number)[6:8].mean(axis=0)
        return float(np.linalg.norm(found_m[:2] / found_m[2] - hips_m[:2] / hips_m[2]))

    number = min(range(len(quality.people)), key=apart)
    found_m = joints_m(number)
    found_hips_m = found_m[6:8].mean(axis=0)
    off_m = (found_m - found_hips_m) - (one.true_m - hips_m)
    level_deg = None
    if one.up is not None:
        camera = camera_of(load_clip(solved / PSEUDO_GT / person_file(number)))
        level_deg = float(angles_deg(camera.world_from_cam[0, :3, :3] @ one.up, np.eye(3)[2]))
    return FrameRow(
        one.name,
        quality.people[number].accepted,
        pa_mm=float(aligned_mm(found_m[None], one.true_m[None])[0]),
        mpjpe_mm=float(1000 * np.linalg.norm(off_m, axis=1).mean()),
        distance_ratio=float(found_hips_m[2] / hips_m[2]),
        level_deg=level_deg,
        said_deg=None if quality.level is None else quality.level.sigma_deg,
    )


def _calibration(one: SingleFrame, path: Path) -> Path:
    height_px, width_px = read_color(one.image).shape[:2]
    parts = [np.ravel(one.camera[key]) for key in ("f", "c")]
    parts += [np.ravel(one.camera.get(key, (0.0, 0.0)))[:2] for key in ("k", "p")]
    return write_lens(path, (width_px, height_px), np.concatenate(parts))
