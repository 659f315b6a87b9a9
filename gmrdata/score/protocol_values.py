"""A protocol's samples: of one person in one world, and of people and clips that count together."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from gmrdata.score import ProtocolMetric, metrics
from gmrdata.score.metrics import STANDS_M, Places, Points, Rotmats, Rows, Samples, pooled
from gmrdata.score.records import Protocol
from gmrdata.values.motion_metrics import chunks
from gmrdata.values.shapes import Float
from gmrdata.values.transforms import Similarities, fit_similarities

Joints = Float[np.ndarray, "frames joints 3"]
MAJOR_JOINTS = (0, 1, 2, 4, 5, 16, 17, 18, 19)
"""Joints of MPJAE: SMPL_OR_JOINTS of eth-ait/emdb."""
ACCELERATIONS: tuple[ProtocolMetric, ...] = (
    "accel_error_m_per_s2",
    "accel_mm_per_frame2",
    "accel_error_mm_per_frame2",
)


@dataclass(frozen=True, eq=False)
class WorldBody:
    """What protocols look at of a body over time in one world."""

    root_rotmats: Rotmats  # world_from_root
    joints_m: Joints  # SMPL's 24 joints, the pelvis first, or a regressor's [m]
    feet_m: Points  # points of the feet [m]


@dataclass(frozen=True, eq=False)
class SeenBody:
    """What protocols look at of a body over time in the camera's axes, the pelvis at the origin."""

    joints_m: Joints  # as `WorldBody` has them
    joint_rotmats: Float[np.ndarray, "frames 24 3 3"]  # camera_from_joint
    rest_pelvis_m: np.ndarray  # (3,) J0(shape): where SMPL's mesh has the pelvis
    vertices_m: Callable[[slice], Points]  # vertices of some frames, since all need much memory


TwoBodies = tuple[WorldBody, WorldBody] | tuple[SeenBody, SeenBody]


@dataclass(frozen=True, eq=False)
class WorldPair:
    """A prediction in a world of its own, and the truth of the same frames."""

    predicted: WorldBody
    true: WorldBody
    runs: tuple[Rows, ...]  # rows between the gaps; together they are all frames
    fps_hz: float  # frame rate [Hz]
    seen: tuple[SeenBody, SeenBody] | None = None
    """The prediction and the truth in the camera's axes; None where there is no camera for it."""
    camera_paths_m: tuple[Places, Places] | None = None
    """The prediction's own camera, and the true one, in the frames that both have [m]."""
    frames: np.ndarray | None = None  # (T,) number of each row's frame in the video, from 0
    video_frames: Rows = (0, 0)  # of the whole clip


def protocol_values(protocol: Protocol, pair: WorldPair) -> dict[ProtocolMetric, Samples]:
    """Samples of each of a protocol's metrics; empty where there are none.

    Those that count once per clip are not means yet: a clip has several worlds where it has gaps.
    """
    parts = {metric: _parts(protocol, metric, pair) for metric in protocol.metrics}
    if protocol.sample == "segment":  # each of which counts once
        parts = {metric: [mean_sample(one) for one in samples] for metric, samples in parts.items()}
    return {metric: pooled(samples) for metric, samples in parts.items()}


def values_together(
    protocol: Protocol, pairs: Sequence[WorldPair]
) -> dict[ProtocolMetric, Samples]:
    """The same of all people of one video, as SLAHMR takes them: each segment is one sample.

    A segment is of the video's frames, from the first that a clip of it has on.  Its people's
    frames are laid one behind the other, person by person, and aligned jointly, by the first frames
    of that row where only those are.
    """
    first = min((pair.video_frames[0] for pair in pairs), default=0)
    n_frames = max((pair.video_frames[1] for pair in pairs), default=0) - first
    samples: dict[ProtocolMetric, list[Samples]] = {metric: [] for metric in protocol.metrics}
    for start, stop in metrics.segments_of(n_frames, protocol.segment_frames, protocol.remainder):
        pair = _laid_out(pairs, (first + start, first + stop))
        if pair is None:
            continue
        whole = [(0, len(pair.true.joints_m))]
        for metric in protocol.metrics:
            samples[metric] += map(mean_sample, _parts(protocol, metric, pair, whole))
    return {metric: pooled(parts) for metric, parts in samples.items()}


def accelerations_over_clips(
    protocol: Protocol, clips: Sequence[Sequence[WorldPair]]
) -> list[dict[ProtocolMetric, Samples]]:
    """Accelerations of clips laid one behind the other, as VIBE takes them; one table per clip.

    What is taken from one clip to the next counts as the later one's.  What no camera sees is left
    out.
    """
    wanted = [one for one in protocol.metrics if one in ACCELERATIONS]
    clips = [[pair for pair in clip if pair.seen is not None] for clip in clips]
    pairs = [pair for clip in clips for pair in clip]
    if not pairs:
        return [{metric: np.zeros(0) for metric in wanted} for _ in clips]
    both = zip(*(_from_hips(protocol, pair) for pair in pairs), strict=True)
    laid = [np.concatenate(parts) for parts in both]
    ends = np.cumsum([sum(len(pair.true.joints_m) for pair in clip) for clip in clips])
    tables: list[dict[ProtocolMetric, Samples]] = [{} for _ in clips]
    for metric in wanted:
        whole, fps_hz = [(0, int(ends[-1]))], pairs[0].fps_hz
        values = _accelerations(protocol, metric, laid[0], laid[1], whole, fps_hz)
        # A sample is of the last of its three frames.
        for one, part in zip(tables, np.split(values, np.maximum(ends[:-1] - 2, 0)), strict=True):
            one[metric] = part
    return tables


