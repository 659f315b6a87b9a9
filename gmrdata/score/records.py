"""What `scores.json` holds, and the names in it."""

from collections.abc import Mapping, Set
from typing import Generic, Literal, Self, TypeVar

from pydantic import Field, JsonValue, model_validator

from gmrdata.score import (
    METRICS,
    Deviation,
    Interval,
    Method,
    Metric,
    ProtocolMetric,
    ProtocolName,
    Remainder,
    SeenIn,
)  # fmt: skip
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


class ScoreRow(Config):
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


class ClipScore(ScoreRow):
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
    subsets: tuple[str, ...]
    """Named parts of the data set that it belongs to, as EMDB 1 and EMDB 2."""
    seen_in: SeenIn | None
    """How the prediction came into the camera's frame; None where it did not."""
    took_true_camera: bool
    """Whether it was in the camera's frame, without a camera, and the truth's took it to the world,
    whose motion its figures know then."""

    def paper(self) -> ByMethod[PaperMetrics[float]]:
        return ByMethod(predicted=self.predicted, zero=self.zero)


class GroupScore(ScoreRow):
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

    @model_validator(mode="after")
    def _has_every_time(self) -> Self:
        for name, curve in (("predicted", self.predicted), ("zero", self.zero)):
            for values in (curve.vertex_mm, *(curve.interval95_mm or ())):
                if len(values) != len(self.times_s):
                    n = f"{len(values)} values for {len(self.times_s)} times_s"
                    raise ValueError(f"`over_time.{name}` has {n}")
        return self


class Protocol(Config):
    """What is measured beside OME, TME and VME, and how."""

    name: ProtocolName
    metrics: tuple[ProtocolMetric, ...]
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
    """Joints of MPJPE, W-MPJPE, WA-MPJPE and accelerations."""
    hips: tuple[int, int]
    """Joints whose middle is the point that MPJPE, PVE and accelerations are measured from."""
    joints_from: Literal["skeleton", "mesh"]
    """Whether joints are the body's own, or regressed from its posed mesh by a given file."""
    sample: Literal["frame", "segment"]
    """What each value stands for, of which the mean over all clips is taken."""
    once_per_clip: tuple[ProtocolMetric, ...]
    """Metrics of which each clip counts once, however long it is."""
    zeroed_joints: tuple[int, ...]
    """Joints that count as standing still in jitter, and so lower its mean."""
    jitter: Literal["world", "world_from_pelvis", "camera_from_pelvis"]
    """Whether jitter is of joints in the world, or relative to the pelvis, in which axes."""
    contact_m: float
    """A true point of a foot stands while it moves less than this from frame to frame [m]."""
    accel_trim: int
    """Samples of the acceleration's error that are left out at both ends."""
    pve_from: Literal["hips", "origin"]
    """Whether PVE is measured from the middle of the hips, or from the origin of SMPL's mesh."""
    gaps: Literal["kept", "joined", "joined_over_clips"]
    """Whether differences between frames leave gaps out, or go over them as released code does."""
    camera: Literal["any", "own"]
    """Whether predictions in the world alone are put into the truth's camera, or left out."""
    people: Literal["apart", "together"]
    """Whether each person is aligned alone, or all of a segment of the video jointly."""
    smoothing_frames: float
    """Standard deviation of the Gaussian that smooths a predicted path first [frames]."""
    original: tuple[Deviation, ...]
    """In what it follows the released code because it was asked to."""
    deviations: tuple[Deviation, ...]
    """In what it does not."""


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


class MatchedResult(Config):
    """What of another system's result is a clip's prediction."""

    file: str
    person: str
    """As the file counts people."""
    people: int
    """How many people the result has."""
    frames: int
    """Frames in which the result has the person."""
    used_frames: int
    """Those that are the clip's and, where some may lack, in all sets; valid ones are scored."""
    unused_frames: int
    """Those that are not the clip's."""
    first_unused_frame: int | None
    """First of these, counted from 0 in the video; None without any."""
    notes: tuple[str, ...]
    """What a reader of the figures must know, as sentences."""


class ScoredResults(Config):
    """Results of another system, as it writes them."""

    kind: Literal["results"]
    predictions: str
    """The folder, or file, that they were found in."""
    system: str
    camera: Literal["ignored", "true"] | None
    """How motions in the camera's frame came into the world; None for those in a world."""
    clips: dict[str, MatchedResult]
    """What each clip's prediction is, by id."""


class Bootstrap(Config):
    resamples: int
    seed: int


class ScoreSummary(Config):
    """Scores per clip, per class of camera motion, per type of motion and overall."""

    clips: tuple[ClipScore, ...]
    camera_motion: dict[str, GroupScore]
    motion_type: dict[str, GroupScore]
    """Clips of each type of motion that is on record."""
    subset: dict[str, GroupScore]
    """Clips of each named part of the data set."""
    overall: GroupScore
    over_time: OverTime
    statements: tuple[str, ...]
    """Which scores are below the floor, and that a network knows the clips, as sentences."""

    @model_validator(mode="after")
    def _has_every_group(self) -> Self:
        same_names("camera_motion", self.camera_motion, {c.camera_motion for c in self.clips})
        types = {clip.motion_type for clip in self.clips if clip.motion_type is not None}
        same_names("motion_type", self.motion_type, types)
        same_names("subset", self.subset, {one for clip in self.clips for one in clip.subsets})
        with_floor = (*self.clips, *self.camera_motion.values(), self.overall)
        if len({row.floor is None for row in with_floor}) > 1:
            raise ValueError("some rows have a `floor` and others have none")
        return self


class Scores(ScoreSummary, Record):
    """The content of `scores.json`: the figures of each clip and of groups of clips."""

    format: Literal["gmrdata-scores/4"] = "gmrdata-scores/4"
    name: str
    model: ScoredNetwork | ScoredFiles | ScoredResults = Field(discriminator="kind")
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
    """Valid frames of all clips without a prediction, here or in a set that was scored beside."""

    @model_validator(mode="after")
    def _has_the_protocols_figures(self) -> Self:
        named = (self.camera_motion, self.motion_type, self.subset)
        groups = (*(group for groups in named for group in groups.values()), self.overall)
        figures = [row.protocol for row in (*self.clips, *groups)]
        for values in (*figures, *(group.protocol_interval95 for group in groups)):
            if (values is None) != (self.protocol is None):
                raise ValueError("`protocol` of a row does not fit that of the file")
            if values is not None and self.protocol is not None:
                same_names("protocol.predicted", values.predicted, set(self.protocol.metrics))
                same_names("protocol.zero", values.zero, set(self.protocol.metrics))
        return self


def same_names(key: str, named: Mapping[str, object], expected: Set[str]) -> None:
    """Raise ValueError, for a validator, unless a table by name has the names that it must have."""
    for name in sorted(expected - named.keys()):
        raise ValueError(f"`{key}` has no key `{name}`")
    for name in sorted(named.keys() - expected):
        raise ValueError(f"`{key}` has an unknown key `{name}`")
