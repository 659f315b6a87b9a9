"""Heights of a person on one floor: who neither stands nor falls freely is held by the ground.

A network sees how high a person gets from moment to moment, and its errors add up; at worst the
feet rise far slower than a body falls.  But the mass of a body that nothing holds falls at 9.81
m/s2.  So the way is cut into flights, in which it does, and the rest, in which the lowest point of
the body is on the floor.  A flight is where standing would mean to be pulled down by the ground,
where the network's path falls freely as well, and where the legs give the speed at the take-off
and take it at the landing: the cheapest of all ways to cut is found by dynamic programming.

Then heights are the least squares of two things: the network's steps, and the floor under the
lowest point outside of flights.  So are roll and pitch, which drift: they lean on the floor and on
what standing shows of up.  On stairs and slopes the floor is not one, and heights stay.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from gmrdata.motion.ground import LOW_PERCENTILE, lowest_others_m, sole_points_m
from gmrdata.values.body import BodyModel
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_joints_m
from gmrdata.values.transforms import smallest_rotation
from gmrdata.world.level import BALANCE_SIGMA_RAD, MASSES, ONE_FLOOR_M
from gmrdata.world.planted_feet import standing_soles_m
from gmrdata.world.upright import ShownTilts, shown_tilts

GRAVITY_M_PER_S2 = 9.81
RATE_HZ = 30.0  # about which flights are looked for: at more, poses' noise hides accelerations
LONGEST_FLIGHT_S = 1.0  # a leap of 1.2 m
DEEPEST_M = 0.03  # in a flight no point is further below the floor
SPEED_TIME_S = 0.07  # over which the speed before a take-off and after a landing is the mean
LEGS_SIGMA_M_PER_S = 0.5  # of that speed, from the flight's
PULL_SIGMA_M_PER_S2 = 10.0  # of an acceleration beyond gravity's while standing: poses' noise
STEP_SIGMA_M_PER_S = 0.3  # of a network's vertical speed, where it sees what happens
MOST_SIGMAS = 2.0  # beyond which an error is one, however large
TOGETHER_S = 0.1  # errors as near in time are one
FLOOR_SIGMA_M = 0.03  # of the lowest point from the floor, as feet bend, roll and err
DRIFT_SIGMA_M = 0.01  # of a network's height after `TOGETHER_S`, beside what it tilts
TILT_DRIFT_RAD = np.deg2rad(6.0)  # of a network's roll and pitch, after a second
RISING_M_PER_S = 0.4
"""A person whose slowest sole point rises or sinks faster stands on nothing that is at rest."""
UNHELD_SHARE = 0.3
"""A network that lets a person neither stand nor fall for more of the time knows no heights: 0.63
in jumping jacks, at most 0.2 in nearly all of 312 of CMU's motions."""


@dataclass(frozen=True, eq=False)
class _SeenPerson:
    """What a network saw of a person, in a world that is about level."""

    pelvis_m: np.ndarray  # (T, 3)
    on_floor_m: np.ndarray  # (T,) heights of the pelvis with the lowest point on the floor
    held: np.ndarray  # (T,) bool: in no flight
    unheld_share: float
    shown: ShownTilts
    fps_hz: float


def held_upright(body: BodyModel, motion: Motion) -> Motion:
    """A motion turned back over time as far as standing shows that its roll and pitch drift, in a
    world whose z axis is up on average."""
    nowhere, shown = np.zeros(motion.n_frames), shown_tilts(body, motion)
    seen = _SeenPerson(motion.pelvis_m, nowhere, nowhere > 0, 0.0, shown, motion.fps_hz)
    return _turned_level(motion, _heights_and_tilts(seen, DRIFT_SIGMA_M)[1])


def on_one_floor(body: BodyModel, motion: Motion) -> Motion | None:
    """One that is `held_upright` over one floor at z = 0; None for steps or a slope."""
    seen, drift_m = _seen(body, motion), DRIFT_SIGMA_M
    soles_m, still = standing_soles_m(body, motion)
    if seen.unheld_share > UNHELD_SHARE:
        drift_m = 10 * DRIFT_SIGMA_M
    elif still.any() and _is_steep(soles_m[still]):
        return None
    # In a level world the lowest point may be another one.
    tilt = _heights_and_tilts(seen, drift_m)[1].mean(axis=0)
    motion = _turned_level(motion, np.tile(tilt, (motion.n_frames, 1)))
    heights_m, tilts = _heights_and_tilts(_seen(body, motion), drift_m)
    motion = _turned_level(motion, tilts)
    return replace(motion, pelvis_m=np.column_stack([motion.pelvis_m[:, :2], heights_m]))


