"""`gmrdata.export`: which files are to be written, and each as a whole or not at all."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Literal, NamedTuple, get_args

from gmrdata.export.formats import (
    FORMATS,
    ExportOptions,
    FormatName,
    Seen,
    Trajectory,
    kept_images,
    not_held,
    seen_points,
    times_of,
    unit_of,
    why_not,
    write_background,
)
from gmrdata.export.sources import (
    ExportedClip,
    UnreadClip,
    list_clips,
    load_exported,
    require_solved,
    world_people_dir,
)
from gmrdata.gmr.config import Which
from gmrdata.solve.request import FRAMES, SFM
from gmrdata.solve.verdict import (
    FILES,
    FOLDERS,
    VERDICT_FILE,
    VideoVerdict,
    own_parts,
    remove,
    remove_written,
)
from gmrdata.stage.locks import locked
from gmrdata.stage.progress import progress_bar, remark
from gmrdata.values.errors import BadRecipe, GmrdataError, MissingInput, StaleOutput, nearest
from gmrdata.values.files import write_bytes
from gmrdata.values.people import PSEUDO_GT
from gmrdata.world.compose import load_background
from gmrdata.world.judge import load_record
from gmrdata.write.cameras import write_tum
from gmrdata.write.emdb import emdb_name

USED_BY = {
    "of": ("camera", ("tum", "kitti")),
    "observations": ("keyframes", ("colmap",)),
    "threedpw": (None, ("3dpw",)),
    "truth": (None, ("rrd",)),
    "which": ("latest", ("onnx",)),
}
"""Settings that say nothing to most formats: what they are when left out, and whom they are for."""
OF_CLIPS = ("clips", "body", "images", "truth")  # nothing to a network
ONNX_ALONE = "onnx is of a training run, the other formats of clips"


class Unit(NamedTuple):
    """One thing to write: a clip, or the people of a sequence, in one format."""

    format: str
    name: str
    path: Path
    ids: tuple[str, ...]  # of the clips; empty for a network


class Exported(NamedTuple):
    """What became of a unit."""

    unit: Unit
    left_out: str  # why it was not written; empty if it was


def export(
    source: str | Path,
    formats: Iterable[FormatName | Literal["onnx"]],
    out: str | Path,
    *,
    clips: Iterable[str] = (),
    of: Trajectory = "camera",
    observations: Seen = "keyframes",
    body: str | Path | None = None,
    images: str | Path | None = None,
    truth: str | Path | None = None,
    threedpw: str | Path | None = None,
    which: Which = "latest",
    redo: bool = False,
    dry_run: bool = False,
) -> list[Exported]:
    """Write clips in the formats of other programs; what became of each file or folder.

    A clip that can't be read, or that a format can't hold, is left out with its reason.

    Args:
        source: A manifest, a clip's file, or a folder that a stage left; for onnx also "bundled".
        formats: Names of `FORMATS`; or "onnx" alone, for which `source` is a training run.
        out: Output folder; gets `<format>/<clip id>`.
        clips: Ids of the clips to write; all when empty.
        of: The trajectory in tum and kitti: of the camera or of the person.
        observations: Which image points a COLMAP model has: of the keyframes, all or none.
        body: As `load_body` takes it, or a folder of bodies; what lies beside the clips when None.
        images: Folder with the images of one sequence, or with a folder for each of several.
        truth: Manifest, folder or clip with the exact motions of the same clips, by id.
        threedpw: 3DPW's own folder, for its 2D keypoints and clothed templates.
        which: Which weights of a network.
        redo: Write again what is there.
        dry_run: Only say what would be written.

    Raises:
        StaleOutput: something is there already, and `redo` is not set; nothing was written.
        BadRecipe: there is no format or setting of that name, none looks at something that was
            said, onnx is not alone, or two clips would be written to one file.
        MissingInput: there is no such source, clip, body, image folder or network.
    """
    source, out, formats = Path(source), Path(out), list(formats)
    clips = [clips] if isinstance(clips, str) else list(clips)
    options = ExportOptions(of, observations, None if threedpw is None else Path(threedpw))
    of_clips = {"clips": clips, "body": body, "images": images, "truth": truth}
    _require_used(formats, vars(options) | {"which": which} | of_clips)
    wanted = tuple(dict.fromkeys(name for name in formats if name != "onnx"))
    if "onnx" in formats:
        return [_export_network(source, out, which, redo=redo, dry_run=dry_run)]
    people_of = _sequences(list_clips(source, clips))
    plan = [(people, list(_units(people, wanted, options, out))) for people in people_of]
    paths = _apart([unit for _, units in plan for unit in units])
    _refuse_to_overwrite([] if redo or dry_run else paths)
    given = _StandIns(*(None if one is None else Path(one) for one in (body, images, truth)))
    return _export_clips(plan, given, options, dry_run)


def _require_used(formats: Sequence[str], said: Mapping[str, object]) -> None:
    """Refuse formats that are none or don't go together, and settings that none looks at."""
    known = (*FORMATS, "onnx")
    if unknown := next((name for name in formats if name not in known), None):
        names = f"give a list of names, of {', '.join(known)}{nearest(unknown, known)}"
        raise BadRecipe(f"no format {unknown!r}; {names}")
    if "onnx" in formats and set(formats) != {"onnx"}:
        raise BadRecipe(f"{ONNX_ALONE}. Export it alone")
    for flag in OF_CLIPS if "onnx" in formats else ():
        if said[flag]:
            raise BadRecipe(f"--{flag}: {ONNX_ALONE}. Leave it out")
    for flag, kinds in (("of", Trajectory), ("observations", Seen), ("which", Which)):
        if said[flag] not in get_args(kinds):
            raise BadRecipe(f"--{flag}: {said[flag]!r} is none of {', '.join(get_args(kinds))}")
    for flag, (usual, users) in USED_BY.items():
        if said[flag] != usual and not {*users} & {*formats}:
            raise BadRecipe(f"--{flag}: is for {' and '.join(users)} alone. Leave it out")


