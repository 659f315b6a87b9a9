"""Which way is up in a motion's world, by what the person does in it.

Readers first take the convention's axis: the zero pose's of a BVH or AMC, z of AMASS.  A person
whose trunk is upright then is left alone.  For anybody else each of the six axes is tried: a body
stands along it, flat feet stay in place under a trunk that moves over them, or soles stop by turns
while the pelvis goes on.  Nobody does that lying, crawling, swimming, hanging or on the hands: feet
are pointed then, slide with the body, or hands carry.
"""

from dataclasses import dataclass, replace

import numpy as np

from gmrdata.motion.ground import soles_of_feet_m, support_m
from gmrdata.motion.resample import valid_runs
from gmrdata.motion.rest_pose import middles, pair, to_left
from gmrdata.read.source_motion import UpAxis, axis_of
from gmrdata.values.body import JOINT, BodyModel
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.motion import Motion, without_root
from gmrdata.values.motion_metrics import speeds_m_per_s
from gmrdata.values.skinning import motion_joints_m
from gmrdata.values.transforms import angles_deg, smallest_rotation

LOOKED_AT_HZ = 30.0
UPRIGHT = 0.75  # cosine of the trunk's tilt, below which it is not held upright
TRUNK_UP, BODY_UP = 0.5, 0.6
"""Cosines of trunk, and of ankles to neck, with an axis along which one stands, bent or not."""
HANDS_UP_M = 0.15  # both wrists so far above the shoulders: hands carry, or a diver's stroke
FLAT_M = 0.06  # points of a flat foot's sole are as high as in the rest pose, to this
STILL_M_PER_S = 0.25  # the fastest point of a planted sole
GOING_M_PER_S = 0.6  # the pelvis of somebody who walks
STOPS, HAND_STOPS = 0.35, 0.15  # a sole in stance, and a hand that carries, over the pelvis's speed
ROLLS_RAD_PER_M = 3.0  # hips that turn more over a metre roll along the ground
LEAST_STANDING = 0.2  # share of the frames, for all of below
STANDING_M = ((0.05, 0.1), (0.2, 0.05))
"""(share of frames with a planted foot, how far the trunk sways over one [m])."""
CARRIED_M = 0.02
"""How much further the pelvis goes over a planted foot than the foot: it is the foot of a person
who lies that moves (30 of 270 made people who lie were turned; no motion of CMU is lost)."""
STEPS, BY_TURNS = 0.1, 0.02  # shares of frames with a sole in stance, and with one foot's alone
LONG, FLAT_FEET = 0.9, 0.5
"""Shares of frames in which one stands along an axis with flat feet, still or lying: who knows."""
FLOOR_M, OFF_FLOOR_M = 0.08, 0.25  # what lies on the floor z = 0 of most files, and what doesn't
MOSTLY, ALWAYS = 0.5, 0.95  # of somebody who walks; runners of CMU have a foot down in 0.92 at most
FASTEST_M_PER_S = 13.0  # of anybody who runs
FASTEST_WALK_M_PER_S = 2.3  # CMU's fastest of 95 walks has 1.9
LARGEST_TILT_DEG = 20.0  # of trunk over feet, on average: at most 11 in CMU's motions
SLIDES_M_PER_S, SLIDES_OVER = 0.4, 2.0
"""Of the lower sole, and over the pelvis's: CMU's highest are 0.65 in a run at 3.3 m/s and 0.3."""
LARGEST_RISE_M = 0.5  # along the axis; a swimmer goes further
_HANDS = [*pair("wrist"), *pair("hand")]
_UP = np.eye(3)[2]  # of a z-up world
LIES = (
    "the person lies or leans throughout. If that is wrong, say with --up which axis of the file "
    "is up: y, z, x, -y, -z or -x"
)

BY_TRUNK = (
    "the zero pose shows no up, nor do the feet: up is the axis along which the trunk is held. If "
    "the person lies or hangs, say with --up which axis of the file is up"
)


