"""Motion files of any kind as a manifest of training motions, or as a table.

Which files go in, what each clip is called, where its motion came from, and what that allows.
"""

import os
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path, PurePath
from typing import Literal, Self

import numpy as np

from gmrdata.manifest.current import ClipEntry, Quality, Source
from gmrdata.manifest.write import (
    ClipAbout,
    ClipFiles,
    ManifestHead,
    clip_entry,
    made_by,
    stage_recipe,
    write_manifest,
)
from gmrdata.motion.amass import chosen_body
from gmrdata.motion.files import FileReading, find_motions, input_files, read_file
from gmrdata.motion.retarget import LARGEST_RESIDUAL_DEG
from gmrdata.read import source_motion
from gmrdata.read.bodies import keep_bodies, keep_body, load_bodies, load_body_once
from gmrdata.read.source_motion import DEFAULT_READING, ReadConfig, RestPose, UpAxis
from gmrdata.stage.jobs import Job, Outcome, try_batch
from gmrdata.stage.progress import remark, track
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import AGAIN, StageRecord, run_stage
from gmrdata.values.clip import Clip, save_clip
from gmrdata.values.errors import BadManifest, BadMotionFile, BadRecipe, GmrdataError, MissingInput
from gmrdata.values.files import as_paths, as_text
from gmrdata.values.records import Config, Record, with_absolute_paths

LICENCES = {
    "gmrdata": "CC0-1.0",  # generated gait on a CC0 body: nobody's work but the program's
    "CMU": "CMU Graphics Lab Motion Capture Database: free for all uses, may not be resold; credit "
    "mocap.cs.cmu.edu, created with funding from NSF EIA-0196217",
    "AMASS": "AMASS's licence (amass.is.tue.mpg.de): non-commercial; not to be passed on",
}
LINES = ("limbs", "hips", "shoulders", "trunk")
"""The file's own lines against the body's, mean (worst) [deg]; the keys of LARGEST_RESIDUAL_DEG."""
HEADINGS = ("file", "frames", "rate [Hz]", "from", "length [s]", "path [m]", "speed [m/s]",
            *(f"{line} [deg]" for line in LINES))  # fmt: skip
EXPORTED = re.compile(r"(?:.*\.)?([^.]+)\.([^.]+)\.([^.]+_(?:poses|stageii))(?:_\d+-\d+)?")
"""Names of exported clips of AMASS: `CMU.02.02_03_poses_00000-00172`."""
LONGEST_ID = 150
READING = "reading motions"
FAILED = "failed"
"""Folder below the library's with a text file for each file that could not be read."""
CLIPS, CLIP_FILE = "clips", "clip.npz"
READING_FILE, MANIFEST = "reading.json", "motions.yaml"
FEW_FILES = 8  # so many files are read faster than worker processes start
MAX_LISTED = 20


def gait_source(name: str) -> Source:
    return Source(dataset="gmrdata", sequence=name)


def motion_source(path: Path, inside: Path) -> Source:
    """A motion file, known as CMU's by a name like 02_03, as AMASS's by data set, subject and
    trial: `KIT/3/kick_poses.npz`.

    These are the last three parts of its path as far as they lie in the folder that was given
    (`inside`), or are that folder's name.  Or they are in its name, as `gmrdata export` names a
    clip's files.  The data set is CMU's wherever one of its trials lies in a folder of CMU's.
    """
    # A library's folders are named as its clips.
    stem = path.absolute().parent.name if path.name == CLIP_FILE else path.stem
    if exported := EXPORTED.fullmatch(stem):
        return _amass_source(exported.groups(), PurePath(*stem.split(".")))
    n_inside = len(inside.parts)
    given = (path.absolute().parents[n_inside - 1].resolve().name,) if n_inside > 1 else ()
    names = (*given, *inside.with_suffix("").parts)[-3:]
    in_amass = path.suffix.lower() == ".npz" and path.stem.endswith(("_poses", "_stageii"))
    if in_amass and len(names) == 3:
        return _amass_source(names, path)
    return Source(dataset="CMU" if source_motion.is_trial(stem) else "file", sequence=as_text(stem))


def _amass_source(names: Sequence[str], path: PurePath) -> Source:
    in_cmu = source_motion.in_cmu
    if source_motion.CMU_TRIAL.match(names[-1]) and in_cmu(path) and not in_cmu(PurePath(*names)):
        names = ("CMU", *names[1:])
    return Source(dataset="AMASS", sequence=as_text("/".join(names)))


