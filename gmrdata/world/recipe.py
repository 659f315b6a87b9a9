"""The recipe of a pseudo ground truth: its metric scale, and the thresholds of its verdict."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    BeforeValidator,
    Field,
    NonNegativeInt,
    PlainSerializer,
    PositiveFloat,
    StrictInt,
    StringConstraints,
    TypeAdapter,
    model_validator,
)
from pydantic.dataclasses import dataclass as part

from gmrdata.cameras.recipe import CamerasVerdictConfig
from gmrdata.values import limits
from gmrdata.values.camera_motion import MotionClassConfig
from gmrdata.values.clip import dropped_ranges, text_runs, texts_of
from gmrdata.values.errors import BadRecipe
from gmrdata.values.files import write_npz
from gmrdata.values.records import PART, ArrayShapes, Config, Figure, Record, read_arrays

DATASET_CAMERA_FORMAT = "gmrdata-dataset-camera/1"
GRAVITY_FORMAT = "gmrdata-gravity/1"
_SHAPES: ArrayShapes = {"world_from_cam": ("f", ("T", 4, 4))}
_GRAVITY_SHAPES: ArrayShapes = {"up_cam": ("f", ("T", 3))}


@part(frozen=True, config=PART)
class Dropped:
    """Frames start, start + 1, ..., stop - 1 that must not be used."""

    start: int
    stop: int
    reason: str


@part(frozen=True, config=PART)
class Verdict:
    """What was decided of one person of a sequence, and on what, as it stands in records."""

    id: str
    frames: NonNegativeInt
    kept_frames: NonNegativeInt
    kept_share: Figure
    accepted: bool
    reasons: tuple[str, ...]
    """Why not, for a rejected one; and what a person decided, for any."""
    dropped: tuple[Dropped, ...]

    @property
    def kept(self) -> np.ndarray:
        """(T,) bool: frames outside the dropped ranges."""
        return np.array([not reason for reason in self.frame_reasons], dtype=bool)

    @property
    def frame_reasons(self) -> list[str]:
        """T texts: why each frame is dropped by itself; empty where it isn't."""
        runs = ((run.start, run.stop, run.reason) for run in self.dropped)
        return texts_of(runs, self.frames)

    @property
    def row_reasons(self) -> list[str]:
        """T texts: why each row is dropped; all rows of a rejected sequence are."""
        if self.accepted:
            return self.frame_reasons
        rejected = f"the sequence is rejected: {'; '.join(self.reasons)}"
        return [reason or rejected for reason in self.frame_reasons]


def verdict_of(
    clip_id: str, accepted: bool, reasons: Iterable[str], frame_reasons: Sequence[str]
) -> Verdict:
    """The verdict on T frames; a frame with an empty reason is kept."""
    frames, kept = len(frame_reasons), list(frame_reasons).count("")
    dropped = tuple(Dropped(*run) for run in dropped_ranges(frame_reasons))
    return Verdict(clip_id, frames, kept, kept / frames, accepted, tuple(reasons), dropped)


FrameRange = tuple[Annotated[int, Field(ge=0)], int]  # (start, stop): start, ..., stop - 1
Reason = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)]
NOTHING_TO_USE = "the frame has no camera or no pose"
NOTHING_LEFT = "no frame can be used"


class Override(Config):
    """What a person decided who looked at a sequence; all else stays as the thresholds left it."""

    verdict: Literal["accepted", "rejected"] | None = None
    """Whether the sequence can be used; None: as the thresholds say, even where `keep` and `drop`
    change how many frames are left."""
    because: Reason
    """Why, for whoever reads the manifest."""
    keep: tuple[FrameRange, ...] = ()
    """Frames to use whatever the thresholds say, as ranges (start, stop), stop one past the last.
    A frame without a camera or a pose can't be kept."""
    drop: tuple[FrameRange, ...] = ()
    """Frames not to use, as ranges (start, stop).  Where both are given, dropping counts."""

    @model_validator(mode="after")
    def _decides_something(self) -> Self:
        named = [("keep", run) for run in self.keep] + [("drop", run) for run in self.drop]
        for name, (start, stop) in named:
            if stop <= start:
                raise ValueError(
                    f"{name} {start}..{stop} is empty; stop is one past the last frame"
                )
        if self.verdict is None and not self.keep and not self.drop:
            raise ValueError("it decides nothing; give verdict, keep or drop, or leave it out")
        return self

    @property
    def decision(self) -> str:
        """The reason that stands in the result."""
        return f"a person decided: {self.because}"


