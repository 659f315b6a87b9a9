"""Small records of scores, complete and consistent."""

from collections.abc import Mapping, Sequence
from typing import Any

from gmrdata.score import METRICS
from gmrdata.score.protocols import PROTOCOLS
from gmrdata.score.records import (
    Bootstrap,
    ByMethod,
    ClipScore,
    Curve,
    GroupScore,
    OverTime,
    PaperMetrics,
    Protocol,
    ScoredFiles,
    Scores,
)

NO_INTERVALS: PaperMetrics[Any] = PaperMetrics(**dict.fromkeys(METRICS))
SMALL = PaperMetrics(ome_deg=0.01, tme_mm=0.01, vme_mm=0.01)


def metrics(ome_deg: float, tme_mm: float, vme_mm: float) -> PaperMetrics[float]:
    return PaperMetrics(ome_deg=ome_deg, tme_mm=tme_mm, vme_mm=vme_mm)


def clip_score(
    id: str,
    predicted: PaperMetrics[float],
    *,
    camera_motion: str = "linear",
    zero: PaperMetrics[float] = SMALL,
    n_motions: int = 9,
    world: Mapping[str, float] | None = None,
    protocol_fps_hz: float = 30.0,
) -> ClipScore:
    """A clip, with a protocol's figures where they are given; zero motion's are 50."""
    return ClipScore(
        id=id,
        camera_motion=camera_motion,
        motion_type=None,
        n_motions=n_motions,
        dropped_frames=0,
        predicted=predicted,
        zero=zero,
        protocol=None
        if world is None
        else ByMethod(predicted=dict(world), zero=dict.fromkeys(world, 50.0)),
        protocol_fps_hz=None if world is None else protocol_fps_hz,
        subsets=(),
        seen_in=None,
        took_true_camera=False,
        floor=None,
        below_floor=(),
    )


def group_score(
    clips: Sequence[ClipScore], interval: PaperMetrics[Any] = NO_INTERVALS, **changes: Any
) -> GroupScore:
    """A group with the figures of its first clip."""
    first = clips[0]
    world = None if first.protocol is None else dict.fromkeys(first.protocol.predicted)
    given = {
        "n_clips": len(clips),
        "n_motions": sum(clip.n_motions for clip in clips),
        "pooled_over_motions": first.paper(),
        "pooled_interval95": ByMethod(predicted=interval, zero=NO_INTERVALS),
        "mean_of_clips": first.paper(),
        "mean_of_clips_interval95": ByMethod(predicted=NO_INTERVALS, zero=NO_INTERVALS),
        "protocol": first.protocol,
        "protocol_interval95": None if world is None else ByMethod(predicted=world, zero=world),
        "floor": first.floor,
        "below_floor": first.below_floor,
    }
    return GroupScore.model_validate(given | changes)


def scores(
    clips: Sequence[ClipScore],
    *,
    name: str = "run",
    fps_hz: float = 10.0,
    protocol: Protocol | None = None,
    overall: GroupScore | None = None,
) -> Scores:
    """Scores of clips."""
    classes = dict.fromkeys(clip.camera_motion for clip in clips)
    types = dict.fromkeys(clip.motion_type for clip in clips if clip.motion_type is not None)
    return Scores(
        name=name,
        model=ScoredFiles(kind="files", predictions=name),
        fps_hz=fps_hz,
        body="small",
        protocol=protocol,
        bootstrap=Bootstrap(resamples=2000, seed=0),
        skipped={},
        dropped_frames=0,
        clips=tuple(clips),
        camera_motion={
            kind: group_score([clip for clip in clips if clip.camera_motion == kind])
            for kind in classes
        },
        motion_type={
            type: group_score([clip for clip in clips if clip.motion_type == type], floor=None)
            for type in types
        },
        subset={},
        overall=overall or group_score(clips),
        over_time=OverTime(
            times_s=(0.0, 0.1),
            clips=(clips[0].id,),
            predicted=Curve(vertex_mm=(0.0, 5.0), interval95_mm=((0.0, 4.0), (0.0, 6.0))),
            zero=Curve(vertex_mm=(0.0, 9.0), interval95_mm=None),
        ),
        statements=(),
    )


def of_protocol(name: str, *measured: str) -> Protocol:
    """A protocol that measures only some metrics."""
    return next(p for p in PROTOCOLS.values() if p.name == name).model_copy(
        update={"metrics": measured}
    )