def licence_of(source: Source) -> str:
    """Terms under which a clip of this source may be passed on."""
    return LICENCES.get(source.dataset, "as the motion file that it was made from")


@dataclass(frozen=True)
class LibraryFile:
    """A motion file, and its clip's id and origin."""

    path: Path
    id: str
    source: Source


def library_files(
    sources: tuple[Path, ...], config: ReadConfig = DEFAULT_READING
) -> list[LibraryFile]:
    """The motion files among files and folders, each once; BadRecipe where `config` says of them
    what none of them looks at.

    What gmrdata made is left out of folders with other files, as the clips of an earlier run.

    A clip is called as its file.  An .npz that was found in a folder has its folders in the name
    as well, `CMU.01.01_01_poses`, since AMASS's data sets repeat the names of files; so has any
    file whose name another one has too.  Names that differ in letters alone that an id may not
    have, like those of Chinese files, are told apart by a hash.
    """
    if not sources:
        raise MissingInput("nothing given. Name motion files or folders of them")
    if missing := [str(source) for source in sources if not source.exists()]:
        raise MissingInput(f"{', '.join(missing)}: no such file or folder")
    motions = []
    for source in sources:
        folder = source if source.is_dir() else source.parent
        paths = find_motions(source) if source.is_dir() else [source]
        if not paths:
            raise MissingInput(f"{source}: holds no .bvh, .amc or .npz with a motion")
        motions += [(path, path.relative_to(folder)) for path in paths]
    once = {path.resolve(): (path, inside) for path, inside in reversed(motions)}
    motions = list(reversed(once.values()))
    of_skeletons = config.model_dump(include={"joint_map", "rest_pose"}, exclude_none=True)
    if of_skeletons and all(path.suffix.lower() == ".npz" for path, _ in motions):
        flag = next(iter(of_skeletons)).replace("_", "-")
        raise BadRecipe(f"--{flag}: is for BVH and AMC, and all files are .npz. Leave it out")
    stems = Counter(path.stem for path, _ in motions)
    names = [
        ".".join(inside.with_suffix("").parts)
        if path.suffix.lower() == ".npz" or stems[path.stem] > 1
        else path.stem
        for path, inside in motions
    ]
    ids = Counter(map(clip_id, set(names)))
    files: dict[str, LibraryFile] = {}
    for (path, inside), name in zip(motions, names, strict=True):
        id = clip_id(name)
        if ids[id] > 1:
            id += f"_{sha256(name.encode(errors='surrogateescape')).hexdigest()[:8]}"
        file = LibraryFile(path, id, motion_source(path, inside))
        if (other := files.setdefault(file.id, file)) is not file:
            remedy = "Give the folder that holds both, or import them into two folders"
            if other.path.with_suffix("") == path.with_suffix(""):
                remedy = "Leave one out, as two forms of one motion, or rename it"
            raise BadRecipe(f"{other.path} and {path} would both be clip {file.id}. {remedy}")
    return list(files.values())


def clip_id(name: str) -> str:
    """A name with the letters that a clip's id may have; AMASS has files with spaces."""
    plain = re.sub(r"[^A-Za-z0-9_.-]+", "_", name)[-LONGEST_ID:]
    return plain if re.match(r"[A-Za-z0-9_]", plain) else f"_{plain}"


class ReadingRecord(Record):
    """`reading.json`: how a clip's file was read."""

    format: Literal["gmrdata-reading/1"] = "gmrdata-reading/1"
    rate_from: str
    """Where the frame rate is from: "header", "file", "CMU's index", "CMU's skeleton", "given"."""
    residual_deg: dict[str, float]
    """Mean and worst angles between the file's own lines and the body's (`Residual.figures`); empty
    for a file that holds poses of this tree."""
    upright: bool
    """False for one who lies or leans in most frames."""
    remarks: list[str]
    """What may be wrong."""

    @classmethod
    def of(cls, read: FileReading) -> Self:
        residual = read.residual
        figures = {} if residual is None else residual.figures
        upright, remarks = read.upright, list(read.remarks)
        rate_from = read.rate_from
        return cls(rate_from=rate_from, residual_deg=figures, upright=upright, remarks=remarks)


