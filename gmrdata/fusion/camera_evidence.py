"""Evidence of the camera: poses of a clip with their errors, and feet that stand."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from gmrdata.fusion.smoothing import FusedPoses, PlantedFeet, SeenMotions, SeenPoses
from gmrdata.motion.resample import valid_runs
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip
from gmrdata.values.motion import Motion, without_root
from gmrdata.values.people import BODIES
from gmrdata.values.records import Config
from gmrdata.world.bodies import BODIES_FILE, BodiesRecord
from gmrdata.world.planted_feet import SOLE_POINTS, foot_points_m

ROBUST = 1.4826  # from the median of absolute values to a standard deviation
FEWEST_STEPS = 10  # of three known frames equally far apart, behind a measured noise
FURTHEST_S = 0.2  # of those three: over longer steps the network's own error hides the noise
A_STEP_S = 0.5  # of a walk: a pose made up between two that are nearer is about right


class FusionConfig(Config):
    """How far cameras, feet and loops are believed."""

    place_floor_m: float = Field(default=0.002, gt=0)
    """Least noise of a camera's pelvis from frame to frame, if less is measured [m]."""
    turn_floor_deg: float = Field(default=0.2, gt=0)
    place_unmeasured_m: float = Field(default=0.01, gt=0)
    """The same where known frames are too few to measure it, as of the built-in estimator: too wide
    an error bar does less harm than one of a noise that nobody saw [m]."""
    turn_unmeasured_deg: float = Field(default=2.0, gt=0)
    place_sigma_m: float | None = Field(default=None, gt=0)
    """That noise [m]; None to measure it beside the network's motions, along and across the ray."""
    turn_sigma_deg: float | None = Field(default=None, gt=0)
    slow_place_m: float = Field(default=0.01, ge=0)
    """Error of camera and body that lasts from frame to frame [m]."""
    slow_along_share: float = Field(default=0.0, ge=0)
    """The same along the camera's ray, as a share of the distance, if that is more."""
    slow_time_s: float = Field(default=0.5, gt=0)
    """Time in which it forgets itself to 1/e [s]."""
    lasting_place_m: float = Field(default=0.0, ge=0)
    """Error of a person's place that lasts, along each axis; it widens error bars alone [m]."""
    slow_turn_deg: float = Field(default=0.5, ge=0)
    unseen_widening: float = Field(default=3.0, ge=1)
    """Factor on the network's error where the person was not seen though the camera is known: the
    pose is made up between its neighbours then."""
    pace_share: float = Field(default=0.0, ge=0)
    """Error of the network's pace that lasts for seconds, as a share of it, besides the one that
    was measured: of poses whose steps are too short."""
    like_poses: bool = True
    """Whether the network's error where cameras see the person is taken for its error in like
    poses that they don't see."""
    feet: bool = True
    """Whether planted feet stand still."""
    planted_m_per_s: float = Field(default=0.15, gt=0)
    """Speed below which a foot's point may be planted, by the network's motion [m/s]."""
    slip_m_per_s: float = Field(default=0.2, gt=0)
    """Standard deviation of a planted point's speed: errors of the legs' joints [m/s]."""
    slip_time_s: float = Field(default=0.5, gt=0)
    """Time over which such an error lasts [s]."""
    ground: bool = True
    """Whether planted feet are on the ground, z = 0; not where the world's record has steps."""
    ground_sigma_m: float = Field(default=0.04, gt=0)
    """Standard deviation of a planted point's height over a step or stance [m]."""


OWN_FUSION = FusionConfig(
    place_sigma_m=0.01,
    turn_sigma_deg=2.0,
    pace_share=0.35,
    slow_place_m=0.02,
    slow_along_share=0.03,
    lasting_place_m=0.03,
    slow_turn_deg=8.0,
)
"""For poses of the built-in estimator: on real people its distance is off by 1.5 to 3 % for a third
of a second at a time, and hips by 3.4 cm across the ray, most of which lasts, as landmarks are not
quite the body's joints (docs/figures.md); and a network sees a third less of a walker's pace in its
poses."""


def fusion_config_of(source: Path) -> FusionConfig:
    """What suits the people of a video's folder, of its pseudo ground truth, or of a clip in there,
    by who saw them."""
    source = source.absolute()
    folder = source.parent if source.is_file() else source
    for near in (folder, folder.parent):
        record = near / BODIES / BODIES_FILE
        if record.is_file() and BodiesRecord.read(record).estimator == "gmrdata":
            return OWN_FUSION
    return FusionConfig()


