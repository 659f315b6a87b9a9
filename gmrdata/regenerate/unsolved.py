"""Stage: what is left of a sequence without a reconstruction: its people, and the reason."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.body.file import read_body
from gmrdata.clip import Clip, load_clip, save_clip
from gmrdata.people import person_file
from gmrdata.pseudogt.verdict import Verdict, dropped_ranges
from gmrdata.regenerate.people import SequencePeople
from gmrdata.sequence import SequenceConfig
from gmrdata.sfm.cameras import QUALITY_FILE
from gmrdata.store import is_made, read_json, run_stage, write_json

STAGE = "unsolved"


def is_unsolved(out_dir: Path, config: SequenceConfig, inputs: Mapping[str, Path]) -> bool:
    """Whether the same recipe has found no reconstruction before."""
    return is_made(STAGE, out_dir, config, inputs)


def make_unsolved(
    given: SequencePeople,
    reason: str,
    out_dir: Path,
    config: SequenceConfig,
    inputs: Mapping[str, Path],
    *,
    redo: bool = False,
) -> Path:
    """Write the people in the camera's frame, every row dropped with its reason.

    Args:
        given: The sequence's people.
        reason: Why there is no reconstruction.
        out_dir: Folder to make: `person_<n>.npz` for each person, and `quality.json`.
        config: The recipe of the stages that were tried.
        inputs: What they were tried on.
        redo: Replace a folder that another recipe made.
    """

    def work(partial: Path) -> None:
        doubts = read_json(given.doubts_path)
        reasons = (*doubts["sequence"], reason)
        judged = []
        for number, person in enumerate(given.people):
            clip = load_clip(person.clip_path)
            nothing = np.zeros(clip.motion.n_frames, dtype=bool)
            unsolved = replace(clip, valid=nothing, camera=None)
            rest_pelvis_m = read_body(person.body_path).rest_pelvis_m(clip.motion.shape)
            save_clip(partial / person_file(number), unsolved, rest_pelvis_m)
            judged.append(_judged(clip, doubts["frames"][number], reasons))
        write_json(partial / QUALITY_FILE, {"camera_motion": "none", "people": judged})

    return run_stage(STAGE, out_dir, config, inputs, work, redo=redo)


def _judged(clip: Clip, doubts: list[str], reasons: tuple[str, ...]) -> dict[str, Any]:
    dropped = dropped_ranges([doubt or "there is no reconstruction" for doubt in doubts])
    return Verdict(False, reasons, tuple(dropped), len(doubts)).as_record(clip.id)
