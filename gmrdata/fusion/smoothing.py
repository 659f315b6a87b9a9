"""A pose graph of one person: poses of cameras, motions that a network sees, feet that stand.

The network's error has two parts, a fast and a slow one, each a Gauss-Markov process whose spread
and memory were measured on people whom the network had not seen.  Errors of neighbouring motions
are alike, so motions taken as independent would promise too much over a gap; and what the cameras
show of the slow part before and after a gap holds within it.  The places that cameras give err
slowly too, most of all in depth.  Each frame has a root orientation, a pelvis place, and both slow
errors as unknowns; the fast error is what is left of a motion then.

The graph is solved by Gauss-Newton on SO(3) x R3 with a sparse factor (Dellaert & Kaess 2006;
Barfoot 2017, section 9.2), damped by the gain of each step (Madsen, Nielsen & Tingleff 2004,
section 3.2), outliers by Cauchy weights.  The error bars are the diagonal blocks of
the inverse of its last normal matrix.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from gmrdata.values.errors import StageFailed
from gmrdata.values.motion import accumulate, bent
from gmrdata.values.transforms import cross_matrices

TURN, PLACE, SLOW, SHIFT, WIDTH = 0, 3, 6, 12, 15
"""Where the unknowns of a frame begin among its 15: turn [rad], place [m], the network's slow error
and the camera's [1]."""
ANCHOR = 1e-6  # standard deviation of the first pose where no camera says where it is [rad, m]
LEAST = 1e-6  # and of a step that is said to be exact [rad, m]
LEAST_DAMPING = 1e-9  # of each diagonal entry: hardly any, and a start for more
OUTLIER = 4.0  # standard deviations beyond which a camera's pose or a foot counts for less


@dataclass(frozen=True, eq=False)
class SeenPoses:
    """Poses in the world that cameras give, over T frames.  Rows that are not known may be NaN."""

    rotmats: np.ndarray  # (T, 3, 3) world_from_root
    pelvis_m: np.ndarray  # (T, 3) [m]
    known: np.ndarray  # (T,) bool
    turn_sigma_rad: np.ndarray  # (T,) independent from frame to frame, about each axis [rad]
    place_covariance_m2: np.ndarray  # (T, 3, 3) the same of the place, world axes [m2]
    shift_m: np.ndarray  # (T, 3, 3) world axes: what one standard deviation of the slow error moves
    shift_time_s: float  # time in which it forgets itself to 1/e


@dataclass(frozen=True, eq=False)
class ErrorProcess:
    """A part of a network's error: a rate that wanders about zero.  Turn first, then place."""

    sigma: np.ndarray  # (T-1, 6) standard deviation [rad/s, m/s], in the body's axes
    time_s: np.ndarray  # (6,) time in which it forgets itself to 1/e


@dataclass(frozen=True, eq=False)
class SeenMotions:
    """Motions from each of T frames to the next, as a network sees them, and how wrong they are."""

    delta_rotmats: np.ndarray  # (T-1, 3, 3)
    delta_m: np.ndarray  # (T-1, 3) [m]
    fast: ErrorProcess
    slow: ErrorProcess


@dataclass(frozen=True, eq=False)
class PlantedFeet:
    """Points of feet, and when each of them stands."""

    points_root_m: np.ndarray  # (T, P, 3) seen from the pelvis, root axes [m]
    still: np.ndarray  # (T-1, P) bool: stands from this frame to the next
    slip_m: float  # standard deviation of what a standing point moves in a frame [m]
    height_sigma_m: float | None  # that of its height over z = 0 [m]; None: the ground isn't level


class SamePlace(NamedTuple):
    """The person stands on one spot at two times: equal x and y of the pelvis."""

    row: int
    other_row: int
    sigma_m: float


@dataclass(frozen=True, eq=False)
class FusedPoses:
    """The person's poses in every frame, and their covariances."""

    rotmats: np.ndarray  # (T, 3, 3) world_from_root
    pelvis_m: np.ndarray  # (T, 3) [m]
    turn_covariance_rad2: np.ndarray  # (T, 3, 3) about the body's axes
    place_covariance_m2: np.ndarray  # (T, 3, 3) world axes
    iterations: int


