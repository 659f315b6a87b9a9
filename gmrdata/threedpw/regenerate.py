"""A data set in 3DPW's layout: every sequence a job, a verdict for each, one manifest.

A row for each sequence: accepted or not, why, and the camera's class.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gmrdata.manifest.entry import created_by
from gmrdata.manifest.write import write_manifest
from gmrdata.read.bodies import keep_body
from gmrdata.read.threedpw_layout import (
    SequenceFiles,
    find_sequences,
    require_name,
    require_one_split,
    splits_of,
)
from gmrdata.stage.jobs import Job, raise_failures, try_jobs, worker_pool
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.threedpw.recipe import SetPaths, ThreedpwRecipe
from gmrdata.threedpw.sequence import regenerate_one, sequence_entries
from gmrdata.values.errors import BadSequence, MissingInput
from gmrdata.values.files import remove_orphans, write_json
from gmrdata.world.quality import load_record

VERDICT_HEADINGS = ("sequence", "split", "verdict", "camera", "kept", "scale", "reasons")


def verdict_row(files: SequenceFiles, paths: SetPaths) -> dict[str, Any]:
    """The verdict of a sequence whose stages are done: accepted if one of its people is."""
    record = load_record(paths.pseudo_gt_dir(files.name))
    people = record["people"]
    reasons = [reason for person in people for reason in person["reasons"]]
    frames = sum(person["frames"] for person in people)
    kept = sum(person["kept_frames"] for person in people if person["accepted"])
    return {
        "sequence": files.name,
        "split": files.split,
        "accepted": any(person["accepted"] for person in people),
        "reasons": list(dict.fromkeys(reasons)),
        "class": record["camera_motion"],
        "kept_share": float(f"{kept / frames:.6g}"),
        "scale": record.get("scale"),
        "scale_sigma": record.get("scale_sigma"),
    }


def failed_row(name: str, split: str, reason: str) -> dict[str, Any]:
    """The verdict of a sequence that could not be read."""
    return {
        "sequence": name,
        "split": split,
        "accepted": False,
        "reasons": [reason.splitlines()[0]],
        "class": "none",
        "kept_share": 0.0,
        "scale": None,
        "scale_sigma": None,
    }


def table_row(row: dict[str, Any]) -> tuple[str, ...]:
    """A row for `VERDICT_HEADINGS`."""
    scale = "-"
    if row["scale"] is not None:
        scale = f"{row['scale']:.4g} ± {100 * row['scale_sigma'] / row['scale']:.1f} %"
    return (
        row["sequence"],
        row["split"],
        "accepted" if row["accepted"] else "rejected",
        row["class"],
        f"{100 * row['kept_share']:.1f} %",
        scale,
        "; ".join(row["reasons"]),
    )


HEADINGS = ("sequence", "split", "state")
STAGES = ("people", "masks", "sfm", "pseudo_gt")


def regenerate_set(
    recipe: ThreedpwRecipe,
    root: Path,
    out_dir: Path,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Make world motions of all sequences, `verdicts.json`, and the manifest `pseudo_gt.yaml`.

    A sequence that can't be read or masked leaves its reason in `failed/<name>.txt`, and the others
    go on; one without a reconstruction is listed as rejected.  A run that was stopped goes on.

    Args:
        recipe: The recipe.
        root: 3DPW's folder, which holds `imageFiles` and `sequenceFiles`.
        out_dir: The output folder.

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
        keep_body(body, paths.body_dir(number), run=run)
        for number, body in enumerate(recipe.bodies)
    )
    with worker_pool(run, recipe.workers) as client:
        outcome = try_jobs(
            "regenerating sequences",
            [_job(files, paths, recipe, body_paths, run) for files in chosen],
            client,
            paths.failures_dir,
            units_total=len(STAGES) * len(chosen),
            units_done=lambda: _stages_done(paths, chosen),
        )
    reasons = {**refused, **outcome.reasons}
    _list(recipe, chosen, refused, reasons, paths, run)
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
    run: Run,
) -> Job:
    arguments: dict[str, Any] = {
        "files": files,
        "root": paths.root,
        "recipe": recipe,
        "body_paths": body_paths,
        "run": run,
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
    run: Run,
) -> None:
    """Write the verdicts of all sequences, and the manifest of those with files."""
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
        _write_manifest(recipe, done, bool(reasons), paths, run)


def _write_manifest(
    recipe: ThreedpwRecipe,
    done: Sequence[SequenceFiles],
    is_incomplete: bool,
    paths: SetPaths,
    run: Run,
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
        redo=run.redo or is_incomplete,
    )
