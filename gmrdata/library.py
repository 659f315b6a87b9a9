"""Motion files of any kind as a table, or as a manifest of training motions."""

import os
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from gmrdata.body.keep import keep_body
from gmrdata.body.load import load_body
from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip, save_clip
from gmrdata.config import Config
from gmrdata.errors import BadMotionFile, GmrdataError
from gmrdata.jobs import Job, Outcome, Workers, record_failures, try_jobs, worker_pool
from gmrdata.library_files import LibraryFile, clip_id, library_files
from gmrdata.manifest.current import Clip as ClipEntry
from gmrdata.manifest.entry import clip_entry
from gmrdata.manifest.recipe import created_by, stage_recipe
from gmrdata.manifest.write import write_manifest
from gmrdata.motion.motion import Motion
from gmrdata.motion.read import input_files, read_motion
from gmrdata.progress import track
from gmrdata.sources import licence_of
from gmrdata.store import run_stage

READING = "reading motions"
FAILED = "failed"
"""Folder below the library's with a text file for each file that could not be read."""
FEW_FILES = 8
"""So many files are read faster than worker processes start."""
MAX_LISTED = 20
"""Bad files that the error message lists."""


class LibraryConfig(Config):
    """How the files are read."""

    fps_hz: float | None
    """True frame rate that a person gave [Hz], or None for the files' own."""


def motion_table(
    sources: tuple[Path, ...],
    body: str,
    *,
    fps_hz: float | None = None,
    joint_map: Path | None = None,
) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    """Read motion files and say what is in them.

    Returns:
        Headings and rows: file, frames, rate, seconds, distance travelled, speed.

    Raises:
        MissingInput: there is no motion file.
        BadMotionFile: a file can't be read.
    """
    loaded_body = load_body(body)
    rows = []
    for file in track(library_files(sources), READING):
        motion = read_motion(file.path, loaded_body, fps_hz=fps_hz, joint_map=joint_map)
        travelled_m = _travelled_m(motion)
        seconds = motion.n_frames / motion.fps_hz
        rows.append(
            (
                file.path.name,
                f"{motion.n_frames}",
                f"{motion.fps_hz:g}",
                f"{seconds:.2f}",
                f"{travelled_m:.2f}",
                f"{travelled_m / seconds:.2f}",
            )
        )
    return ("file", "frames", "rate [Hz]", "length [s]", "path [m]", "speed [m/s]"), rows


def make_library(
    sources: tuple[Path, ...],
    body: str,
    out_dir: Path,
    *,
    fps_hz: float | None = None,
    joint_map: Path | None = None,
    workers: int | None = None,
    redo: bool = False,
) -> Path:
    """Write one clip per motion file, and `motions.yaml` that lists them.

    Each file is a stage of its own, done by one of several worker processes, and is not done again.
    A file that can't be read doesn't keep the others from the manifest.

    Args:
        sources: Motion files, and folders of them.
        body: The body to put them on, as `load_body` takes it.
        out_dir: Folder to make.
        fps_hz: Frame rate to believe instead of the files' [Hz].
        joint_map: A file of joint names, see `read_motion`.
        workers: Worker processes; None for one per CPU.
        redo: Make anew what other settings made.

    Returns:
        Path of the manifest.

    Raises:
        MissingInput: there is no motion file.
        BadRecipe: two files would make clips of one name.
        BadMotionFile: files could not be read; the message lists them, after the manifest of the
            others was written.
    """
    out_dir = out_dir.resolve()
    files = library_files(sources)
    body_path = keep_body(body, out_dir / "body", redo=redo)
    config = LibraryConfig(fps_hz=fps_hz)
    shared = {
        "body_path": body_path,
        "out_dir": out_dir,
        "config": config,
        "joint_map": joint_map,
        "redo": redo,
    }
    jobs = [Job(file.id, make_entry, {"file": file} | shared) for file in files]
    outcome = _run(jobs, out_dir / FAILED, workers or os.cpu_count() or 1)
    manifest_path = out_dir / "motions.yaml"
    if outcome.results:
        write_manifest(
            manifest_path,
            name=clip_id(out_dir.name),
            version="1.0.0",
            description="Motions on the 24-joint tree.",
            kind="motions",
            licence=f"clips as stated by each; body: {_body(body_path).licence}",
            clips=list(outcome.results.values()),
            created_by=created_by(config),
            redo=redo,
        )
    if outcome.reasons:
        raise BadMotionFile(_bad_files(outcome.reasons, len(files), out_dir))
    return manifest_path