class _Terms(NamedTuple):
    """Linearised residuals in standard deviations: r + sum of J @ x[column : column + width]."""

    residuals: np.ndarray  # (n, d)
    blocks: list[tuple[np.ndarray, np.ndarray]]  # first columns (n,) and Jacobians (n, d, width)
    cost: float | None = None  # None for the sum of squares


@dataclass(frozen=True, eq=False)
class _State:
    rotmats: np.ndarray
    pelvis_m: np.ndarray
    slow: np.ndarray  # (T, 6) the network's slow error in standard deviations
    shift: np.ndarray  # (T, 3) the camera's, the same

    def moved(self, change: np.ndarray) -> "_State":
        """After a step (T, 15) in the tangent space."""
        turns = Rotation.from_rotvec(change[:, TURN:PLACE]).as_matrix()
        return _State(
            self.rotmats @ turns,
            self.pelvis_m + change[:, PLACE:SLOW],
            self.slow + change[:, SLOW:SHIFT],
            self.shift + change[:, SHIFT:],
        )


@dataclass(frozen=True, eq=False)
class _Graph:
    fps_hz: float
    seen: SeenPoses
    motions: SeenMotions
    feet: PlantedFeet | None
    loops: Sequence[SamePlace]

    def terms(self, state: _State) -> Iterator[_Terms]:
        for errors, first, time_s in (
            (state.slow, SLOW, self.motions.slow.time_s),
            (state.shift, SHIFT, np.full(3, self.seen.shift_time_s)),
        ):
            yield from _slow_terms(errors, first, _memory(time_s, self.fps_hz))
        yield from _motion_terms(state, self.motions, self.fps_hz)
        if self.seen.known.any():
            yield from _seen_terms(state, self.seen)
        else:
            yield _Terms(np.zeros((1, 6)), [(np.array([TURN]), np.eye(6)[None] / ANCHOR)])
        if self.feet is not None:
            yield from _feet_terms(state, self.feet)
        if self.loops:
            yield _loop_terms(state, self.loops)


def smooth(
    fps_hz: float,
    seen: SeenPoses,
    motions: SeenMotions,
    *,
    feet: PlantedFeet | None = None,
    loops: Sequence[SamePlace] = (),
    most_iterations: int = 200,
) -> FusedPoses:
    """The most likely poses of T frames, given all of it.

    Without a known frame the world is that of the first pose, which is kept where `seen` has it,
    and the error bars are relative to it.  StageFailed where it doesn't settle.
    """
    graph = _Graph(fps_hz, seen, motions, feet, loops)
    state = _first_guess(seen, motions)
    cost, damping, growth = _cost(graph, state), LEAST_DAMPING, 2.0
    for iteration in range(1, most_iterations + 1):
        normal, gradient = _normal_equations(graph, state)
        damped = damping * normal.diagonal()
        change = _solved(normal, gradient, damped)
        moved = state.moved(change.reshape(-1, WIDTH))
        after = _cost(graph, moved)
        if not after <= cost * (1 + 1e-9) + 1e-9:
            damping, growth = growth * damping, 2 * growth
            if damping > 1e8:
                break
            continue
        settled = cost - after < 1e-4 * (1 + after)
        gain = (cost - after) / max(float(change @ (damped * change - gradient)), 1e-12)
        damping *= max(1 / 3, 1 - (2 * min(gain, 1.0) - 1) ** 3)
        state, cost, damping, growth = moved, after, max(damping, LEAST_DAMPING), 2.0
        if settled:
            return _with_covariances(graph, state, iteration)
    what = "cameras, motions and loops" if loops else "cameras and motions"
    remedy = ". Leave out --loops, or give a larger --loop-sigma-m" if loops else ""
    steps = f"in {most_iterations} steps"
    raise StageFailed(f"the poses didn't settle {steps}: {what} contradict each other{remedy}")


