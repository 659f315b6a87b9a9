"""Stage: world-frame pseudo ground truth of a 3DPW folder, and what is in one, as tables."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

from pydantic.dataclasses import dataclass as part

from gmrdata.manifest.current import Manifest
from gmrdata.manifest.read import read_manifest
from gmrdata.manifest.write import ManifestHead, made_by, write_manifest
from gmrdata.people.sources import FolderSource
from gmrdata.read import threedpw
from gmrdata.read.bodies import keep_body
from gmrdata.read.threedpw_files import (
    SEQUENCE_NAME,
    SequenceFiles,
    find_sequences,
    require_one_split,
)
from gmrdata.stage.jobs import Job, in_threads, raise_failures, record_failures, try_jobs
from gmrdata.stage.progress import console, remark, track
from gmrdata.stage.recipes import read_recipe
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import AGAIN, NotMade
from gmrdata.stage.workers import worker_pool
from gmrdata.threedpw.recipe import SetPaths, ThreedpwRecipe
from gmrdata.threedpw.sequence import regenerate_one, sequence_entries
from gmrdata.values.camera_motion import MotionClass
from gmrdata.values.clip import dropped_ranges
from gmrdata.values.errors import (
    BadManifest,
    BadRecipe,
    BadSequence,
    GmrdataError,
    MissingInput,
    StaleOutput,
)
from gmrdata.values.files import remove_orphans
from gmrdata.values.records import PART, Figure, Record, with_absolute_paths
from gmrdata.world.judge import load_record

HEADINGS = ("sequence", "split", "state")
VERDICT_HEADINGS = ("sequence", "split", "verdict", "camera", "kept", "scale", "reasons")
STAGES = ("people", "masks", "sfm", "lines", "pseudo_gt")


@part(frozen=True, config=PART)
class SequenceVerdict:
    """What was decided of a sequence."""

    sequence: str
    split: str
    """Empty where it has none or several."""
    accepted: bool
    """Whether one of its people is."""
    reasons: tuple[str, ...]
    """Why people were rejected, or why it could not be read."""
    camera_motion: MotionClass | Literal["none"]
    """ "none" without a reconstruction."""
    kept_share: Figure
    """Frames of accepted people that are kept, over all frames of all people."""
    scale: Figure | None
    """Metres per unit of the reconstruction; null where it does not enter."""
    scale_sigma: Figure | None

    @property
    def scale_share(self) -> float | None:
        """Standard error of the scale, as a share of it; None without a scale above zero."""
        if self.scale is None or self.scale_sigma is None or not self.scale > 0:
            return None
        return self.scale_sigma / self.scale

    @property
    def scale_words(self) -> str:
        """The scale with its error; empty where it does not enter."""
        scale = "" if self.scale is None else f"{self.scale:.4g}"
        return scale if self.scale_share is None else f"{scale} ± {100 * self.scale_share:.1f} %"

    @property
    def table_row(self) -> tuple[str, ...]:
        """A row for `VERDICT_HEADINGS`."""
        return (
            self.sequence,
            self.split,
            "accepted" if self.accepted else "rejected",
            self.camera_motion,
            f"{100 * self.kept_share:.1f} %",
            self.scale_words or "-",
            "; ".join(self.reasons),
        )


class Verdicts(Record):
    """`verdicts.json`: what was decided of each sequence, those included that can't be read."""

    format: Literal["gmrdata-verdicts/1"] = "gmrdata-verdicts/1"
    sequences: tuple[SequenceVerdict, ...]
    """In the order of their names."""