def _seen(body: BodyModel, motion: Motion) -> _SeenPerson:
    joints_m, soles_m = motion_joints_m(body, motion), sole_points_m(body, motion)
    lowest_m = np.minimum(soles_m[:, :, 2].min(axis=1), lowest_others_m(joints_m))
    mass_m = joints_m[:, :, 2] @ MASSES
    apart = max(1, round(motion.fps_hz / RATE_HZ))
    airborne = flights((mass_m - lowest_m)[::apart], mass_m[::apart], motion.fps_hz / apart)
    held = np.ones(motion.n_frames, dtype=bool)
    for start, stop in airborne:
        held[start * apart + 1 : stop * apart] = False
    unheld = _unheld_share(soles_m[::apart], held[::apart], motion.fps_hz / apart)
    shown, on_floor_m = shown_tilts(body, motion), motion.pelvis_m[:, 2] - lowest_m
    return _SeenPerson(motion.pelvis_m, on_floor_m, held, unheld, shown, motion.fps_hz)


def _is_steep(standing_m: np.ndarray) -> bool:
    """Whether soles (N, 3) stand further from one floor than a world that is not quite level has
    them [m]; without the highest and the lowest tenth."""
    low_m, high_m = np.percentile(standing_m, [LOW_PERCENTILE, 100.0 - LOW_PERCENTILE], axis=0)
    reach_m, spread_m = np.linalg.norm(high_m[:2] - low_m[:2]), high_m[2] - low_m[2]
    return bool(spread_m > ONE_FLOOR_M + BALANCE_SIGMA_RAD * reach_m)


def _unheld_share(soles_m: np.ndarray, held: np.ndarray, fps_hz: float) -> float:
    """Share of steps between frames in which even the slowest point of soles (T, P, 3) rises or
    sinks, and which are in no flight."""
    steps_m = np.diff(soles_m, axis=0)
    slowest = np.linalg.norm(steps_m, axis=-1).argmin(axis=1)
    rising = np.abs(steps_m[np.arange(len(steps_m)), slowest, 2]) * fps_hz > RISING_M_PER_S
    return float((rising & held[1:] & held[:-1]).sum()) / max(1, len(rising))


def flights(on_floor_m: np.ndarray, seen_m: np.ndarray, fps_hz: float) -> list[tuple[int, int]]:
    """Frames of take-off and landing, of a mass at heights (T,) with the lowest point on the floor,
    and at heights (T,) that a network has seen [m]."""
    n_frames, longest = len(on_floor_m), int(LONGEST_FLIGHT_S * fps_hz)
    standing = np.concatenate([[0.0], np.cumsum(_standing_costs(on_floor_m, seen_m, fps_hz))])
    steps = np.arange(2, min(longest, n_frames - 1) + 1)
    flying = np.full((n_frames, len(steps)), np.inf)  # by landing and length
    for column, n_steps in enumerate(steps):
        flying[n_steps:, column] = _flight_costs(on_floor_m, seen_m, fps_hz, int(n_steps))
    # The least cost up to each frame, and where the flight began that ends there.
    least, began = np.zeros(n_frames), np.full(n_frames, -1)
    for frame in range(1, n_frames):
        least[frame] = least[frame - 1] + standing[frame] - standing[frame - 1]
        possible = steps[steps <= frame]
        costs = least[frame - possible] + flying[frame, : len(possible)]
        if len(costs) and costs.min() < least[frame]:
            best = int(costs.argmin())
            least[frame], began[frame] = costs[best], frame - possible[best]
    return _runs_back(began)


def _runs_back(began: np.ndarray) -> list[tuple[int, int]]:
    """The flights of the best way, from its end to its start, in order."""
    runs, frame = [], len(began) - 1
    while frame > 0:
        if began[frame] >= 0:
            runs.append((int(began[frame]), frame))
        frame = int(began[frame]) if began[frame] >= 0 else frame - 1
    return runs[::-1]


def _standing_costs(on_floor_m: np.ndarray, seen_m: np.ndarray, fps_hz: float) -> np.ndarray:
    """Of each step (T-1,): of what a network sees otherwise, and of being pulled down."""
    others = _unlike(np.diff(seen_m) - np.diff(on_floor_m), fps_hz)
    pulls = np.zeros(len(on_floor_m))
    beyond = -GRAVITY_M_PER_S2 - np.diff(on_floor_m, n=2) * fps_hz**2
    pulls[1:-1] = np.minimum(np.maximum(beyond, 0.0) / PULL_SIGMA_M_PER_S2, MOST_SIGMAS) ** 2
    # Three speeds tell an acceleration, so it counts as much as they.
    return others + 1.5 * (pulls[1:] + pulls[:-1]) / (fps_hz * TOGETHER_S)


def _unlike(apart_m: np.ndarray, fps_hz: float) -> np.ndarray:
    sigmas = np.minimum(np.abs(apart_m) * fps_hz / STEP_SIGMA_M_PER_S, MOST_SIGMAS)
    return sigmas**2 / (fps_hz * TOGETHER_S)


