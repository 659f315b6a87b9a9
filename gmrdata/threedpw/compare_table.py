"""A comparison with Table 7 as a table, as one line and as a CSV file."""

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

from gmrdata.manifest.current import FrameRange
from gmrdata.store import write_text
from gmrdata.threedpw.compare import ComparedRow
from gmrdata.threedpw.frame_ranges import n_frames, n_shared

HEADINGS = (
    "sequence", "person", "Table 7", "class there", "ours", "kept of it", "kept beyond",
    "verdict", "first reason",
)  # fmt: skip
CSV_HEADINGS = (
    "sequence", "person", "table7_start", "table7_stop", "table7_camera_motion", "camera_motion",
    "same_camera_motion", "kept_share_of_table7", "kept_frames_beyond_table7", "verdict", "reason",
)  # fmt: skip


def table_rows(rows: Iterable[ComparedRow]) -> list[tuple[str, ...]]:
    """Rows for `HEADINGS`."""
    return [
        (
            row.sequence,
            _person(row),
            "-" if row.listed is None else _first_last(row.listed.frames),
            "-" if row.listed is None else row.listed.camera_motion,
            "-" if row.clip is None else row.clip.camera_motion,
            "-" if row.kept_share is None else f"{100 * row.kept_share:.1f} %",
            "-" if row.clip is None else str(row.kept_beyond),
            row.verdict or "-",
            row.reason,
        )
        for row in rows
    ]


def summary(rows: Sequence[ComparedRow]) -> str:
    """One line: how many rows of Table 7 we have, agree with and cover.

    A row agrees in class if all our people of it do.  A frame is covered if an accepted clip of
    anybody keeps it.
    """
    listed = {row.listed.id: row.listed for row in rows if row.listed is not None}
    ours: dict[str, list[ComparedRow]] = {name: [] for name in listed}
    for row in rows:
        if row.listed is not None and row.clip is not None:
            ours[row.listed.id].append(row)
    found = [people for people in ours.values() if people]
    accepted = sum(any(row.verdict == "accepted" for row in people) for people in found)
    agree = sum(all(row.same_class for row in people) for people in found)
    total = sum(n_frames([row.frames]) for row in listed.values())
    covered = sum(_covered(people) for people in found)
    share = f" ({100 * covered / total:.1f} %)" if total else ""
    others = len({row.sequence for row in rows if row.listed is None})
    return (
        f"Table 7: {len(listed)} rows, {len(found)} in our manifest, {accepted} accepted; the "
        f"camera's class agrees in {agree} of {len(found)}; {covered} of {total} frames{share} are "
        f"kept in accepted clips; sequences of ours that it lacks: {others}"
    )


def write_csv(path: Path, rows: Iterable[ComparedRow]) -> Path:
    """Write the rows under `CSV_HEADINGS`, with shares from 0 to 1 and empty cells where unknown.

    Returns:
        `path`.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(CSV_HEADINGS)
    writer.writerows(_csv_row(row) for row in rows)
    write_text(path, text.getvalue())
    return path


def _covered(people: Sequence[ComparedRow]) -> int:
    """Frames of one row of Table 7 that an accepted clip keeps."""
    kept = [
        part
        for row in people
        if row.clip is not None and row.verdict == "accepted"
        for part in row.clip.kept
    ]
    return n_shared(kept, [row.listed.frames for row in people if row.listed is not None])


def _person(row: ComparedRow) -> str:
    return (row.clip.source.person or "-") if row.clip is not None else "-"


def _first_last(frames: FrameRange) -> str:
    """As Table 7 writes it, with the last frame named."""
    return f"{frames.start}-{frames.stop - 1}"


def _csv_row(row: ComparedRow) -> tuple[str | int | float, ...]:
    frames = None if row.listed is None else row.listed.frames
    return (
        row.sequence,
        "" if row.clip is None else row.clip.source.person or "",
        "" if frames is None else frames.start,
        "" if frames is None else frames.stop,
        "" if row.listed is None else row.listed.camera_motion,
        "" if row.clip is None else row.clip.camera_motion,
        "" if row.same_class is None else str(row.same_class).lower(),
        "" if row.kept_share is None else round(row.kept_share, 4),
        "" if row.clip is None else row.kept_beyond,
        row.verdict,
        row.reason,
    )