@dataclass(frozen=True, eq=False)
class Noise:
    """Of camera poses, independent from frame to frame."""

    along_m: float  # the camera's ray to the pelvis
    across_m: float
    turn_rad: float


def seen_poses(clip: Clip, noise: Noise, config: FusionConfig) -> SeenPoses:
    """The poses of a clip's valid frames; a frame without a camera is not known."""
    known = known_frames(clip)
    covariances = np.tile(noise.across_m**2 * np.eye(3), (len(known), 1, 1))
    rays = _rays(clip)
    more = noise.along_m**2 - noise.across_m**2
    covariances[known] += more * rays[known, :, None] * rays[known, None]
    turn_sigma_rad = np.full(len(known), noise.turn_rad)
    motion = clip.motion
    return SeenPoses(
        motion.root_rotmats,
        motion.pelvis_m,
        known,
        turn_sigma_rad,
        covariances,
        _shift_m(clip, known, config),
        config.slow_time_s,
    )


def known_frames(clip: Clip) -> np.ndarray:
    """(T,) bool: frames with a valid motion and a camera; none where the clip has no cameras."""
    if clip.camera is None:
        return np.zeros(clip.motion.n_frames, dtype=bool)
    return clip.valid & clip.camera.has_camera


def unseen_frames(clip: Clip) -> np.ndarray:
    """(T,) bool: frames with a camera whose motion can't be used."""
    if clip.camera is None:
        return ~clip.valid
    return ~clip.valid & clip.camera.has_camera


def hidden_frames(seen: np.ndarray, fps_hz: float) -> np.ndarray:
    """(T,) bool: frames in which nobody saw the person, by (T,), for longer than a step takes: the
    pose between its neighbours skips steps then."""
    hidden = ~seen
    for start, stop in valid_runs(hidden):
        if stop - start <= A_STEP_S * fps_hz:
            hidden[start:stop] = False
    return hidden


@dataclass(frozen=True)
class WorldErrors:
    """What is wrong with a whole world, by one standard error."""

    scale_share: float = 0.0  # of the cameras' path, as a share
    distance_share: float = 0.0  # of the person's distance from the camera: size and lens
    level_deg: float = 0.0  # of the angle between z and up, both axes together
    floor_at_m: tuple[float, float] | None = None
    """x and y of those who say where z = 0 is, where the person may stand on something else; None
    of who stands on it."""
    floor_sigma_m: float = 0.0  # of the height of z = 0


EXACT = WorldErrors()


def error_bars(
    poses: FusedPoses, clip: Clip, config: FusionConfig, errors: WorldErrors
) -> dict[str, np.ndarray]:
    """Standard deviations (T, 3): `place_sigma_m` in world axes, `camera_sigma_m` of the place seen
    from the camera, in its axes, and `turn_sigma_deg` about the root's axes.

    Those of the graph, and what no mean over frames lowers.  A world of a wrong scale is wrong by
    that share of the person's distance from the middle of its path, and of the height over the
    floor; before the camera, of the distance from it.  On steps and platforms, the height over
    who stands low has the error of the level in between, and that of how far down one is seen.
    """
    blocks_m2 = poses.place_covariance_m2
    turn_rad2 = np.diagonal(poses.turn_covariance_rad2, axis1=1, axis2=2)
    nowhere = np.full((len(blocks_m2), 3), np.nan)
    known = known_frames(clip)
    if clip.camera is None or not known.any():
        place_m = np.sqrt(np.diagonal(blocks_m2, axis1=1, axis2=2))
        turn_deg = np.rad2deg(np.sqrt(turn_rad2))
        return {"place_sigma_m": place_m, "camera_sigma_m": nowhere, "turn_sigma_deg": turn_deg}
    middle_m = np.append(poses.pelvis_m[known, :2].mean(axis=0), 0.0)
    apart_m = poses.pelvis_m - middle_m
    tilt_rad = np.deg2rad(errors.level_deg) / np.sqrt(2)
    across_m = np.linalg.norm(apart_m[:, :2], axis=1)
    blocks_m2 = blocks_m2 + config.lasting_place_m**2 * np.eye(3)
    whole_m2 = np.diagonal(blocks_m2, axis1=1, axis2=2) + (errors.scale_share * apart_m) ** 2
    whole_m2[:, 2] += (tilt_rad * across_m) ** 2 + errors.floor_sigma_m**2
    if errors.floor_at_m is not None:
        from_floor_m = np.linalg.norm(middle_m[:2] - errors.floor_at_m)
        with_camera = np.flatnonzero(clip.camera.has_camera)  # between them, as high as both
        heights_m = clip.camera.centres_world_m[with_camera, 2]
        camera_m = np.interp(np.arange(len(known)), with_camera, heights_m)
        whole_m2[:, 2] += (tilt_rad * from_floor_m) ** 2
        whole_m2[:, 2] += (errors.distance_share * (camera_m - poses.pelvis_m[:, 2])) ** 2
    lasting_rad2 = np.deg2rad(config.slow_turn_deg) ** 2 + tilt_rad**2
    return {
        "place_sigma_m": np.sqrt(whole_m2),
        "camera_sigma_m": _before_camera_m(blocks_m2, poses, clip, errors.distance_share),
        "turn_sigma_deg": np.rad2deg(np.sqrt(turn_rad2 + lasting_rad2)),
    }


