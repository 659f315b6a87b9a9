"""Errors of a prediction of one clip, and of zero motion beside it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from gmrdata.score import METHODS, METRICS, Method, Metric, WorldMetric
from gmrdata.score.predictions import PredictedClip, PredictedRun, World, still_motion
from gmrdata.score.protocols import WorldBody, WorldPair, protocol_values
from gmrdata.score.records import Protocol
from gmrdata.score.world_metrics import pooled
from gmrdata.values import motion_metrics
from gmrdata.values.body import BodyModel, sole_vertices, with_vertices
from gmrdata.values.motion import Motion
from gmrdata.values.motion_deltas import deltas
from gmrdata.values.skinning import motion_joints_m, motion_vertices_m

SMPL_VERTICES = 6890
SMPL_FEET = (3216, 3387, 6617, 6787)
"""Two points on each foot of SMPL, left and right: yohanshin/WHAM, lib/eval/eval_utils.py."""
SOLE_M = 0.03  # vertices of a foot up to this high above its lowest one are its sole [m]


def foot_vertices(body: BodyModel) -> tuple[int, ...]:
    """Vertices at toes and heels, left first: SMPL's own, or both ends of another mesh's soles."""
    if len(body.template_m) == SMPL_VERTICES and body.name.startswith("smpl"):
        return SMPL_FEET
    found = []
    for side in ("left", "right"):
        sole = sole_vertices(body, body.template_m, side, SOLE_M)
        depths_m = body.template_m[sole, 2]
        found += [int(sole[depths_m.argmax()]), int(sole[depths_m.argmin()])]
    return tuple(found)


@dataclass(frozen=True, eq=False)
class ClipErrors:
    """Errors of one clip by method, "predicted" or "zero"."""

    clip_id: str
    camera_motion: str
    errors: dict[Method, dict[Metric, np.ndarray]]  # (n,) OME, TME and VME of each motion
    motion_type: str | None = None
    over_time_mm: dict[Method, np.ndarray] = field(default_factory=dict)
    """Vertex error in each frame of the clip's longest run, whose first pose is the true one: (K,)
    by method [mm]."""
    protocol: dict[Method, dict[WorldMetric, np.ndarray]] = field(default_factory=dict)
    """A protocol's samples: (n,) by method and metric; none without a protocol."""
    protocol_fps_hz: float | None = None  # rate of the protocol's frames [Hz], if there is one
    dropped_frames: int = 0

    @property
    def n_motions(self) -> int:
        return len(self.errors["predicted"]["ome_deg"])


def clip_errors(
    clip: PredictedClip,
    body: BodyModel,
    protocol: Protocol | None = None,
    predicted_body: BodyModel | None = None,
) -> ClipErrors:
    """Score a prediction of a clip; `predicted_body` has the true one's mesh, or is None for it."""
    runs = [_run_errors(run, body, predicted_body) for run in clip.runs]
    errors = {
        method: {m: np.concatenate([run[method][m] for run in runs]) for m in METRICS}
        for method in METHODS
    }
    longest = max(runs, key=lambda run: len(run["predicted"]["over_time_mm"]))
    return ClipErrors(
        clip.clip_id,
        clip.camera_motion,
        errors,
        over_time_mm={method: longest[method]["over_time_mm"] for method in METHODS},
        protocol=_protocol(clip.worlds, protocol, body, predicted_body or body) if protocol else {},
        protocol_fps_hz=clip.worlds[0][0].true.fps_hz if protocol else None,
        dropped_frames=clip.dropped_frames,
    )


def _run_errors(
    run: PredictedRun, body: BodyModel, predicted_body: BodyModel | None
) -> dict[Method, dict[str, np.ndarray]]:
    motions = {"predicted": run.predicted, "zero": still_motion(run.true, run.true)}
    vertices = motion_metrics.run_vertex_errors(body, run.true, motions, predicted_body)
    true_rotmats, true_m = deltas(run.true.root_rotmats, run.true.pelvis_m)
    found = {}
    for method in METHODS:
        delta_rotmats, delta_m = deltas(motions[method].root_rotmats, motions[method].pelvis_m)
        found[method] = vertices[method]._asdict() | {
            "ome_deg": motion_metrics.orientation_errors_deg(delta_rotmats, true_rotmats),
            "tme_mm": motion_metrics.translation_errors_mm(delta_m, true_m),
        }
    return found


def _protocol(
    worlds: Sequence[World], protocol: Protocol, body: BodyModel, predicted_body: BodyModel
) -> dict[Method, dict[WorldMetric, np.ndarray]]:
    with_feet = "foot_sliding_mm" in protocol.metrics
    found: dict[Method, list[dict[WorldMetric, np.ndarray]]] = {method: [] for method in METHODS}
    for world in worlds:
        true = _world_body(body, [run.true for run in world], with_feet)
        predicted = _world_body(predicted_body, [run.predicted for run in world], with_feet)
        still = [still_motion(run.true, world[0].true) for run in world]
        zero = _world_body(body, still, with_feet)
        edges = np.cumsum([0, *(run.true.n_frames for run in world)]).tolist()
        for method, one in zip(METHODS, (predicted, zero), strict=True):
            pair = WorldPair(one, true, tuple(pairwise(edges)), world[0].true.fps_hz)
            found[method].append(protocol_values(protocol, pair))
    return {
        method: {metric: pooled([one[metric] for one in parts]) for metric in protocol.metrics}
        for method, parts in found.items()
    }


def _world_body(body: BodyModel, motions: Sequence[Motion], with_feet: bool) -> WorldBody:
    root_rotmats = np.concatenate([motion.root_rotmats for motion in motions])
    feet_m = np.zeros((len(root_rotmats), 0, 3))
    if with_feet:
        feet = with_vertices(body, np.array(foot_vertices(body)))
        feet_m = np.concatenate([motion_vertices_m(feet, one) for one in motions]).astype(float)
    joints_m = np.concatenate([motion_joints_m(body, motion) for motion in motions])
    return WorldBody(root_rotmats, joints_m, feet_m)
