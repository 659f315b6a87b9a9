"""A twin on disk: rendered frames and exact clips as a faulty sequence of 3DPW, the truth aside."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gmrdata.motion.resample import resample
from gmrdata.read.frames import check_images
from gmrdata.read.threedpw_arrays import FPS_HZ, IMU_HZ, Person, SequenceArrays
from gmrdata.read.threedpw_layout import SequenceFiles, require_name
from gmrdata.threedpw.camera_frame import WORLD_FROM_3DPW
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
from gmrdata.values.errors import BadFrames, BadSequence
from gmrdata.values.files import atomic_path, write_npz
from gmrdata.values.motion import Motion
from gmrdata.values.records import Config
from gmrdata.values.transforms import apply, invert
from gmrdata.write.threedpw import write_sequence

IMU_ROWS = round(IMU_HZ / FPS_HZ)
_3DPW_FROM_WORLD = invert(WORLD_FROM_3DPW)


def sequence_arrays(
    name: str,
    clips: Sequence[Clip],
    body: BodyModel,
    genders: Sequence[str],
    poses2d_px: Sequence[np.ndarray],
) -> SequenceArrays:
    """Arrays of a sequence whose people and camera are given in our z-up world.

    The pelvis becomes SMPL's `trans` and the world y-up here; `camera_clip` and `world_clip` of the
    result are the clips again.  Clips, genders ("female" or "male") and keypoints (N, 18, 3) are
    one per person; clips are at 30 Hz with one camera, and `valid` becomes `campose_valid`.
    """
    camera = camera_of(clips[0])
    _require_one_camera(name, clips)
    people = zip(clips, genders, poses2d_px, strict=True)
    return SequenceArrays(
        name=name,
        intrinsics_px=camera.intrinsics_px.copy(),
        cam_from_world=invert(camera.world_from_cam) @ WORLD_FROM_3DPW,
        img_frame_ids=IMU_ROWS * np.arange(camera.n_frames),
        people=tuple(_person(clip, body, gender, points) for clip, gender, points in people),
    )


def _require_one_camera(name: str, clips: Sequence[Clip]) -> None:
    first = camera_of(clips[0])
    for clip in clips:
        camera = camera_of(clip)
        if clip.motion.frame != "world" or clip.motion.fps_hz != FPS_HZ:
            found = f"is in the {clip.motion.frame} frame at {clip.motion.fps_hz:g} Hz"
            needed = f"a sequence needs the world frame at {FPS_HZ:g} Hz"
            raise BadSequence(f"{name}: clip {clip.id} {found}; {needed}")
        same_path = np.array_equal(camera.world_from_cam, first.world_from_cam)
        same_lens = np.array_equal(camera.intrinsics_px, first.intrinsics_px)
        if not (same_path and same_lens and camera.has_camera.all()):
            found = f"has another camera than {clips[0].id}, or frames without"
            needed = "people of a sequence share one camera"
            raise BadSequence(f"{name}: clip {clip.id} {found}; {needed}")


def _person(clip: Clip, body: BodyModel, gender: str, poses2d_px: np.ndarray) -> Person:
    from gmrdata.values.skinning import motion_joints_m

    motion = clip.motion
    rest_pelvis_m = body.rest_pelvis_m(motion.shape)
    poses_60hz_rad, trans_60hz_m = _poses_and_trans(_at_60hz(motion), rest_pelvis_m)
    to_3dpw = np.broadcast_to(_3DPW_FROM_WORLD, (motion.n_frames, 4, 4))
    return Person(
        poses_rad=poses_60hz_rad[::IMU_ROWS].copy(),
        trans_m=trans_60hz_m[::IMU_ROWS].copy(),
        betas=np.asarray(motion.shape, dtype=np.float64),
        gender=gender,
        campose_valid=clip.valid.copy(),
        poses2d_px=poses2d_px,
        poses_60hz_rad=poses_60hz_rad,
        trans_60hz_m=trans_60hz_m,
        joints_world_m=apply(to_3dpw, motion_joints_m(body, motion)),
        betas_clothed=np.asarray(motion.shape, dtype=np.float64),
        template_clothed_m=body.rest_vertices_m(motion.shape),
    )


def _at_60hz(motion: Motion) -> Motion:
    """The motion at the IMUs' rate, 2N rows: the last one holds, as there is nothing after it."""
    between = resample(motion, IMU_HZ)
    return between.take(np.arange(IMU_ROWS * motion.n_frames).clip(max=between.n_frames - 1))


def _poses_and_trans(motion: Motion, rest_pelvis_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(M, 72) axis-angle and (M, 3) `trans` in the y-up world."""
    to_3dpw = _3DPW_FROM_WORLD[:3, :3]
    rotmats = replace(motion, root_rotmats=to_3dpw @ motion.root_rotmats).rotmats
    rotvecs = Rotation.from_matrix(rotmats.reshape(-1, 3, 3)).as_rotvec()
    trans_m = motion.pelvis_m @ to_3dpw.T - rest_pelvis_m
    return rotvecs.reshape(-1, 72), trans_m


class TwinConfig(Config):
    """How a twin's dataset side differs from the truth."""

    faults: FaultConfig = FaultConfig()
    """Errors of world, cameras and bodies."""
    keypoints: KeypointConfig = KeypointConfig()
    exposure: ExposureConfig = ExposureConfig()


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

    `truth_dir` gets the exact clips as `<name>.p<person>.npz`, and the exposure's `gains` (N,) as
    `<name>.exposure.npz`.

    Args:
        clips: Exact world-frame clips at 30 Hz, one per person, with the camera that was rendered.
        genders: "female" or "male" per person; letters in the file, without effect on the body.
        image_dir: Where to write the images; the sequence's own folder when left out.
    """
    from gmrdata.values.skinning import motion_joints_m

    require_name(name)
    # Of the exact people: detectors look at the image, which has no drift.
    joints_m = [motion_joints_m(body, clip.motion) for clip in clips]
    keypoints_px = [
        detected_keypoints(of_person, camera_of(clip), config.keypoints, rng)
        for of_person, clip in zip(joints_m, clips, strict=True)
    ]
    faulty = dataset_side(clips, config.faults, rng)
    arrays = sequence_arrays(name, faulty, body, genders, keypoints_px)
    _require_frames(name, clips[0], frames)
    files = SequenceFiles(root, name, split)
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
    return write_sequence(root, split, arrays)


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
