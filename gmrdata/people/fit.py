"""The fit: a body laid onto a track's landmarks, up to 600 frames at once, until it stands still.

Least squares with few outliers (Geman and McClure 1987): landmarks in the picture, how much nearer
to the camera than the hips the network has them, second differences over time, how far joints turn,
and the pose prior.  A network that sees a crop takes each part as it looks along its own ray: feet
that stand 0.9 m below the hips and 2.5 m away look tilted back, and it has them 0.15 m further
away.  Levenberg and Marquardt's steps; a frame hangs on the two after it alone, so that the
equations of all frames are a narrow band (Cholesky).  All is in metres and seconds and each frame
adds to every term alike, so a video at 15 and at 60 Hz gets the same motion.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from gmrdata.people.landmark_body import (
    HANGS_ON,
    HIPS,
    TURNS_WITH,
    SeenLandmarks,
    from_hips,
    landmarks_on,
    offsets_of,
)
from gmrdata.people.landmark_network import LANDMARKS, N_LANDMARKS, TRUNK, to_the_left
from gmrdata.people.pose_prior import N_PRIOR, PRIOR_JOINTS, prior_by_turn, prior_errors
from gmrdata.values.body import JOINT, JOINT_NAMES, N_JOINTS, PARENTS
from gmrdata.values.records import Config
from gmrdata.values.skinning import posed_joints_m
from gmrdata.values.transforms import cross_matrices, slerp


class FitConfig(Config):
    """What each term of the fit is weighed by: its usual size."""

    image: float = Field(default=0.08, gt=0)
    """Landmarks in the picture, in the person's size."""
    depth_m: float = Field(default=0.21, gt=0)
    """Distances beside that of the hips, by the network [m]."""
    depth_share: float = Field(default=0.8, gt=0, le=1)
    """What is believed of them beside the slope of the whole body: errors make depths larger than
    they are, and a body that is as deep stands too near."""
    acceleration: float = Field(default=12.0, gt=0)
    """Of landmarks about the hips [m/s2]."""
    pelvis_acceleration: float = Field(default=8.0, gt=0)
    """Of the pelvis across the camera's axis [m/s2]."""
    depth_acceleration: float = Field(default=2.0, gt=0)
    """Of the pelvis along it [m/s2]: people's sizes tell little of it, and change as they bend."""
    turn_acceleration: float = Field(default=40.0, gt=0)
    """Of the pelvis's orientation [rad/s2]: hips are near to each other, and hardly tell of it."""
    prior: float = Field(default=0.05, ge=0)
    """How much the pose prior (`gmrdata.people.pose_prior`) counts: little, as frames are alike."""
    rest: float = Field(default=1.0, gt=0)
    """How far joints turn from their rest pose; larger lets them turn more."""
    stop_share: float = Field(default=1e-5, gt=0)
    """Gain of a step that ends the fit, as a share of what is left.  At ten times as much a track
    stopped 10 cm too far away, where steps bring it along frame by frame."""
    most_steps: int = Field(default=200, ge=1)


@dataclass(frozen=True, eq=False)
class FittedPose:
    """The body at each of the T frames."""

    rotmats: np.ndarray  # (T, 24, 3, 3), the root's in the camera's axes
    pelvis_m: np.ndarray  # (T, 3) before the camera
    energies: np.ndarray  # (T,) what is left of landmarks, limits and prior; motion is not in it
    converged: bool


_REST_WEIGHTS = {
    "spine1": 1.5, "spine2": 1.5, "spine3": 1.5, "neck": 1.0, "head": 1.0,
    "left_collar": 3.0, "right_collar": 3.0, "left_wrist": 0.5, "right_wrist": 0.5,
    "left_hip": 0.05, "right_hip": 0.05, "left_knee": 0.0, "right_knee": 0.0,
    "left_ankle": 0.1, "right_ankle": 0.1, "pelvis": 0.0,
}  # fmt: skip
"""How much a joint is drawn to its rest pose; shoulders and elbows little, and legs hardly: who
stands with bent knees stood on straighter legs, and so 4 cm below the floor."""
_WEIGHTS = np.array([_REST_WEIGHTS.get(name, 0.15) for name in JOINT_NAMES])
SAME_TIME = 4.0  # landmarks of a frame err together: so many of them tell as much as one
OUTLIER = 9.0  # the most that a landmark costs, or by the prior a frame
SLOPES_S = 1.0  # over which a body slopes alike
SLOPE_NOISE = 0.6  # of a body that does not slope: a share of slopes like it is believed
HINGE_SIDE, HINGE_BACK = 2.0, 40.0
"""Weights of a knee that turns aside, and of a knee or elbow that bends the wrong way."""
WINDOW, OVERLAP = 600, 60  # frames at a time, which is half a gigabyte
NEAREST_M = 0.1