def regenerate_threedpw(
    threedpw_dir: str | Path,
    out_dir: str | Path,
    recipe: ThreedpwRecipe | str | Path = "threedpw",
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """World motions of a 3DPW folder with a verdict for each sequence; gives the manifest's path.

    `recipe` names SMPL's files, as a copy of pipelines/threedpw.yaml does; all else as
    `regenerate_set`.
    """
    loaded = read_recipe(recipe, ThreedpwRecipe)
    return regenerate_set(loaded, Path(threedpw_dir), Path(out_dir), run=run)


def regenerate_set(
    recipe: ThreedpwRecipe, root: Path, out_dir: Path, *, run: Run = DEFAULT_RUN
) -> Path:
    """Make world motions of all sequences, `verdicts.json` and the manifest `pseudo_gt.yaml`.

    A sequence that can't be read or masked leaves its reason in `failed/<name>.txt`, and the others
    go on; a complete manifest of an earlier run stays then.  One without a reconstruction is listed
    as rejected.  A run that was stopped goes on.  Where nothing is left to make, no worker starts.
    Where the recipe names sequences and a manifest of this version is there, those that it was
    asked for stay in it; BadManifest where they were made with other settings.

    StageFailed where some sequences failed, NothingMade where all did, NoWorkers where no worker
    began.
    """
    recipe, chosen, refused = _checked(recipe, root)
    paths = SetPaths(out_dir.resolve())
    whole, others, missing = _besides(recipe, root, paths, run)
    for folder in (paths.root, paths.failures_dir):
        remove_orphans(folder)
    body_paths = _keep_bodies(recipe, paths, run)
    before = _listing(paths)
    common = {"root": paths.root, "recipe": recipe, "body_paths": body_paths, "run": run}
    jobs = [Job(files.name, regenerate_one, common | {"files": files}) for files in chosen]
    # What is no name of a sequence is none of a file either.
    named = {name: why for name, why in refused.items() if _as_shown(name) == name}
    record_failures(paths.failures_dir, named, ())
    reasons = refused | _regenerate(jobs, recipe, chosen, paths, run)
    _list(whole, [*chosen, *others], missing | reasons, paths, run)
    if not reasons and _listing(paths) == before:
        console.print(f"nothing changed: {len(chosen)} sequences are as they were made")
    failed = {_as_shown(name): why for name, why in reasons.items()}
    raise_failures("sequences", failed, len(chosen) + len(refused), paths.failures_dir)
    return paths.manifest


def _as_shown(name: str) -> str:
    """A sequence's name; quoted where it could hold anything, even escape codes for terminals."""
    return name if SEQUENCE_NAME.fullmatch(name) else repr(name)


def _checked(
    recipe: ThreedpwRecipe, root: Path
) -> tuple[ThreedpwRecipe, list[SequenceFiles], dict[str, str]]:
    """The recipe, and sequences as `choose` gives them, by absolute paths: a worker of another
    machine may run in another folder."""
    recipe, root = with_absolute_paths(recipe), root.absolute()
    chosen, refused = choose(root, recipe.sequences)
    _require_fitting(recipe, root, len(chosen))
    return recipe, chosen, refused


def choose(root: Path, names: Sequence[str]) -> tuple[list[SequenceFiles], dict[str, str]]:
    """The sequences to regenerate, and by name why others can't be read."""
    sequences = find_sequences(root)
    if unknown := sorted(set(names) - {files.name for files in sequences}):
        known = "`gmrdata threedpw list` shows the names"
        raise MissingInput(f"{root}: no sequence {', '.join(unknown)}; {known}")
    chosen, refused = [], {}
    for files in sequences:
        if names and files.name not in names:
            continue
        try:
            require_one_split(files.name, sequences)
            chosen.append(files)
        except BadSequence as error:
            refused[files.name] = str(error)
    return chosen, refused


def _require_fitting(recipe: ThreedpwRecipe, root: Path, n_chosen: int) -> None:
    """Refuse masks that all sequences would share; say whose decisions are of no sequence."""
    masks = recipe.sequence.masks
    sources = () if masks is None else masks.sources
    if n_chosen > 1 and any(isinstance(source, FolderSource) for source in sources):
        raise BadRecipe("sequence.masks: a folder of masks is of one sequence. Name that one alone")
    # Not an error: of twins, which share the recipe, there may be fewer.
    if unknown := sorted(recipe.overrides.keys() - {files.name for files in find_sequences(root)}):
        remark(f"overrides of {', '.join(unknown)}: {root} has no such sequence")


def plan(
    recipe: ThreedpwRecipe, root: Path, out_dir: Path, *, run: Run = DEFAULT_RUN
) -> list[tuple[str, ...]]:
    """Rows for `HEADINGS`: what a run would do, or refuse, without doing it."""
    recipe, chosen, refused = _checked(recipe, root)
    # Not with `redo`, for which folders are removed that nothing takes the place of.
    paths, look = SetPaths(out_dir.resolve()), Run(anew=run.redo, only_look=True)
    _besides(recipe, root, paths, run)

    def row(files: SequenceFiles) -> tuple[str, ...]:
        folder = paths.sequence_dir(files.name)
        missing = [stage for stage in STAGES if not (folder / stage).is_dir()]
        said = "done"
        try:
            _require_made(files, recipe, paths, look)
        except NotMade:
            said = f"to do: {', '.join(missing) or 'again'}"
        except (GmrdataError, OSError) as error:
            said = str(error)
        return files.name, files.split, said

    return [*in_threads(row, chosen), *((_as_shown(n), "-", why) for n, why in refused.items())]


def _require_made(files: SequenceFiles, recipe: ThreedpwRecipe, paths: SetPaths, look: Run) -> None:
    """NotMade, or an error, where a sequence is not as the recipe makes it."""
    regenerate_one(files, paths.root, recipe, _keep_bodies(recipe, paths, look), look)


def _besides(
    recipe: ThreedpwRecipe, root: Path, paths: SetPaths, run: Run
) -> tuple[ThreedpwRecipe, list[SequenceFiles], dict[str, str]]:
    """What a manifest of this version that is there was asked for besides the sequences that are
    named now: the recipe of all, the others, and why some of those can't be listed.  With --redo
    what is gone from `root` is forgotten: other twins may have taken its place."""
    there = _manifest_of(recipe, paths) if recipe.sequences else None
    if there is None:
        return recipe, [], {}
    asked: tuple[str, ...] = tuple(there.created_by.recipe.get("sequences", ()))
    names = tuple(dict.fromkeys((*asked, *recipe.sequences))) if asked else ()
    known = {files.name for files in find_sequences(root)}
    unmade = {name: f"it is not in {root} any more" for name in names if name not in known}
    if run.redo:
        for name, why in unmade.items():
            remark(f"{name}: left out, as {why}")
        names, unmade = tuple(name for name in names if name in known), {}
    chosen, refused = choose(root.absolute(), [name for name in names if name in known])
    missing = {name: why for name, why in refused.items() if name not in recipe.sequences}
    missing |= unmade
    others = [files for files in chosen if files.name not in recipe.sequences]
    for files in others:
        try:
            _require_made(files, recipe, paths, Run(only_look=True))
        except (NotMade, StaleOutput) as error:
            unmade[files.name] = str(error).removesuffix(f". {AGAIN}")
            missing[files.name] = "not made with these settings"
        except (GmrdataError, OSError) as error:
            missing[files.name] = str(error)
    for name in (clip.source.sequence or clip.id for clip in there.clips):
        if name in unmade:
            what = f"lists {name} besides, which is not as these settings make it"
            remedy = "Name no sequences, to make all with" if name in known else "Leave it out with"
            why = f"({unmade[name]}). {remedy} --redo, or pass another --out"
            raise BadManifest(f"{paths.manifest}: {what} {why}")
    return recipe.model_copy(update={"sequences": names}), others, missing


def _manifest_of(recipe: ThreedpwRecipe, paths: SetPaths) -> Manifest | None:
    """The manifest of this name and version that is there, complete or not."""
    if not paths.manifest.is_file():
        return None
    try:
        there = read_manifest(paths.manifest)
    except BadManifest:  # who writes says so
        return None
    version = there.version.partition("incomplete")[0].rstrip("-.")
    is_same = (there.name, version) == (recipe.name, recipe.version)
    return there if is_same and isinstance(there, Manifest) else None


def _keep_bodies(recipe: ThreedpwRecipe, paths: SetPaths, run: Run) -> tuple[Path, ...]:
    """Files of the recipe's bodies, in its order, kept beside the sequences."""
    return tuple(
        keep_body(body, paths.body_dir(number), run=run)
        for number, body in enumerate(recipe.bodies)
    )


def _regenerate(
    jobs: Sequence[Job],
    recipe: ThreedpwRecipe,
    chosen: Sequence[SequenceFiles],
    paths: SetPaths,
    run: Run,
) -> dict[str, str]:
    """Why sequences failed, by name."""
    with worker_pool(run, recipe.workers) as pool:
        own = [paths.sequence_dir(files.name) for files in chosen if pool.is_own(files.name)]
        folders = [folder / stage for folder in own for stage in STAGES]
        return try_jobs(
            "regenerating sequences",
            jobs,
            pool,
            paths.failures_dir,
            (len(folders), lambda: sum(folder.is_dir() for folder in folders)),
        ).reasons


def _listing(paths: SetPaths) -> list[bytes]:
    """What is listed, to see whether it changed."""
    files = (paths.verdicts, paths.manifest)
    return [path.read_bytes() for path in files if path.is_file()]


def _list(
    recipe: ThreedpwRecipe,
    chosen: Sequence[SequenceFiles],
    reasons: Mapping[str, str],
    paths: SetPaths,
    run: Run,
) -> None:
    done = [files for files in chosen if files.name not in reasons]
    splits = {files.name: files.split for files in chosen}
    verdicts = [_verdict(files, paths) for files in done]
    verdicts += [_failed(name, splits.get(name, ""), why) for name, why in reasons.items()]
    verdicts.sort(key=lambda verdict: verdict.sequence)
    if done:  # the manifest first, which may be refused
        _write_manifest(recipe, done, reasons, paths, run)
    Verdicts(sequences=tuple(verdicts)).write(paths.verdicts)


def _write_manifest(
    recipe: ThreedpwRecipe,
    done: Sequence[SequenceFiles],
    reasons: Mapping[str, str],
    paths: SetPaths,
    run: Run,
) -> None:
    write_manifest(
        paths.manifest,
        ManifestHead(
            name=recipe.name,
            version=recipe.version,
            description="World-frame pseudo ground truth, regenerated from frames, intrinsics and "
            "camera-frame bodies.",
            kind="pseudo_gt",
            licence=recipe.licence,
        ),
        [entry for files in done for entry in sequence_entries(files, recipe, paths)],
        created_by=made_by(recipe, {"sfm": recipe.sequence.sfm.seed}),
        redo=run.redo,
        incomplete=bool(reasons),
    )


def _verdict(files: SequenceFiles, paths: SetPaths) -> SequenceVerdict:
    record = load_record(paths.pseudo_gt_dir(files.name))
    frames = sum(person.frames for person in record.people)
    kept = sum(person.kept_frames for person in record.people if person.accepted)
    reasons = [reason for person in record.people for reason in person.reasons]
    return SequenceVerdict(
        sequence=files.name,
        split=files.split,
        accepted=any(person.accepted for person in record.people),
        reasons=tuple(dict.fromkeys(reasons)),
        camera_motion=record.camera_motion,
        kept_share=kept / frames,
        scale=record.scale,
        scale_sigma=record.scale_sigma,
    )


def _failed(name: str, split: str, reason: str) -> SequenceVerdict:
    return SequenceVerdict(
        sequence=name, split=split, accepted=False, reasons=(reason.splitlines()[0],),
        camera_motion="none", kept_share=0.0, scale=None, scale_sigma=None,
    )  # fmt: skip


LIST_HEADINGS = ("sequence", "split", "people", "frames", "size [px]", "usable", "problems")
RANGE_HEADINGS = ("person", "gender", "first frame", "last frame", "frames", "usable, or why not")


def sequence_rows(root: Path, rule: str) -> tuple[list[tuple[str, ...]], int]:
    """A row for `LIST_HEADINGS` per sequence, and how many say why one can't be read."""
    known = threedpw.known_rule(rule)
    sequences = find_sequences(root)
    rows: list[tuple[str, ...]] = []
    n_bad = 0
    for files in track(sequences, "reading sequences"):
        try:
            require_one_split(files.name, sequences)
            rows.append(_row(files, known))
        except (GmrdataError, OSError) as error:
            rows.append((_as_shown(files.name), files.split, "-", "-", "-", "-", str(error)))
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
            for start, stop, reason in dropped_ranges(reasons)
        ]
    return rows, sequence.problems


def _row(files: SequenceFiles, rule: threedpw.ValidRule) -> tuple[str, ...]:
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
