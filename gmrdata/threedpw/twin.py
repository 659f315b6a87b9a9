"""A twin on disk: rendered frames and exact clips as a faulty sequence of 3DPW, the truth aside."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip, camera_of, save_clip
from gmrdata.config import Config
from gmrdata.errors import BadFrames
from gmrdata.frames import check_images
from gmrdata.store import atomic_path, write_npz
from gmrdata.threedpw.build import sequence_arrays
from gmrdata.threedpw.exposure import (
    UNCHANGED,
    ExposureConfig,
    exposed_jpeg,
    exposure_gains,
)
from gmrdata.threedpw.faults import FaultConfig, dataset_side
from gmrdata.threedpw.keypoints import KeypointConfig, detected_keypoints
from gmrdata.threedpw.layout import SequenceFiles, require_name
from gmrdata.threedpw.write import write_sequence


class TwinConfig(Config):
    """How a twin's dataset side differs from the truth."""

    faults: FaultConfig = FaultConfig()
    """Errors of world, cameras and bodies."""
    keypoints: KeypointConfig = KeypointConfig()
    """How well the 2D keypoints are detected."""
    exposure: ExposureConfig = ExposureConfig()
    """How the exposure of the images changes."""


def write_twin(
    root: Path,
    split: str,
    name: str,
    clips: Sequence[Clip],
    frames: Sequence[Path],
    genders: Sequence[str],
    body: BodyModel,
    truth_dir: Path,
    config: TwinConfig,
    rng: np.random.Generator,
    *,
    image_dir: Path | None = None,
) -> SequenceFiles:
    """Write one twin.  The sequence file comes last, so one that exists has all that belongs to it.

    Args:
        root: Root of the dataset to write in.
        split: `train`, `validation` or `test`.
        name: Name of the sequence.
        clips: Exact world-frame clips at 30 Hz, one per person, with the camera that was rendered.
        frames: The N images in order, .jpg.
        genders: "female" or "male" per person; letters in the file, without effect on the body.
        body: The body of all clips.
        truth_dir: Where the exact clips are kept, as `<name>.p<person>.npz`, and the exposure's
            `gains` (N,), as `<name>.exposure.npz`.
        config: The faults.
        rng: Source of all faults and keypoints; the same state gives the same bytes.
        image_dir: Where to write the images; the sequence's own folder when left out.

    Returns:
        Where the sequence is.

    Raises:
        BadSequence: the name, the split or the clips do not make a sequence.
        BadFrames: not one whole JPEG of the camera's size per row of the clips.
    """
    require_name(name)
    keypoints_px = [_keypoints(clip, body, config.keypoints, rng) for clip in clips]
    faulty = dataset_side(clips, config.faults, rng)
    arrays = sequence_arrays(name, faulty, body, genders, keypoints_px)
    _require_frames(name, clips[0], frames)
    files = SequenceFiles(root, name, split)
    gains = exposure_gains(len(frames), clips[0].motion.fps_hz, config.exposure, rng)
    write_npz(truth_dir / f"{name}.exposure.npz", {"gains": gains})
    for row, frame in enumerate(frames):
        with atomic_path((image_dir or files.image_dir) / files.image_path(row).name) as temporary:
            temporary.write_bytes(_image(frame, float(gains[row]), config.exposure))
    for person, clip in enumerate(clips):
        truth = replace(clip, id=f"{name}.p{person}", image_numbers=np.arange(len(frames)))
        rest_pelvis_m = body.rest_pelvis_m(clip.motion.shape)
        save_clip(truth_dir / f"{truth.id}.npz", truth, rest_pelvis_m)
    return write_sequence(root, split, arrays)


def _keypoints(
    clip: Clip, body: BodyModel, config: KeypointConfig, rng: np.random.Generator
) -> np.ndarray:
    """Keypoints of the exact person: detectors look at the image, which has no drift."""
    from gmrdata.body.skin import motion_joints_m  # torch; the readers need none

    return detected_keypoints(motion_joints_m(body, clip.motion), camera_of(clip), config, rng)


def _image(frame: Path, gain: float, config: ExposureConfig) -> bytes:
    content = frame.read_bytes()
    if config.gain == UNCHANGED:
        return content
    return exposed_jpeg(content, gain, config.jpeg_quality)


def _require_frames(name: str, clip: Clip, frames: Sequence[Path]) -> None:
    camera = camera_of(clip)
    if len(frames) != camera.n_frames:
        raise BadFrames(f"{name}: {len(frames)} images for {camera.n_frames} frames of {clip.id}")
    for frame in frames:
        if frame.suffix.lower() != ".jpg":
            raise BadFrames(f"{frame}: 3DPW's images are .jpg; render the twin as JPEG")
    width_px, height_px = check_images(list(frames))
    if (width_px, height_px) != (camera.width_px, camera.height_px):
        raise BadFrames(
            f"{frames[0]}: {width_px}x{height_px} px, the camera of {clip.id} has "
            f"{camera.width_px}x{camera.height_px} px; give the frames that it rendered"
        )
