"""The faults of 3DPW put into exact clips: what the dataset says, where the truth is known.

3DPW's camera-frame bodies are nearly right and its world is not: person and camera drift together
(GMR paper, S1).  So a drift D(t) turns world_from_cam into D world_from_cam and the person into
D person, which leaves what the camera sees as it was; small errors of root and joints, and frames
in which the camera was not aligned, come on top.  All of them are band-limited random curves.

The exposure of the images changes as that of a phone's camera that never stops metering: the gain
is one factor of the light for a whole frame.  It wanders, and now and then an automatic exposure
corrects it within a fraction of a second.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import numpy as np
from numpy.random import Generator
from pydantic import Field, model_validator
from scipy.spatial.transform import Rotation

from gmrdata.read.openpose import OPENPOSE_JOINTS
from gmrdata.read.threedpw_files import N_KEYPOINTS
from gmrdata.values.body import N_JOINTS
from gmrdata.values.camera import CameraPath, project_cam
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.errors import BadFrames, BadSequence
from gmrdata.values.records import Config
from gmrdata.values.transforms import apply, invert, rigid, rotmats_from_rotvecs

FEWEST_JOINTS = 6
"""With fewer joints 3DPW gives no keypoints at all."""

N_WAVES = 4
LONGEST_SHARE = 4.0
"""The longest period is this many times the shortest."""


def smooth_noise(
    n_frames: int, fps_hz: float, shortest_period_s: float, n_channels: int, rng: Generator
) -> np.ndarray:
    """Random curves (N, C) without any part that is faster than `shortest_period_s` [s]: each an
    independent sum of sine waves of standard-normal amplitudes."""
    times_s = np.arange(n_frames)[:, None, None] / fps_hz
    shape = (n_channels, N_WAVES)
    periods_s = shortest_period_s * np.exp(rng.uniform(0.0, np.log(LONGEST_SHARE), shape))
    phases_rad = rng.uniform(0.0, 2 * np.pi, shape)
    waves = rng.normal(size=shape) * np.sin(2 * np.pi * times_s / periods_s + phases_rad)
    return np.asarray(waves.sum(axis=2))


def with_peak(vectors: np.ndarray, peak: float) -> np.ndarray:
    """Scale vectors (N, C) so that the longest of the N has the length `peak`."""
    return vectors * (peak / np.linalg.norm(vectors, axis=1).max())


WANDER = 0.5
"""How far the gain wanders to either side, as a share of one correction."""
SMALLEST_SHARE = 0.6
"""A sequence uses at least this share of the range (of its logarithm)."""
UNCHANGED = (1.0, 1.0)


class _Ranges(Config):
    """Settings of which the pairs are (least, most)."""

    @model_validator(mode="after")
    def _are_ranges(self) -> Self:
        for name, value in self:
            if isinstance(value, tuple) and not 0 <= value[0] <= value[1]:
                raise ValueError(f"{name} is {value}: give (least, most), neither below 0")
        return self


class ExposureConfig(_Ranges):
    """How the exposure of a twin's images changes.  Ranges are (least, most)."""

    gain: tuple[float, float] = (0.7, 1.4)
    """Light of the darkest and the brightest frame that there may be, as factors of what was
    rendered.  (1, 1): the images stay as they are, byte for byte."""
    period_s: float = Field(default=3.0, gt=0)
    """The slow part has no shorter period [s]."""
    steps: tuple[int, int] = (1, 2)
    """Corrections of the automatic exposure in a sequence."""
    step_s: tuple[float, float] = (0.15, 0.5)
    """How long a correction takes."""
    jpeg_quality: int = Field(default=92, ge=1, le=100)

    @model_validator(mode="after")
    def _above_zero(self) -> Self:
        if self.gain[0] == 0 or self.step_s[0] == 0:
            raise ValueError("gain and step_s must be above 0")
        return self


def exposure_gains(
    n_frames: int, fps_hz: float, config: ExposureConfig, rng: Generator
) -> np.ndarray:
    """Gain of each frame (N,), inside `config.gain`."""
    slow = smooth_noise(n_frames, fps_hz, config.period_s, 1, rng)
    curve = WANDER * with_peak(slow, 1.0)[:, 0]
    times_s = np.arange(n_frames) / fps_hz
    for _ in range(rng.integers(config.steps[0], config.steps[1] + 1)):
        start_s = rng.uniform(0.1, 0.9) * times_s[-1]
        share = np.clip((times_s - start_s) / rng.uniform(*config.step_s), 0.0, 1.0)
        curve += rng.choice([-1.0, 1.0]) * share**2 * (3 - 2 * share)
    least, most = np.log(config.gain)
    used = (most - least) * rng.uniform(SMALLEST_SHARE, 1.0)
    lowest = rng.uniform(least, most - used)
    unit = (curve - curve.min()) / max(float(np.ptp(curve)), 1e-9)
    # The logarithm's last bits must not take a gain out of its range.
    return np.clip(np.exp(lowest + used * unit), *config.gain)


