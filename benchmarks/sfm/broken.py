"""Whether broken sequences are caught, and the reasons that are given."""

from pathlib import Path
from typing import Any

import numpy as np
from sfm.breakages import BREAKAGES, Breakage, Broken
from sfm.ours import Regenerated, regenerate

from gmrdata.manifest.current import ClipEntry
from gmrdata.read.threedpw_files import SequenceFiles, read_sequence_file

WHITE = "masked_everywhere"
MIN_GOOD_SHARE = 0.8
"""Share of the good half's annotated frames that must be left where only the bad half is dropped.
At its edges some go, since a motion is judged over half a second."""


def measure_broken(broken: Broken, out_dir: Path, recipe: str) -> list[dict[str, Any]]:
    """Regenerate the broken sequences; a row for each.

    Args:
        broken: The data set.
        out_dir: Folder to make.
        recipe: The recipe by name.
    """
    names = tuple(each.sequence for each in BREAKAGES if each.id != WHITE)
    made = regenerate(broken.root, out_dir / "broken", sequences=names, recipe=recipe)
    covered = next(each.sequence for each in BREAKAGES if each.id == WHITE)
    white = regenerate(
        broken.root, out_dir / "white", sequences=(covered,), recipe=broken.white_recipe
    )
    rows = []
    for each in BREAKAGES:
        files = SequenceFiles(broken.root, each.sequence, "test")
        rows.append(_row(each, white if each.id == WHITE else made, files))
    return rows


def _row(breakage: Breakage, made: Regenerated, files: SequenceFiles) -> dict[str, Any]:
    verdict, entries = made.verdicts[files.name], made.entries(files.name)
    bad = np.zeros(read_sequence_file(files.pickle_path).n_frames, dtype=bool)
    bad[len(bad) // 2 if breakage.half else 0 :] = True
    if verdict.accepted:
        caught = all(
            _only_bad_dropped(entry, files, number, bad) for number, entry in enumerate(entries)
        )
        reason = _reason_for(entries, bad)
    else:
        caught, reason = True, "; ".join(verdict.reasons)
    reason = reason.replace(f"{files.root}/", "")
    named = [other.id for other in BREAKAGES if other.cause.search(reason)]
    return {
        "id": breakage.id,
        "caught": caught,
        "how": "bad frames dropped" if verdict.accepted else "rejected",
        "reason": reason,
        "names_the_cause": breakage.id in named,
        "also_names": [name for name in named if name != breakage.id],
        "kept_share": verdict.kept_share,
    }


def _only_bad_dropped(entry: ClipEntry, files: SequenceFiles, person: int, bad: np.ndarray) -> bool:
    """No bad frame is kept, and most of the good ones for which the data set vouches are.

    A person who is rejected has no frame to be judged by.
    """
    if entry.quality is not None and entry.quality.verdict == "rejected":
        return True
    kept = np.zeros(len(bad), dtype=bool)
    for part in entry.kept:
        kept[part.start : part.stop] = True
    good = ~bad & read_sequence_file(files.pickle_path).people[person].campose_valid
    return not kept[bad].any() and kept[good].mean() >= MIN_GOOD_SHARE


def _reason_for(entries: list[ClipEntry], bad: np.ndarray) -> str:
    """The reason that stands at most of the bad frames; empty where none is dropped."""
    counts = {"": 0}
    for entry in entries:
        for part in entry.dropped:
            hits = int(bad[part.start : part.stop].sum())
            counts[part.reason] = counts.get(part.reason, 0) + hits
    return max(counts, key=lambda reason: counts[reason])
