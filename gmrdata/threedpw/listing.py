"""What is in a 3DPW folder, as tables."""

from pathlib import Path

from gmrdata.read import threedpw
from gmrdata.read import threedpw_layout as layout
from gmrdata.stage.progress import track
from gmrdata.values.errors import GmrdataError

HEADINGS = ("sequence", "split", "people", "frames", "size [px]", "usable", "problems")
RANGE_HEADINGS = ("person", "gender", "first frame", "last frame", "frames", "usable, or why not")


def sequence_rows(root: Path, rule: str) -> tuple[list[tuple[str, ...]], int]:
    """A row for `HEADINGS` per sequence under a root, and how many say why one can't be read."""
    known = threedpw.known_rule(rule)
    found = layout.find_sequences(root)
    splits = layout.splits_of(found)
    rows: list[tuple[str, ...]] = []
    n_bad = 0
    for files in track(found, "reading sequences"):
        try:
            layout.require_name(files.name)
            layout.require_one_split(files.name, splits[files.name])
            rows.append(_row(files, known))
        except (GmrdataError, OSError) as error:
            # Not the name as it is: it could hold anything, even escape codes for the terminal.
            name = files.name if layout.SEQUENCE_NAME.fullmatch(files.name) else repr(files.name)
            rows.append((name, files.split, "-", "-", "-", "-", str(error)))
            n_bad += 1
    return rows, n_bad


def range_rows(root: Path, name: str, rule: str) -> tuple[list[tuple[str, ...]], tuple[str, ...]]:
    """Rows for `RANGE_HEADINGS`, each person's usable frames and other ranges, and the problems."""
    known = threedpw.known_rule(rule)
    sequence = threedpw.read_sequence(root, name)
    rows: list[tuple[str, ...]] = []
    for index, person in enumerate(sequence.arrays.people):
        reasons = threedpw.unusable_reasons(sequence, index, known)
        kept = sum(reason == "" for reason in reasons)
        who = (str(index), person.gender)
        rows.append((*who, "0", str(len(reasons) - 1), str(kept), _share(reasons)))
        rows += [
            (*who, str(start), str(stop - 1), str(stop - start), reason)
            for start, stop, reason in threedpw.dropped_ranges(reasons)
        ]
    return rows, sequence.problems


def _row(files: layout.SequenceFiles, rule: threedpw.ValidRule) -> tuple[str, ...]:
    sequence = threedpw.read_found(files)
    people = sequence.arrays.people
    reasons = [threedpw.unusable_reasons(sequence, index, rule) for index in range(len(people))]
    genders = ", ".join(person.gender for person in people)
    return (
        files.name,
        files.split,
        f"{len(people)} ({genders})",
        str(sequence.n_frames),
        f"{sequence.images.width_px}x{sequence.images.height_px}",
        ", ".join(map(_share, reasons)),
        "; ".join(sequence.problems),
    )


def _share(reasons: list[str]) -> str:
    return f"{100 * sum(reason == '' for reason in reasons) / len(reasons):.1f} %"
