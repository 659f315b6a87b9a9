"""What was decided of a clip, by thresholds or a person, and what its data set says itself."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, NonNegativeInt, StringConstraints, model_validator
from pydantic.dataclasses import dataclass as part

from gmrdata.values.clip import text_runs, texts_of
from gmrdata.values.errors import BadRecipe
from gmrdata.values.files import write_npz
from gmrdata.values.records import PART, ArrayShapes, Config, Figure, Record, read_arrays

DATASET_CAMERA_FORMAT = "gmrdata-dataset-camera/1"
_SHAPES: ArrayShapes = {"world_from_cam": ("f", ("T", 4, 4))}


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
    dropped = tuple(Dropped(*run) for run in text_runs(frame_reasons) if run[2])
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


class Doubts(Record):
    """`doubts.json`: why the data set does not vouch for frames, or for the whole sequence."""

    format: Literal["gmrdata-doubts/1"] = "gmrdata-doubts/1"
    frames: tuple[tuple[str, ...], ...]
    """For each person T texts: why a frame must not be used; empty where it may."""
    sequence: tuple[str, ...]
    """Why the sequence can't be used at all; none where it can."""


def save_dataset_camera(path: Path, world_from_cam: np.ndarray) -> None:
    """Write a data set's metric cameras (T, 4, 4); NaN where unknown."""
    write_npz(path, {"format": DATASET_CAMERA_FORMAT, "world_from_cam": world_from_cam})


def load_dataset_camera(path: Path) -> np.ndarray:
    """Read cameras (T, 4, 4) [m], NaN where unknown."""
    return read_arrays(path, DATASET_CAMERA_FORMAT, _SHAPES)["world_from_cam"]
