"""What `scores.json` holds, and the names in it."""

from collections.abc import Mapping, Set
from typing import Generic, Literal, Self, TypeVar

from pydantic import Field, JsonValue, model_validator

from gmrdata.score import METRICS, Interval, Method, Metric, ProtocolName, Remainder, WorldMetric
from gmrdata.values.records import Config, Record

T = TypeVar("T")


class ByMethod(Config, Generic[T]):
    """One value for what was predicted, and one for a body that neither turns nor moves."""

    predicted: T
    zero: T

    def get(self, method: Method) -> T:
        return self.predicted if method == "predicted" else self.zero


class PaperMetrics(Config, Generic[T]):
    """One value for each of the paper's errors: of orientation, translation and vertex motion."""

    ome_deg: T
    tme_mm: T
    vme_mm: T

    def get(self, metric: Metric) -> T:
        return dict(self)[metric]

    def by_metric(self) -> dict[str, T]:
        return {metric: self.get(metric) for metric in METRICS}


WorldFigures = dict[str, float | None]  # a protocol's figures; None for one that no clip has


class RowFloor(PaperMetrics[float]):
    """The pseudo ground truth's own errors, beside a row."""

    of: str
    """Class of camera motion that they are of, or "all"."""


class Row(Config):
    """What rows of clips and of groups have in common."""

    n_motions: int
    protocol: ByMethod[WorldFigures] | None
    """A protocol's figures; None without one."""
    floor: RowFloor | None
    """Errors of the pseudo ground truth itself; None where no floor was given."""
    below_floor: tuple[Metric, ...]

    def paper(self) -> ByMethod[PaperMetrics[float]]:
        """OME, TME and VME, pooled over motions."""
        raise NotImplementedError

    def figures(self, method: Method) -> dict[str, float | None]:
        """All figures by metric, the protocol's after the paper's."""
        world = {} if self.protocol is None else self.protocol.get(method)
        return {**self.paper().get(method).by_metric(), **world}

    def intervals(self, method: Method) -> dict[str, Interval | None]:
        """95 % intervals of the figures by metric; none of a single clip."""
        return {}


class ClipScore(Row):
    id: str
    camera_motion: str
    """Class of its camera's motion; "none" without a camera."""
    motion_type: str | None
    """What the person does, where that is on record."""
    dropped_frames: int
    predicted: PaperMetrics[float]
    """Means over its motions."""
    zero: PaperMetrics[float]
    protocol_fps_hz: float | None
    """Rate of the protocol's frames [Hz]; None without a protocol."""

    def paper(self) -> ByMethod[PaperMetrics[float]]:
        return ByMethod(predicted=self.predicted, zero=self.zero)


class GroupScore(Row):
    """Several clips.  Intervals are of 95 %, by bootstrap over clips; None for fewer than two."""

    n_clips: int
    pooled_over_motions: ByMethod[PaperMetrics[float]]
    """Means over all motions."""
    pooled_interval95: ByMethod[PaperMetrics[Interval | None]]
    mean_of_clips: ByMethod[PaperMetrics[float]]
    """Means of the clips' means."""
    mean_of_clips_interval95: ByMethod[PaperMetrics[Interval | None]]
    protocol_interval95: ByMethod[dict[str, Interval | None]] | None

    def paper(self) -> ByMethod[PaperMetrics[float]]:
        return self.pooled_over_motions

    def intervals(self, method: Method) -> dict[str, Interval | None]:
        world = {} if self.protocol_interval95 is None else self.protocol_interval95.get(method)
        return {**self.pooled_interval95.get(method).by_metric(), **world}


class Curve(Config):
    """Vertex error in each frame, mean over clips."""

    vertex_mm: tuple[float, ...]
    interval95_mm: tuple[tuple[float, ...], tuple[float, ...]] | None
    """Lower and upper ends of its 95 % interval [mm]; None for a single clip."""


class OverTime(ByMethod[Curve]):
    """The vertex error after t seconds (fig. 5)."""

    times_s: tuple[float, ...]
    clips: tuple[str, ...]
    """Ids of the clips that last so long."""


