"""The files of `gmrdata export`: which are to be written, and each as a whole or not at all."""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from gmrdata.cli.answers import answer, print_table
from gmrdata.cli.export import FormatName
from gmrdata.export.formats import FORMATS, ExportOptions, why_not
from gmrdata.export.sources import ClipFiles, ExportedClip, list_clips, load_exported
from gmrdata.gmr.config import Which
from gmrdata.stage.progress import console, progress_bar
from gmrdata.values.errors import GmrdataError, MissingInput, StageFailed, StaleOutput
from gmrdata.values.files import write_bytes
from gmrdata.write.emdb import emdb_name

HEADINGS = ("format", "clip", "file or folder", "state")


class Given(NamedTuple):
    """What the flags say of the clips."""

    source: Path
    ids: tuple[str, ...]  # all when empty
    body: str | None
    images: Path | None
    truth: Path | None


def write_exports(
    given: Given,
    formats: Sequence[FormatName],
    out: Path,
    options: ExportOptions,
    *,
    redo: bool = False,
    dry_run: bool = False,
) -> None:
    """Write clips in some formats, or say what would be written.

    Raises:
        StaleOutput: something is there already, and `redo` is not set; nothing was written.
        StageFailed: some could not be written; the others are, and the reasons were printed.
    """
    _say(exported(given, formats, out, options, redo=redo, dry_run=dry_run), out, dry_run)


def exported(
    given: Given,
    formats: Sequence[FormatName],
    out: Path,
    options: ExportOptions,
    *,
    redo: bool = False,
    dry_run: bool = False,
) -> "list[Result]":
    """The same without a word: what became of each file or folder."""
    wanted = list_clips(given.source, given.ids)
    truths = _truths(given.truth, wanted)
    sequences = _by_sequence(wanted)
    if not (redo or dry_run):
        _refuse_to_overwrite([u.path for people in sequences for u in _units(people, formats, out)])
    results: list[Result] = []
    with progress_bar(shown=not dry_run) as bar:
        for people in bar.track(sequences, description="exporting"):
            images = _images(given.images, people[0].sequence, alone=len(sequences) == 1)
            loaded = {
                files.id: _load(files, given.body, images, truths.get(files.id)) for files in people
            }
            for unit in _units(people, formats, out):
                results.append(Result(unit, _write(unit, loaded, options, dry_run)))
    return results


class Unit(NamedTuple):
    """One thing to write: a clip, or the people of a sequence, in one format."""

    format: FormatName
    name: str
    path: Path
    ids: tuple[str, ...]  # of the clips


class Result(NamedTuple):
    """What became of a unit."""

    unit: Unit
    left_out: str  # why it was not written; empty if it was


def _by_sequence(wanted: Sequence[ClipFiles]) -> list[list[ClipFiles]]:
    """The people of each sequence."""
    sequences: dict[str, list[ClipFiles]] = {}
    for files in wanted:
        sequences.setdefault(files.sequence, []).append(files)
    return list(sequences.values())


def _units(people: Sequence[ClipFiles], formats: Sequence[FormatName], out: Path) -> Iterator[Unit]:
    """What is to be written of one sequence."""
    for name in formats:
        of_all = FORMATS[name].unit == "sequence"
        groups = [people] if of_all else [(person,) for person in people]
        for group in groups:
            called = group[0].sequence if of_all else group[0].id
            path = out / name / _placed(FORMATS[name].path, called, group[0].split)
            yield Unit(name, called, path, tuple(person.id for person in group))


def _placed(pattern: str, name: str, split: str) -> str:
    """Where a unit goes below its format's folder."""
    subject, take = emdb_name(name)
    return pattern.format(id=name, split=split, subject=subject, take=take)


