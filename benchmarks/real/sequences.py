"""A case made into files: frames, masks, the intrinsics that are given, and the truth."""

import shutil
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from real.cases import Case, MaskKind
from real.clips import RealClip
from real.pictures import Film

from gmrdata.people.sources import MasksConfig, OnnxSource, PersonSource, make_masks, masks_seconds
from gmrdata.read.frames import read_color, read_frames
from gmrdata.read.models import POSE_LANDMARKS

JPEG_QUALITY = 95
JOINED_FRAMES = 60
"""Frames of the second clip where two are joined."""


@dataclass(frozen=True, eq=False)
class RealSequence:
    """What is handed to the camera stage, and what is right."""

    images_dir: Path
    masks_dir: Path | None
    masks_s: float
    """Time that the masks took [s]."""
    intrinsics_px: np.ndarray
    """(3, 3) as they are given [px]."""
    fps_hz: float
    max_speed_m_per_s: float
    still: bool
    """Whether the true camera stays in place."""
    world_from_cam: np.ndarray
    """(T, 4, 4) true cameras [m]; NaN where they are not known."""
    takes: np.ndarray
    """(T,) which take a frame belongs to: cameras of different takes have no relation."""


def make_sequence(case: Case, clips_dir: Path, detector: Path, out_dir: Path) -> RealSequence:
    """Write a case's frames and masks.

    Args:
        detector: YOLOX in an ONNX file; BlazePose lies beside it under its published name.
    """
    clip, rng = RealClip(clips_dir / case.clip), np.random.default_rng(case.seed)
    rows = np.arange(len(clip.images))[slice(*case.part)]
    if case.rows is not None:
        rows = rows[case.rows(len(rows), rng)]
    images, cameras = [clip.images[row] for row in rows], clip.world_from_cam[rows]
    takes = np.zeros(len(rows), dtype=int)
    if case.joined_to is not None:
        other = RealClip(clips_dir / case.joined_to)
        images += other.images[:JOINED_FRAMES]
        cameras = np.concatenate([cameras, other.world_from_cam[:JOINED_FRAMES]])
        takes = np.append(takes, np.ones(len(other.images[:JOINED_FRAMES]), dtype=int))
    images_dir = out_dir / "frames"
    intrinsics_px = _write(images, case, clip.intrinsics_px, images_dir, rng)
    intrinsics_px[[0, 1], [0, 1]] *= case.focal
    masks_dir, masks_s = _masks(case.masks, images_dir, detector, out_dir / "masks")
    facts = clip.facts
    return RealSequence(
        images_dir=images_dir,
        masks_dir=masks_dir,
        masks_s=masks_s,
        intrinsics_px=intrinsics_px,
        fps_hz=facts.fps_hz / case.part[2],
        max_speed_m_per_s=facts.max_speed_m_per_s,
        still=facts.still,
        world_from_cam=cameras,
        takes=takes,
    )


def _write(
    images: list[Path], case: Case, intrinsics_px: np.ndarray, out_dir: Path,
    rng: np.random.Generator,
) -> np.ndarray:  # fmt: skip
    """Frames under consecutive numbers, unchanged ones copied as they are; their intrinsics."""
    out_dir.mkdir(parents=True)
    if case.change is None and case.joined_to is None:
        for row, image in enumerate(images):
            shutil.copyfile(image, out_dir / f"{row:05d}{image.suffix}")
        return intrinsics_px.copy()
    pictures = [read_color(image) for image in images]
    size_px = pictures[0].shape[1::-1]
    film = Film([cv2.resize(picture, size_px) for picture in pictures], intrinsics_px, rng)
    film = film if case.change is None else case.change(film)
    for row, picture in enumerate(film.images):
        quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        cv2.imwrite(str(out_dir / f"{row:05d}.jpg"), picture, quality)
    return film.intrinsics_px.copy()


def _masks(
    kind: MaskKind, images_dir: Path, detector: Path, out_dir: Path
) -> tuple[Path | None, float]:
    if kind == "none":
        return None, 0.0
    make_masks(read_frames(images_dir), out_dir, masks_config(kind, detector))
    return out_dir, masks_seconds(out_dir)


def masks_config(kind: MaskKind, detector: Path) -> MasksConfig:
    """Where masks of a kind come from."""
    if kind == "boxes":
        return MasksConfig(sources=(OnnxSource(model=detector),))
    landmarks = detector.with_name(POSE_LANDMARKS.name)
    return MasksConfig(sources=(PersonSource(model=detector, landmarks=landmarks),))
