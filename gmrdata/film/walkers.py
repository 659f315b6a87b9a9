"""Where passers-by, company and cars go, clear of everyone.

Each is found by sampling ways until one is clear of the people and the cameras and is seen long
enough.  So the constraints hold exactly, whatever the subject and the camera do.  Cars drive along
straight lines on one side of the place.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gmrdata.motion.resample import hold_pose
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath, in_frame
from gmrdata.values.clip import Clip, camera_of
from gmrdata.values.errors import BadRecipe
from gmrdata.values.motion import Motion
from gmrdata.values.transforms import about_z, rigid

PEOPLE_APART_M = 0.8
"""Between the pelvises of two people, on the ground; a person is about half a metre wide."""
FROM_CAMERA_M = 1.3
HALF_TRUNK_M = 0.25
TRIES = 1500
COMPANY_M = (0.9, 1.5)  # how far company walks from its subject, on average over the clip [m]
COMPANY_FARTHEST_M = 2.0
"""How far it may be in any frame, as long as the subject walks straight on [m]."""
COMPANY_SEEN = 0.8
PASSER_BY_SEEN = (0.15, 1.0)
"""Least share of the frames with a passer-by in the image, or this many seconds if that is less."""
BEHIND_M = 2.5
STANDS_M_PER_S = 0.3
"""A subject that gets away from its start more slowly has no direction that company could take."""
RUN_M_PER_S = 2.0
PACES = (0.5, 1.6)
"""How much slower or faster than drawn a gait may be played to keep up with someone."""


@dataclass(frozen=True, eq=False)
class Shot:
    """Clips that share one place, all with T frames."""

    fps_hz: float
    subjects_m: tuple[np.ndarray, ...]  # (T, 3) pelvis path for each clip, world [m]
    cameras: tuple[CameraPath, ...]
    hold_s: float | None = None  # the others hold the pose of this time [s]; None: they move

    @property
    def n_frames(self) -> int:
        return len(self.subjects_m[0])

    @property
    def duration_s(self) -> float:
        return self.n_frames / self.fps_hz

    @property
    def motion_frames(self) -> int:
        """Frames of a motion that serves: the shot's, and on to a pose to hold that comes later."""
        held = 0 if self.hold_s is None else round(self.hold_s * self.fps_hz) + 1
        return max(self.n_frames, held)

    @property
    def motion_s(self) -> float:
        """How long that is [s]."""
        return self.motion_frames / self.fps_hz

    def sees(self, path_m: np.ndarray, share: float, seconds: float = np.inf) -> bool:
        """Whether each camera sees a point (T, 3) [m] for long enough, not behind its subject.

        That is a share of the frames, but no more of them than a time [s] has.  In less than a
        second, as a dry run probes, nobody gets out from behind another: there it doesn't matter.
        """
        enough = min(share, seconds * self.fps_hz / self.n_frames)
        for camera, subject_m in zip(self.cameras, self.subjects_m, strict=True):
            seen = in_frame(camera, path_m)
            if self.n_frames >= self.fps_hz:
                seen &= ~_is_behind(path_m, subject_m, camera)
            if seen.mean() < enough:
                return False
        return True

    def posed(self, motion: Motion) -> Motion:
        """A motion of `motion_frames` as the shot has it: held in one pose, or as it is."""
        if self.hold_s is None:
            return motion
        return hold_pose(motion, self.hold_s, self.n_frames)


def shot_of(clips: Sequence[Clip], hold_s: float | None = None) -> Shot:
    """The shot of clips with cameras; one that is shorter than the longest rests at its end."""
    frames = np.arange(max(clip.motion.n_frames for clip in clips))
    rows = [(clip, np.minimum(frames, clip.motion.n_frames - 1)) for clip in clips]
    subjects_m = tuple(clip.motion.pelvis_m[own] for clip, own in rows)
    cameras = tuple(camera_of(clip).at_rows(own) for clip, own in rows)
    return Shot(clips[0].motion.fps_hz, subjects_m, cameras, hold_s)


