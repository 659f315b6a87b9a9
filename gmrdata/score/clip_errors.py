"""Errors of a prediction of one clip, and of zero motion beside it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import get_args

import numpy as np

from gmrdata.score import METHODS, METRICS, CameraMetric, Method, Metric, ProtocolMetric, SeenIn
from gmrdata.score.metrics import Points, pooled
from gmrdata.score.predictions import PredictedClip, PredictedRun, World, still_motion
from gmrdata.score.protocol_values import (
    SeenBody,
    WorldBody,
    WorldPair,
    accelerations_over_clips,
    mean_sample,
    protocol_values,
    values_together,
)
from gmrdata.score.records import Protocol
from gmrdata.values import motion_metrics
from gmrdata.values.body import PARENTS, BodyModel, sole_vertices, with_vertices
from gmrdata.values.errors import BadMotionFile, BadRecipe
from gmrdata.values.motion import Motion, deltas
from gmrdata.values.skinning import global_rotmats, motion_joints_m, motion_vertices_m

SMPL_VERTICES = 6890
SMPL_FEET = (3216, 3387, 6617, 6787)
"""Two points on each foot of SMPL, left and right: yohanshin/WHAM, lib/eval/eval_utils.py."""
SOLE_M = 0.03  # vertices of a foot up to this high above its lowest one are its sole [m]


def foot_vertices(body: BodyModel) -> tuple[int, ...]:
    """Vertices at toes and heels, left first: SMPL's own, or both ends of another mesh's soles."""
    if len(body.template_m) == SMPL_VERTICES and body.name.startswith("smpl"):
        return SMPL_FEET
    vertices = []
    for side in ("left", "right"):
        sole = sole_vertices(body, body.template_m, side, SOLE_M)
        depths_m = body.template_m[sole, 2]
        vertices += [int(sole[depths_m.argmax()]), int(sole[depths_m.argmin()])]
    return tuple(vertices)


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
    protocol: dict[Method, dict[ProtocolMetric, np.ndarray]] = field(default_factory=dict)
    """A protocol's samples: (n,) by method and metric; none without a protocol."""
    protocol_fps_hz: float | None = None  # rate of the protocol's frames [Hz], if there is one
    dropped_frames: int = 0
    seen_in: SeenIn | None = None  # how it came into the camera's frame, if a protocol asked
    took_true_camera: bool = False  # whether the truth's camera took it to the world
    subsets: tuple[str, ...] = ()  # named parts of the data set that it belongs to
    pairs: dict[Method, list[WorldPair]] = field(default_factory=dict)
    """What a protocol measures across clips, by method; none where it measures each alone."""

    @property
    def n_motions(self) -> int:
        return len(self.errors["predicted"]["ome_deg"])


def clip_errors(
    clip: PredictedClip,
    body: BodyModel,
    protocol: Protocol | None = None,
    predicted_body: BodyModel | None = None,
    regressor: np.ndarray | None = None,
) -> ClipErrors:
    """Score a prediction of a clip.

    A protocol that takes several clips together has its figures by `across_clips` alone.

    Args:
        predicted_body: Of the true one's mesh; None for the true one.
        regressor: (J, V) which joints a protocol takes from posed meshes; None for the bodies' own.
    """
    runs = [_run_errors(run, body, predicted_body) for run in clip.runs]
    errors = {
        method: {m: np.concatenate([run[method][m] for run in runs]) for m in METRICS}
        for method in METHODS
    }
    longest = max(runs, key=lambda run: len(run["predicted"]["over_time_mm"]))
    scored = ClipErrors(
        clip.clip_id,
        clip.camera_motion,
        errors,
        over_time_mm={method: longest[method]["over_time_mm"] for method in METHODS},
        dropped_frames=clip.dropped_frames,
        took_true_camera=clip.took_true_camera,
    )
    if protocol is None:
        return scored
    pairs = _pairs(clip, protocol, (body, predicted_body or body), regressor)
    across = protocol.people == "together" or protocol.gaps == "joined_over_clips"
    return replace(
        scored,
        protocol={method: _pooled_values(protocol, pairs[method]) for method in METHODS},
        protocol_fps_hz=clip.worlds[0][0].true.fps_hz if clip.worlds else protocol.fps_hz,
        seen_in=_seen_in(clip.worlds, protocol) if _needs_camera(protocol) else None,
        pairs=pairs if across else {},
    )