def _first_guess(seen: SeenPoses, motions: SeenMotions) -> _State:
    """Known poses as they are; before and after them the network's motions, and between them the
    same, bent so that they end where the next known pose is."""
    n = len(seen.known)
    rotmats, pelvis_m, known = seen.rotmats.copy(), seen.pelvis_m.copy(), seen.known.copy()
    turns, steps_m = motions.delta_rotmats, motions.delta_m
    known[0] |= not known.any()
    rows = np.flatnonzero(known)
    for start, stop in zip(rows, [*rows[1:], n], strict=True):
        if stop - start > 1:
            steps = slice(start, min(stop, n - 1))
            first = rotmats[start], pelvis_m[start]
            path = accumulate(turns[steps], steps_m[steps], *first)
            if stop < n:
                path = bent(*path, rotmats[stop], pelvis_m[stop])
            rotmats[start : stop + 1], pelvis_m[start : stop + 1] = path
    for row in range(rows[0] - 1, -1, -1):
        rotmats[row] = rotmats[row + 1] @ turns[row].T
        pelvis_m[row] = pelvis_m[row + 1] - rotmats[row] @ steps_m[row]
    return _State(rotmats, pelvis_m, np.zeros((n, SHIFT - SLOW)), np.zeros((n, WIDTH - SHIFT)))


def _slow_terms(
    errors: np.ndarray, first: int, memory: tuple[np.ndarray, np.ndarray]
) -> Iterator[_Terms]:
    """A slow error (T, d) begins with its spread, and keeps a part of itself over a frame."""
    kept, new = memory
    yield _Terms(errors[:1], [(np.array([first]), np.eye(errors.shape[1])[None])])
    columns = np.arange(len(errors) - 1) * WIDTH + first
    jacobians = (np.diag(factor)[None] for factor in (-kept / new, 1 / new))
    blocks = list(zip((columns, columns + WIDTH), jacobians, strict=True))
    yield _Terms((errors[1:] - kept * errors[:-1]) / new, blocks)