def _truths(source: Path | None, wanted: Sequence[ClipFiles]) -> dict[str, Path]:
    """The files of exact clips by id; says of which clips there is none."""
    if source is None:
        return {}
    found = {files.id: files.clip_path for files in list_clips(source)}
    without = [files.id for files in wanted if files.id not in found]
    if len(without) == len(wanted):
        raise MissingInput(f"{source}: has none of the clips; there are {', '.join(found)}")
    if without:
        console.print(f"no truth for {', '.join(without)}", markup=False, soft_wrap=True)
    return found


def _images(folder: Path | None, sequence: str, *, alone: bool) -> Path | None:
    """A sequence's images in `--images`: in a folder of its name, or right there if it is alone."""
    if folder is None or (alone and not (folder / sequence).is_dir()):
        return folder
    return folder / sequence


def _load(
    files: ClipFiles, body: str | None, images: Path | None, truth: Path | None
) -> ExportedClip | GmrdataError:
    """The clip, or why it can't be read."""
    try:
        return load_exported(files, body=body, images=images, truth=truth)
    except GmrdataError as error:
        return error


def _refuse_to_overwrite(paths: Sequence[Path]) -> None:
    if there := [path for path in paths if path.exists()]:
        more = f" and {len(there) - 1} more" if len(there) > 1 else ""
        raise StaleOutput(f"{there[0]}{more}: already there. Pass --redo to write again")


def _write(
    unit: Unit,
    loaded: Mapping[str, ExportedClip | GmrdataError],
    options: ExportOptions,
    dry_run: bool,
) -> str:
    """Write one unit; why it can't be, or "".  A dry run only looks."""
    people: list[ExportedClip] = []
    for found in map(loaded.__getitem__, unit.ids):
        if isinstance(found, GmrdataError):
            return str(found)
        people.append(found)
    format = FORMATS[unit.format]
    if (reason := why_not(format, people, options)) or dry_run:
        return reason
    try:
        with _whole(unit.path) as partial:
            format.write(people, partial, options)
    except GmrdataError as error:
        return str(error).replace(_partial(unit.path).name, unit.path.name)
    return ""


def _say(results: Sequence[Result], out: Path, dry_run: bool) -> None:
    """Print what was, or would be, written, and end with an error if something could not be."""
    left_out = [one for one in results if one.left_out]
    if dry_run:
        rows = []
        for unit, reason in results:
            state = "to replace" if unit.path.exists() else "to write"
            state = f"left out: {reason}" if reason else state
            rows.append((unit.format, unit.name, str(unit.path), state))
        print_table(HEADINGS, rows)
        return
    for name in dict.fromkeys(one.unit.format for one in results if not one.left_out):
        answer(out / name)
    for unit, reason in left_out:
        console.print(f"{unit.name}: no {unit.format}: {reason}", markup=False, soft_wrap=True)
    if left_out:
        raise StageFailed(f"{len(left_out)} of {len(results)} could not be written, see above")


def write_network(
    run_dir: Path, out: Path, which: Which, *, redo: bool = False, dry_run: bool = False
) -> None:
    """Write the network of a training run as `onnx/<run>.onnx`, or say where it would go."""
    from gmrdata.gmr.onnx_network import onnx_network
    from gmrdata.gmr.predict import load_gmr

    gmr = load_gmr(run_dir.resolve(), which)
    path = out / "onnx" / f"{gmr.name}.onnx"
    if dry_run:
        state = "to replace" if path.exists() else "to write"
        print_table(HEADINGS, [("onnx", gmr.name, str(path), state)])
        return
    if not redo:
        _refuse_to_overwrite([path])
    write_bytes(path, onnx_network(gmr))
    answer(path)


@contextmanager
def _whole(path: Path) -> Iterator[Path]:
    """A sibling of `path` to write a file or folder to, which replaces it when the block ends."""
    partial = _partial(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    _remove(partial)
    try:
        yield partial
        _remove(path)
        partial.rename(path)
    finally:
        _remove(partial)


def _partial(path: Path) -> Path:
    """Keeps the suffix, by which some writers choose a form."""
    return path.with_name(f".partial.{path.name}")


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
