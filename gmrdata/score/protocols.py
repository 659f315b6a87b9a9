"""Named protocols: what other systems measure in the world, and how each differs, as plain data.

Each entry says which public code it follows; `notes` say where it can't, or must not, be followed
to the letter.  The protocols agree in this: positions are of SMPL's tree in metres, alignments are
least squares (Umeyama 1991), and published figures are of video at 30 fps.  A protocol's figures
for one person in one world are samples, of which means are taken.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np

from gmrdata.score import ProtocolName, WorldMetric
from gmrdata.score import world_metrics as metrics
from gmrdata.score.records import Protocol
from gmrdata.score.world_metrics import Points, Rotmats, Rows, Samples, pooled
from gmrdata.values.body import JOINT, N_JOINTS
from gmrdata.values.shapes import Float

_WHAM_NOTES = (
    "Released code joins the frames on both sides of a gap; here no velocity, jitter, sliding or "
    "path length goes over one.",
    "W-MPJPE and WA-MPJPE fit the scale, so they don't show an error of it; RTE does.",
)

_LSP_JOINTS = (
    "right_ankle", "right_knee", "right_hip", "left_hip", "left_knee", "left_ankle", "right_wrist",
    "right_elbow", "right_shoulder", "left_shoulder", "left_elbow", "left_wrist", "neck", "head",
)  # fmt: skip

_EMDB_ZEROED = (
    "pelvis", "left_ankle", "right_ankle", "left_foot", "right_foot",
    "left_wrist", "right_wrist", "left_hand", "right_hand",
)  # fmt: skip


def _protocol(**differences: Any) -> Protocol:
    """A protocol that is as most are, but for what is given."""
    usual = {
        "fps_hz": 30.0,
        "segment_frames": 100,
        "remainder": "own_segment",
        "first_frames": 2,
        "scale": True,
        "joints": tuple(range(N_JOINTS)),
        "sample": "frame",
        "zeroed_joints": (),
        "jitter_of_path": True,
        "contact_m": 0.01,
    }
    return Protocol.model_validate(usual | differences)


PROTOCOLS: dict[ProtocolName, Protocol] = {
    protocol.name: protocol
    for protocol in (
        _protocol(
            name="gmr",
            metrics=(),
            source="the GMR paper (arXiv 2112.00343), eqs. 15-17 and fig. 5",
            notes=("OME, TME, VME and the vertex error over time; nothing is aligned.",),
            fps_hz=10.0,
        ),
        _protocol(
            name="wham",
            metrics=get_args(WorldMetric),
            source="yohanshin/WHAM, lib/eval/eval_utils.py and lib/eval/evaluate_emdb.py",
            notes=(
                *_WHAM_NOTES,
                "The released code has no ROE and no ERVE. ROE is taken after the first frame's "
                "orientations were made equal, ERVE as yufu-wang/tram codes it.",
                "RTE is of SMPL's transl there and of the pelvis here; the two paths differ by a "
                "constant, which the alignment takes away.",
            ),
        ),
        _protocol(
            name="tram",
            metrics=("w_mpjpe_mm", "wa_mpjpe_mm", "rte_percent", "erve_mm_per_frame"),
            source="yufu-wang/tram, lib/utils/eval_utils.py and scripts/emdb/run_eval.py",
            notes=(
                *_WHAM_NOTES,
                "Frames after the last full segment belong to it, but for the very last one; "
                "sequences of up to 100 frames have no W-MPJPE and no WA-MPJPE, and where the "
                "length is a multiple of 100 the last 100 frames are not scored.",
                "There the predicted path is smoothed before it is scored; here it is scored as "
                "it is given.",
            ),
            remainder="joined_but_last_frame",
        ),
        _protocol(
            name="gvhmr",
            metrics=(
                "w_mpjpe_mm",
                "wa_mpjpe_mm",
                "rte_percent",
                "jitter_10m_per_s3",
                "foot_sliding_mm",
            ),
            source="zju3dv/GVHMR, hmr4d/utils/eval/eval_utils.py and "
            "hmr4d/model/gvhmr/callbacks/metric_emdb.py",
            notes=(
                *_WHAM_NOTES,
                "There the joints of both bodies are regressed from their meshes by the neutral "
                "SMPL model; here each body has its own joints.",
            ),
        ),
        _protocol(
            name="slahmr",
            metrics=("w_mpjpe_mm", "wa_mpjpe_mm"),
            source="vye16/slahmr, slahmr/eval/tools.py, slahmr/eval/run_eval.py (fa_jmse, ga_jmse) "
            "and slahmr/eval/split_egobody.py",
            notes=(
                "Each segment counts once, however many frames it has: figures are means of "
                "segments.",
                "Sequences are cut into segments of 100 frames, the rest belongs to the last one, "
                "and sequences of up to 100 frames have none; where no frame is left over, the "
                "last 200 frames are one segment.",
                "There the joints are Human3.6M's, regressed from the mesh by a file that is not "
                "free; here they are SMPL's of the same names, 14 without the root. Until commit "
                "f65c767 the root was aligned too, and its error was a figure of its own.",
                "Both fit the scale, so they don't show an error of it.",
            ),
            remainder="joined",
            joints=tuple(JOINT[name] for name in _LSP_JOINTS),
            sample="segment",
        ),
        _protocol(
            name="emdb",
            metrics=("jitter_10m_per_s3",),
            source="eth-ait/emdb, evaluation_metrics.py and evaluation_engine.py",
            notes=(
                "The jitter of EMDB's own evaluation: nine joints count as standing still, which "
                "makes it 15/24 of the mean of the others; the pelvis' translation is left out; "
                "each sequence counts once. One file there calls the unit km/s^3, the other "
                "10 m/s^3, which it is.",
                "The figures of others on EMDB 2 are those of protocol wham.",
                "Released code joins the frames on both sides of a gap; here no jitter goes over "
                "one.",
            ),
            sample="clip",
            zeroed_joints=tuple(JOINT[name] for name in _EMDB_ZEROED),
            jitter_of_path=False,
        ),
    )
}


@dataclass(frozen=True, eq=False)
class WorldBody:
    """What protocols look at of a body over time in one world."""

    root_rotmats: Rotmats  # world_from_root
    joints_m: Float[np.ndarray, "frames 24 3"]  # SMPL's joints, the pelvis first [m]
    feet_m: Points  # points of the feet [m]


@dataclass(frozen=True, eq=False)
class WorldPair:
    """A prediction in a world of its own, and the truth of the same frames."""

    predicted: WorldBody
    true: WorldBody
    runs: tuple[Rows, ...]  # rows between the gaps; together they are all frames
    fps_hz: float  # frame rate [Hz]


def protocol_values(protocol: Protocol, pair: WorldPair) -> dict[WorldMetric, Samples]:
    """Samples of each of a protocol's metrics; empty where there are none."""
    return {
        metric: _sampled(protocol, _parts(protocol, metric, pair)) for metric in protocol.metrics
    }