def _export_clips(
    plan: "Sequence[tuple[Sequence[UnreadClip], Sequence[Unit]]]",
    given: "_StandIns",
    options: ExportOptions,
    dry_run: bool,
) -> list[Exported]:
    """Write the units of each sequence, whose people are loaded once."""
    truths = _truths(given.truth, [one for people, _ in plan for one in people])
    results: list[Exported] = []
    with progress_bar(shown=not dry_run) as bar:
        for people, units in bar.track(plan, description="exporting"):
            loaded = {one.id: _load(one, given, truths, len(plan) == 1) for one in people}
            results += [Exported(unit, _write(unit, loaded, options, dry_run)) for unit in units]
    return results


class _StandIns(NamedTuple):
    """What stands in place of what lies beside the clips."""

    body: Path | None
    images: Path | None
    truth: Path | None


def _sequences(wanted: Sequence[UnreadClip]) -> list[list[UnreadClip]]:
    """The people of each sequence: folders may differ where their names, fit for files, don't."""
    sequences: dict[tuple[str, Path], list[UnreadClip]] = {}
    for files in wanted:
        sequences.setdefault((files.sequence, files.clip_path.parent), []).append(files)
    return list(sequences.values())


def _units(
    people: Sequence[UnreadClip], formats: Sequence[FormatName], options: ExportOptions, out: Path
) -> Iterator[Unit]:
    """What is to be written of one sequence."""
    for name in formats:
        of_all = unit_of(FORMATS[name], options) == "sequence"
        groups = [people] if of_all else [(person,) for person in people]
        for group in groups:
            called = group[0].sequence if of_all else group[0].id
            subject, take = emdb_name(called)
            place = FORMATS[name].path.format(
                id=called, split=group[0].split, subject=subject, take=take
            )
            yield Unit(name, called, out / name / place, tuple(person.id for person in group))


def _truths(source: Path | None, wanted: Sequence[UnreadClip]) -> dict[str, UnreadClip]:
    """The files of exact clips by id; says of which clips there is none."""
    if source is None:
        return {}
    there = {files.id: files for files in list_clips(source)}
    without = [files.id for files in wanted if files.id not in there]
    if len(without) == len(wanted):
        raise MissingInput(f"{source}: has none of the clips; there are {', '.join(there)}")
    if without:
        remark(f"no truth for {', '.join(without)}")
    return there


def _load(
    files: UnreadClip, given: _StandIns, truths: Mapping[str, UnreadClip], alone: bool
) -> ExportedClip | GmrdataError:
    """The clip, or why it can't be read."""
    images = None if given.images is None else images_of(given.images, files.sequence, alone=alone)
    if given.truth is not None:
        files = replace(files, truth_files=truths.get(files.id))
    try:
        return load_exported(files, body=given.body, images=images)
    except GmrdataError as error:
        return error


def images_of(folder: Path, sequence: str, *, alone: bool) -> Path:
    """A sequence's images: in a folder of its name, or right in `folder` if it is alone."""
    named = folder / sequence
    return folder if alone and not named.is_dir() else named