TURNED = tuple(n for n, name in enumerate(JOINT_NAMES) if not name.endswith(("foot", "hand")))
"""Joints that landmarks tell of."""
N_TURNS = 3 * len(TURNED)
N_UNKNOWNS = N_TURNS + 3
BY_PRIOR = np.array([TURNED.index(joint) for joint in PRIOR_JOINTS])


def fit(seen: SeenLandmarks, rest_joints_m: np.ndarray, config: FitConfig) -> FittedPose:
    """Lay a body with rest joints (24, 3) onto a track; metres are along each frame's ray.

    Long tracks are fitted in windows, each of which goes over into the next where they overlap.
    """
    starts = range(0, max(1, len(seen.times_s) - OVERLAP), WINDOW - OVERLAP)
    windows = (seen.take(slice(start, start + WINDOW)) for start in starts)
    parts = [_Problem(window, rest_joints_m, config).solved() for window in windows]
    share = np.arange(1, OVERLAP + 1) / (OVERLAP + 1)
    share = share**2 * (3 - 2 * share)  # a window is worst at its ends
    for before, after in pairwise(parts):
        ends, begins = slice(-OVERLAP, None), slice(OVERLAP)
        after.rotmats[begins] = slerp(before.rotmats[ends], after.rotmats[begins], share)
        apart_m = after.pelvis_m[begins] - before.pelvis_m[ends]
        after.pelvis_m[begins] = before.pelvis_m[ends] + share[:, None] * apart_m
    kept = [slice(-OVERLAP)] * (len(parts) - 1) + [slice(None)]
    rotmats, pelvis_m, energies = (
        np.concatenate([getattr(one, key)[rows] for one, rows in zip(parts, kept, strict=True)])
        for key in ("rotmats", "pelvis_m", "energies")
    )
    return FittedPose(rotmats, pelvis_m, energies, all(one.converged for one in parts))


_BONES = {
    JOINT[f"{side}_{joint}"]: (
        LANDMARKS.index(f"{side}_{joint}"),
        LANDMARKS.index(f"{side}_{child}"),
        JOINT[f"{side}_{child}"],
    )
    for side in ("left", "right")
    for joint, child in (
        ("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"),
    )
}  # fmt: skip
"""By joint: landmarks between which its bone lies, and the joint at its end."""


def _believed_m(seen: SeenLandmarks, share: float) -> np.ndarray:
    """How much further away than the hips landmarks are (T, 33), as far as the network is believed.

    A body that is seen from above slopes as a whole, away from the camera toward the feet, and
    goes on to.  So the mean slope over some time is believed; a share of what is left is.
    """
    slopes = seen.slopes
    apart = (seen.times_s[:, None] - seen.times_s) / SLOPES_S
    near = np.exp(-0.5 * apart**2)
    lasting = near @ slopes / near.sum(axis=1, keepdims=True)
    steep2 = (lasting**2).sum(axis=1, keepdims=True)
    lasting *= steep2 / (steep2 + SLOPE_NOISE**2)
    sloping_m = (seen.world_m[..., :2] @ lasting[..., None])[..., 0]
    return np.asarray(sloping_m + share * (seen.world_m[..., 2] - sloping_m))


def first_rotmats(seen: SeenLandmarks, rest_joints_m: np.ndarray) -> np.ndarray:
    """(T, 24, 3, 3) trunk and limbs as the network's metres have them, without a twist."""
    world_m = seen.world_m @ seen.cam_from_ray.swapaxes(-1, -2)
    up = world_m[:, TRUNK[:2]].sum(1) - world_m[:, TRUNK[2:]].sum(1)
    x = _unit(to_the_left(world_m))
    z = _unit(np.cross(x, up))
    local = np.tile(np.eye(3), (len(x), N_JOINTS, 1, 1))
    local[:, 0] = np.stack([x, np.cross(z, x), z], axis=-1)
    turned = [local[:, 0]]
    for joint in range(1, N_JOINTS):
        before = turned[PARENTS[joint]]
        if joint in _BONES:
            start, end, child = _BONES[joint]
            wanted = ((world_m[:, end] - world_m[:, start])[:, None] @ before)[:, 0]
            local[:, joint] = _turn_between(rest_joints_m[child] - rest_joints_m[joint], wanted)
        turned.append(before @ local[:, joint])
    return local


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-9))


