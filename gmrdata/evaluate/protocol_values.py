"""A protocol's figures for one person in one world, as samples of which means are taken."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gmrdata.evaluate import world_metrics
from gmrdata.evaluate.protocols import Protocol
from gmrdata.evaluate.world_metrics import Rows


@dataclass(frozen=True, eq=False)
class WorldBody:
    """What protocols look at of a body over T frames in one world."""

    root_rotmats: np.ndarray
    """(T, 3, 3) world_from_root."""
    joints_m: np.ndarray
    """(T, 24, 3) SMPL's joints, the pelvis first [m]."""
    feet_m: np.ndarray
    """(T, F, 3) points of the feet [m]."""


@dataclass(frozen=True, eq=False)
class WorldPair:
    """A prediction in a world of its own, and the truth of the same frames."""

    predicted: WorldBody
    true: WorldBody
    runs: tuple[Rows, ...]
    """Rows (start, stop) between the gaps; together they are all T frames."""
    fps_hz: float
    """Frame rate [Hz]."""


def protocol_values(protocol: Protocol, pair: WorldPair) -> dict[str, np.ndarray]:
    """Samples of each of a protocol's metrics: (n,) by metric, (0,) where there are none."""
    return {metric: _VALUES[metric](protocol, pair) for metric in protocol.metrics}


def _w(protocol: Protocol, pair: WorldPair) -> np.ndarray:
    return _segments(protocol, pair, protocol.first_frames)


def _wa(protocol: Protocol, pair: WorldPair) -> np.ndarray:
    return _segments(protocol, pair, None)


def _segments(protocol: Protocol, pair: WorldPair, first_frames: int | None) -> np.ndarray:
    joints = list(protocol.joints)
    errors_mm = world_metrics.segment_errors_mm(
        pair.predicted.joints_m[:, joints],
        pair.true.joints_m[:, joints],
        world_metrics.segments_of(
            len(pair.true.joints_m), protocol.segment_frames, protocol.remainder
        ),
        first_frames=first_frames,
        scale=protocol.scale,
    )
    if protocol.sample == "segment":
        return np.array([segment_mm.mean() for segment_mm in errors_mm])
    return _sampled(protocol, np.concatenate([np.zeros(0), *errors_mm]))


def _rte(protocol: Protocol, pair: WorldPair) -> np.ndarray:
    errors = world_metrics.root_errors_percent(
        pair.predicted.joints_m[:, 0], pair.true.joints_m[:, 0], pair.runs
    )
    return _sampled(protocol, errors)


def _roe(protocol: Protocol, pair: WorldPair) -> np.ndarray:
    errors_deg = world_metrics.root_orientation_errors_deg(
        pair.predicted.root_rotmats, pair.true.root_rotmats
    )
    return _sampled(protocol, errors_deg)


def _erve(protocol: Protocol, pair: WorldPair) -> np.ndarray:
    errors = world_metrics.root_velocity_errors_mm_per_frame(
        pair.predicted.root_rotmats,
        pair.predicted.joints_m[:, 0],
        pair.true.root_rotmats,
        pair.true.joints_m[:, 0],
        pair.runs,
    )
    return _sampled(protocol, errors)


def _jitter(protocol: Protocol, pair: WorldPair) -> np.ndarray:
    joints_m = pair.predicted.joints_m
    if not protocol.jitter_of_path:
        joints_m = joints_m - joints_m[:, :1]
    joints_m = joints_m.copy()
    joints_m[:, list(protocol.zeroed_joints)] = 0.0
    return _sampled(protocol, world_metrics.jitter_10m_per_s3(joints_m, pair.fps_hz, pair.runs))


def _foot_sliding(protocol: Protocol, pair: WorldPair) -> np.ndarray:
    slid_mm = world_metrics.foot_sliding_mm(
        pair.predicted.feet_m, pair.true.feet_m, pair.runs, protocol.contact_m
    )
    return _sampled(protocol, slid_mm)


def _sampled(protocol: Protocol, values: np.ndarray) -> np.ndarray:
    """The values themselves, or their mean where each clip counts once."""
    if protocol.sample == "clip" and len(values):
        return np.array([values.mean()])
    return values


_VALUES: dict[str, Callable[[Protocol, WorldPair], np.ndarray]] = {
    "w_mpjpe_mm": _w,
    "wa_mpjpe_mm": _wa,
    "rte_percent": _rte,
    "roe_deg": _roe,
    "erve_mm_per_frame": _erve,
    "jitter_10m_per_s3": _jitter,
    "foot_sliding_mm": _foot_sliding,
}