@dataclass(frozen=True, eq=False)
class PosedPerson:
    """Joints (T, 24, 3) and points of the left and the right sole (T, P, 3), at some rate."""

    joints_m: np.ndarray
    soles_m: list[np.ndarray]
    rest_soles_m: list[np.ndarray]  # (P,) how high these are in the rest pose
    fps_hz: float

    def speeds(self, points_m: np.ndarray) -> np.ndarray:
        """(T, ...) of points (T, ..., 3) [m/s]."""
        return speeds_m_per_s(points_m, self.fps_hz)

    def slowest(self) -> np.ndarray:
        """(T, 2) speed of the slowest point of the left and of the right sole [m/s]."""
        return np.stack([self.speeds(one).min(axis=1) for one in self.soles_m], axis=1)


@dataclass(frozen=True)
class Standing:
    """How somebody stands along an axis, as shares of all frames but for lengths."""

    standing: float  # trunk and body along it, hands not overhead
    flat: float  # a flat foot lowest of all
    planted: float  # that stays in place
    sway_m: float  # how far the shoulders go over such a foot
    carried_m: float  # how much further the pelvis goes meanwhile than the foot
    steps: float  # a sole in stance while the pelvis goes on
    by_turns: float  # the lesser share of a foot that is so alone
    on_hands: float  # a hand that is so
    rise_m: float  # range of the pelvis along the axis
    sole_m: float  # median place of the lower sole, and of the lowest joint, and of the pelvis
    lowest_m: float
    pelvis_m: float

    @property
    def is_evident(self) -> bool:
        """Whether what the feet do shows that the axis is up."""
        stands = any(self.planted >= a and self.sway_m >= b for a, b in STANDING_M)
        stands &= self.carried_m >= CARRIED_M
        walks = self.steps >= STEPS and self.by_turns >= BY_TURNS
        walks &= self.steps > 2 * self.on_hands
        return self.standing >= LEAST_STANDING and (stands or walks)

    @property
    def is_likely(self) -> bool:
        """Whether somebody who hardly moves may stand along the axis."""
        long = self.standing >= LONG and self.flat >= FLAT_FEET
        return long and self.rise_m < LARGEST_RISE_M


def standing_along(person: PosedPerson, up: np.ndarray) -> Standing:
    """What a person does along an axis (3,)."""
    joints_m = person.joints_m
    heights_m, soles_m = joints_m @ up, person.soles_m
    lowest_m = heights_m.min(axis=1)
    hip_m, shoulders_m, ankle_m = middles(joints_m, "hip", "shoulder", "ankle")
    hands_m = heights_m[:, pair("wrist")].min(axis=1) - shoulders_m @ up
    stands = _cosines(shoulders_m - hip_m, up) > TRUNK_UP
    stands &= _cosines(joints_m[:, JOINT["neck"]] - ankle_m, up) > BODY_UP
    stands &= hands_m < HANDS_UP_M
    sole_m = np.stack([(points_m @ up).min(axis=1) for points_m in soles_m], axis=1)
    tilts_m = [
        np.ptp(points_m @ up - rest_m, axis=1)
        for points_m, rest_m in zip(soles_m, person.rest_soles_m, strict=True)
    ]
    flat = np.stack(tilts_m, axis=1) < FLAT_M
    flat &= stands[:, None] & (sole_m <= lowest_m[:, None] + 0.02)
    speeds = [person.speeds(points_m) for points_m in soles_m]
    planted = flat & np.stack([speed.max(axis=1) < STILL_M_PER_S for speed in speeds], axis=1)
    pelvis_m = joints_m[:, JOINT["pelvis"]]
    feet = [(one.mean(axis=1), rows) for one, rows in zip(soles_m, planted.T, strict=True)]
    sways_m = [_sway_m(_level(shoulders_m - foot_m, up), rows) for foot_m, rows in feet]
    carried_m = [
        _sway_m(_level(pelvis_m, up), rows) - _sway_m(_level(foot_m, up), rows)
        for foot_m, rows in feet
    ]
    going = person.speeds(_level(pelvis_m, up))
    hips_m = _level(to_left(joints_m), up)
    turning = person.speeds(hips_m / np.maximum(np.linalg.norm(hips_m, axis=1), 1e-9)[:, None])
    walks = stands & (going > GOING_M_PER_S) & (turning < ROLLS_RAD_PER_M * going)
    stops = np.stack([speed.min(axis=1) for speed in speeds], axis=1)
    low = sole_m.min(axis=1) <= lowest_m + 0.1
    alone = (stops < STOPS * going[:, None]) & (stops[:, ::-1] > going[:, None])
    held = person.speeds(joints_m[:, _HANDS]).min(axis=1) < HAND_STOPS * going
    return Standing(
        standing=float(stands.mean()),
        flat=float(flat.any(axis=1).mean()),
        planted=float(planted.any(axis=1).mean()),
        sway_m=max(sways_m),
        carried_m=max(carried_m),
        steps=float((walks & low & (stops.min(axis=1) < STOPS * going)).mean()),
        by_turns=float((walks[:, None] & alone).mean(axis=0).min()),
        on_hands=float((walks & held).mean()),
        rise_m=float(np.ptp(pelvis_m @ up)),
        sole_m=float(np.median(sole_m.min(axis=1))),
        lowest_m=float(np.median(lowest_m)),
        pelvis_m=float(np.median(pelvis_m @ up)),
    )