def _turn_between(start: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """The smallest turns (T, 3, 3) from a direction (3,) to others (T, 3)."""
    a = np.broadcast_to(_unit(start), ends.shape)
    b = _unit(ends)
    half = _unit(a + b + 1e-4 * np.roll(b, 1, axis=-1))
    # Two reflections: at a's own plane, then at the one half way.
    reflected = np.eye(3) - 2 * a[..., :, None] * a[..., None, :]
    return np.asarray((np.eye(3) - 2 * half[..., :, None] * half[..., None, :]) @ reflected)


def _above(joint: int) -> list[int]:
    return [joint, *(_above(PARENTS[joint]) if joint else [])]


_MOVES = np.zeros((N_LANDMARKS, N_JOINTS), dtype=bool)
for _n in range(N_LANDMARKS):
    _MOVES[_n, _above(HANGS_ON[_n])[1:] + _above(TURNS_WITH[_n])] = True


class _Placed(NamedTuple):
    """A body that lies somewhere, and how far it is off."""

    joints_m: np.ndarray  # (T, 24, 3) from the pelvis
    turned: np.ndarray  # (T, 24, 3, 3)
    about_m: np.ndarray  # (T, 33, 3) landmarks from the pelvis
    image: np.ndarray  # (T, 33, 2) off in the picture, in usual errors
    rays: np.ndarray  # (T, 33, 3) unit, from the camera
    depth: np.ndarray  # (T, 33) off in depth


class _Problem:
    """The unknowns of one window, and the equations of a step."""

    def __init__(self, seen: SeenLandmarks, rest_joints_m: np.ndarray, config: FitConfig) -> None:
        self.config, self.seen, self.rest_m = config, seen, rest_joints_m
        self.offsets_m = offsets_of(rest_joints_m)
        self.per_ray = 1 / (seen.sizes * config.image)
        self.depth_m = _believed_m(seen, config.depth_share)
        self.weights = seen.weights / SAME_TIME
        self.rest_weights = _WEIGHTS / config.rest**2
        self.over_time = _second_differences(seen.times_s)
        across = 1 / config.pelvis_acceleration
        self.per_pelvis = np.array([across, across, 1 / config.depth_acceleration])
        self.rotmats = first_rotmats(seen, rest_joints_m)
        depth_m = 0.5 / seen.sizes[:, None]
        self.pelvis_m = np.c_[seen.rays[:, HIPS].mean(axis=1) * depth_m, depth_m]

    def solved(self) -> FittedPose:
        config, damping = self.config, 1e-2
        energy, gain = self._energy(self.rotmats, self.pelvis_m), np.inf
        for _ in range(config.most_steps):
            blocks, slope = self._equations()
            while damping < 1e7:
                step = _banded_solution(blocks, slope, damping)
                rotmats, pelvis_m = self._after(step)
                there = self._energy(rotmats, pelvis_m)
                if there < energy:
                    break
                damping *= 6
            else:
                gain = 0.0
                break
            gain = energy - there
            self.rotmats, self.pelvis_m, energy = rotmats, pelvis_m, there
            damping = max(damping / 4, 1e-7)
            if gain < config.stop_share * energy:
                break
        placed = self._placed(self.rotmats, self.pelvis_m)
        energies = self._of_landmarks(placed) + self._of_joints(self.rotmats)
        is_still = bool(gain < config.stop_share * energy)
        return FittedPose(self.rotmats, self.pelvis_m, energies, is_still)

    def _after(self, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rotmats = self.rotmats.copy()
        turns = Rotation.from_rotvec(step[:, :N_TURNS].reshape(-1, 3)).as_matrix()
        rotmats[:, TURNED] = rotmats[:, TURNED] @ turns.reshape(len(step), -1, 3, 3)
        pelvis_m = self.pelvis_m + step[:, N_TURNS:]
        pelvis_m[:, 2] = pelvis_m[:, 2].clip(2 * NEAREST_M)
        return rotmats, pelvis_m

    def _placed(self, rotmats: np.ndarray, pelvis_m: np.ndarray) -> _Placed:
        joints_m, turned = posed_joints_m(self.rest_m, rotmats, np.zeros_like(pelvis_m))
        about_m = landmarks_on(joints_m, turned, self.offsets_m)
        placed_m = about_m + pelvis_m[:, None]
        rays = placed_m[..., :2] / placed_m[..., 2:].clip(NEAREST_M)
        image = (rays - self.seen.rays) * self.per_ray[:, None, None]
        away_m = np.linalg.norm(placed_m, axis=-1, keepdims=True)
        depth = (from_hips(away_m)[..., 0] - self.depth_m) / self.config.depth_m
        return _Placed(joints_m, turned, about_m, image, placed_m / away_m, depth)

    def _energy(self, rotmats: np.ndarray, pelvis_m: np.ndarray) -> float:
        placed = self._placed(rotmats, pelvis_m)
        energy = self._of_landmarks(placed).sum() + self._of_joints(rotmats).sum()
        if self.over_time is not None:
            for values in (*self._in_time(placed.about_m, pelvis_m), self._axes(rotmats)):
                energy += (self.over_time.of(values) ** 2).sum()
        return float(energy)

    def _of_landmarks(self, placed: _Placed) -> np.ndarray:
        """(T,) of Geman and McClure's errors: the square, at most `OUTLIER`."""
        squares = (placed.image**2).sum(-1), placed.depth**2
        costs = sum(OUTLIER * square / (OUTLIER + square) for square in squares)
        return np.asarray((self.weights * costs).sum(axis=1))

    def _in_time(self, about_m: np.ndarray, pelvis_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(T, 99) and (T, 3) whose second differences are in usual ones."""
        config = self.config
        about = from_hips(about_m).reshape(len(about_m), -1)
        usual = config.acceleration * np.sqrt(N_LANDMARKS)
        return about / usual, pelvis_m * self.per_pelvis

    def _axes(self, rotmats: np.ndarray) -> np.ndarray:
        """(T, 9) the same of the pelvis's axes; those of a turn by w change by the root of 2 w."""
        return rotmats[:, 0].reshape(-1, 9) / (np.sqrt(2) * self.config.turn_acceleration)

    def _of_joints(self, rotmats: np.ndarray) -> np.ndarray:
        """(T,) joints that turn, also otherwise than usual ones, and hinges that bend aside."""
        off = ((rotmats - np.eye(3)) ** 2).sum((-1, -2)) @ self.rest_weights
        square = self.config.prior * (prior_errors(rotmats) ** 2).sum(-1)
        off = off + OUTLIER * square / (OUTLIER + square)
        for joint, row, column, weight, sign in _LIMITS:
            value = rotmats[:, joint, row, column]
            off = off + weight * (value if sign == 0 else np.minimum(sign * value, 0)) ** 2
        return np.asarray(off)

    def _equations(self) -> tuple[np.ndarray, np.ndarray]:
        """Blocks (3, T, n, n) of frames with themselves and the two after, and the slope (T, n)."""
        n = len(self.pelvis_m)
        placed = self._placed(self.rotmats, self.pelvis_m)
        blocks, slope = np.zeros((3, n, N_UNKNOWNS, N_UNKNOWNS)), np.zeros((n, N_UNKNOWNS))
        by_turn = self._by_turn(placed)
        self._add_landmarks(placed, by_turn, blocks[0], slope)
        self._add_prior(blocks[0], slope)
        self._add_joints(blocks[0], slope)
        if self.over_time is not None:
            config = self.config
            about, pelvis = self._in_time(placed.about_m, self.pelvis_m)
            usual = config.acceleration * np.sqrt(N_LANDMARKS)
            by_turn = (by_turn - by_turn[:, HIPS].mean(1, keepdims=True)) / usual
            root, turns, places = slice(0, 3), slice(0, N_TURNS), slice(N_TURNS, None)
            by_place = np.tile(np.diag(self.per_pelvis), (n, 1, 1))
            by_turn = by_turn.reshape(n, -1, N_TURNS)
            self.over_time.add(about, by_turn, blocks[:, :, turns, turns], slope[:, turns])
            self.over_time.add(pelvis, by_place, blocks[:, :, places, places], slope[:, places])
            axes = self._axes(self.rotmats)
            # R exp(w) is R (1 + [w]x) for a small turn w about the pelvis's own axes.
            by_root = axes.reshape(n, 1, 3, 3) @ cross_matrices(np.eye(3))
            by_root = by_root.reshape(n, 3, 9).swapaxes(-1, -2)
            self.over_time.add(axes, by_root, blocks[:, :, root, root], slope[:, root])
        return blocks, slope

    def _by_turn(self, placed: _Placed) -> np.ndarray:
        """(T, 33, 3, turns) how landmarks move as joints turn about their own axes."""
        axes = placed.turned[:, TURNED].swapaxes(-1, -2)  # (T, joints, axis, 3)
        levers_m = placed.about_m[:, :, None] - placed.joints_m[:, None, TURNED]
        levers_m = levers_m * _MOVES[:, TURNED, None]
        moved = np.cross(axes[:, None], levers_m[..., None, :])  # (T, 33, joints, axis, 3)
        return np.asarray(moved.reshape(*moved.shape[:2], N_TURNS, 3).swapaxes(-1, -2))

    def _add_landmarks(
        self, placed: _Placed, by_turn: np.ndarray, blocks: np.ndarray, slope: np.ndarray
    ) -> None:
        n = len(slope)
        placed_m = placed.about_m + self.pelvis_m[:, None]
        z = placed_m[..., 2].clip(NEAREST_M)
        pixels = np.zeros((n, N_LANDMARKS, 2, 3))
        pixels[..., 0, 0] = pixels[..., 1, 1] = 1 / z
        pixels[..., 2] = -placed_m[..., :2] / z[..., None] ** 2
        pixels *= self.per_ray[:, None, None, None]
        by_all = np.concatenate([pixels @ by_turn, pixels], axis=-1)
        believed = np.sqrt(self.weights) * _belief((placed.image**2).sum(-1))
        _add_squares(by_all * believed[..., None, None], placed.image * believed[..., None],
                     blocks, slope)  # fmt: skip
        by_depth = from_hips((placed.rays[:, :, None] @ by_turn)[:, :, 0]) / self.config.depth_m
        believed = np.sqrt(self.weights) * _belief(placed.depth**2)
        turns = slice(0, N_TURNS)
        _add_squares(by_depth * believed[..., None], placed.depth * believed,
                     blocks[:, turns, turns], slope[:, turns])  # fmt: skip

    def _add_prior(self, blocks: np.ndarray, slope: np.ndarray) -> None:
        off, by_turn = prior_errors(self.rotmats), np.zeros((len(slope), N_PRIOR, len(TURNED), 3))
        believed = np.sqrt(self.config.prior) * _belief(self.config.prior * (off**2).sum(-1))
        by_turn[:, :, BY_PRIOR] = prior_by_turn(self.rotmats) * believed[:, None, None, None]
        _add_squares(by_turn.reshape(len(off), N_PRIOR, N_TURNS), off * believed[:, None],
                     blocks[:, :N_TURNS, :N_TURNS], slope[:, :N_TURNS])  # fmt: skip

    def _add_joints(self, blocks: np.ndarray, slope: np.ndarray) -> None:
        for place, joint in enumerate(TURNED):
            own = slice(3 * place, 3 * place + 3)
            rotmats = self.rotmats[:, joint]
            # Of |R - 1|^2: twice its axis by the sine, and less than 4 times the turn's square.
            twice = _vee(rotmats - rotmats.swapaxes(-1, -2))
            slope[:, own] += self.rest_weights[joint] * twice
            blocks[:, own, own] += 2 * self.rest_weights[joint] * np.eye(3)
        for joint, row, column, weight, sign in _LIMITS:
            own = slice(3 * TURNED.index(joint), 3 * TURNED.index(joint) + 3)
            value = self.rotmats[:, joint, row, column]
            counts = np.sqrt(weight) * (np.ones_like(value) if sign == 0 else sign * value < 0)
            by_own = np.cross(self.rotmats[:, joint, row], np.eye(3)[column]) * -counts[:, None]
            _add_squares(by_own[:, None], (value * counts)[:, None],
                         blocks[:, own, own], slope[:, own])  # fmt: skip


_LIMITS = [
    *((JOINT[f"{side}_knee"], 0, column, HINGE_SIDE, 0) for side in ("left", "right")
      for column in (1, 2)),
    *((JOINT[f"{side}_knee"], 2, 1, HINGE_BACK, 1) for side in ("left", "right")),
    (JOINT["left_elbow"], 2, 0, HINGE_BACK, 1), (JOINT["right_elbow"], 2, 0, HINGE_BACK, -1),
]  # fmt: skip
"""Joint, row and column of its rotation, weight, and the sign that the number may have (0: none).
A knee turns about x and only backward, an elbow only forward."""


def _vee(skew: np.ndarray) -> np.ndarray:
    return np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)


def _belief(squares: np.ndarray) -> np.ndarray:
    """Root of the weight of an error in the robust sum."""
    return np.asarray(OUTLIER / (OUTLIER + squares))


def _add_squares(by: np.ndarray, off: np.ndarray, blocks: np.ndarray, slope: np.ndarray) -> None:
    """Add sums of squares: derivatives (T, ..., n) of errors (T, ...)."""
    by = by.reshape(len(by), -1, by.shape[-1])
    across = by.swapaxes(-1, -2)
    blocks += across @ by
    slope += (across @ off.reshape(len(off), -1, 1))[..., 0]


@dataclass(frozen=True, eq=False)
class _OverTime:
    """Second differences per second squared over T frames."""

    shares: np.ndarray  # (T - 2, 3) of three frames in a row
    coupled: np.ndarray  # (3, T) of each frame with itself and the two after, in their squares

    def of(self, values: np.ndarray) -> np.ndarray:
        """(T - 2, n) of (T, n)."""
        a, b, c = (self.shares[:, n, None] for n in range(3))
        return np.asarray(a * values[:-2] + b * values[1:-1] + c * values[2:])

    def add(
        self, values: np.ndarray, by: np.ndarray, blocks: np.ndarray, slope: np.ndarray
    ) -> None:
        """Add the squares of values (T, m) with derivatives (T, m, n) to the equations."""
        across, n = by.swapaxes(-1, -2), len(values)
        pulled = self.coupled[0][:, None] * values
        for later in (1, 2):
            shares = self.coupled[later][: n - later, None]
            pulled[: n - later] += shares * values[later:]
            pulled[later:] += shares * values[: n - later]
        slope += (across @ pulled[..., None])[..., 0]
        for later in range(3):
            shares = self.coupled[later][: n - later, None, None]
            blocks[later, : n - later] += shares * (across[later:] @ by[: n - later])


def _second_differences(times_s: np.ndarray) -> _OverTime | None:
    """None where there are fewer than three frames."""
    n = len(times_s)
    if n < 3:
        return None
    before, after = 1 / np.diff(times_s)[:-1], 1 / np.diff(times_s)[1:]
    between_s = (times_s[2:] - times_s[:-2]) / 2
    shares = np.stack([before, -(before + after), after], axis=-1) / between_s[:, None]
    coupled = np.zeros((3, n))
    for first in range(3):
        for later in range(3 - first):
            coupled[later, first : first + n - 2] += shares[:, first] * shares[:, first + later]
    return _OverTime(shares, coupled)


def _banded_solution(blocks: np.ndarray, slope: np.ndarray, damping: float) -> np.ndarray:
    """The step (T, n) that the equations ask for, shortened by a damping."""
    from scipy.linalg import solveh_banded

    frames, n = slope.shape
    band = np.zeros((3 * n, frames * n))
    row, column = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    for later in range(min(3, frames)):
        own = blocks[later, : frames - later]
        if later == 0:
            own = own + (damping * np.einsum("tii->ti", own) + 1e-9)[:, :, None] * np.eye(n)
        below = later * n + row - column
        kept = below >= 0
        columns = np.arange(frames - later)[:, None] * n + column[kept]
        band[np.broadcast_to(below[kept], columns.shape), columns] = own[:, kept]
    step = solveh_banded(band, -slope.ravel(), overwrite_ab=True, lower=True, check_finite=False)
    return np.asarray(step.reshape(frames, n))