def _memory(time_s: np.ndarray, fps_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Share of itself that an error keeps over a frame, and standard deviation of what is new."""
    times = 1 / (fps_hz * time_s)
    return np.exp(-times), np.sqrt(-np.expm1(-2 * times))


def _motion_terms(state: _State, motions: SeenMotions, fps_hz: float) -> Iterator[_Terms]:
    """What is left of a motion, less the slow error, is the fast one, which remembers itself."""
    fast, jac = _fast_errors(state, motions, fps_hz)
    kept, new = _memory(motions.fast.time_s, fps_hz)
    columns = np.arange(len(fast)) * WIDTH
    yield _Terms(fast[:1], [(columns[:1], jac[:1])])
    before, after = -(kept / new)[:, None] * jac[:-1], jac[1:] / new[:, None]
    blocks = [(columns[:-1], before), (columns[1:], after)]
    yield _Terms((fast[1:] - kept * fast[:-1]) / new, blocks)


def _fast_errors(
    state: _State, motions: SeenMotions, fps_hz: float
) -> tuple[np.ndarray, np.ndarray]:
    """The fast errors (T-1, 6) in standard deviations, and how they change with the 30 unknowns of
    the frames before and after."""
    slow_step = _step(motions.slow, fps_hz)
    before, after = state.rotmats[:-1], state.rotmats[1:]
    to_root = before.swapaxes(-1, -2)
    wrong = Rotation.from_matrix(
        after.swapaxes(-1, -2) @ before @ motions.delta_rotmats
    ).as_rotvec()
    step_m = (to_root @ np.diff(state.pelvis_m, axis=0)[..., None])[..., 0]
    left = np.concatenate([wrong, motions.delta_m - step_m], axis=1) - slow_step * state.slow[:-1]
    jac = np.zeros((len(left), 6, 2 * WIDTH))
    half, each = 0.5 * cross_matrices(wrong), np.arange(6)
    jac[:, :3, TURN:PLACE] = (np.eye(3) + half) @ motions.delta_rotmats.swapaxes(-1, -2)
    jac[:, :3, WIDTH + TURN : WIDTH + PLACE] = half - np.eye(3)
    jac[:, 3:, TURN:PLACE] = -cross_matrices(step_m)
    jac[:, 3:, PLACE:SLOW] = to_root
    jac[:, 3:, WIDTH + PLACE : WIDTH + SLOW] = -to_root
    jac[:, each, SLOW + each] = -slow_step
    sigma = np.maximum(_step(motions.fast, fps_hz), LEAST)
    return left / sigma, jac / sigma[..., None]


def _step(process: ErrorProcess, fps_hz: float) -> np.ndarray:
    """Spread (T-1, 6) of the error of a motion [rad, m]: of a rate's mean over a frame's time."""
    x = 1 / (fps_hz * process.time_s)
    return np.asarray(process.sigma * np.sqrt(mean_variance(x)) / fps_hz)


def mean_variance(times: np.ndarray) -> np.ndarray:
    """Variance of the mean of a Gauss-Markov process of variance 1 over times (...), in its own
    time constants: 1 for short ones, 2 / time for long ones (Papoulis 1991, section 10-1)."""
    times = np.maximum(times, 1e-4)
    return np.asarray(2 * (times + np.expm1(-times)) / times**2)


def _seen_terms(state: _State, seen: SeenPoses) -> Iterator[_Terms]:
    rows = np.flatnonzero(seen.known)
    wrong = Rotation.from_matrix(
        seen.rotmats[rows].swapaxes(-1, -2) @ state.rotmats[rows]
    ).as_rotvec()
    inverse_sigma = 1 / seen.turn_sigma_rad[rows, None, None]
    jac = (np.eye(3) + 0.5 * cross_matrices(wrong)) * inverse_sigma
    yield _robust(_Terms(wrong * inverse_sigma[..., 0], [(rows * WIDTH + TURN, jac)]))
    whitening = np.linalg.inv(np.linalg.cholesky(seen.place_covariance_m2[rows]))
    shifted_m = (seen.shift_m @ state.shift[..., None])[..., 0]
    apart_m = (state.pelvis_m - shifted_m - seen.pelvis_m)[rows]
    whitened = (whitening @ apart_m[..., None])[..., 0]
    blocks = [
        (rows * WIDTH + PLACE, whitening),
        (rows * WIDTH + SHIFT, -whitening @ seen.shift_m[rows]),
    ]
    yield _robust(_Terms(whitened, blocks))


def _feet_terms(state: _State, feet: PlantedFeet) -> Iterator[_Terms]:
    """Standing points stay where they are, and on the ground."""
    rows, points = np.nonzero(feet.still)
    arms_m = [feet.points_root_m[rows, points], feet.points_root_m[rows + 1, points]]
    from_pelvis_m = (state.rotmats[:, None] @ feet.points_root_m[..., None])[..., 0]
    places_m = state.pelvis_m[:, None] + from_pelvis_m
    moved_m = places_m[rows + 1, points] - places_m[rows, points]
    blocks = []
    for later, sign in ((0, -1.0), (1, 1.0)):
        jac = np.zeros((len(rows), 3, 6))
        jac[..., TURN:PLACE] = -state.rotmats[rows + later] @ cross_matrices(arms_m[later])
        jac[..., PLACE:SLOW] = np.eye(3)
        blocks.append(((rows + later) * WIDTH, sign * jac / feet.slip_m))
    yield _robust(_Terms(moved_m / feet.slip_m, blocks))
    if feet.height_sigma_m is not None:
        height = places_m[rows, points, 2:] / feet.height_sigma_m
        first, jac = blocks[0]
        of_height = -jac[:, 2:] * feet.slip_m / feet.height_sigma_m
        yield _robust(_Terms(height, [(first, of_height)]))


def _loop_terms(state: _State, loops: Sequence[SamePlace]) -> _Terms:
    rows, others = (np.array([loop[k] for loop in loops]) for k in (0, 1))
    inverse_sigma = 1 / np.array([loop.sigma_m for loop in loops])[:, None]
    residuals = (state.pelvis_m[others] - state.pelvis_m[rows])[:, :2] * inverse_sigma
    jac = np.eye(3)[:2] * inverse_sigma[..., None]
    return _Terms(residuals, [(others * WIDTH + PLACE, jac), (rows * WIDTH + PLACE, -jac)])


def _robust(terms: _Terms) -> _Terms:
    """With Cauchy's weights: what is off by many standard deviations counts for less."""
    share = (terms.residuals**2).sum(axis=1, keepdims=True) / OUTLIER**2
    root = 1 / np.sqrt(1 + share)
    weighted = [(columns, jac * root[..., None]) for columns, jac in terms.blocks]
    return _Terms(terms.residuals * root, weighted, OUTLIER**2 * float(np.log1p(share).sum()))


def _cost(graph: _Graph, state: _State) -> float:
    costs = ((t.residuals**2).sum() if t.cost is None else t.cost for t in graph.terms(state))
    return float(sum(costs))


def _normal_equations(graph: _Graph, state: _State) -> tuple[Any, np.ndarray]:
    """J^T J, sparse, and J^T r."""
    jacobian, residuals = _jacobian(graph.terms(state), len(state.slow) * WIDTH)
    return (jacobian.T @ jacobian).tocsc(), jacobian.T @ residuals


def _jacobian(all_terms: Iterable[_Terms], n_unknowns: int) -> tuple[Any, np.ndarray]:
    """J, sparse, and r."""
    n_rows, data, rows, columns, residuals = 0, [], [], [], []
    for terms in all_terms:
        n, d = terms.residuals.shape
        numbers = n_rows + np.arange(n * d).reshape(n, d, 1)
        for first, jac in terms.blocks:
            shape = n, d, jac.shape[-1]
            data.append(np.broadcast_to(jac, shape).ravel())
            rows.append(np.broadcast_to(numbers, shape).ravel())
            wide = first[:, None, None] + np.arange(shape[-1])
            columns.append(np.broadcast_to(wide, shape).ravel())
        residuals.append(terms.residuals.ravel())
        n_rows += n * d
    entries = np.concatenate(data), (np.concatenate(rows), np.concatenate(columns))
    jacobian = sparse.csr_matrix(entries, shape=(n_rows, n_unknowns))
    return jacobian, np.concatenate(residuals)


def _factor(normal: Any) -> Any:
    options = {"SymmetricMode": True}
    return splu(normal, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)


def _solved(normal: Any, gradient: np.ndarray, damped: np.ndarray) -> np.ndarray:
    return np.asarray(-_factor(normal + sparse.diags(damped).tocsc()).solve(gradient))


def _with_covariances(graph: _Graph, state: _State, iterations: int) -> FusedPoses:
    """The poses, and blocks of the inverse of J^T J; loops by Woodbury's identity."""
    normal, _ = _normal_equations(replace(graph, loops=()), state)
    blocks = _diagonal_blocks(normal)
    if graph.loops:
        jacobian = _jacobian([_loop_terms(state, graph.loops)], normal.shape[0])[0]
        spread = _factor(normal).solve(jacobian.T.toarray())
        inner = np.linalg.inv(np.eye(spread.shape[1]) + jacobian @ spread)
        by_frame = spread.reshape(len(blocks), WIDTH, -1)
        blocks = blocks - by_frame @ inner @ by_frame.swapaxes(-1, -2)
    blocks = 0.5 * (blocks + blocks.swapaxes(-1, -2))
    return FusedPoses(
        state.rotmats,
        state.pelvis_m,
        blocks[:, TURN:PLACE, TURN:PLACE],
        blocks[:, PLACE:SLOW, PLACE:SLOW],
        iterations,
    )


def _diagonal_blocks(normal: Any) -> np.ndarray:
    """Blocks (T, 15, 15) on the diagonal of the inverse of J^T J without loops.

    No term reaches further than two frames, so in pairs of frames the matrix is block-tridiagonal,
    and what all frames before, and all after, leave to a pair are two recursions (Meurant 1992).
    """
    n = normal.shape[0] // WIDTH
    if n % 2:
        normal = sparse.block_diag([normal, sparse.identity(WIDTH)])
    size = 2 * WIDTH
    pairs = sparse.bsr_matrix(normal, blocksize=(size, size))
    rows = np.repeat(np.arange(normal.shape[0] // size), np.diff(pairs.indptr))
    diagonal = np.zeros((rows[-1] + 1, size, size))
    after = np.zeros_like(diagonal)  # from each pair to the next
    on, beside = rows == pairs.indices, rows + 1 == pairs.indices
    diagonal[rows[on]], after[rows[beside]] = pairs.data[on], pairs.data[beside]
    left = diagonal.copy()
    for i in range(1, len(left)):
        left[i] -= after[i - 1].T @ np.linalg.solve(left[i - 1], after[i - 1])
    whole, right = left.copy(), diagonal[-1]
    for i in range(len(left) - 2, -1, -1):
        taken = after[i] @ np.linalg.solve(right, after[i].T)
        whole[i] -= taken
        right = diagonal[i] - taken
    inverse = np.linalg.inv(whole).reshape(-1, 2, WIDTH, 2, WIDTH)
    return np.asarray(inverse[:, (0, 1), :, (0, 1)].swapaxes(0, 1).reshape(-1, WIDTH, WIDTH)[:n])