def _sampled(protocol: Protocol, parts: Sequence[np.ndarray]) -> Samples:
    """The values themselves, or their means where each segment or each clip counts once."""
    values = pooled(parts)
    if protocol.sample == "segment":
        return np.array([part.mean() for part in parts])
    if protocol.sample == "clip" and len(values):
        return np.array([values.mean()])
    return values


def _parts(protocol: Protocol, metric: WorldMetric, pair: WorldPair) -> list[Samples]:
    """Samples of a metric, segment by segment where it has segments."""
    predicted, true = pair.predicted, pair.true
    roots_m = predicted.joints_m[:, 0], true.joints_m[:, 0]
    rotmats = predicted.root_rotmats, true.root_rotmats
    match metric:
        case "w_mpjpe_mm":
            return _segments(protocol, pair, protocol.first_frames)
        case "wa_mpjpe_mm":
            return _segments(protocol, pair, None)
        case "rte_percent":
            return [metrics.root_errors_percent(*roots_m, pair.runs)]
        case "roe_deg":
            return [metrics.root_orientation_errors_deg(*rotmats)]
        case "erve_mm_per_frame":
            of_both = (rotmats[0], roots_m[0], rotmats[1], roots_m[1])
            return [metrics.root_velocity_errors_mm_per_frame(*of_both, pair.runs)]
        case "jitter_10m_per_s3":
            return [metrics.jitter_10m_per_s3(_jittered_m(protocol, pair), pair.fps_hz, pair.runs)]
        case "foot_sliding_mm":
            feet_m = predicted.feet_m, true.feet_m
            return [metrics.foot_sliding_mm(*feet_m, pair.runs, protocol.contact_m)]


def _segments(protocol: Protocol, pair: WorldPair, first_frames: int | None) -> list[Samples]:
    joints, n_frames = list(protocol.joints), len(pair.true.joints_m)
    return metrics.segment_errors_mm(
        pair.predicted.joints_m[:, joints],
        pair.true.joints_m[:, joints],
        metrics.segments_of(n_frames, protocol.segment_frames, protocol.remainder),
        first_frames=first_frames,
        scale=protocol.scale,
    )


def _jittered_m(protocol: Protocol, pair: WorldPair) -> Points:
    joints_m = pair.predicted.joints_m.copy()
    if not protocol.jitter_of_path:
        joints_m -= joints_m[:, :1].copy()
    joints_m[:, list(protocol.zeroed_joints)] = 0.0
    return joints_m