def _apart(units: Sequence[Unit]) -> list[Path]:
    """Where units are written; BadRecipe where two would be one file, as P0_walk and walk of EMDB's
    would, and Walk and walk on disks of macOS and Windows."""
    by_path: dict[str, Unit] = {}
    for unit in units:
        if (other := by_path.setdefault(str(unit.path).casefold(), unit)) is not unit:
            remedy = "Write one of them at a time, with --clips, to another --out each"
            raise BadRecipe(f"{unit.path}: {other.name} and {unit.name} would be this. {remedy}")
    return [unit.path for unit in by_path.values()]


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
    """Write one unit; why it can't be, or "".  A dry run prepares all, and writes nothing."""
    people: list[ExportedClip] = []
    for one in map(loaded.__getitem__, unit.ids):
        if isinstance(one, GmrdataError):
            return str(one)
        people.append(one)
    format = FORMATS[unit.format]
    if reason := why_not(format, people, options):
        return reason
    try:
        for lacking in not_held(unit.format, people, options.of):
            remark(f"{unit.name}: {lacking}")
        write = format.prepare(people, options)
        if not dry_run:
            with _whole(unit) as partial:
                write(partial)
    except GmrdataError as error:
        return str(error).replace(_partial(unit.path).name, unit.path.name)
    return ""


def _export_network(
    run_dir: Path, out: Path, which: Which, *, redo: bool, dry_run: bool
) -> Exported:
    """Write the network of a training run as `onnx/<run>.onnx`."""
    from gmrdata.gmr.predict import load_gmr, onnx_network

    gmr = load_gmr(run_dir, which)
    path = out / "onnx" / f"{gmr.name}.onnx"
    if not dry_run:
        if not redo:
            _refuse_to_overwrite([path])
        write_bytes(path, onnx_network(gmr))
    return Exported(Unit("onnx", gmr.name, path, ()), "")


@contextmanager
def _whole(unit: Unit) -> Iterator[Path]:
    """A sibling of the unit's path to write a file or folder to, which replaces it when the block
    ends: all of it, or what of a folder is ours.  Another process that writes the same waits."""
    path, partial = unit.path, _partial(unit.path)
    with locked(path):
        remove(partial)
        try:
            yield partial
            if unit.format not in FOLDERS:
                remove(path)
                partial.rename(path)
                return
            for old in own_parts(path, unit.name):
                remove(old)
            for new in own_parts(partial, unit.name):
                placed = path / new.relative_to(partial)
                placed.parent.mkdir(parents=True, exist_ok=True)
                new.rename(placed)
        finally:
            remove(partial)


def _partial(path: Path) -> Path:
    """Keeps the suffix, by which some writers choose a form."""
    return path.with_name(f".partial.{path.name}")


TAKEN_ALONG: tuple[FormatName, ...] = ("colmap", "tum", "bvh", "glb", "amass")
"""Formats that are written of people; of cameras alone the first two."""


def write_files(
    out_dir: Path, *, images: Path | None = None, body: str | None = None
) -> Sequence[tuple[str, str]]:
    """Files for other programs of the people who were accepted, by `fused/` where it is there, or
    of cameras alone; gives what could not be written, and why.

    What they were of another verdict or body is taken away, but not what others put beside them.
    MissingInput for a folder in which nothing was solved: nothing in it is touched.
    """
    require_solved(out_dir)
    verdict_path, pseudo_gt_dir = out_dir / VERDICT_FILE, out_dir / PSEUDO_GT
    results: list[Exported] = []
    try:
        people = load_record(pseudo_gt_dir).people if pseudo_gt_dir.is_dir() else ()
        clips = list_clips(people_dir := world_people_dir(out_dir)) if people else []
        ids = [files.id for files, one in zip(clips, people, strict=True) if one.accepted]
        remove_written(out_dir / FILES, {name for one in clips for name in (one.id, one.sequence)})
        if ids:
            into = TAKEN_ALONG, out_dir / FILES
            results = export(people_dir, *into, clips=ids, body=body, images=images, redo=True)
        elif verdict_path.is_file() and (verdict := VideoVerdict.read(verdict_path)).accepted:
            _write_cameras(out_dir, images or out_dir / FRAMES, verdict.fps_hz)
    except (GmrdataError, ValueError) as error:
        return [("all formats", str(error))]
    return [
        (f"{one.unit.format} of {one.unit.name}", one.left_out) for one in results if one.left_out
    ]


def _write_cameras(out_dir: Path, images: Path, fps_hz: float) -> None:
    """Cameras alone, in the frames that the verdict keeps, as a COLMAP model and as TUM's
    trajectory, in their own unit and world."""
    sfm_dir, model = out_dir / SFM, Unit("colmap", "", out_dir / FILES / "colmap", ())
    solved = load_background(sfm_dir, None)
    known = solved.camera.has_camera & kept_images(sfm_dir, solved.image_numbers)
    solved = replace(solved, camera=replace(solved.camera, has_camera=known))
    names, points = seen_points(solved, sfm_dir, "keyframes")
    with _whole(model) as partial:
        write_background(partial, solved, names, points, images)
    times_s = times_of(images, solved.image_numbers, fps_hz)[known]
    write_tum(out_dir / FILES / "tum" / "camera.txt", solved.camera.world_from_cam[known], times_s)
