"""A twin on disk: rendered frames and exact clips as a faulty sequence of 3DPW, the truth aside."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gmrdata.read.frames import check_images
from gmrdata.read.threedpw_layout import SequenceFiles, require_name
from gmrdata.threedpw.world_sequence import sequence_arrays
from gmrdata.twins.faults import (
    UNCHANGED,
    ExposureConfig,
    FaultConfig,
    KeypointConfig,
    dataset_side,
    detected_keypoints,
    exposed_jpeg,
    exposure_gains,
)
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, camera_of, save_clip
from gmrdata.values.errors import BadFrames
from gmrdata.values.files import atomic_path, write_npz
from gmrdata.values.records import Config
from gmrdata.write.threedpw import write_sequence


class TwinConfig(Config):
    """How a twin's dataset side differs from the truth."""

    faults: FaultConfig = FaultConfig()
    """Errors of world, cameras and bodies."""
    keypoints: KeypointConfig = KeypointConfig()
    exposure: ExposureConfig = ExposureConfig()


@dataclass(frozen=True, eq=False)
class FilmedPeople:
    """Annotated people of a rendered sequence."""

    clips: Sequence[Clip]
    """Exact world-frame clips at 30 Hz, one per person, with the camera that was rendered."""
    frames: Sequence[Path]
    genders: Sequence[str]
    """"female" or "male" per person; letters in the file, without effect on the body."""
    body: BodyModel


def write_twin(
    files: SequenceFiles,
    filmed: FilmedPeople,
    truth_dir: Path,
    config: TwinConfig,
    rng: np.random.Generator,
    image_dir: Path | None = None,
) -> SequenceFiles:
    """Write one twin.  The sequence file comes last, so one that exists has all that belongs to it.

    `truth_dir` gets the exact clips as `<name>.p<person>.npz`, and the exposure's `gains` (N,) as
    `<name>.exposure.npz`.

    Args:
        files: Where it goes.
        image_dir: Where to write the images; the sequence's own folder when left out.
    """
    from gmrdata.values.skinning import motion_joints_m

    require_name(files.name)
    name, clips, body, frames = files.name, filmed.clips, filmed.body, filmed.frames
    # Of the exact people: detectors look at the image, which has no drift.
    joints_m = [motion_joints_m(body, clip.motion) for clip in clips]
    keypoints_px = [
        detected_keypoints(of_person, camera_of(clip), config.keypoints, rng)
        for of_person, clip in zip(joints_m, clips, strict=True)
    ]
    faulty = dataset_side(clips, config.faults, rng)
    arrays = sequence_arrays(name, faulty, [body] * len(faulty), filmed.genders, keypoints_px)
    _require_frames(name, clips[0], frames)
    gains = exposure_gains(len(frames), clips[0].motion.fps_hz, config.exposure, rng)
    write_npz(truth_dir / f"{name}.exposure.npz", {"gains": gains})
    for row, frame in enumerate(frames):
        with atomic_path((image_dir or files.image_dir) / files.image_path(row).name) as temporary:
            content = frame.read_bytes()
            if config.exposure.gain != UNCHANGED:
                content = exposed_jpeg(content, float(gains[row]), config.exposure.jpeg_quality)
            temporary.write_bytes(content)
    for person, clip in enumerate(clips):
        truth = replace(clip, id=f"{name}.p{person}", image_numbers=np.arange(len(frames)))
        rest_pelvis_m = body.rest_pelvis_m(clip.motion.shape)
        save_clip(truth_dir / f"{truth.id}.npz", truth, rest_pelvis_m)
    return write_sequence(files.root, files.split, arrays)


def _require_frames(name: str, clip: Clip, frames: Sequence[Path]) -> None:
    camera = camera_of(clip)
    if len(frames) != camera.n_frames:
        raise BadFrames(f"{name}: {len(frames)} images for {camera.n_frames} frames of {clip.id}")
    for frame in frames:
        if frame.suffix.lower() != ".jpg":
            raise BadFrames(f"{frame}: 3DPW's images are .jpg; render the twin as JPEG")
    width_px, height_px = check_images(list(frames))
    if (width_px, height_px) != (camera.width_px, camera.height_px):
        own = f"the camera of {clip.id} has {camera.width_px}x{camera.height_px} px"
        what = f"{width_px}x{height_px} px, {own}; give the frames that it rendered"
        raise BadFrames(f"{frames[0]}: {what}")