def mean_sample(values: np.ndarray) -> Samples:
    """One sample for all, or none where there are none."""
    return np.array([values.mean()]) if len(values) else values


def _parts(
    protocol: Protocol,
    metric: ProtocolMetric,
    pair: WorldPair,
    segments: Sequence[Rows] | None = None,
) -> list[Samples]:
    """Samples of a metric, segment by segment where it has segments."""
    n_frames = len(pair.true.joints_m)
    if protocol.gaps != "kept":
        pair = replace(pair, runs=((0, n_frames),))
    if segments is None:
        segments = metrics.segments_of(n_frames, protocol.segment_frames, protocol.remainder)
    match metric:
        case "w_mpjpe_mm":
            return _segments(protocol, pair, segments, protocol.first_frames)
        case "wa_mpjpe_mm":
            return _segments(protocol, pair, segments, None)
        case "pa_mpjpe_mm":
            both = pair.predicted, pair.true  # the same before the camera
            errors_mm = metrics.aligned_errors_mm(*_joints_m(protocol, both), _best(protocol, both))
            in_segments = protocol.sample == "segment"
            return [errors_mm[a:b] for a, b in segments] if in_segments else [errors_mm]
        case "accel_length_error_mm_per_frame2":
            return [_acceleration_lengths(protocol, pair, segment) for segment in segments]
        case "rte_percent" | "roe_deg" | "erve_mm_per_frame" | "foot_sliding_mm":
            return [_of_path(protocol, metric, pair)]
        case "ate_m" | "ate_s_m":
            return (
                [] if pair.camera_paths_m is None else [_camera_error(metric, *pair.camera_paths_m)]
            )
        case "jitter_10m_per_s3":
            return _jitters(protocol, pair)
    return [] if pair.seen is None else [_of_seen(protocol, metric, pair, pair.seen)]


def _camera_error(metric: ProtocolMetric, predicted_m: Places, true_m: Places) -> Samples:
    """One value; none where one of the two stands, so that there is no scale to fit: that of the
    truth would be 0, and so would the error."""
    fits_scale = metric == "ate_m"
    if fits_scale and min(np.ptp(path, axis=0).max() for path in (predicted_m, true_m)) < STANDS_M:
        return np.zeros(0)
    return np.array([metrics.path_error_m(predicted_m, true_m, scale=fits_scale)])


def _of_path(protocol: Protocol, metric: ProtocolMetric, pair: WorldPair) -> Samples:
    predicted, true = pair.predicted, pair.true
    roots_m = predicted.joints_m[:, 0], true.joints_m[:, 0]
    rotmats = predicted.root_rotmats, true.root_rotmats
    if metric == "rte_percent":
        return metrics.root_errors_percent(*roots_m, pair.runs)
    if metric == "roe_deg":
        return metrics.root_orientation_errors_deg(*rotmats)
    if metric == "foot_sliding_mm":
        feet_m = predicted.feet_m, true.feet_m
        return metrics.foot_sliding_mm(*feet_m, pair.runs, protocol.contact_m)
    of_both = (rotmats[0], roots_m[0], rotmats[1], roots_m[1])
    return metrics.root_velocity_errors_mm_per_frame(*of_both, pair.runs)


def _of_seen(
    protocol: Protocol, metric: ProtocolMetric, pair: WorldPair, seen: tuple[SeenBody, SeenBody]
) -> Samples:
    if metric == "mpjpe_mm":
        return metrics.point_errors_mm(*_from_hips(protocol, pair))
    if metric in ("pve_mm", "pa_pve_mm"):
        return _vertex_errors_mm(protocol, seen, aligned=metric == "pa_pve_mm")
    if metric in ("mpjae_deg", "pa_mpjae_deg"):
        predicted, true = (body.joint_rotmats[:, list(MAJOR_JOINTS)] for body in seen)
        if metric == "pa_mpjae_deg":
            predicted = _best(protocol, seen).rotmats[:, None] @ predicted
        return metrics.joint_angle_errors_deg(predicted, true)
    predicted_m, true_m = _from_hips(protocol, pair)
    return _accelerations(protocol, metric, predicted_m, true_m, pair.runs, pair.fps_hz)


def _from_hips(protocol: Protocol, pair: WorldPair) -> tuple[Points, Points]:
    """Predicted and true joints in the camera's axes, from the middle of the hips [m]."""
    assert pair.seen is not None
    predicted_m, true_m = (
        one.joints_m[:, list(protocol.joints)] - metrics.hips_m(one.joints_m, protocol.hips)
        for one in pair.seen
    )
    return predicted_m, true_m


