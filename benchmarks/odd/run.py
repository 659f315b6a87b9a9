"""One odd file through the command line, and what came of it."""

import json
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

LONGEST_S = 1200.0
SHOWN = 300  # characters of what was said


@dataclass(frozen=True)
class Run:
    """What a command left."""

    folder: Path
    """Copy of the input's folder; the command ran there."""
    code: int
    said: str
    """Both streams, with single spaces."""

    @property
    def out(self) -> Path:
        return self.folder / "OUT"

    def json(self, place: str) -> dict[str, Any]:
        content: dict[str, Any] = json.loads((self.out / place).read_text(encoding="utf-8"))
        return content

    def clip(self, stem: str) -> Any:
        return np.load(self.out / "clips" / stem / "clip.npz")


@dataclass(frozen=True)
class Case:
    """An input, the words after `gmrdata`, and what is right."""

    folder: str
    file: str
    words: str
    """FILE, OUT and MODELS stand for paths; several commands have a semicolon between them."""
    is_right: Callable[[Run], bool]
    """Of a run that ended with 0."""
    asks_for: str = ""
    """A regular expression of the error, or warning, that is right too; none if there is none."""
    made_by: str = ""
    """A script beside the file that makes it, in DIR; its name is MADE."""


def tried(case: Case, folder: Path, models: Path) -> tuple[str, str]:
    """How it ended, and what was said last."""
    run = _run(case, folder, models)
    said = run.said[-SHOWN:]
    if "Traceback (most recent call last)" in run.said:
        return "wrong", f"a traceback: {said}"
    try:
        if run.code == 0 and case.is_right(run):
            return "right", said
    except (OSError, KeyError, ValueError) as error:
        said = f"{type(error).__name__} {error}: {said}"
    refused = bool(case.asks_for and re.search(case.asks_for, run.said, re.IGNORECASE))
    if refused and run.code == 1:
        return "refused_rightly", said
    return "wrong", f"exit code {run.code}: {said}"


def _run(case: Case, folder: Path, models: Path) -> Run:
    said, code = "", 0
    places = {"FILE": case.file, "OUT": "OUT", "MODELS": str(models)}
    if case.made_by:
        subprocess.run([folder / case.made_by, "DIR"], cwd=folder, check=True)
        places["MADE"] = str(next((folder / "DIR").iterdir()))
    marks = "|".join(places)
    for words in case.words.split(";"):
        command = [re.sub(marks, lambda mark: places[mark[0]], one) for one in words.split()]
        call = [sys.executable, "-m", "gmrdata", *command]
        done = subprocess.run(
            call, cwd=folder, capture_output=True, text=True, errors="replace", timeout=LONGEST_S
        )
        said, code = f"{said} {done.stdout} {done.stderr}", max(code, done.returncode)
    return Run(folder, code, " ".join(said.split()))


def is_same_motion(run: Run, plain: str, other: str) -> bool:
    """Whether two clips agree, as compare.py has it: 0.5 deg and 10 mm in every frame."""
    clips = [run.clip(stem) for stem in (plain, other)]
    turns = [Rotation.from_rotvec(clip["poses"][:, :66].reshape(-1, 3)) for clip in clips]
    off_deg = np.rad2deg((turns[0].inv() * turns[1]).magnitude())
    path_m = np.linalg.norm(clips[0]["trans"] - clips[1]["trans"], axis=1)
    return bool(off_deg.max() < 0.5 and path_m.max() < 0.01)
