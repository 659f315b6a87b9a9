"""Our pseudo ground truth of 3DPW beside the ranges that the GMR paper chose by hand (Table 7)."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from gmrdata.manifest import yaml_text
from gmrdata.manifest.current import ClipEntry, FrameRange, ListedClip, Manifest
from gmrdata.manifest.read import published_list, read_manifest
from gmrdata.score.table import csv_text
from gmrdata.values.errors import BadManifest, MissingInput
from gmrdata.values.files import write_text


def merged(ranges: Iterable[FrameRange]) -> list[tuple[int, int]]:
    """The same frames as (start, stop) that neither meet nor overlap, in ascending order."""
    result: list[tuple[int, int]] = []
    for start, stop in sorted((part.start, part.stop) for part in ranges):
        if result and start <= result[-1][1]:
            start, before = result.pop()
            stop = max(stop, before)
        result.append((start, stop))
    return result


def n_frames(ranges: Iterable[FrameRange]) -> int:
    """Number of frames in any of the ranges."""
    return sum(stop - start for start, stop in merged(ranges))


def n_shared(a: Sequence[FrameRange], b: Sequence[FrameRange]) -> int:
    """Number of frames that are in a range of both."""
    return n_frames(a) + n_frames(b) - n_frames([*a, *b])


DATASET = "3DPW"


@dataclass(frozen=True)
class ComparedRow:
    """A range of Table 7 and one of our clips; at least one of the two."""

    sequence: str
    listed: ListedClip | None  # None: Table 7 has none of this sequence
    clip: ClipEntry | None  # None: we have none of this sequence
    kept_beyond: int  # frames that the clip keeps and that are in no row of Table 7

    @property
    def kept_share(self) -> float | None:
        """Share of the row's frames that the clip keeps, 0 to 1; None unless there are both."""
        if self.listed is None or self.clip is None:
            return None
        frames = [self.listed.frames]
        return n_shared(self.clip.kept, frames) / n_frames(frames)

    @property
    def same_class(self) -> bool | None:
        """Whether both say the same of the camera's motion; None unless there are both."""
        if self.listed is None or self.clip is None:
            return None
        return self.listed.camera_motion == self.clip.camera_motion

    @property
    def verdict(self) -> str:
        """ "accepted", "rejected", or "" where nobody judged."""
        quality = None if self.clip is None else self.clip.quality
        return "" if quality is None or quality.verdict is None else quality.verdict

    @property
    def reason(self) -> str:
        """The first reason of the verdict, or why there is nothing to compare."""
        if self.clip is None:
            return "not in our manifest"
        reasons = () if self.clip.quality is None else self.clip.quality.reasons
        return "; ".join((() if self.listed else ("not in Table 7",)) + reasons[:1])


def compare_with_table7(path: Path) -> list[ComparedRow]:
    """Lay 3DPW pseudo ground truth, a manifest or its folder, beside Table 7: a row per person."""
    return compare(_clips_of_3dpw(find_manifest(path)), published_list("paper_table7"))


def compare(clips: Sequence[ClipEntry], listed: Sequence[ListedClip]) -> list[ComparedRow]:
    """Rows for clips whose rows are 3DPW's image numbers, as in every sequence file of 3DPW."""
    rows: list[ComparedRow] = []
    for row in listed:
        sequence = row.source.sequence
        everything = [other.frames for other in listed if other.source.sequence == sequence]
        ours = [clip for clip in clips if clip.source.sequence == sequence]
        for clip in ours:
            beyond = n_frames(clip.kept) - n_shared(clip.kept, everything)
            rows.append(ComparedRow(sequence, row, clip, beyond))
        rows += [] if ours else [ComparedRow(sequence, row, None, 0)]
    known = {row.source.sequence for row in listed}
    others = (clip for clip in clips if clip.source.sequence not in known)
    return rows + [
        ComparedRow(clip.source.sequence, None, clip, n_frames(clip.kept)) for clip in others
    ]


