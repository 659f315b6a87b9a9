"""Write manifests and their entries: same content, same bytes; a version that is out stays."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from gmrdata import __version__
from gmrdata.manifest import current, yaml_text
from gmrdata.manifest.current import (
    FORMAT,
    ClipEntry,
    CreatedBy,
    DroppedRange,
    Extra,
    FrameRange,
    ListedClip,
    ListManifest,
    Manifest,
)
from gmrdata.manifest.listing import FILES, FOLDERS, file_record, folder_record
from gmrdata.manifest.read import ADAPTER, read_manifest
from gmrdata.stage.progress import remark
from gmrdata.stage.store import StageRecord, package_versions
from gmrdata.values import plain_yaml
from gmrdata.values.clip import load_clip, text_runs
from gmrdata.values.errors import BadManifest
from gmrdata.values.files import write_text
from gmrdata.values.records import Config

BODIES = ("body", "bodies")
"""Keys of recipes that hold names of bodies, or their files."""


def made_by(
    recipe: Config | Mapping[str, Any] | None = None, seeds: Mapping[str, int] | None = None
) -> current.CreatedBy:
    """The record for a manifest's head: the recipe without its maker's paths, and seeds by use.

    How many workers there were decides nothing, so a model's `workers` are no part of it.
    """
    if isinstance(recipe, Config):  # not as JSON, in which a path is a text like any other
        recipe = recipe.model_dump(exclude={"workers"})
    return current.CreatedBy(
        gmrdata=__version__,
        recipe=without_machine_paths(recipe or {}),
        seeds=dict(sorted((seeds or {}).items())),
        packages=package_versions(),
    )


def stage_recipe(stage_dir: Path) -> current.Recipe:
    """The record of the stage that made a finished folder."""
    record = StageRecord.of(stage_dir)
    config = without_machine_paths(record.config)
    return current.Recipe(
        stage=record.stage,
        config=config,
        inputs=record.inputs,
        sha256=recipe_sha256(record.stage, config, record.inputs),
    )


def recipe_sha256(stage: str, config: Mapping[str, Any], inputs: Mapping[str, str]) -> str:
    """Hex SHA-256 of a stage's recipe, as JSON with sorted keys and no spaces."""
    value = {"stage": stage, "config": config, "inputs": inputs}
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def without_machine_paths(value: Any, *, of_body: bool = False) -> Any:
    """Plain data with every path cut to its last part: a `Path`, a text that begins as an absolute
    one, and the file of a body, however it is written."""
    if isinstance(value, Mapping):
        return {str(k): without_machine_paths(v, of_body=k in BODIES) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [without_machine_paths(item, of_body=of_body) for item in value]
    if isinstance(value, Path) or (isinstance(value, str) and (of_body or value.startswith("/"))):
        return Path(value).name
    return value


@dataclass(frozen=True)
class ClipFiles:
    """Files and folders of a clip that a stage left, by the manifest's fields."""

    clip: Path
    images: Path | None = None
    """The other folders have a file for each image in it."""
    masks: Path | None = None
    depth: Path | None = None
    normals: Path | None = None
    flow: Path | None = None
    instances: Path | None = None
    joints: Path | None = None
    video: Path | None = None
    character: Path | None = None
    extras: Sequence[Path] = ()
    """The extras' files, in the order of their instance numbers from 2 on."""


@dataclass(frozen=True)
class ClipAbout:
    """What a manifest says of a clip beside its files."""

    camera_motion: current.CameraMotion
    licence: str
    source: current.Source
    dropped_reason: str | Sequence[str] = "not valid in the clip's file"
    """Why rows are not valid: one reason, or T reasons; a row with a reason of its own is dropped,
    valid in the file or not."""
    quality: current.Quality | None = None
    recipe: current.Recipe | None = None
    id: str | None = None
    """The clip's id if one is expected; the file must agree."""


def clip_entry(root: Path, files: ClipFiles, about: ClipAbout) -> current.ClipEntry:
    """Make a clip's manifest entry from the files that a stage left; hashes them all.

    The kept ranges are the rows where the clip's `valid` is True and no reason speaks against
    them.  The listing of a folder `a/frames` goes to `root/listings/a/frames.tsv`, outside the
    stage's finished folder.  `root` is the manifest's folder.
    """
    clip = load_clip(files.clip)
    if about.id not in (None, clip.id):
        raise BadManifest(f"{files.clip}: holds clip {clip.id}, not {about.id}")
    ranges = list(text_runs(_reasons(files.clip, about.dropped_reason, clip.valid)))
    try:
        entry = current.ClipEntry(
            id=clip.id,
            source=about.source,
            licence=about.licence,
            body=clip.motion.body,
            fps_hz=clip.motion.fps_hz,
            n_frames=clip.motion.n_frames,
            frame=clip.motion.frame,
            translation_of="smpl_transl",
            camera_motion=about.camera_motion,
            kept=tuple(FrameRange(start=a, stop=b) for a, b, why in ranges if not why),
            dropped=tuple(DroppedRange(start=a, stop=b, reason=why) for a, b, why in ranges if why),
            arrays=file_record(root, files.clip),
            quality=about.quality,
            recipe=about.recipe,
        )
    except ValidationError as error:
        raise BadManifest(f"{files.clip}: clip {clip.id} can't be listed: {error}") from None
    return entry.model_copy(update=_records(root, files))


def _records(root: Path, files: ClipFiles) -> dict[str, Any]:
    """The records of folders and files, by the manifest's fields."""
    folders = ((key, getattr(files, key), folder_record) for key in FOLDERS)
    single = ((key, getattr(files, key), file_record) for key in FILES)
    records = {key: path and record(root, path) for key, path, record in (*folders, *single)}
    extras = enumerate((file_record(root, path) for path in files.extras), 2)
    return records | {"extras": tuple(Extra(instance=i, arrays=file) for i, file in extras)}


def _reasons(clip_path: Path, reason: str | Sequence[str], valid: np.ndarray) -> list[str]:
    """(T,) why each row is dropped; empty for rows that are kept."""
    if isinstance(reason, str):
        return ["" if row_valid else reason for row_valid in valid]
    if len(reason) != len(valid):
        raise BadManifest(f"{clip_path}: {len(reason)} reasons for {len(valid)} frames")
    if any(not why and not row_valid for why, row_valid in zip(reason, valid, strict=True)):
        raise BadManifest(f"{clip_path}: a row that is not valid has no reason")
    return list(reason)


@dataclass(frozen=True)
class ManifestHead:
    """What a manifest says of all of its clips."""

    name: str
    version: str
    description: str
    kind: str
    """"synthetic", "pseudo_gt", "motions", or "list" for clips without files."""
    licence: str


def write_manifest(
    path: Path,
    head: ManifestHead,
    clips: Sequence[ClipEntry] | Sequence[ListedClip],
    created_by: CreatedBy | None = None,
    *,
    redo: bool = False,
    incomplete: bool = False,
) -> Path:
    """Write a manifest as a whole or not at all; a file that says the same is left alone.

    Args:
        path: The files of the clips lie below its folder.
        clips: Written in order of id; or, for a list, in the order given.
        created_by: Versions alone where left out.
        redo: Replace a manifest of the same name and version but other content.
        incomplete: Whether some clips failed.  The version says so then, and where one with all
            clips is there, that stays.
    """
    dot = "." if "-" in head.version else "-"
    version = f"{head.version}{dot}incomplete" if incomplete else head.version
    data = vars(head) | {
        "format": FORMAT,
        "version": version,
        "created_by": created_by or made_by(),
        "clips": clips if head.kind == "list" else sorted(clips, key=lambda clip: clip.id),
    }
    try:
        manifest = ADAPTER.validate_python(data)
    except ValidationError as error:
        raise BadManifest(f"{path}: can't be written: {error}") from None
    text = manifest_text(manifest)
    if path.exists() and path.read_bytes() == text.encode():
        return path
    if not redo and _is_out(path, head):
        there = f"{path}: {head.name} {head.version} is there"
        if not incomplete:
            remedy = "raise the version, or pass --redo if nobody has it yet"
            raise BadManifest(f"{there} with other content, and a version never changes; {remedy}")
        remark(f"{there} with all its clips, and stays. --redo replaces it")
        return path
    write_text(path, text)
    return path


def manifest_text(manifest: Manifest | ListManifest) -> str:
    """YAML of a manifest: keys in the models' order, fields without a value left out.

    A long one has a line of JSON for each clip.
    """
    if len(manifest.clips) < yaml_text.LINES_FROM:
        return plain_yaml.dump(manifest.model_dump(mode="json", exclude_defaults=True))
    head = manifest.model_dump(mode="json", exclude_defaults=True, exclude={"clips"})
    clips = (clip.model_dump(mode="json", exclude_defaults=True) for clip in manifest.clips)
    return yaml_text.dump_lines(head, clips)


def _is_out(path: Path, head: ManifestHead) -> bool:
    """Whether this version is there already; BadManifest where something else is."""
    if not path.exists():
        return False
    try:
        old = read_manifest(path)
    except BadManifest:
        remedy = "pass --redo to replace it, or another --out"
        raise BadManifest(f"{path}: holds something that is no manifest; {remedy}") from None
    return (old.name, old.version) == (head.name, head.version)
