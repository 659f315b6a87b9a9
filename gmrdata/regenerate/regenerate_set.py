"""A data set in 3DPW's layout: every sequence a job, a verdict for each, one manifest."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gmrdata.body.keep import keep_body
from gmrdata.errors import BadSequence, MissingInput
from gmrdata.jobs import Job, Workers, raise_failures, try_jobs, worker_pool
from gmrdata.manifest.recipe import created_by
from gmrdata.manifest.write import write_manifest
from gmrdata.regenerate.entries import sequence_entries
from gmrdata.regenerate.one_sequence import regenerate_one
from gmrdata.regenerate.paths import SetPaths
from gmrdata.regenerate.qa.pages import write_pages
from gmrdata.regenerate.recipe import ThreedpwRecipe
from gmrdata.regenerate.verdicts import failed_row, verdict_row
from gmrdata.store import remove_orphans, write_json
from gmrdata.threedpw.layout import (
    SequenceFiles,
    find_sequences,
    require_name,
    require_one_split,
    splits_of,
)

HEADINGS = ("sequence", "split", "state")
STAGES = ("people", "masks", "sfm", "pseudo_gt")


def regenerate_set(
    recipe: ThreedpwRecipe,
    root: Path,
    out_dir: Path,
    *,
    scheduler: str | None = None,
    redo: bool = False,
) -> Path:
    """Make world motions of all sequences, `verdicts.json`, the manifest `pseudo_gt.yaml`, and
    pages to look at: `index.html` and `qa/<sequence>.html`.

    A sequence that can't be read or masked leaves its reason in `failed/<name>.txt`, and the others
    go on; one without a reconstruction is listed as rejected.  A run that was stopped goes on.

    Args:
        recipe: The recipe.
        root: 3DPW's folder, which holds `imageFiles` and `sequenceFiles`.
        out_dir: The output folder.
        scheduler: Address of a Dask cluster; local processes when None.
        redo: Make anew what another recipe made.

    Returns:
        Path of the manifest.

    Raises:
        MissingInput: no such data set or sequence.
        StageFailed: some sequences failed; the others are done and the manifest lists them.
    """
    chosen, refused = choose(root, recipe.sequences)
    paths = SetPaths(out_dir.resolve())
    for folder in (paths.root, paths.failures_dir):
        remove_orphans(folder)
    body_paths = tuple(
        keep_body(body, paths.body_dir(number), redo=redo)
        for number, body in enumerate(recipe.bodies)
    )
    with worker_pool(Workers(recipe.workers, scheduler)) as client:
        outcome = try_jobs(
            "regenerating sequences",
            [_job(files, paths, recipe, body_paths, redo) for files in chosen],
            client,
            paths.failures_dir,
            units_total=len(STAGES) * len(chosen),
            units_done=lambda: _stages_done(paths, chosen),
        )
    reasons = {**refused, **outcome.reasons}
    _list(recipe, chosen, refused, reasons, paths, redo)
    raise_failures("sequences", reasons, len(chosen) + len(refused), paths.failures_dir)
    return paths.manifest


def choose(root: Path, names: Sequence[str]) -> tuple[list[SequenceFiles], dict[str, str]]:
    """The sequences to regenerate, and by name why others can't be read.

    Raises:
        MissingInput: no such data set, or a name that isn't there.
    """
    found = find_sequences(root)
    splits = splits_of(found)
    if unknown := sorted(set(names) - set(splits)):
        raise MissingInput(
            f"{root}: no sequence {', '.join(unknown)}; `gmrdata threedpw list` shows the names"
        )
    chosen, refused = [], {}
    for files in found:
        if names and files.name not in names:
            continue
        try:
            require_name(files.name)
            require_one_split(files.name, splits[files.name])
            chosen.append(files)
        except BadSequence as error:
            refused[files.name] = str(error)
    return chosen, refused


def plan(recipe: ThreedpwRecipe, root: Path, out_dir: Path) -> list[tuple[str, ...]]:
    """Rows for `HEADINGS`: what a run would do, without doing it."""
    chosen, refused = choose(root, recipe.sequences)
    paths = SetPaths(out_dir.resolve())
    rows: list[tuple[str, ...]] = []
    for files in chosen:
        folder = paths.sequence_dir(files.name)
        missing = [stage for stage in STAGES if not (folder / stage).is_dir()]
        done = (folder / "pseudo_gt").is_dir()
        rows.append((files.name, files.split, "done" if done else f"to do: {', '.join(missing)}"))
    return rows + [(repr(name), "-", reason) for name, reason in refused.items()]


def _job(
    files: SequenceFiles,
    paths: SetPaths,
    recipe: ThreedpwRecipe,
    body_paths: tuple[Path, ...],
    redo: bool,
) -> Job:
    arguments: dict[str, Any] = {
        "files": files,
        "root": paths.root,
        "recipe": recipe,
        "body_paths": body_paths,
        "redo": redo,
    }
    return Job(files.name, regenerate_one, arguments)


def _stages_done(paths: SetPaths, chosen: Sequence[SequenceFiles]) -> int:
    folders = [paths.sequence_dir(files.name) / stage for files in chosen for stage in STAGES]
    return sum(folder.is_dir() for folder in folders)


def _list(
    recipe: ThreedpwRecipe,
    chosen: Sequence[SequenceFiles],
    refused: Mapping[str, str],
    reasons: Mapping[str, str],
    paths: SetPaths,
    redo: bool,
) -> None:
    """Write the verdicts and pages of all sequences, and the manifest of those with files."""
    done = [files for files in chosen if files.name not in reasons]
    rows = [verdict_row(files, paths) for files in done]
    rows += [
        failed_row(files.name, files.split, reasons[files.name])
        for files in chosen
        if files.name in reasons
    ]
    rows += [failed_row(name, "", reason) for name, reason in refused.items()]
    rows.sort(key=lambda row: str(row["sequence"]))
    write_json(paths.verdicts, rows)
    if done:
        _write_manifest(recipe, done, bool(reasons), paths, redo)
    write_pages(rows, chosen, reasons, recipe, paths)


def _write_manifest(
    recipe: ThreedpwRecipe,
    done: Sequence[SequenceFiles],
    is_incomplete: bool,
    paths: SetPaths,
    redo: bool,
) -> None:
    write_manifest(
        paths.manifest,
        name=recipe.name,
        version=f"{recipe.version}-incomplete" if is_incomplete else recipe.version,
        kind="pseudo_gt",
        description="World-frame pseudo ground truth, regenerated from frames, intrinsics and "
        "camera-frame bodies.",
        licence=recipe.licence,
        clips=[entry for files in done for entry in sequence_entries(files, recipe, paths)],
        created_by=created_by(
            recipe.model_dump(mode="json", exclude={"workers"}), {"sfm": recipe.sequence.sfm.seed}
        ),
        redo=redo or is_incomplete,
    )