def across_clips(
    scored: Sequence[ClipErrors], protocol: Protocol | None, videos: Mapping[str, str]
) -> list[ClipErrors]:
    """Clips with the figures that a protocol takes of several together; others are as they were.

    `videos` says by a clip's id which video it is of.  Figures of several people of a video are in
    its first clip.  BadMotionFile where predictions that are taken together differ in frame rate.
    """
    if protocol is None or not scored:
        return list(scored)
    if protocol.people == "together":
        return _of_videos(scored, protocol, videos)
    if protocol.gaps != "joined_over_clips":
        return list(scored)
    _require_one_rate(scored)
    figures = [dict(one.protocol) for one in scored]
    for method in METHODS:
        tables = accelerations_over_clips(protocol, [one.pairs[method] for one in scored])
        for clip, table in zip(figures, tables, strict=True):
            clip[method] = {**clip[method], **table}
    return [replace(one, protocol=new, pairs={}) for one, new in zip(scored, figures, strict=True)]


def _of_videos(
    scored: Sequence[ClipErrors], protocol: Protocol, videos: Mapping[str, str]
) -> list[ClipErrors]:
    by_video: dict[str, list[ClipErrors]] = {}
    for one in scored:
        if any(pair.frames is None for pair in one.pairs["predicted"]):
            raise BadRecipe(
                "--original people: a network's motions have no place in a video. Write its "
                "predictions to files and score those"
            )
        by_video.setdefault(videos.get(one.clip_id, one.clip_id), []).append(one)
    figures = {}
    for clips in by_video.values():
        _require_one_rate(clips)
        figures[clips[0].clip_id] = {
            method: values_together(protocol, [pair for one in clips for pair in one.pairs[method]])
            for method in METHODS
        }
    return [
        replace(one, protocol=figures.get(one.clip_id, one.protocol), pairs={}) for one in scored
    ]


def _require_one_rate(scored: Sequence[ClipErrors]) -> None:
    """Frame k of one would be laid beside frame k of another, which is of another time."""
    rates = {one.protocol_fps_hz: one.clip_id for one in scored}
    if len(rates) > 1:
        said = " and ".join(f"clip {id} at {fps_hz:g} fps" for fps_hz, id in rates.items())
        raise BadMotionFile(
            f"predictions of {said}, which --original takes together. Give them at one frame rate"
        )


def _run_errors(
    run: PredictedRun, body: BodyModel, predicted_body: BodyModel | None
) -> dict[Method, dict[str, np.ndarray]]:
    motions = {"predicted": run.predicted, "zero": still_motion(run.true, run.true)}
    vertices = motion_metrics.run_vertex_errors(body, run.true, motions, predicted_body)
    true_rotmats, true_m = deltas(run.true.root_rotmats, run.true.pelvis_m)
    errors = {}
    for method in METHODS:
        delta_rotmats, delta_m = deltas(motions[method].root_rotmats, motions[method].pelvis_m)
        errors[method] = vertices[method]._asdict() | {
            "ome_deg": motion_metrics.orientation_errors_deg(delta_rotmats, true_rotmats),
            "tme_mm": motion_metrics.translation_errors_mm(delta_m, true_m),
        }
    return errors


def _pooled_values(
    protocol: Protocol, pairs: Sequence[WorldPair]
) -> dict[ProtocolMetric, np.ndarray]:
    if protocol.people == "together":
        return {metric: np.zeros(0) for metric in protocol.metrics}
    parts = [protocol_values(protocol, pair) for pair in pairs]
    values = {metric: pooled([one[metric] for one in parts]) for metric in protocol.metrics}
    return values | {metric: mean_sample(values[metric]) for metric in protocol.once_per_clip}


def _pairs(
    clip: PredictedClip,
    protocol: Protocol,
    bodies: tuple[BodyModel, BodyModel],
    regressor: np.ndarray | None,
) -> dict[Method, list[WorldPair]]:
    """What a protocol looks at, world by world: the true body's is the first of the bodies."""
    pairs: dict[Method, list[WorldPair]] = {method: [] for method in METHODS}
    for world in clip.worlds:
        true = _whole([run.true for run in world])
        predicted = _whole([run.predicted for run in world])
        still = _whole([still_motion(run.true, world[0].true) for run in world])
        edges = np.cumsum([0, *(run.true.n_frames for run in world)]).tolist()
        numbers = [run.frames for run in world if run.frames is not None]
        frames = np.concatenate(numbers) if len(numbers) == len(world) else None
        seen = _needs_camera(protocol) and _seen_in([world], protocol) is not None
        true_body, its_body = bodies
        cameras = _cameras(world, true, predicted)
        truth = _world_body(true_body, true, protocol, regressor)
        true_seen = _seen_body(true_body, true, cameras[0], regressor)
        for method, one, body, camera in (
            ("predicted", predicted, its_body, cameras[1]),
            ("zero", still, true_body, cameras[0]),
        ):
            pair = WorldPair(
                _world_body(body, one, protocol, regressor),
                truth,
                tuple(pairwise(edges)),
                true.fps_hz,
                (_seen_body(body, one, camera, regressor), true_seen) if seen else None,
                clip.camera_paths_m if method == "predicted" else None,
                frames,
                clip.video_frames,
            )
            pairs[method].append(pair)  # type: ignore[index]  # mypy takes the names for str
    return pairs