def make_entry(
    file: LibraryFile,
    body_path: Path,
    out_dir: Path,
    config: LibraryConfig,
    joint_map: Path | None,
    redo: bool,
) -> ClipEntry:
    """Stage: the clip of one motion file.

    Args:
        file: The file.
        body_path: The body, kept beside the clips.
        out_dir: The library's folder; the clip goes to `clips/<id>`.
        config: How to read it.
        joint_map: A file of joint names.
        redo: Replace a clip that other settings made.

    Returns:
        Its manifest entry.
    """

    def work(partial_dir: Path) -> None:
        body = _body(body_path)
        motion = read_motion(file.path, body, fps_hz=config.fps_hz, joint_map=joint_map)
        n = motion.n_frames
        clip = Clip(file.id, motion, np.ones(n, dtype=bool), np.full(n, -1), None)
        save_clip(partial_dir / "clip.npz", clip, body.rest_pelvis_m(motion.shape))

    inputs = input_files(file.path) | {"body": body_path}
    if joint_map is not None:
        inputs["joint_map"] = joint_map
    folder = run_stage("motion", out_dir / "clips" / file.id, config, inputs, work, redo=redo)
    return clip_entry(
        out_dir,
        clip_path=folder / "clip.npz",
        camera_motion="none",
        licence=licence_of(file.source),
        source=file.source,
        recipe=stage_recipe(folder),
    )


@lru_cache(maxsize=1)
def _body(path: Path) -> BodyModel:
    """The body, read once per process and not once per file."""
    return load_body(str(path))


def _run(jobs: Sequence[Job], failures_dir: Path, workers: int) -> Outcome:
    """Make clips in worker processes, or a few of them right here.

    Raises:
        OSError: a clip could not be written, right here.
    """
    if len(jobs) > FEW_FILES and workers > 1:
        with worker_pool(Workers(workers)) as client:
            return try_jobs(READING, jobs, client, failures_dir)
    outcome = Outcome({}, {})
    for job in track(jobs, READING):
        try:
            outcome.results[job.id] = job.call(**job.arguments)
        except GmrdataError as error:
            outcome.reasons[job.id] = str(error)
    record_failures(failures_dir, outcome.reasons, outcome.results)
    return outcome


def _bad_files(reasons: Mapping[str, str], n_files: int, out_dir: Path) -> str:
    """Which files could not be read, and why."""
    listed = [f"  {reason.splitlines()[0]}" for reason in reasons.values()]
    if len(listed) > MAX_LISTED:
        rest = f"  ... and {len(listed) - MAX_LISTED} more, see {out_dir / FAILED}"
        listed = [*listed[:MAX_LISTED], rest]
    others = (
        "motions.yaml lists the others; mend them and give --redo to list them too"
        if len(reasons) < n_files
        else "there is no manifest"
    )
    return f"{len(reasons)} of {n_files} files could not be read; {others}:\n" + "\n".join(listed)


def _travelled_m(motion: Motion) -> float:
    """Length of the pelvis's path on the ground at 10 fps, which leaves out its sway [m]."""
    step = max(1, round(motion.fps_hz / 10))
    ground_m = motion.pelvis_m[::step, :2]
    return float(np.linalg.norm(np.diff(ground_m, axis=0), axis=1).sum())