def overridden(verdict: Verdict, override: Override, unusable: np.ndarray) -> Verdict:
    """Let a person's decision replace that of the thresholds, and list what it overrules.

    Nobody can keep frames without a camera or a pose, `unusable` (T,) bool.  BadRecipe where a
    range reaches beyond the sequence.
    """
    decided, n = verdict.frame_reasons, verdict.frames
    kept, dropped = _frames("keep", override.keep, n), _frames("drop", override.drop, n)
    for row in range(n):
        if unusable[row]:
            decided[row] = decided[row] or NOTHING_TO_USE
        elif dropped[row]:
            decided[row] = override.decision
        elif kept[row]:
            decided[row] = ""
    accepted, reasons = verdict.accepted, verdict.reasons
    if override.verdict is not None:
        accepted = override.verdict == "accepted"
        before = [f"overruled: {reason}" for reason in reasons] if accepted else reasons
        reasons = (override.decision, *before)
    if accepted and all(decided):
        accepted, reasons = False, (*reasons, NOTHING_LEFT)
    return verdict_of(verdict.id, accepted, reasons, decided)


def _frames(name: str, ranges: tuple[FrameRange, ...], n_frames: int) -> np.ndarray:
    """(T,) bool: frames in any of the ranges."""
    inside = np.zeros(n_frames, dtype=bool)
    for start, stop in ranges:
        if stop > n_frames:
            raise BadRecipe(
                f"override: {name} {start}..{stop}: the sequence has {n_frames} frames; stop is "
                f"{n_frames} at most"
            )
        inside[start:stop] = True
    return inside


_RUNS = TypeAdapter(list[tuple[StrictInt, StrictInt, str]])


def _texts(value: Any) -> Any:
    """T texts, of which a file has a list of runs; ValueError unless each begins where the one
    before it stops."""
    if not isinstance(value, list):
        return value
    runs, stops = _RUNS.validate_python(value), [0]
    for start, stop, _ in runs:
        if not start == stops[-1] < stop <= limits.MOST_FRAMES:
            raise ValueError(f"frames {start} to {stop} don't follow on {stops[-1]}")
        stops.append(stop)
    return tuple(texts_of(runs, stops[-1]))


class Doubts(Record):
    """`doubts.json`: why the data set, or the video, does not vouch for frames or for the whole."""

    format: Literal["gmrdata-doubts/2"] = "gmrdata-doubts/2"
    frames: tuple[
        Annotated[tuple[str, ...], BeforeValidator(_texts), PlainSerializer(text_runs)], ...
    ]
    """For each person T texts: why a frame must not be used; empty where it may.  The file has
    them as runs: start, one past the last frame, text."""
    sequence: tuple[str, ...]
    """Why the sequence can't be used at all; none where it can."""


def save_dataset_camera(path: Path, world_from_cam: np.ndarray) -> None:
    """Write a data set's metric cameras (T, 4, 4); NaN where unknown."""
    write_npz(path, {"format": DATASET_CAMERA_FORMAT, "world_from_cam": world_from_cam})


def load_dataset_camera(path: Path) -> np.ndarray:
    """Read cameras (T, 4, 4) [m], NaN where unknown."""
    return read_arrays(path, DATASET_CAMERA_FORMAT, _SHAPES)["world_from_cam"]


def save_gravity(path: Path, up_cam: np.ndarray) -> None:
    """Write unit directions (T, 3) that a phone felt as up, in its camera's axes, or NaN."""
    write_npz(path, {"format": GRAVITY_FORMAT, "up_cam": up_cam})


def load_gravity(path: Path) -> np.ndarray:
    """Read directions (T, 3) in the camera's axes, NaN where unknown."""
    return read_arrays(path, GRAVITY_FORMAT, _GRAVITY_SHAPES)["up_cam"]


