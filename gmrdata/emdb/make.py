"""EMDB as manifests of world clips with cameras: all sequences, EMDB 1, and EMDB 2."""

import math
from collections.abc import Mapping
from pathlib import Path

from gmrdata.body.file import read_body
from gmrdata.body.keep import keep_body
from gmrdata.body.load import load_body
from gmrdata.clip import Clip, camera_of, load_clip, save_clip
from gmrdata.config import Config
from gmrdata.emdb.clips import body_of, dropped_reasons, sequence_clip, tilt_deg
from gmrdata.emdb.layout import find_sequences
from gmrdata.emdb.parse import read_emdb
from gmrdata.errors import BadBodyFile, MissingInput
from gmrdata.geometry.motion_class import MotionClass, MotionClassConfig, classify
from gmrdata.manifest.current import Clip as ClipEntry
from gmrdata.manifest.current import Quality, Source
from gmrdata.manifest.entry import clip_entry
from gmrdata.manifest.recipe import created_by, stage_recipe
from gmrdata.manifest.write import write_manifest
from gmrdata.progress import track
from gmrdata.store import read_json, run_stage, write_json

LICENCE = "EMDB's licence (non-commercial research; not to be passed on)"
ABOUT_FILE, CLIP_FILE = "about.json", "clip.npz"
DESCRIPTIONS = {
    "emdb": "All sequences of EMDB in the world, with their moving cameras.",
    "emdb1": "EMDB 1, the sequences on which poses are scored, in the world with their cameras.",
    "emdb2": "EMDB 2, the sequences on which global trajectories are scored, with their cameras.",
}


class EmdbConfig(Config):
    """What decides a sequence's clip."""

    name: str
    """The sequence."""


def make_emdb(root: Path, body: str, out_dir: Path, *, redo: bool = False) -> tuple[Path, ...]:
    """Write one clip per sequence, and `emdb.yaml`, `emdb1.yaml` and `emdb2.yaml`.

    Args:
        root: The folder that holds P0 to P9.
        body: A folder with SMPL's models of the genders that the sequences have, or one model.
        out_dir: Folder to make.
        redo: Make anew what other settings made.

    Returns:
        The manifests that have clips.

    Raises:
        MissingInput: no sequences, or no bodies.
        BadSequence: a file is broken, or laid out otherwise.
        UnsafePickle: a file wants to run something; nothing was run.
        BadBodyFile: a gender's body is missing.
    """
    out_dir = out_dir.resolve()
    sequence_paths = find_sequences(root)
    body_paths = _keep_bodies(body, out_dir, redo)
    entries: dict[str, list[ClipEntry]] = {name: [] for name in DESCRIPTIONS}
    for path in track(sequence_paths, "reading EMDB's sequences"):
        folder = _make_sequence(path, body_paths, out_dir, redo)
        about = read_json(folder / ABOUT_FILE)
        entry = _entry(folder, about, out_dir)
        for name in ("emdb", *(part for part in ("emdb1", "emdb2") if about[part])):
            entries[name].append(entry)
    return tuple(
        write_manifest(
            out_dir / f"{name}.yaml",
            name=name,
            version="1.0.0",
            description=description,
            kind="motions",
            licence=LICENCE,
            clips=entries[name],
            created_by=created_by(),
            redo=redo,
        )
        for name, description in DESCRIPTIONS.items()
        if entries[name]
    )


def _keep_bodies(body: str, out_dir: Path, redo: bool) -> dict[str, Path]:
    """Files of the given bodies by their names, kept beside the clips."""
    given = Path(body)
    specs = (
        [str(path) for path in sorted(given.iterdir()) if path.suffix in (".pkl", ".npz")]
        if given.is_dir()
        else [body]
    )
    if not specs:
        raise MissingInput(f"{given}: holds no SMPL models (.pkl or .npz)")
    kept: dict[str, Path] = {}
    for spec in specs:
        name = load_body(spec).name
        if name in kept:
            raise BadBodyFile(f"{given}: holds two files of the body {name}. Leave one there")
        kept[name] = keep_body(spec, out_dir / "body" / name, redo=redo)
    return kept


def _make_sequence(path: Path, body_paths: Mapping[str, Path], out_dir: Path, redo: bool) -> Path:
    name = path.stem.removesuffix("_data")

    def work(partial_dir: Path) -> None:
        sequence = read_emdb(path)
        body = body_of(sequence, [read_body(kept) for kept in body_paths.values()])
        clip = sequence_clip(name, sequence, body)
        save_clip(partial_dir / CLIP_FILE, clip, body.rest_pelvis_m(clip.motion.shape))
        about = {
            "emdb1": sequence.emdb1,
            "emdb2": sequence.emdb2,
            "reasons": dropped_reasons(sequence),
        }
        write_json(partial_dir / ABOUT_FILE, about)

    inputs = {"sequence": path} | {f"body {key}": kept for key, kept in body_paths.items()}
    return run_stage(
        "emdb", out_dir / "clips" / name, EmdbConfig(name=name), inputs, work, redo=redo
    )


def _entry(folder: Path, about: dict[str, list[str]], out_dir: Path) -> ClipEntry:
    clip = load_clip(folder / CLIP_FILE)
    off_deg = tilt_deg(clip)
    return clip_entry(
        out_dir,
        clip_path=folder / CLIP_FILE,
        camera_motion=_camera_motion(clip),
        licence=LICENCE,
        source=Source(dataset="EMDB", sequence=clip.id.replace("_", "/", 1)),
        dropped_reason=about["reasons"],
        quality=None if math.isnan(off_deg) else Quality(figures={"mean_tilt_deg": off_deg}),
        recipe=stage_recipe(folder),
    )


def _camera_motion(clip: Clip) -> MotionClass:
    if not clip.valid.any():
        return "static"
    path, motion = camera_of(clip), clip.motion
    rows = clip.valid
    return classify(
        path.world_from_cam[rows], motion.pelvis_m[rows], motion.fps_hz, MotionClassConfig()
    )[0]
