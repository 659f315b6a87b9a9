"""Motion files of any kind as a table, or as a manifest of training motions."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gmrdata.body.keep import keep_body
from gmrdata.body.load import load_body
from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip, save_clip
from gmrdata.config import Config
from gmrdata.errors import BadMotionFile, MissingInput
from gmrdata.manifest.entry import clip_entry
from gmrdata.manifest.recipe import created_by, stage_recipe
from gmrdata.manifest.write import write_manifest
from gmrdata.motion.motion import Motion
from gmrdata.motion.read import find_motions, input_files, read_motion
from gmrdata.progress import console, track
from gmrdata.sources import file_source, licence_of
from gmrdata.store import run_stage


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
        BadMotionFile: a file named on its own can't be read.
    """
    loaded_body = load_body(body)
    rows = []
    for path in track(_files(sources), "reading motions"):
        motion = read_motion(path, loaded_body, fps_hz=fps_hz, joint_map=joint_map)
        travelled_m = _travelled_m(motion)
        seconds = motion.n_frames / motion.fps_hz
        rows.append(
            (
                path.name,
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
    redo: bool = False,
) -> Path:
    """Write one clip per motion file, and `motions.yaml` that lists them.

    A file that can't be read is left out and said; the others go on.

    Returns:
        Path of the manifest.

    Raises:
        BadMotionFile: not one file could be read.
    """
    out_dir = out_dir.resolve()
    files = _files(sources)
    body_path = keep_body(body, out_dir / "body", redo=redo)
    loaded_body = load_body(str(body_path))
    config = LibraryConfig(fps_hz=fps_hz)
    entries = []
    for path in track(files, "reading motions"):
        try:
            folder = _make_clip(path, loaded_body, body_path, out_dir, config, joint_map, redo)
        except BadMotionFile as error:
            console.print(f"left out: {error}", markup=False, soft_wrap=True)
            continue
        source = file_source(path.stem)
        entries.append(
            clip_entry(
                out_dir,
                clip_path=folder / "clip.npz",
                camera_motion="none",
                licence=licence_of(source),
                source=source,
                recipe=stage_recipe(folder),
            )
        )
    if not entries:
        raise BadMotionFile(f"none of {len(files)} files could be read; see above")
    return write_manifest(
        out_dir / "motions.yaml",
        name=out_dir.name,
        version="1.0.0",
        kind="motions",
        description="Motions on the 24-joint tree.",
        licence=f"clips as stated by each; body: {loaded_body.licence}",
        clips=entries,
        created_by=created_by(config),
        redo=redo,
    )


def _make_clip(
    path: Path,
    body: BodyModel,
    body_path: Path,
    out_dir: Path,
    config: LibraryConfig,
    joint_map: Path | None,
    redo: bool,
) -> Path:
    def work(partial_dir: Path) -> None:
        motion = read_motion(path, body, fps_hz=config.fps_hz, joint_map=joint_map)
        n = motion.n_frames
        clip = Clip(path.stem, motion, np.ones(n, dtype=bool), np.full(n, -1), None)
        save_clip(partial_dir / "clip.npz", clip, body.rest_pelvis_m(motion.shape))

    inputs = input_files(path) | {"body": body_path}
    if joint_map is not None:
        inputs["joint_map"] = joint_map
    return run_stage("motion", out_dir / "clips" / path.stem, config, inputs, work, redo=redo)


def _files(sources: tuple[Path, ...]) -> list[Path]:
    if not sources:
        raise MissingInput("nothing given. Name motion files or folders of them")
    return [
        path
        for source in sources
        for path in (find_motions(source) if source.is_dir() else [source])
    ]


def _travelled_m(motion: Motion) -> float:
    """Length of the pelvis's path on the ground at 10 fps, which leaves out its sway [m]."""
    step = max(1, round(motion.fps_hz / 10))
    ground_m = motion.pelvis_m[::step, :2]
    return float(np.linalg.norm(np.diff(ground_m, axis=0), axis=1).sum())