def _cosines(vectors_m: np.ndarray, up: np.ndarray) -> np.ndarray:
    return np.asarray(np.cos(np.deg2rad(angles_deg(vectors_m, up))))


def _level(points_m: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Points (T, 3) without their part along an axis."""
    return np.asarray(points_m - np.outer(points_m @ up, up))


def _sway_m(places_m: np.ndarray, rows: np.ndarray) -> float:
    """The widest range of places (T, 3) over three or more rows in a row that count."""
    runs = [places_m[start:stop] for start, stop in valid_runs(rows) if stop - start >= 3]
    return max((float(np.linalg.norm(np.ptp(run, axis=0))) for run in runs), default=0.0)


def person_of(body: BodyModel, motion: Motion) -> PosedPerson:
    """Where somebody's joints and soles are, at about 30 Hz."""
    step = max(1, round(motion.fps_hz / LOOKED_AT_HZ))
    some = motion.take(slice(None, None, step), motion.fps_hz / step)
    if some.n_frames < 2:  # of a short one that is sampled finely
        some = motion
    at_rest = replace(
        without_root(some.take(slice(1))), local_rotmats=np.eye(3) + np.zeros((1, 23, 3, 3))
    )
    rest_soles_m = [points_m[0, :, 1] for points_m in soles_of_feet_m(body, at_rest)]
    soles_m = soles_of_feet_m(body, some)
    return PosedPerson(motion_joints_m(body, some), soles_m, rest_soles_m, some.fps_hz)


def is_upright(person: PosedPerson) -> bool:
    """Whether somebody is upright: the trunk mostly is, or else the feet show that z is up."""
    return _holds_trunk_up(person) or shows_z_up(person)


def shows_z_up(person: PosedPerson) -> bool:
    """Whether what the feet do shows that z is up."""
    return standing_along(person, _UP).is_evident


def _holds_trunk_up(person: PosedPerson) -> bool:
    hip_m, shoulder_m = middles(person.joints_m, "hip", "shoulder")
    trunk_m = np.median(shoulder_m - hip_m, axis=0)
    return bool(trunk_m[2] >= UPRIGHT * np.linalg.norm(trunk_m))


def walking_m_per_s(person: PosedPerson) -> float:
    """The speed of somebody who walks, with a foot always down, in a z-up world; else 0 [m/s]."""
    going = person.speeds(_level(person.joints_m[:, JOINT["pelvis"]], _UP))
    rows = going > GOING_M_PER_S
    stops = person.slowest().min(axis=1) < STOPS * going
    if rows.mean() < MOSTLY or stops[rows].mean() < ALWAYS:
        return 0.0
    return float(np.median(going[rows]))


def tilt_over_feet_deg(person: PosedPerson) -> float:
    """How far the way from standing feet to the middle of the trunk is off z, on average."""
    feet_m = np.stack([one.mean(axis=1) for one in person.soles_m], axis=1)
    stood_on_m, carried = support_m(feet_m, person.slowest())
    trunk_m = person.joints_m[:, [JOINT["pelvis"], JOINT["neck"]]].mean(axis=1)
    return float(angles_deg(carried @ (trunk_m - stood_on_m), _UP))


def sliding_m_per_s(person: PosedPerson) -> float:
    """The speed of the lower sole of somebody who walks in place; else 0 [m/s]."""
    lows_m = np.stack([one[..., 2].min(axis=1) for one in person.soles_m], axis=1)
    lower = lows_m.argmin(axis=1)[:, None]
    low = float(np.median(np.take_along_axis(person.slowest(), lower, axis=1)))
    pelvis_m = _level(person.joints_m[:, JOINT["pelvis"]], _UP)
    going = float(np.median(person.speeds(pelvis_m)))
    return low if low > max(SLIDES_M_PER_S, SLIDES_OVER * going) else 0.0


def remarks_on(person: PosedPerson, fps_hz: float) -> tuple[str, ...]:
    """What may be wrong with a motion, for who gave the file."""
    remarks: tuple[str, ...] = () if is_upright(person) else (LIES,)
    speeds = person.speeds(person.joints_m[:, JOINT["pelvis"]])
    if (often := float(np.percentile(speeds, 90))) > FASTEST_M_PER_S:
        what = f"goes at {often:.3g} m/s: its path is in another unit, or the frame rate is wrong"
        return (*remarks, f"{what}. Give --unit-m (0.01 for centimetres), or --fps-hz")
    if (tilt_deg := tilt_over_feet_deg(person)) > LARGEST_TILT_DEG and not remarks:
        what = f"leans by {tilt_deg:.0f} degrees over the feet on average: its world is tilted"
        remarks += (
            f"{what}, as before a camera that looks down, or the person leans on something",
        )
    if (slides := sliding_m_per_s(person)) > 0:
        what = f"its feet slide at {slides:.1f} m/s under a pelvis that stays: a walk in place"
        remarks += (f"{what}, or a path that is missing or in another unit than the skeleton",)
    speed_m_per_s = walking_m_per_s(person)
    if speed_m_per_s > FASTEST_WALK_M_PER_S:
        what = f"walks at {speed_m_per_s:.1f} m/s at {fps_hz:g} Hz, which nobody does"
        remarks += (f"{what}. Give the true frame rate with --fps-hz",)
    return remarks


def turn_upright(
    body: BodyModel,
    motion: Motion,
    world_from_file: np.ndarray,
    said: UpAxis | None,
    name: str,
    *,
    refused: bool = True,
) -> tuple[np.ndarray, str] | None:
    """The rotation (3, 3) that makes a motion z-up, and a note; None where it is.

    `world_from_file` (3, 3) are the axes that the reader took.  `said` is the file's axis that a
    person says is up.  BadMotionFile where it can't be told and is `refused`.
    """
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    if said is not None:
        up = world_from_file @ axis_of(said)
        return None if up[2] > 0.5 else (smallest_rotation(up, axes[2]), f"{said} is up (given)")
    person = person_of(body, motion)
    if _holds_trunk_up(person):
        return None
    stands = [standing_along(person, axis) for axis in axes]
    names = [_name_of(axis @ world_from_file) for axis in axes]
    best = max(range(6), key=lambda n: (stands[n].is_evident, stands[n].planted + stands[n].steps))
    if not stands[best].is_evident:
        best = max(range(6), key=lambda n: stands[n].standing)
    lying, along = stands[2], stands[best]
    on_floor = abs(lying.lowest_m) < FLOOR_M and lying.pelvis_m > 0.75 * FLOOR_M
    if best == 2 or (on_floor and abs(along.sole_m) > OFF_FLOOR_M):
        return None
    clear = along.is_likely and abs(along.sole_m) < FLOOR_M and abs(lying.lowest_m) > OFF_FLOOR_M
    if along.is_evident or clear:
        note = f"{names[best]} is up (the feet show it)"
        return smallest_rotation(axes[best], axes[2]), note
    if along.is_likely and refused:
        raise BadMotionFile(
            f"{name}: the person stands still along {names[best]}, or lies; say which axis of the "
            f"file is up: --up {names[best]} or --up {names[2]}"
        )
    return None


def turned(motion: Motion, turn: np.ndarray, note: str) -> Motion:
    """A world motion turned by a rotation (3, 3), which its source says."""
    return replace(
        motion,
        root_rotmats=turn @ motion.root_rotmats,
        pelvis_m=motion.pelvis_m @ turn.T,
        source=f"{motion.source}, {note}",
    )


def _name_of(axis: np.ndarray) -> str:
    k = int(np.abs(axis).argmax())
    return f"{'-' if axis[k] < 0 else ''}{'xyz'[k]}"