def exposed_jpeg(content: bytes, gain: float, jpeg_quality: int) -> bytes:
    """The JPEG of a frame as if `gain` times the light had come in; what is too bright is white."""
    import cv2

    image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise BadFrames("a frame cannot be decoded; render it again")
    image = cv2.LUT(image, _table(gain))
    _, encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])
    return encoded.tobytes()


def _table(gain: float) -> np.ndarray:
    """(256,) uint8: what each 8-bit sRGB value becomes (IEC 61966-2-1)."""
    value = np.arange(256) / 255
    light = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    light = np.minimum(gain * light, 1.0)
    value = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.round(255 * value).astype(np.uint8)


DRIFT_TILT_DEG = 30.0
"""The drift turns about an axis within this angle of the vertical: IMUs know gravity, not north."""
LARGEST_WOBBLE = 0.8
"""How unevenly the drift grows; below 1 it never goes back."""


class FaultConfig(_Ranges):
    """Faults of the dataset's side of a twin.  Ranges are (least, most), drawn per clip."""

    drift_m: tuple[float, float] = (0.2, 0.8)
    """Drift of the world over the clip, at the middle of the people's paths."""
    drift_deg: tuple[float, float] = (3.0, 10.0)
    root_error_m: tuple[float, float] = (0.005, 0.010)
    """Largest error of the pelvis in the camera frame over the clip."""
    root_error_deg: tuple[float, float] = (0.25, 0.5)
    root_error_period_s: float = Field(default=4.0, gt=0)
    """Neither error has a part with a shorter period."""
    joint_noise_deg: tuple[float, float] = (2.0, 4.0)
    """Root mean square error of each local joint rotation, drawn per joint."""
    joint_noise_period_s: float = Field(default=2.0, gt=0)
    """It has no part with a shorter period: sensors slip on the body, they don't flicker."""
    invalid_runs: tuple[int, int] = (1, 3)
    """Runs of frames per person in which the camera is not aligned."""
    invalid_frames: tuple[int, int] = (3, 15)
    """Length of such a run."""
    invalid_error_m: tuple[float, float] = (0.1, 0.3)
    """Error of the pelvis in such a run."""


def dataset_side(clips: Sequence[Clip], config: FaultConfig, rng: Generator) -> list[Clip]:
    """What a faulty dataset says of exact clips, one per person, all with the same camera.

    One drift is common to people and camera; each clip has errors of its own in root and joints,
    and unaligned frames that are not `valid`.
    """
    for clip in clips:
        if clip.motion.frame != "world" or not camera_of(clip).has_camera.all():
            what = "a world-frame clip with a camera in each frame"
            raise BadSequence(f"{clip.id}: faults need {what}")
    pivot_world_m = np.mean([clip.motion.pelvis_m.mean(axis=0) for clip in clips], axis=0)
    drifted_from_world = drift(camera_of(clips[0]).n_frames, pivot_world_m, config, rng)
    faulty = []
    for clip in clips:
        clip = with_joint_noise(with_root_error(clip, config, rng), config, rng)
        faulty.append(drifted(with_invalid_frames(clip, config, rng), drifted_from_world))
    return faulty


def drift(
    n_frames: int, pivot_world_m: np.ndarray, config: FaultConfig, rng: Generator
) -> np.ndarray:
    """drifted_from_world (N, 4, 4): identity at first; grows to `drift_m` and `drift_deg`.  Only
    the translation moves the point `pivot_world_m` (3,) [m]."""
    offset_m = rng.uniform(*config.drift_m) * _direction(rng)
    tilt_rad = np.deg2rad(rng.uniform(0, DRIFT_TILT_DEG))
    azimuth_rad = rng.uniform(0.0, 2 * np.pi)
    across = np.array([np.cos(azimuth_rad), np.sin(azimuth_rad), 0.0])
    axis = Rotation.from_rotvec(tilt_rad * across).apply([0.0, 0.0, 1.0])
    turn_rad = np.deg2rad(rng.uniform(*config.drift_deg)) * rng.choice([-1.0, 1.0])
    turns_rad = _growth(n_frames, rng)[:, None] * turn_rad * axis
    rotmats = rotmats_from_rotvecs(turns_rad)
    moves_m = _growth(n_frames, rng)[:, None] * offset_m
    return rigid(rotmats, pivot_world_m - rotmats @ pivot_world_m + moves_m)


def drifted(clip: Clip, drifted_from_world: np.ndarray) -> Clip:
    """The clip with person and camera moved by one drift (N, 4, 4): the camera sees the same."""
    camera, motion = camera_of(clip), clip.motion
    camera = replace(camera, world_from_cam=drifted_from_world @ camera.world_from_cam)
    root_rotmats = drifted_from_world[:, :3, :3] @ motion.root_rotmats
    pelvis_m = apply(drifted_from_world, motion.pelvis_m[:, None])[:, 0]
    motion = replace(motion, root_rotmats=root_rotmats, pelvis_m=pelvis_m)
    return replace(clip, motion=motion, camera=camera)