@dataclass(frozen=True)
class MotionTable:
    """What is in motion files."""

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    warnings: Sequence[str]
    bad: str  # which files can't be read; empty if all can


def motion_table(
    sources: tuple[Path, ...], body: str, config: ReadConfig = DEFAULT_READING
) -> MotionTable:
    """Read motion files and say what is in them, with paths from the folder that holds them all."""
    files = library_files(sources, config)
    bodies = {one.name: one for one in load_bodies(body)}
    root = os.path.commonpath([file.path.absolute().parent for file in files])
    rows, warnings, reasons = [], [], {}
    for file in track(files, READING):
        try:
            read = read_file(file.path, bodies[chosen_body(file.path, bodies)], config)
        except GmrdataError as error:
            reasons[file.id] = str(error)
            continue
        inside = str(file.path.absolute().relative_to(root))
        rows.append((inside, *_cells(read)))
        warnings += [f"{inside}: {what}" for what in read.remarks]
    others = "the others are listed" if rows else ""
    bad = _bad_files(reasons, len(files), others) if reasons else ""
    return MotionTable(HEADINGS, rows, warnings, bad)


def _cells(read: FileReading) -> tuple[str, ...]:
    """A motion's row, without its name."""
    motion, residual = read.motion, read.residual
    # Its path on the ground at 10 fps, which leaves out the pelvis's sway.
    ground_m = motion.pelvis_m[:: max(1, round(motion.fps_hz / 10)), :2]
    travelled_m = float(np.linalg.norm(np.diff(ground_m, axis=0), axis=1).sum())
    seconds = motion.n_frames / motion.fps_hz
    figures = [f"{value:.2f}" for value in (seconds, travelled_m, travelled_m / seconds)]
    off = ["" for _ in LARGEST_RESIDUAL_DEG]
    if residual is not None:
        both = [(residual.mean_deg[line], residual.worst_deg[line]) for line in residual.mean_deg]
        off = [f"{mean:.1f} ({worst:.1f})" for mean, worst in both]
    return f"{motion.n_frames}", f"{motion.fps_hz:g}", read.rate_from, *figures, *off


PLAN_HEADINGS = ("clip", "file", "state")
TO_DO = "to do"


def plan_library(
    sources: tuple[Path, ...], out_dir: Path | None, config: ReadConfig
) -> list[tuple[str, str, str]]:
    """Rows of `PLAN_HEADINGS`: what `make_library` would read; no motion file is opened."""

    def state(id: str) -> str:
        if out_dir is None or not (folder := out_dir / CLIPS / id).is_dir():
            return TO_DO
        made_by = StageRecord.of(folder)
        is_so = made_by.config == config.recorded.model_dump(mode="json")
        is_so &= made_by.inputs.keys() & {"joint_map", "rest_pose"} == config.inputs.keys()
        return "there" if is_so else "read in another way before, needs --redo"

    files = library_files(sources, config)
    return [(one.id, str(one.path), state(one.id)) for one in files]