class ScaleConfig(Config):
    """How metric scale is found."""

    slip_m_per_s: float = Field(default=0.25, gt=0)
    """Speed below which a foot point may be planted [m/s]."""
    slip_floor_m: float = Field(default=0.005, gt=0)
    """Distance between frames that counts as standing still at any frame rate [m]."""
    residual_m: float = Field(default=0.005, gt=0)
    """Distance from its stance's mean at which a planted point's weight is halved (Cauchy) [m]."""
    creep_m_per_s: float = Field(default=0.015, ge=0)
    """Speed at which planted feet creep in one direction; part of the error bar.  On 55 CMU takes
    exact feet made the scale too small by 0.5 % (circling camera) to 1.1 % (tracking camera), which
    is 0.01 m/s relative to those cameras.  Where joints err slowly by 2 to 4 degrees, 69 % of 96
    scales lay within one and 96 % within two standard errors at 0.015, 58 % and 85 % at 0.01
    [m/s]."""
    grid_steps: int = Field(default=600, ge=50, le=100_000)
    """Scales that the search tries."""
    min_stances: int = Field(default=2, ge=1)
    """Planted feet that a scale needs at least."""
    ground_radius_m: float = Field(default=2.5, gt=0)
    """The ground is what lies this near to planted feet, seen from above [m]."""
    ground_height_m: float = Field(default=0.4, gt=0)
    """And this near to them in height, while the scale is only roughly known [m]."""
    ground_inlier_m: float = Field(default=0.03, gt=0)
    """Distance from the plane of the ground at which a point's weight is halved (Cauchy) [m]."""
    min_ground_points: int = Field(default=25, ge=3)
    """Points on the ground that its plane needs at least."""
    contact_sigma_m: float = Field(default=0.012, gt=0)
    """Standard error of the body's soles above the ground, the same in all frames [m]."""
    stance_sigma_m: float = Field(default=0.02, gt=0)
    """Standard error of a planted sole from one plane, the same over a stance [m]."""
    guessed_sigma_m: float = Field(default=0.2, gt=0)
    """The same of soles that are not seen to stand: who is hidden below the hips stands, or sits
    half a metre lower [m]."""
    body_share: float = Field(default=0.01, ge=0)
    """What all cues of bodies have in common, such as a wrong size, as a share; part of the error
    bar.  Scales under simulated faults are off by 0.5 % (RMS, benchmarks/bench_scale_cues.py),
    which is each cue's own: bodies of a wrong size are not in that."""
    slow_m_per_s: float = Field(default=0.02, ge=0)
    """Error of the camera's speed up to which the scale need not be known any better, however
    large its error is as a share: of a camera that hardly travels; 2 mm in 0.1 s [m/s]."""
    unseen_move_m: float = Field(default=0.15, ge=0)
    """The same of its way through frames in which nobody is seen, whom it would seem to move by as
    much at once: what is no jump of a body, as `body_step_m` [m]."""
    vague_share: float = Field(default=0.5, gt=0)
    """Standard error, as a share of the scale, beyond which the scale of such a camera is said to
    be unknown, and the camera to stay in place."""
    window_s: float = Field(default=1.0, gt=0, le=limits.LONGEST_S)
    """Time over which a data set's own camera path is compared [s]."""
    drift_m_per_s: float = Field(default=0.15, ge=0)
    """Speed at which such a path may drift along its own direction, which nothing shows: 0.8 m in
    5 s, or 2 degrees/s about a person 4 m away; part of the error bar [m/s]."""
    drift_time_s: float = Field(default=4.0, gt=0)
    """Time over which the drift of such a path keeps its direction: windows this far apart count as
    independent [s]."""

    def slip_m(self, fps_hz: float) -> float:
        """Distance between frames below which a foot point may be planted [m]."""
        return self.slip_floor_m + self.slip_m_per_s / fps_hz


@part(frozen=True, config=PART)
class CueEstimate:
    """What one source of evidence says about the scale."""

    name: str
    """"planted_feet", "ground_contact", "above_ground" or "short_windows"."""
    scale: float
    """Metres per unit of the reconstruction."""
    sigma: float
    """Its standard error."""
    support: int
    """Independent observations behind it: stances, points of the ground, or windows."""
    residual_m: float
    """Root mean square of what the cue leaves unexplained [m]."""
    person: int | None
    """Whose feet, counted from 0; None for a cue that needs nobody."""