def with_root_error(clip: Clip, config: FaultConfig, rng: Generator) -> Clip:
    """The clip with a slow error of root position and orientation, as the camera sees them."""
    motion, fps_hz = clip.motion, clip.motion.fps_hz
    waves = smooth_noise(motion.n_frames, fps_hz, config.root_error_period_s, 6, rng)
    offsets_cam_m = with_peak(waves[:, :3], rng.uniform(*config.root_error_m))
    turns_rad = with_peak(waves[:, 3:], np.deg2rad(rng.uniform(*config.root_error_deg)))
    world_from_cam = camera_of(clip).world_from_cam[:, :3, :3]
    # R_wc exp(w) R_cw = exp(R_wc w)
    turns = rotmats_from_rotvecs(_rotate(world_from_cam, turns_rad))
    pelvis_m = motion.pelvis_m + _rotate(world_from_cam, offsets_cam_m)
    erring = replace(motion, root_rotmats=turns @ motion.root_rotmats, pelvis_m=pelvis_m)
    return replace(clip, motion=erring)


def with_joint_noise(clip: Clip, config: FaultConfig, rng: Generator) -> Clip:
    """The clip with a slow error of each of the 23 local joint rotations."""
    motion = clip.motion
    n_frames, n_local = motion.local_rotmats.shape[:2]
    waves = smooth_noise(n_frames, motion.fps_hz, config.joint_noise_period_s, 3 * n_local, rng)
    waves = waves.reshape(n_frames, n_local, 3)
    rms_rad = np.deg2rad(rng.uniform(*config.joint_noise_deg, n_local))
    turns_rad = waves * (rms_rad / np.sqrt((waves**2).sum(axis=2).mean(axis=0)))[:, None]
    noisy = motion.local_rotmats @ rotmats_from_rotvecs(turns_rad)
    return replace(clip, motion=replace(motion, local_rotmats=noisy))


def with_invalid_frames(clip: Clip, config: FaultConfig, rng: Generator) -> Clip:
    """The clip with runs of frames that are not valid, and whose person is elsewhere."""
    valid, pelvis_m = clip.valid.copy(), clip.motion.pelvis_m.copy()
    for _ in range(rng.integers(config.invalid_runs[0], config.invalid_runs[1] + 1)):
        length = int(rng.integers(config.invalid_frames[0], config.invalid_frames[1] + 1))
        start = rng.integers(0, max(1, len(valid) - length + 1))
        run = slice(start, start + length)
        # A run that meets an earlier one leaves its frames as they are, so no error adds up.
        fresh = np.flatnonzero(valid[run]) + start
        pelvis_m[fresh] += rng.uniform(*config.invalid_error_m) * _direction(rng)
        valid[run] = False
    return replace(clip, motion=replace(clip.motion, pelvis_m=pelvis_m), valid=valid)


def _growth(n_frames: int, rng: Generator) -> np.ndarray:
    """(N,) from 0 to 1, never falling, at an uneven rate."""
    share = np.linspace(0.0, 1.0, n_frames)
    wobble = rng.uniform(-LARGEST_WOBBLE, LARGEST_WOBBLE)
    return np.asarray(share + wobble * np.sin(2 * np.pi * share) / (2 * np.pi))


def _direction(rng: Generator) -> np.ndarray:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def _rotate(rotmats: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("nij,nj->ni", rotmats, vectors))


class KeypointConfig(_Ranges):
    """How well the joints are detected."""

    noise_px: float = Field(default=2.0, ge=0)
    """Standard deviation of x and of y."""
    confidence: tuple[float, float] = (0.6, 0.95)
    """Confidence of a joint that is seen is drawn from this range; 3DPW's are like that."""


def detected_keypoints(
    joints_world_m: np.ndarray, camera: CameraPath, config: KeypointConfig, rng: Generator
) -> np.ndarray:
    """Keypoints (N, 18, 3) of a person with joints (N, 24, 3) [m]: x [px], y [px], confidence.

    Joints inside the image have noise, all others are zero.  Occlusion is not looked at: OpenPose
    guesses hidden joints too.
    """
    if joints_world_m.shape != (camera.n_frames, N_JOINTS, 3):
        raise ValueError(f"joints {joints_world_m.shape} for {camera.n_frames} cameras")
    rows = list(OPENPOSE_JOINTS)
    joints_m = joints_world_m[:, list(OPENPOSE_JOINTS.values())]
    points_px = project_cam(apply(invert(camera.world_from_cam), joints_m), camera.intrinsics_px)
    points_px = points_px + rng.normal(0.0, config.noise_px, points_px.shape)
    confidence = rng.uniform(*config.confidence, points_px.shape[:2])
    seen = ((points_px >= 0) & (points_px < (camera.width_px, camera.height_px))).all(axis=-1)
    seen &= (seen.sum(axis=1) >= FEWEST_JOINTS)[:, None]
    keypoints = np.zeros((camera.n_frames, N_KEYPOINTS, 3))
    keypoints[:, rows, :2] = np.where(seen[..., None], points_px, 0.0)
    keypoints[:, rows, 2] = np.where(seen, confidence, 0.0)
    return keypoints