def _before_camera_m(
    blocks_m2: np.ndarray, poses: FusedPoses, clip: Clip, share: float
) -> np.ndarray:
    """Standard deviations (T, 3) of the pelvis seen from the camera; NaN without one."""
    assert clip.camera is not None
    cameras, seen = clip.camera.world_from_cam, clip.camera.has_camera
    found_m = np.full((len(seen), 3), np.nan)
    cam_from_world = cameras[seen, :3, :3].swapaxes(1, 2)
    away_m = poses.pelvis_m[seen] - cameras[seen, :3, 3]
    away_m = (cam_from_world @ away_m[..., None])[..., 0]
    turned_m2 = cam_from_world @ blocks_m2[seen] @ cam_from_world.swapaxes(1, 2)
    own_m2 = np.diagonal(turned_m2, axis1=1, axis2=2)
    found_m[seen] = np.sqrt(own_m2 + (share * away_m) ** 2)
    return found_m


def _shift_m(clip: Clip, known: np.ndarray, config: FusionConfig) -> np.ndarray:
    """(T, 3, 3) what one standard deviation of the slow error about each axis of the camera moves,
    world axes; nothing where the person is not known."""
    shift_m = np.zeros((len(known), 3, 3))
    if clip.camera is None:
        return shift_m
    rays, cameras = _rays(clip)[known], clip.camera.world_from_cam[known]
    away_m = np.linalg.norm(clip.motion.pelvis_m[known] - cameras[:, :3, 3], axis=1)
    more_m = np.maximum(config.slow_along_share * away_m - config.slow_place_m, 0.0)
    along = more_m[:, None, None] * rays[:, :, None] * rays[:, None]
    shift_m[known] = (config.slow_place_m * np.eye(3) + along) @ cameras[:, :3, :3]
    return shift_m


def _rays(clip: Clip) -> np.ndarray:
    """Directions (T, 3) from the camera to the pelvis."""
    if clip.camera is None:
        return np.tile(np.eye(3)[0], (clip.motion.n_frames, 1))
    rays = clip.motion.pelvis_m - clip.camera.centres_world_m
    return np.asarray(rays / np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-9))


def measured_noise(clip: Clip, motions: SeenMotions, config: FusionConfig) -> Noise:
    """Noise of a clip's poses from frame to frame, measured beside a network's motions.

    Both say how far the person goes between frames.  The difference of that from one step to the
    next is `n[t] - 2 n[t+1] + n[t+2]` of independent noise n, and the change of the network's own
    error, whose part is taken off.  The median is not led by outliers.  Where poses are of every
    second frame or so, steps are as long.
    """
    motion, (apart, rows) = clip.motion, _threes(known_frames(clip), clip.motion.fps_hz)
    along_m = across_m = config.place_unmeasured_m
    turn_rad = np.deg2rad(config.turn_unmeasured_deg)
    if len(rows) >= FEWEST_STEPS:
        place_m = config.place_floor_m
        turns, expected_m = _over(motions, apart)
        steps_m = motion.pelvis_m[apart:] - motion.pelvis_m[:-apart]
        off_m = steps_m - (motion.root_rotmats[:-apart] @ expected_m[..., None])[..., 0]
        changes_m, rays = off_m[rows + apart] - off_m[rows], _rays(clip)[rows + apart]
        along = (changes_m * rays).sum(axis=1, keepdims=True)
        across = changes_m - along * rays
        own = _own_change(motions, motion.fps_hz, apart)[rows]
        along_m = _noise(np.abs(along[:, 0]), own[:, 3:], place_m)
        # Two of the three directions are across the ray: the median of a Rayleigh's length.
        lengths = np.linalg.norm(across, axis=1) / 1.1774 / ROBUST
        across_m = _noise(lengths, own[:, 3:], place_m)
        wrong = turns.swapaxes(-1, -2) @ (
            motion.root_rotmats[:-apart].swapaxes(-1, -2) @ motion.root_rotmats[apart:]
        )
        first = Rotation.from_matrix(wrong[rows]).as_rotvec()
        later = Rotation.from_matrix(wrong[rows + apart]).as_rotvec()
        floor_rad = np.deg2rad(config.turn_floor_deg)
        turn_rad = _noise(np.abs(later - first).ravel(), own[:, :3], floor_rad)
    if config.place_sigma_m is not None:
        along_m = across_m = config.place_sigma_m
    if config.turn_sigma_deg is not None:
        turn_rad = np.deg2rad(config.turn_sigma_deg)
    return Noise(float(along_m), float(across_m), float(turn_rad))


