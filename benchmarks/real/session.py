"""What the measurements on real clips share: the clips, the record, and the rows so far."""

import hashlib
import json
import shutil
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from real.cases import Case
from real.clips import CLIPS, FEWEST_CLIPS, missing_clips
from real.rows import measure
from record import OUT_DIR, Record, machine

import gmrdata

KEPT_FILE = "real.jsonl"
DECIDING = ("values", "read", "people", "cameras", "solve", "world")
"""Parts of the package that a row hangs on."""


@dataclass
class RealSession:
    """One run; its files lie in `out/bench/real`, which it empties."""

    small: bool
    ours_alone: bool
    """Whether to leave plain pycolmap, which takes most of the time, and the bars out."""
    clips_dir: Path
    detector: Path
    resume: bool = False
    """Whether to take up the rows that an earlier run of the same code left in `real.jsonl`."""
    rows: dict[str, dict[str, Any]] = field(default_factory=dict)
    """What was measured, by case."""

    def __post_init__(self) -> None:
        shutil.rmtree(self.work_dir, ignore_errors=True)
        if not self.resume:
            self.kept_path.unlink(missing_ok=True)
        tried = self.small or self.ours_alone
        self.record = Record(OUT_DIR / "real.json", tried, self._settings)

    @property
    def work_dir(self) -> Path:
        """Where a case lies while it is solved."""
        return (OUT_DIR / "real").resolve()

    @property
    def kept_path(self) -> Path:
        """One line of JSON for each case, written as soon as it is done."""
        return OUT_DIR / KEPT_FILE

    @cached_property
    def kept(self) -> dict[str, dict[str, Any]]:
        """Rows of an earlier run of the same code and sizes, by case."""
        lines = self.kept_path.read_text().splitlines() if self.kept_path.is_file() else []
        rows = []
        for line in lines:
            with suppress(json.JSONDecodeError):  # a line that a kill cut short
                rows.append(json.loads(line))
        same = [row for row in rows if row.pop("code") == self.code]
        return {row["name"]: row for row in same}

    @cached_property
    def code(self) -> str:
        """A hash of what decides a row: the package's parts, pycolmap, and the size of the run."""
        package = Path(gmrdata.__file__).parent
        files = sorted(file for part in DECIDING for file in (package / part).rglob("*.py"))
        text = f"{metadata.version('pycolmap')} {self.small}".encode()
        return hashlib.sha256(b"".join([text, *(file.read_bytes() for file in files)])).hexdigest()

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
        row = self.kept.get(case.name)
        if row is None or (case.plain and "plain_ate_mm" not in row):
            row = measure(case, self.clips_dir, self.detector, self.work_dir / case.name)
            self._keep(row)
        self.rows[case.name] = row
        self.record.add(
            cases=list(self.rows.values()), missing_clips=self.missing, **self.summary()
        )
        return row

    def _keep(self, row: dict[str, Any]) -> None:
        self.kept_path.parent.mkdir(parents=True, exist_ok=True)
        with self.kept_path.open("a") as file:
            file.write("\n" + json.dumps(row | {"code": self.code}))

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
            "again_of_right": _again(right, max),
            "again_of_wrong": _again((row for row in rows if row["right"] is False), min),
        }

    def _settings(self) -> dict[str, Any]:
        return machine() | {
            "scale": "small" if self.small else "full",
            "threads": "features: one per core; all else: ours one, plain one per core",
            "pycolmap": metadata.version("pycolmap"),
            "evo": metadata.version("evo"),
        }


def _again(rows: Iterable[dict[str, Any]], extreme: Any) -> list[float] | None:
    """The largest or the smallest difference that a second solution has, [degrees] and as a share
    of the way; None where none has one."""
    known = [(row["again_deg"], row["again_share"]) for row in rows if row["again_deg"] is not None]
    return [extreme(values) for values in zip(*known, strict=True)] if known else None