def _is_behind(path_m: np.ndarray, subject_m: np.ndarray, camera: CameraPath) -> np.ndarray:
    """(T,) bool: seen from above, the subject's trunk is in the line of sight to a point."""
    sight_m = (path_m - camera.centres_world_m)[:, :2]
    to_subject_m = (subject_m - camera.centres_world_m)[:, :2]
    far_m = np.maximum(np.linalg.norm(sight_m, axis=1), 1e-9)
    along_m = (to_subject_m * sight_m).sum(axis=1) / far_m
    left_m = np.c_[-sight_m[:, 1], sight_m[:, 0]]
    aside_m = np.abs((to_subject_m * left_m).sum(axis=1)) / far_m
    return np.asarray((along_m > 0) & (along_m < far_m) & (aside_m < HALF_TRUNK_M))


def place_in_sight(
    shot: Shot, row: int, half_width_m: float, reach_m: float, rng: np.random.Generator
) -> tuple[np.ndarray, float]:
    """A place (2,) [m] in line with the first camera and its subject, and the line's angle [rad].
    It is in front as often as behind, where there is room, and at most `reach_m` too far behind."""
    near_m, room_m = FROM_CAMERA_M + half_width_m, PEOPLE_APART_M + half_width_m
    camera_m = shot.cameras[0].centres_world_m[row, :2]
    sight_m = shot.subjects_m[0][row, :2] - camera_m
    distance_m, angle_rad = float(np.linalg.norm(sight_m)), float(np.arctan2(*sight_m[::-1]))
    in_front, share = rng.random() < 0.5, rng.random()
    if in_front and near_m < distance_m - room_m:
        along_m = near_m + share * (distance_m - room_m - near_m)
    else:
        along_m = distance_m + room_m + share * reach_m
    return camera_m + along_m * np.array([np.cos(angle_rad), np.sin(angle_rad)]), angle_rad


def move_motion(motion: Motion, yaw_rad: float, from_m: np.ndarray, to_m: np.ndarray) -> Motion:
    """A world-frame motion turned about the vertical, its point `from_m` (2,) moved to `to_m`."""
    turn = about_z(yaw_rad)
    pelvis_m = (motion.pelvis_m - np.append(from_m, 0.0)) @ turn.T + np.append(to_m, 0.0)
    return replace(motion, root_rotmats=turn @ motion.root_rotmats, pelvis_m=pelvis_m)


def facing_rad(motion: Motion, row: int) -> float:
    """Angle on the ground, from x to y, in which the body faces in a frame [rad]."""
    ahead = motion.root_rotmats[row] @ (0.0, 0.0, 1.0)
    return float(np.arctan2(ahead[1], ahead[0]))


def pass_by(
    name: str, motion: Motion, shot: Shot, others: Sequence[Motion], rng: np.random.Generator
) -> Motion:
    """Place a motion of the shot's length across the first camera's sight of its subject."""
    for _ in range(TRIES):
        row = round(rng.uniform(0.2, 0.8) * (shot.n_frames - 1))
        place_m, sight_rad = place_in_sight(shot, row, 0.0, BEHIND_M, rng)
        across_rad = float(rng.choice([-1, 1]) * rng.uniform(np.deg2rad(40), np.deg2rad(140)))
        yaw_rad = sight_rad + across_rad - facing_rad(motion, row)
        placed = move_motion(motion, yaw_rad, motion.pelvis_m[row, :2], place_m)
        if _is_clear(placed, shot, others) and shot.sees(placed.pelvis_m, *PASSER_BY_SEEN):
            return placed
    raise no_way(name, "give the camera more distance_m")


def no_way(name: str, remedy: str) -> BadRecipe:
    """The error that there is no room for an extra that is to cross the view."""
    return BadRecipe(
        f"no way is free for {name} that keeps {PEOPLE_APART_M} m from people and {FROM_CAMERA_M} m"
        f" from the camera and crosses the view. Ask for fewer extras, another seed, or {remedy}"
    )