def _threes(known: np.ndarray, fps_hz: float) -> tuple[int, np.ndarray]:
    """How many frames apart the closest known ones are of which there are enough threes, and the
    first of each; none where there are too few."""
    for apart in range(1, max(1, int(FURTHEST_S * fps_hz)) + 1):
        rows = np.flatnonzero(known[: -2 * apart] & known[apart:-apart] & known[2 * apart :])
        if len(rows) >= FEWEST_STEPS:
            return apart, rows
    return 1, np.array([], dtype=int)


def _over(motions: SeenMotions, apart: int) -> tuple[np.ndarray, np.ndarray]:
    """Motions from each frame to one so many frames later: turns (T-apart, 3, 3), steps [m]."""
    n = len(motions.delta_m) + 1 - apart
    turns, steps_m = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))
    for i in range(apart):
        steps_m = steps_m + (turns @ motions.delta_m[i : n + i, :, None])[..., 0]
        turns = turns @ motions.delta_rotmats[i : n + i]
    return turns, steps_m


def _noise(sizes: np.ndarray, own: np.ndarray, floor: float) -> float:
    """Standard deviation of the noise n of which `sizes` are |n - 2 n + n|, less `own` variance."""
    variance = (ROBUST * float(np.median(sizes))) ** 2 - float(np.median(own.mean(axis=1)))
    return max(floor, float(np.sqrt(max(variance, 0.0) / 6)))


def _own_change(motions: SeenMotions, fps_hz: float, apart: int) -> np.ndarray:
    """Variance (T, 6) of the change of the network's error from one step to the next, of steps over
    so many frames."""
    at = np.arange(2 * apart)
    signs = np.where(at < apart, -1.0, 1.0)
    lags = np.abs(at[:, None] - at)
    total = np.zeros_like(motions.fast.sigma)
    for process in (motions.fast, motions.slow):
        kept = np.exp(-1 / (fps_hz * process.time_s))
        share = np.einsum("i,ijk,j->k", signs, kept ** lags[..., None], signs)
        total += share * (process.sigma / fps_hz) ** 2
    return total


def planted_feet(
    body: BodyModel, motion: Motion, deltas: tuple[np.ndarray, np.ndarray], config: FusionConfig
) -> PlantedFeet:
    """Points of a person's feet, and when they stand by the network's motions (`held`).

    Joints of a leg err slowly, so a standing point seems to creep one way for a while.  As the
    graph takes steps for independent, each gets the spread that adds up to the same over a stance.
    """
    n, fps_hz = motion.n_frames, motion.fps_hz
    points_m = _points_root_m(body, motion)
    delta_rotmats, delta_m = deltas
    later_m = (delta_rotmats[:, None] @ points_m[1:, ..., None])[..., 0]
    steps_m = later_m + delta_m[:, None] - points_m[:-1]
    still = np.linalg.norm(steps_m, axis=-1) * fps_hz < config.planted_m_per_s
    lasting = np.sqrt(max(1.0, 2 * config.slip_time_s * fps_hz))
    height_sigma_m = config.ground_sigma_m * lasting * np.sqrt(points_m.shape[1])
    return PlantedFeet(
        points_m,
        still[: n - 1],
        config.slip_m_per_s / fps_hz * lasting,
        height_sigma_m if config.ground else None,
    )


def _points_root_m(body: BodyModel, motion: Motion) -> np.ndarray:
    """Heel, ball and toe of both soles (T, 6, 3) from the pelvis, root axes [m]."""
    n = motion.n_frames
    return foot_points_m(body, without_root(motion))[:, :, SOLE_POINTS].reshape(n, -1, 3)
