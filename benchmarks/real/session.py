"""What the measurements on real clips share: the clips, the record, and the rows so far."""

import os
import platform
import shutil
from dataclasses import dataclass, field, replace
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from real.cases import Case
from real.clips import CLIPS, FEWEST_CLIPS, missing_clips
from real.rows import measure
from record import Record

OUT_DIR = Path("out/bench")


@dataclass
class RealSession:
    """One run; its files lie in `out/bench/real`, which it empties."""

    small: bool
    ours_alone: bool
    """Whether to leave plain pycolmap, which takes most of the time, and the bars out."""
    clips_dir: Path
    detector: Path
    rows: dict[str, dict[str, Any]] = field(default_factory=dict)
    """What was measured, by case."""

    def __post_init__(self) -> None:
        shutil.rmtree(self.work_dir, ignore_errors=True)
        tried = self.small or self.ours_alone
        self.record = Record(OUT_DIR / "real.json", tried, self._settings)

    @property
    def work_dir(self) -> Path:
        """Where a case lies while it is solved."""
        return (OUT_DIR / "real").resolve()

    @property
    def missing(self) -> list[str]:
        """Clips that are not there."""
        return missing_clips(self.clips_dir)

    def require_clips(self) -> None:
        """Fail with the names of what is missing where too few clips are there."""
        there = len(CLIPS) - len(self.missing)
        if there < FEWEST_CLIPS:
            pytest.fail(
                f"{self.clips_dir}: {there} clips, fewer than {FEWEST_CLIPS}; missing: "
                f"{', '.join(self.missing)}; benchmarks/real/layout.py says where they are from"
            )

    def measure(self, case: Case) -> dict[str, Any]:
        """Solve a case and write what is known so far."""
        self.require_clips()
        needed = {case.clip, case.joined_to} & set(self.missing)
        if needed:
            pytest.skip(f"no clip {', '.join(map(str, needed))} in {self.clips_dir}")
        case = replace(case, plain=case.plain and not self.ours_alone)
        row = measure(case, self.clips_dir, self.detector, self.work_dir / case.name)
        self.rows[case.name] = row
        self.record.add(
            cases=list(self.rows.values()), missing_clips=self.missing, **self.summary()
        )
        return row

    def summary(self) -> dict[str, Any]:
        """What is wrong over all cases."""
        rows = list(self.rows.values())
        wrong = [row["name"] for row in rows if row["accepted"] and row["right"] is False]
        right = [row for row in rows if row["right"]]
        rejected = [row["name"] for row in right if not row["accepted"]]
        sound = [row["name"] for row in right if row["sound"]]
        lost = [name for name in rejected if name in sound]
        return {
            "wrong_acceptances": len(wrong),
            "wrongly_accepted": wrong,
            # A wrong focal length, order or take is a true reason to reject right cameras.
            "right_rejected_share": round(len(lost) / max(1, len(sound)), 4),
            "right_rejected": lost,
            "right_rejected_share_of_all": round(len(rejected) / max(1, len(right)), 4),
        }

    def _settings(self) -> dict[str, Any]:
        return {
            "scale": "small" if self.small else "full",
            "cores": len(os.sched_getaffinity(0)),
            "load_at_the_end": round(os.getloadavg()[0], 1),
            "threads": "features: one per core; all else: ours one, plain one per core",
            "python": platform.python_version(),
            "pycolmap": metadata.version("pycolmap"),
            "evo": metadata.version("evo"),
        }