def keep_company(
    name: str, shot: Shot, others: Sequence[Motion], body: BodyModel, seed: np.random.SeedSequence
) -> Motion:
    """A gait beside the first subject, in its direction and at its mean speed, as near as can be.
    It goes straight on; beside a subject that stays, or comes back, it steps to and fro.  Where the
    shot holds poses, it stands in one."""
    subject_m = shot.subjects_m[0][:, :2]
    way_m = subject_m[-1] - subject_m[0]
    far_m = float(np.linalg.norm(way_m))
    walked_m = float(np.linalg.norm(np.diff(subject_m, axis=0), axis=1).sum())
    goes = far_m > STANDS_M_PER_S * shot.duration_s and far_m > walked_m / 2
    motion = shot.posed(_gait_at(far_m / shot.duration_s if goes else 0.0, shot, body, seed))
    rng = np.random.default_rng(seed.spawn(1)[0])
    best, least_m = None, np.inf
    for attempt in range(TRIES):
        placed = _beside(motion, subject_m, goes, attempt < TRIES // 2, rng)
        farthest_m = float(np.linalg.norm(placed.pelvis_m[:, :2] - subject_m, axis=1).max())
        nearer = farthest_m < least_m and _is_clear(placed, shot, others)
        if nearer and shot.sees(placed.pelvis_m, COMPANY_SEEN):
            best, least_m = placed, farthest_m
        if least_m <= COMPANY_FARTHEST_M:
            break
    if best is not None:
        return best
    raise BadRecipe(
        f"{name} can't be beside its subject, {PEOPLE_APART_M} m from others and {FROM_CAMERA_M} m "
        f"from the camera, and in view for {COMPANY_SEEN:.0%} of the frames. Give the camera more "
        "distance_m or a wider hfov_deg, or ask for passers_by instead"
    )


def _beside(
    motion: Motion, subject_m: np.ndarray, goes: bool, strict: bool, rng: np.random.Generator
) -> Motion:
    """A motion somewhere round a subject's path (T, 2) [m]; strict: on its side, in parallel."""
    way_m = subject_m[-1] - subject_m[0]
    own_m = motion.pelvis_m[-1, :2] - motion.pelvis_m[0, :2]
    subject_rad = float(np.arctan2(way_m[1], way_m[0]))
    own_rad = float(np.arctan2(own_m[1], own_m[0])) if own_m.any() else facing_rad(motion, 0)
    spread_rad = np.deg2rad(15) if strict else np.pi / 2
    beside_rad = rng.choice([-1, 1]) * (np.pi / 2 + rng.uniform(-1, 1) * spread_rad)
    other_way_rad = 0.0 if strict and goes else rng.uniform(-np.pi, np.pi)
    angle_rad, away_m = subject_rad + beside_rad, rng.uniform(*COMPANY_M)
    offset_m = away_m * np.array([np.cos(angle_rad), np.sin(angle_rad)])
    yaw_rad = subject_rad - own_rad + other_way_rad
    mean_m = motion.pelvis_m[:, :2].mean(axis=0)
    return move_motion(motion, yaw_rad, mean_m, subject_m.mean(axis=0) + offset_m)


def _gait_at(
    speed_m_per_s: float, shot: Shot, body: BodyModel, seed: np.random.SeedSequence
) -> Motion:
    """A gait that serves a shot, with a mean speed, as near as `PACES` allows; 0: to and fro."""
    from gmrdata.motion.gait import make_gait  # slow to load; a clip without company needs none

    def gait(kind: str, duration_s: float, fps_hz: float) -> Motion:
        return make_gait(kind, duration_s, fps_hz, body, np.random.default_rng(seed))

    if speed_m_per_s == 0:
        return gait("side_step", shot.motion_s, shot.fps_hz)
    kind = "run" if speed_m_per_s > RUN_M_PER_S else "walk"
    usual = gait(kind, max(shot.motion_s, 2.0), shot.fps_hz)
    way_m = np.linalg.norm(usual.pelvis_m[-1, :2] - usual.pelvis_m[0, :2])
    usual_m_per_s = float(way_m) * usual.fps_hz / max(usual.n_frames - 1, 1)
    pace = float(np.clip(speed_m_per_s / max(usual_m_per_s, 1e-6), *PACES))
    # The same gait, filmed at another rate and played at the shot's.
    played = gait(kind, shot.motion_s * pace, shot.fps_hz / pace)
    source = f"gmrdata gait {kind} played {pace:.2f} times as fast, not motion capture"
    return replace(played, fps_hz=shot.fps_hz, source=source)


def _is_clear(placed: Motion, shot: Shot, others: Sequence[Motion]) -> bool:
    """Whether someone keeps away, on the ground, from everybody else and from the cameras."""
    rooms = [(path_m, PEOPLE_APART_M) for path_m in shot.subjects_m]
    rooms += [(other.pelvis_m, PEOPLE_APART_M) for other in others]
    rooms += [(camera.centres_world_m, FROM_CAMERA_M) for camera in shot.cameras]
    away_m = [np.linalg.norm((placed.pelvis_m - path_m)[:, :2], axis=1) for path_m, _ in rooms]
    return all(far_m.min() >= room_m for far_m, (_, room_m) in zip(away_m, rooms, strict=True))


CAR_SIZE_M = np.array([4.1, 1.82, 1.45])  # (3,) length, width over the wheels, height of a car [m]
WHEEL_RADIUS_M = 0.31
SPEEDS_M_PER_S = (3.0, 8.0)
HALF_DRIVE_M = 8.5
"""A car comes to rest this far from the middle of its way, so that it stays between the houses."""
BRAKING_M_PER_S2 = 4.5
CAR_SEEN = (0.1, 0.5)
"""Least share of the frames with a car's middle in the image, or this many seconds if less."""
CAR_BEHIND_M = 6.0
BESIDE_M = 5.0
CARS_APART_M = 0.8
CAR_TRIES = 3000


@dataclass(frozen=True, eq=False)
class Drive:
    """A car's way.  Its frame: x ahead, y to its left, z up, the origin on the ground below it."""

    world_from_car: np.ndarray  # (T, 4, 4) rigid transforms [m]
    driven_m: np.ndarray  # (T,) way from the middle of the drive [m]: what the wheels have turned
    middle_m: np.ndarray  # (2,) middle of the drive, world [m]

    @property
    def ahead(self) -> np.ndarray:
        """(2,) unit vector of its direction, world."""
        return np.asarray(self.world_from_car[0, :2, 0])

    @property
    def aside(self) -> np.ndarray:
        """(2,) unit vector to its left, world."""
        return np.array([-self.ahead[1], self.ahead[0]])

    @property
    def centres_m(self) -> np.ndarray:
        """(T, 3) middle of the body, world [m]."""
        return self.world_from_car[:, :3, 3] + [0.0, 0.0, CAR_SIZE_M[2] / 2]

    @property
    def ground_m(self) -> np.ndarray:
        """(N, 2) points of the lane it needs, its whole drive long [m]."""
        reach_m = HALF_DRIVE_M + CAR_SIZE_M[0] / 2
        along_m = np.linspace(-reach_m, reach_m, 41)
        middle_m = self.middle_m + along_m[:, None] * self.ahead
        return np.concatenate([middle_m + y * self.aside for y in (-0.5, 0.5)])


def way_driven_m(time_s: np.ndarray, speed_m_per_s: float) -> np.ndarray:
    """Way from the middle (T,) [m] at times before and after it [s], at constant speed but for a
    start from rest and a stop `HALF_DRIVE_M` from the middle."""
    braking_m = speed_m_per_s**2 / (2 * BRAKING_M_PER_S2)
    even_s = (HALF_DRIVE_M - braking_m) / speed_m_per_s
    since_s = np.abs(time_s)
    slow_s = np.clip(since_s - even_s, 0.0, speed_m_per_s / BRAKING_M_PER_S2)
    way_m = speed_m_per_s * (np.minimum(since_s, even_s) + slow_s)
    return np.sign(time_s) * (way_m - BRAKING_M_PER_S2 / 2 * slow_s**2)


def drive_past(
    name: str,
    shot: Shot,
    people_m: Sequence[np.ndarray],
    cars: Sequence[Drive],
    rng: np.random.Generator,
) -> Drive:
    """A drive across the first camera's line of sight, clear of everyone: paths (T, 3) and cars.

    It is parallel to the longer side of the area that everyone covers: a street runs along that.
    Where nothing can cross, as in a street that is filmed along its length, it passes beside.
    """
    walked_m = [path[:, :2] for path in (*shot.subjects_m, *people_m)]
    filmed_m = [camera.centres_world_m[:, :2] for camera in shot.cameras]
    covered_m = np.concatenate([*walked_m, *filmed_m, *(car.ground_m for car in cars)])
    axis = int(np.ptp(covered_m[:, 1]) > np.ptp(covered_m[:, 0]))
    for attempt in range(CAR_TRIES):
        drive = _sample_drive(shot, axis, 0.0 if attempt < CAR_TRIES // 2 else BESIDE_M, rng)
        sides_m = np.ptp(np.concatenate([covered_m, drive.ground_m]), axis=0)
        if (
            sides_m[axis] > sides_m[1 - axis] + 1.0
            and all(car_distance_m(drive, path).min() >= PEOPLE_APART_M for path in walked_m)
            and all(car_distance_m(drive, path).min() >= FROM_CAMERA_M for path in filmed_m)
            and all(_pass_each_other(drive, car) for car in cars)
            and shot.sees(drive.centres_m, *CAR_SEEN)
        ):
            return drive
    raise no_way(name, "a camera that moves less")


def car_distance_m(drive: Drive, path_m: np.ndarray) -> np.ndarray:
    """(T,) distance on the ground from the car's sides to a moving point (T, 2) [m]; 0 inside."""
    away_m = path_m - drive.world_from_car[:, :2, 3]
    local_m = np.abs(np.stack([away_m @ drive.ahead, away_m @ drive.aside], axis=-1))
    return np.asarray(np.linalg.norm(np.maximum(local_m - CAR_SIZE_M[:2] / 2, 0.0), axis=1))


def _sample_drive(shot: Shot, axis: int, beside_m: float, rng: np.random.Generator) -> Drive:
    """Through a place in sight, shifted by up to `beside_m` across the drive."""
    row = round(rng.uniform(0.2, 0.8) * (shot.n_frames - 1))
    middle_m, _ = place_in_sight(shot, row, CAR_SIZE_M[1] / 2, CAR_BEHIND_M, rng)
    middle_m[1 - axis] += rng.uniform(-beside_m, beside_m)
    turn = np.round(about_z(axis * np.pi / 2 + np.pi * int(rng.integers(2))))
    time_s = (np.arange(shot.n_frames) - row) / shot.fps_hz
    driven_m = way_driven_m(time_s, float(rng.uniform(*SPEEDS_M_PER_S)))
    places_m = np.append(middle_m, 0.0) + driven_m[:, None] * turn[:, 0]
    return Drive(rigid(turn, places_m), driven_m, middle_m)


def _pass_each_other(drive: Drive, other: Drive) -> bool:
    """Both are parallel to the same side of the place."""
    away_m = np.abs(drive.world_from_car[:, :2, 3] - other.world_from_car[:, :2, 3])
    along = int(abs(drive.ahead[1]) > 0.5)
    room_m = away_m[:, [along, 1 - along]] - CAR_SIZE_M[:2]
    return bool((room_m.max(axis=1) >= CARS_APART_M).all())