def make_library(
    sources: str | Path | Iterable[str | Path],
    body: str,
    out_dir: str | Path,
    *,
    fps_hz: float | None = None,
    unit_m: float | None = None,
    joint_map: Path | None = None,
    rest_pose: RestPose | Path | None = None,
    up: UpAxis | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Write one clip per motion file, and `motions.yaml` that lists them; gives its path.

    Each file is a stage of its own, done by one of several worker processes, and is not done again.

    `body` is as `load_body` takes it, or a folder of bodies: then each motion is put on the one
    that its shape is of, see `chosen_body`.  `fps_hz` to `up` as in `read_motion`.  A
    BadMotionFile lists the files that could not be read, once the others' manifest is written.
    """
    out_dir = Path(out_dir).resolve()
    said = {"fps_hz": fps_hz, "unit_m": unit_m, "joint_map": joint_map, "rest_pose": rest_pose}
    config = ReadConfig.of(out_dir, up=up, **said)
    config.require_rest_file()
    # By absolute paths: a worker of another machine may run in another folder.
    files = library_files(tuple(source.absolute() for source in as_paths(sources)), config)
    body_paths = _keep(body, out_dir / "body", run)
    config = with_absolute_paths(config)
    shared = {"body_paths": body_paths, "out_dir": out_dir, "config": config, "run": run}
    jobs = [Job(file.id, make_entry, {"file": file} | shared) for file in files]
    outcome = try_batch(READING, jobs, out_dir / FAILED, run, FEW_FILES)
    is_listed = bool(outcome.results) and _list(outcome, body_paths, out_dir, config, run)
    for id in outcome.results:
        for what in ReadingRecord.read(out_dir / CLIPS / id / READING_FILE).remarks:
            remark(f"clip {id}: {what}")
    if outcome.reasons:
        is_there = (out_dir / MANIFEST).is_file()
        others = f"{MANIFEST} is that of before" if is_there else "there is no manifest"
        if is_listed:
            others = f"{MANIFEST} lists the others; mend them and give --redo to list them too"
        raise BadMotionFile(_bad_files(outcome.reasons, len(files), others, out_dir / FAILED))
    return out_dir / MANIFEST


def _list(
    outcome: Outcome, body_paths: Mapping[str, Path], out_dir: Path, config: ReadConfig, run: Run
) -> bool:
    """Write the manifest; False where an earlier one stays, and files have failed since."""
    used = sorted({entry.body for entry in outcome.results.values()})
    licences = dict.fromkeys(load_body_once(body_paths[name]).licence for name in used)
    licence = f"clips as stated by each; body: {'; '.join(licences)}"
    head = motions_head(clip_id(out_dir.name), "Motions on the 24-joint tree.", licence)
    entries = list(outcome.results.values())
    try:
        write_motions(out_dir / MANIFEST, head, entries, config.recorded, run=run)
    except BadManifest:
        if not outcome.reasons:
            raise
        return False
    return True


def make_entry(
    file: LibraryFile, body_paths: Mapping[str, Path], out_dir: Path, config: ReadConfig, run: Run
) -> ClipEntry:
    """Stage: one motion file as a clip in `clips/<id>` of the library; gives its manifest entry."""
    body_path = body_paths[chosen_body(file.path, body_paths)]

    def work(partial_dir: Path) -> None:
        body = load_body_once(body_path)
        read = read_file(file.path, body, config)
        motion = read.motion
        clip = Clip(file.id, motion, read.valid, np.full(motion.n_frames, -1), None)
        save_clip(partial_dir / CLIP_FILE, clip, body.rest_pelvis_m(motion.shape))
        ReadingRecord.of(read).write(partial_dir / READING_FILE)

    inputs = input_files(file.path) | {"body": body_path} | config.inputs
    made_by, clip_dir = config.recorded, out_dir / CLIPS / file.id
    folder = run_stage("motion", clip_dir, made_by, inputs, work, run=run)
    figures = ReadingRecord.read(folder / READING_FILE).residual_deg
    about = ClipAbout(
        camera_motion="none",
        licence=licence_of(file.source),
        source=file.source,
        quality=Quality(figures=figures) if figures else None,
        recipe=stage_recipe(folder),
    )
    return clip_entry(out_dir, ClipFiles(folder / CLIP_FILE), about)


def motions_head(name: str, description: str, licence: str) -> ManifestHead:
    """What a manifest of motions says of all of them."""
    return ManifestHead(name, "1.0.0", description, "motions", licence)


def write_motions(
    path: Path,
    head: ManifestHead,
    clips: Sequence[ClipEntry],
    recipe: Config | Mapping[str, Sequence[int]] | None = None,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Write a manifest of motions; gives its path."""
    return write_manifest(path, head, clips, created_by=made_by(recipe), redo=run.redo)


def _keep(body: str, out_dir: Path, run: Run) -> dict[str, Path]:
    """Files of the kept bodies by name: a single one in the folder itself."""
    if Path(body).expanduser().is_dir():
        return keep_bodies(body, out_dir, run=run)
    path = keep_body(body, out_dir, run=run)
    return {load_body_once(path).name: path}


def _bad_files(
    reasons: Mapping[str, str], n_files: int, others: str, folder: Path | None = None
) -> str:
    listed = [f"  {reason.splitlines()[0]}" for reason in reasons.values()]
    if folder is not None and len(listed) > MAX_LISTED:
        rest = f"  ... and {len(listed) - MAX_LISTED} more, see {folder}"
        listed = [*listed[:MAX_LISTED], rest]
    is_stale = all(AGAIN in reason for reason in reasons.values())
    fate = "were read in another way before" if is_stale else "could not be read"
    count = f"{len(reasons)} of {n_files} files {fate}"
    return "\n".join([f"{'; '.join(filter(None, (count, others)))}:", *listed])