class Protocol(Config):
    """What is measured beside OME, TME and VME, and how."""

    name: ProtocolName
    metrics: tuple[WorldMetric, ...]
    source: str
    """Repository and files that it follows."""
    notes: tuple[str, ...]
    """What a reader of the figures must know, as sentences."""
    fps_hz: float
    """Rate of the published figures [Hz]."""
    segment_frames: int
    """Frames of a segment of W-MPJPE and WA-MPJPE."""
    remainder: Remainder
    first_frames: int
    """Frames whose joints W-MPJPE aligns."""
    scale: bool
    """Whether W-MPJPE and WA-MPJPE fit the scale too."""
    joints: tuple[int, ...]
    """Joints of W-MPJPE and WA-MPJPE."""
    sample: Literal["frame", "segment", "clip"]
    """What each value stands for, of which the mean over all clips is taken."""
    zeroed_joints: tuple[int, ...]
    """Joints that count as standing still in jitter, and so lower its mean."""
    jitter_of_path: bool
    """Whether jitter is of joints in the world; of joints relative to the pelvis otherwise."""
    contact_m: float
    """A true point of a foot stands while it moves less than this from frame to frame [m]."""


def metrics_with(protocol: Protocol | None) -> tuple[str, ...]:
    """OME, TME and VME, then a protocol's metrics."""
    return (*METRICS, *(protocol.metrics if protocol else ()))


class ScoredNetwork(Config):
    kind: Literal["network"]
    run: str
    step: int
    """Training step of its weights."""
    which: Literal["latest", "best"]
    network: dict[str, JsonValue]
    """Its settings, as `ModelConfig` names them."""


class ScoredFiles(Config):
    """The folder that predictions were read from."""

    kind: Literal["files"]
    predictions: str


class Bootstrap(Config):
    resamples: int
    seed: int


class Summary(Config):
    """Scores per clip, per class of camera motion, per type of motion and overall."""

    clips: tuple[ClipScore, ...]
    camera_motion: dict[str, GroupScore]
    motion_type: dict[str, GroupScore]
    """Clips of each type of motion that is on record."""
    overall: GroupScore
    over_time: OverTime
    statements: tuple[str, ...]
    """Which scores are below the floor, as sentences."""

    @model_validator(mode="after")
    def _has_every_group(self) -> Self:
        same_names("camera_motion", self.camera_motion, {c.camera_motion for c in self.clips})
        types = {clip.motion_type for clip in self.clips if clip.motion_type is not None}
        same_names("motion_type", self.motion_type, types)
        with_floor = (*self.clips, *self.camera_motion.values(), self.overall)
        if len({row.floor is None for row in with_floor}) > 1:
            raise ValueError("some rows have a `floor` and others have none")
        return self


class Scores(Summary, Record):
    """What `scores.json` holds: the figures of each clip and of groups of clips."""

    format: Literal["gmrdata-scores/3"] = "gmrdata-scores/3"
    name: str
    model: ScoredNetwork | ScoredFiles = Field(discriminator="kind")
    """Where the predictions come from."""
    fps_hz: float
    """Rate of OME, TME and VME [Hz]."""
    body: str
    protocol: Protocol | None
    """What was measured besides; None for nothing."""
    bootstrap: Bootstrap
    skipped: dict[str, str]
    """Why clips were left out, by id."""
    dropped_frames: int
    """Valid frames of all clips without a prediction."""

    @model_validator(mode="after")
    def _has_the_protocols_figures(self) -> Self:
        groups = (*self.camera_motion.values(), *self.motion_type.values(), self.overall)
        figures = [row.protocol for row in (*self.clips, *groups)]
        for found in (*figures, *(group.protocol_interval95 for group in groups)):
            if (found is None) != (self.protocol is None):
                raise ValueError("`protocol` of a row does not fit that of the file")
            if found is not None and self.protocol is not None:
                same_names("protocol.predicted", found.predicted, set(self.protocol.metrics))
                same_names("protocol.zero", found.zero, set(self.protocol.metrics))
        return self


def same_names(key: str, found: Mapping[str, object], expected: Set[str]) -> None:
    """Raise ValueError, for a validator, unless a table by name has the names that it must have."""
    for name in sorted(expected - found.keys()):
        raise ValueError(f"`{key}` has no key `{name}`")
    for name in sorted(found.keys() - expected):
        raise ValueError(f"`{key}` has an unknown key `{name}`")
