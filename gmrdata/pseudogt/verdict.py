"""What was decided of a clip: accepted or not, which frames are dropped, and why."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gmrdata.row_runs import text_runs, texts_of


@dataclass(frozen=True)
class Dropped:
    """Frames start, start + 1, ..., stop - 1 that must not be used."""

    start: int
    """First frame."""
    stop: int
    """One past the last frame."""
    reason: str
    """Why."""


@dataclass(frozen=True)
class Verdict:
    """What was decided, and on what."""

    accepted: bool
    """Whether the sequence can be used, but for the dropped ranges."""
    reasons: tuple[str, ...]
    """Why not, for a rejected one; and what a person decided, for any."""
    dropped: tuple[Dropped, ...]
    """Ranges in ascending order."""
    n_frames: int
    """Number of frames T."""

    @property
    def kept(self) -> np.ndarray:
        """(T,) bool: frames outside the dropped ranges."""
        kept = np.ones(self.n_frames, dtype=bool)
        for run in self.dropped:
            kept[run.start : run.stop] = False
        return kept

    @property
    def kept_share(self) -> float:
        """Share of the frames that are left, 0 to 1."""
        return float(self.kept.mean())

    @property
    def frame_reasons(self) -> list[str]:
        """T texts: why each frame is dropped; empty where it isn't."""
        runs = ((run.start, run.stop, run.reason) for run in self.dropped)
        return texts_of(runs, self.n_frames)

    def as_record(self, clip_id: str) -> dict[str, Any]:
        """The verdict of one clip as plain JSON."""
        return {
            "id": clip_id,
            "frames": self.n_frames,
            "kept_frames": int(self.kept.sum()),
            "kept_share": float(f"{self.kept_share:.6g}"),
            "accepted": self.accepted,
            "reasons": list(self.reasons),
            "dropped": [asdict(run) for run in self.dropped],
        }


def dropped_ranges(reasons: Sequence[str]) -> list[Dropped]:
    """Runs of frames that share a reason; frames with an empty one are in none."""
    return [Dropped(*run) for run in text_runs(reasons) if run[2]]