def _flight_costs(
    on_floor_m: np.ndarray, seen_m: np.ndarray, fps_hz: float, n_steps: int
) -> np.ndarray:
    """Of each flight (T - n,) of so many steps from floor to floor; infinite for one through it."""
    starts = np.arange(len(on_floor_m) - n_steps)
    stops, seconds = starts + n_steps, n_steps / fps_hz
    first = (on_floor_m[stops] - on_floor_m[starts]) / seconds + GRAVITY_M_PER_S2 * seconds / 2
    times_s = np.arange(n_steps + 1) / fps_hz
    falls_m = first[:, None] * times_s - GRAVITY_M_PER_S2 * times_s**2 / 2
    rows = starts[:, None] + np.arange(n_steps + 1)
    above_m = on_floor_m[starts][:, None] + falls_m - on_floor_m[rows]
    unlike = _unlike(np.diff(seen_m[rows], axis=1) - np.diff(falls_m, axis=1), fps_hz).sum(axis=1)
    before, after = _speeds(on_floor_m, fps_hz)
    last = first - GRAVITY_M_PER_S2 * seconds
    legs = np.stack([first - before[starts], last - after[stops]]) / LEGS_SIGMA_M_PER_S
    costs = unlike + np.nansum(legs**2, axis=0)
    return np.where((above_m > -DEEPEST_M).all(axis=1), costs, np.inf)


def _speeds(heights_m: np.ndarray, fps_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Before and after each frame (T,) [m/s]; NaN at the ends of the motion."""
    rows, reach = np.arange(len(heights_m)), max(1, round(SPEED_TIME_S * fps_hz))
    before, after = np.maximum(rows - reach, 0), np.minimum(rows + reach, rows[-1])
    return (
        (heights_m - heights_m[before]) * fps_hz / np.where(before < rows, rows - before, np.nan),
        (heights_m[after] - heights_m) * fps_hz / np.where(after > rows, after - rows, np.nan),
    )


def _turned_level(motion: Motion, tilts: np.ndarray) -> Motion:
    """The motion, each frame and the step after it turned by how much (T, 2) its floor rises."""
    up_of_floor = np.column_stack([-tilts, np.ones(len(tilts))])
    turns = smallest_rotation(up_of_floor, np.tile([0.0, 0.0, 1.0], (len(tilts), 1)))
    steps_m = np.einsum("tij,tj->ti", turns[:-1], np.diff(motion.pelvis_m, axis=0))
    pelvis_m = motion.pelvis_m[0] + np.concatenate([np.zeros((1, 3)), np.cumsum(steps_m, axis=0)])
    return replace(motion, root_rotmats=turns @ motion.root_rotmats, pelvis_m=pelvis_m)


def _heights_and_tilts(seen: _SeenPerson, drift_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Heights (T,), and by how much (T, 2) the floor rises along x and y in the network's world,
    whose roll and pitch drift; where no frame is held, as standing alone shows it.

    A person always leans a little as a system sees them, so what standing shows may be off by the
    same all the time.
    """
    n_frames, steps_m = len(seen.held), np.diff(seen.pelvis_m, axis=0)
    many = seen.fps_hz * TOGETHER_S
    ones, between = sparse.identity(n_frames, format="csr"), sparse.eye(n_frames - 1, n_frames)
    change = sparse.eye(n_frames - 1, n_frames, k=1) - between
    floor = ones[np.flatnonzero(seen.held)] / (FLOOR_SIGMA_M * np.sqrt(many))
    rise = np.sqrt(many) / drift_m
    turn = change * np.sqrt(seen.fps_hz) / TILT_DRIFT_RAD
    x, y = (sparse.diags(rise * steps_m[:, axis]) @ between for axis in (0, 1))
    told = sparse.diags(np.sqrt(seen.shown.precision))
    lean, own = told @ np.ones((n_frames, 1)), np.full((1, 1), 1 / BALANCE_SIGMA_RAD)
    rows = sparse.bmat(
        [
            [ones[:1], None, None, None, None], [floor, None, None, None, None],
            [rise * change, x, y, None, None],
            [None, turn, None, None, None], [None, None, turn, None, None],
            [None, told, None, lean, None], [None, None, told, None, lean],
            [None, None, None, own, None], [None, None, None, None, own],
        ],
        format="csr",
    )  # fmt: skip
    wanted = np.concatenate([
        seen.pelvis_m[:1, 2], floor @ seen.on_floor_m, rise * steps_m[:, 2],
        np.zeros(2 * (n_frames - 1)), *(told @ seen.shown.tilts).T, np.zeros(2),
    ])  # fmt: skip
    least = rows.T @ rows + 1e-9 * sparse.identity(3 * n_frames + 2)
    solution = spsolve(least.tocsc(), rows.T @ wanted)
    return solution[:n_frames], solution[n_frames:-2].reshape(2, n_frames).T