def _needs_camera(protocol: Protocol) -> bool:
    in_camera = set(get_args(CameraMetric)) & set(protocol.metrics)
    return bool(in_camera) or protocol.jitter == "camera_from_pelvis"


def _seen_in(worlds: Sequence[World], protocol: Protocol) -> SeenIn | None:
    runs = [run for world in worlds for run in world]
    if not runs:
        return None
    if all(run.true_cam_rotmats is not None for run in runs):
        if all(run.predicted_cam_rotmats is not None for run in runs):
            return "own_camera"
        return "true_camera" if protocol.camera == "any" else None
    return "world" if protocol.camera == "any" else None


def _cameras(world: World, true: Motion, predicted: Motion) -> tuple[np.ndarray, np.ndarray]:
    """cam_from_world rotations (T, 3, 3) of the truth, and for the prediction's own world.

    A prediction without a camera is turned so that its first orientation is the true one.  A truth
    without one is looked at as it is in the world.
    """
    seen = [run.true_cam_rotmats for run in world if run.true_cam_rotmats is not None]
    own = [run.predicted_cam_rotmats for run in world if run.predicted_cam_rotmats is not None]
    has_true = len(seen) == len(world)
    of_true = np.concatenate(seen) if has_true else np.tile(np.eye(3), (true.n_frames, 1, 1))
    if has_true and len(own) == len(world):
        return of_true, np.concatenate(own)
    true_from_predicted = true.root_rotmats[0] @ predicted.root_rotmats[0].T
    return of_true, of_true @ true_from_predicted


def _whole(motions: Sequence[Motion]) -> Motion:
    """Runs of one motion, one behind the other."""
    return replace(
        motions[0],
        local_rotmats=np.concatenate([one.local_rotmats for one in motions]),
        root_rotmats=np.concatenate([one.root_rotmats for one in motions]),
        pelvis_m=np.concatenate([one.pelvis_m for one in motions]),
    )


def _world_body(
    body: BodyModel, motion: Motion, protocol: Protocol, regressor: np.ndarray | None
) -> WorldBody:
    feet_m = np.zeros((motion.n_frames, 0, 3))
    if "foot_sliding_mm" in protocol.metrics:
        feet = with_vertices(body, np.array(foot_vertices(body)))
        feet_m = _vertices_m(feet, motion, slice(None))
    return WorldBody(motion.root_rotmats, _joints_m(body, motion, regressor), feet_m)


def _seen_body(
    body: BodyModel, motion: Motion, cam_rotmats: np.ndarray, regressor: np.ndarray | None
) -> SeenBody:
    """A body in the axes of a camera (T, 3, 3), with its pelvis at the origin."""
    seen = replace(
        motion,
        root_rotmats=cam_rotmats @ motion.root_rotmats,
        pelvis_m=np.zeros_like(motion.pelvis_m),
        frame="camera",
    )
    joints_m, rotmats = _joints_m(body, seen, regressor), global_rotmats(PARENTS, seen.rotmats)
    vertices_m = partial(_vertices_m, body, seen)
    return SeenBody(joints_m, rotmats, body.rest_pelvis_m(motion.shape), vertices_m)


def _vertices_m(body: BodyModel, motion: Motion, rows: slice) -> Points:
    # Posed at the origin, since vertices far from it have few digits.
    at_origin = replace(motion, pelvis_m=np.zeros_like(motion.pelvis_m))
    return np.asarray(motion_vertices_m(body, at_origin, rows) + motion.pelvis_m[rows, None])


def _joints_m(body: BodyModel, motion: Motion, regressor: np.ndarray | None) -> Points:
    """Joints (T, J, 3) of the skeleton, or of posed meshes, a chunk of frames at a time [m]."""
    if regressor is None:
        return motion_joints_m(body, motion)
    # From the pelvis, since rows of a regressor sum to 1 but for their rounding.
    at_origin = replace(motion, pelvis_m=np.zeros_like(motion.pelvis_m))
    chunks = motion_metrics.chunks(motion.n_frames, len(body.template_m))
    posed_m = (_vertices_m(body, at_origin, rows) for rows in chunks)
    joints_m = [np.einsum("jv,tvd->tjd", regressor, part, optimize=True) for part in posed_m]
    return np.concatenate(joints_m) + motion.pelvis_m[:, None]