def find_manifest(path: Path) -> Path:
    """The manifest itself, or the only one of kind `pseudo_gt` right in a folder."""
    if not path.is_dir():
        return path
    manifests = [file for file in sorted(path.glob("*.yaml")) if _kind(file) == "pseudo_gt"]
    if not manifests:
        raise MissingInput(f"{path}: holds no manifest (.yaml) of kind pseudo_gt")
    if len(manifests) > 1:
        names = ", ".join(file.name for file in manifests)
        raise BadManifest(f"{path}: several manifests of kind pseudo_gt: {names}; name one")
    return manifests[0]


def _clips_of_3dpw(path: Path) -> list[ClipEntry]:
    manifest = read_manifest(path)
    if not isinstance(manifest, Manifest) or manifest.kind != "pseudo_gt":
        raise BadManifest(f"{path}: is of kind {manifest.kind}; give one of kind pseudo_gt")
    clips = [clip for clip in manifest.clips if clip.source.dataset == DATASET]
    if not clips:
        raise BadManifest(f"{path}: holds no clip whose source is {DATASET}")
    return clips


def _kind(path: Path) -> str | None:
    """What a YAML file says that it is; recipes lie beside manifests, and other things may."""
    try:
        data, _ = yaml_text.load(path)
    except BadManifest:
        return None
    return data.get("kind") if isinstance(data, dict) and "format" in data else None


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
            (row.clip and row.clip.source.person) or "-",
            # As Table 7 writes it, with the last frame named.
            f"{row.listed.frames.start}-{row.listed.frames.stop - 1}" if row.listed else "-",
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
    """One line: how many rows of Table 7 we have, agree with (in the class of all our people of it)
    and cover (a frame is, if an accepted clip of anybody keeps it)."""
    listed = {row.listed.id: row.listed for row in rows if row.listed is not None}
    by_id: dict[str, list[ComparedRow]] = {name: [] for name in listed}
    for row in rows:
        if row.listed is not None and row.clip is not None:
            by_id[row.listed.id].append(row)
    ours = [people for people in by_id.values() if people]
    accepted = sum(any(row.verdict == "accepted" for row in people) for people in ours)
    agree = sum(all(row.same_class for row in people) for people in ours)
    total = sum(n_frames([row.frames]) for row in listed.values())
    covered = sum(_covered(people) for people in ours)
    share = f" ({100 * covered / total:.1f} %)" if total else ""
    others = len({row.sequence for row in rows if row.listed is None})
    return (
        f"Table 7: {len(listed)} rows, {len(ours)} in our manifest, {accepted} accepted; the "
        f"camera's class agrees in {agree} of {len(ours)}; {covered} of {total} frames{share} are "
        f"kept in accepted clips; sequences of ours that it lacks: {others}"
    )


def write_csv(path: Path, rows: Iterable[ComparedRow]) -> Path:
    """Write the rows under `CSV_HEADINGS`, shares from 0 to 1, empty cells where unknown."""
    write_text(path, csv_text([CSV_HEADINGS, *map(_csv_row, rows)]))
    return path


def _covered(people: Sequence[ComparedRow]) -> int:
    """Frames of one row of Table 7 that an accepted clip keeps."""
    accepted = [row.clip for row in people if row.clip and row.verdict == "accepted"]
    kept = [part for clip in accepted for part in clip.kept]
    return n_shared(kept, [row.listed.frames for row in people if row.listed])


def _csv_row(row: ComparedRow) -> tuple[str | int | float, ...]:
    return (
        row.sequence,
        "" if row.clip is None else row.clip.source.person or "",
        "" if row.listed is None else row.listed.frames.start,
        "" if row.listed is None else row.listed.frames.stop,
        "" if row.listed is None else row.listed.camera_motion,
        "" if row.clip is None else row.clip.camera_motion,
        "" if row.same_class is None else str(row.same_class).lower(),
        "" if row.kept_share is None else round(row.kept_share, 4),
        "" if row.clip is None else row.kept_beyond,
        row.verdict,
        row.reason,
    )