class VerdictConfig(CamerasVerdictConfig):
    """What a sequence and its frames must keep to, besides what is asked of cameras alone."""

    max_scale_sigma_share: float = Field(default=0.06, gt=0)
    """Standard error of the metric scale, as a share of the scale.  Of a camera that hardly travels
    it may be larger: `scale.slow_m_per_s`."""
    max_cue_disagreement: float = Field(default=3.5, gt=0)
    """Largest difference between two cues of the scale, in its standard errors; of several pairs as
    unlikely as this is for one."""
    min_kept_share: float = Field(default=0.5, ge=0, le=1)
    """Share of the frames with an undoubted pose that must be left."""
    max_off_share: float = Field(default=0.25, gt=0)
    """Share of the frames in which the body does not lie on a person in the picture; such a frame
    is not kept."""
    max_doubled_share: float = Field(default=0.5, gt=0)
    """Share of the frames in which another body lies on the same person in the picture."""
    max_body_speed_m_per_s: float = Field(default=15.0, gt=0)
    """Speed of the pelvis from one frame to the next, beyond that of any runner [m/s]."""
    max_body_turn_deg_per_s: float = Field(default=2000.0, gt=0)
    """Turn of the root from one frame to the next: front and back are exchanged at 5,400 at 30
    frames per second, a somersault is below 1,000 [degrees/s]."""
    body_step_m: float = Field(default=0.15, gt=0)
    """Way of the pelvis between frames that is no jump, however soon they follow: noise along the
    ray [m]."""
    body_step_deg: tuple[PositiveFloat, PositiveFloat] = (30.0, 120.0)
    """Turn of the root between frames that is no jump, however soon they follow, and that is one,
    however late: front and back are 180 apart, a somersault turns by 100 in 0.1 s [degrees]."""
    off_overlap: float = Field(default=0.5, gt=0, le=1)
    """Overlap, as intersection over union, below which a body does not lie on a person: 0.71 and
    more for right bodies with errors, 0.45 and less for others' (docs/verdict.md).  Where limbs lie
    on landmarks, the mask need only cover as much of the body."""
    off_limbs: float = Field(default=0.3, gt=0)
    """Mean distance of limbs from a person's landmarks, in the person's size in the picture, beyond
    which a body does not lie on the person: 12 cm or so.  0.2 and less where legs were guessed."""
    max_late_gain: float = Field(default=0.08, gt=0)
    """By how much the body may lie better on the people of other frames than on those of its own.
    Measured: 0 for right bodies, also with 8 degrees of error at each joint; 0.15 and more where
    they are five frames off at 10 frames/s, 0.3 and more for twenty."""
    min_joint_deg: float = Field(default=1.0, ge=0)
    """Turn of the joints from their mean pose, in the most a person shows of it (95 % of joints and
    frames turn less), that a body needs that travels by `stiff_travel_m`: less is no person
    [degrees]."""
    stiff_travel_m: float = Field(default=1.0, gt=0)
    """Way from which a body must move its joints [m]."""
    max_speed_m_per_s: float = Field(default=8.0, gt=0)
    """Speed of the camera from one frame to the next [m/s]."""
    window_s: float = Field(default=0.5, gt=0)
    """Time over which camera motion is compared with the data set's own [s]."""
    max_window_deg: float = Field(default=4.0, gt=0)
    """Difference from the data set's own rotation over that time [degrees]."""
    max_window_m: float = Field(default=0.25, gt=0)
    """Difference from the data set's own displacement over that time [m]."""
    min_run_s: float = Field(default=0.0, ge=0)
    """A kept range is at least this long [s]; the default keeps single frames too."""


class PseudoGtConfig(Config):
    """Metric world poses from cameras up to scale.  The people are not smoothed."""

    scale: ScaleConfig = ScaleConfig()
    verdict: VerdictConfig = VerdictConfig()
    override: Override | None = None
    """What a person decided of the sequence."""
    motion_class: MotionClassConfig = MotionClassConfig()
    """Where one class of camera motion ends and the next begins."""