def _accelerations(
    protocol: Protocol,
    metric: ProtocolMetric,
    predicted_m: Points,
    true_m: Points,
    runs: Sequence[Rows],
    fps_hz: float,
) -> Samples:
    if metric == "accel_mm_per_frame2":
        return 1000 * metrics.accelerations(predicted_m, runs)
    errors_m = metrics.accelerations(predicted_m - true_m, runs, protocol.accel_trim)
    return errors_m * (fps_hz**2 if metric == "accel_error_m_per_s2" else 1000)


def _joints_m(protocol: Protocol, bodies: TwoBodies) -> tuple[Points, Points]:
    """The protocol's joints, of the prediction and of the truth [m]."""
    predicted_m, true_m = (one.joints_m[:, list(protocol.joints)] for one in bodies)
    return predicted_m, true_m


def _best(protocol: Protocol, bodies: TwoBodies) -> Similarities:
    predicted_m, true_m = _joints_m(protocol, bodies)
    return fit_similarities(true_m, predicted_m)


def _vertex_errors_mm(
    protocol: Protocol, seen: tuple[SeenBody, SeenBody], *, aligned: bool
) -> Samples:
    """PVE, or PA-PVE: after the best similarity of the joints."""
    best, parts = _best(protocol, seen), []
    n_vertices = seen[1].vertices_m(slice(0, 1)).shape[1]
    for rows in chunks(len(seen[1].joints_m), n_vertices):
        predicted_m, true_m = (_vertices_m(protocol, one, rows, aligned) for one in seen)
        if aligned:
            now = Similarities(*(part[rows] for part in best))
            parts.append(metrics.aligned_errors_mm(predicted_m, true_m, now))
        else:
            parts.append(metrics.point_errors_mm(predicted_m, true_m))
    return pooled(parts)


def _vertices_m(protocol: Protocol, one: SeenBody, rows: slice, aligned: bool) -> Points:
    vertices_m = one.vertices_m(rows)
    if aligned:
        return vertices_m
    if protocol.pve_from == "origin":
        return vertices_m + one.rest_pelvis_m
    return vertices_m - metrics.hips_m(one.joints_m[rows], protocol.hips)


def _segments(
    protocol: Protocol, pair: WorldPair, segments: Sequence[Rows], first_frames: int | None
) -> list[Samples]:
    both_m = _joints_m(protocol, (pair.predicted, pair.true))
    return metrics.segment_errors_mm(
        *both_m, segments, first_frames=first_frames, scale=protocol.scale
    )


def _acceleration_lengths(protocol: Protocol, pair: WorldPair, segment: Rows) -> Samples:
    """Of one segment; with gaps, no acceleration goes over one."""
    first, last = segment
    within = [(max(a, first), min(b, last)) for a, b in pair.runs if a < last and b > first]
    both_m = _joints_m(protocol, (pair.predicted, pair.true))
    return 1000 * metrics.acceleration_length_errors(*both_m, within)


def _jitters(protocol: Protocol, pair: WorldPair) -> list[Samples]:
    """Of joints in the world, or from the pelvis; none where no camera sees them and one must."""
    joints_m = pair.predicted.joints_m.copy()
    if protocol.jitter == "camera_from_pelvis":
        if pair.seen is None:
            return []
        joints_m = pair.seen[0].joints_m.copy()
    if protocol.jitter != "world":
        joints_m -= joints_m[:, :1].copy()
    joints_m[:, list(protocol.zeroed_joints)] = 0.0
    return [metrics.jitter_10m_per_s3(joints_m, pair.fps_hz, pair.runs)]


def _laid_out(pairs: Sequence[WorldPair], segment: Rows) -> WorldPair | None:
    """Rows of several people within a segment of the video, person by person; None without any."""
    predicted, true, runs, n_rows = [], [], [], 0
    for pair in pairs:
        assert pair.frames is not None
        rows = np.flatnonzero((pair.frames >= segment[0]) & (pair.frames < segment[1]))
        if not len(rows):
            continue
        predicted.append(_rows_of(pair.predicted, rows))
        true.append(_rows_of(pair.true, rows))
        breaks = np.flatnonzero(np.diff(pair.frames[rows]) != 1) + 1
        edges = [0, *breaks.tolist(), len(rows)]
        runs += [(n_rows + a, n_rows + b) for a, b in pairwise(edges)]
        n_rows += len(rows)
    if not n_rows:
        return None
    return WorldPair(_joined(predicted), _joined(true), tuple(runs), pairs[0].fps_hz)


def _rows_of(body: WorldBody, rows: np.ndarray) -> WorldBody:
    return WorldBody(*(values[rows] for values in vars(body).values()))


def _joined(bodies: Sequence[WorldBody]) -> WorldBody:
    arrays = zip(*(vars(one).values() for one in bodies), strict=True)
    return WorldBody(*map(np.concatenate, arrays))
