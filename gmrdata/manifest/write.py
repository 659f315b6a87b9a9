"""Write manifests: same content, same bytes; a version that is out stays as it is."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from gmrdata.manifest import clip_lines
from gmrdata.manifest.current import FORMAT, Clip, CreatedBy, ListedClip, ListManifest, Manifest
from gmrdata.manifest.entry import created_by as made_now
from gmrdata.manifest.read import ADAPTER, read_manifest
from gmrdata.values import plain_yaml
from gmrdata.values.errors import BadManifest
from gmrdata.values.files import write_text


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
    clips: Sequence[Clip] | Sequence[ListedClip],
    created_by: CreatedBy | None = None,
    *,
    redo: bool = False,
) -> Path:
    """Write a manifest as a whole or not at all; a file that says the same is left alone.

    Args:
        path: The files of the clips lie below its folder.
        clips: Written in order of id; or, for a list, in the order given.
        created_by: Versions alone where left out.
        redo: Replace a manifest of the same name and version but other content.
    """
    data = vars(head) | {
        "format": FORMAT,
        "created_by": created_by or made_now(),
        "clips": clips if head.kind == "list" else sorted(clips, key=lambda clip: clip.id),
    }
    try:
        manifest = ADAPTER.validate_python(data)
    except ValidationError as error:
        raise BadManifest(f"{path}: can't be written: {error}") from None
    text = manifest_text(manifest)
    if path.exists():
        if path.read_bytes() == text.encode():
            return path
        if not redo:
            _refuse_to_change_a_version(path, manifest)
    write_text(path, text)
    return path


def manifest_text(manifest: Manifest | ListManifest) -> str:
    """YAML of a manifest: keys in the models' order, fields without a value left out.

    A long one has a line of JSON for each clip.
    """
    if len(manifest.clips) < clip_lines.LINES_FROM:
        return plain_yaml.dump(manifest.model_dump(mode="json", exclude_defaults=True))
    head = manifest.model_dump(mode="json", exclude_defaults=True, exclude={"clips"})
    clips = (clip.model_dump(mode="json", exclude_defaults=True) for clip in manifest.clips)
    return clip_lines.dump(head, clips)


def _refuse_to_change_a_version(path: Path, manifest: Manifest | ListManifest) -> None:
    try:
        old = read_manifest(path)
    except BadManifest:
        remedy = "pass --redo to replace it, or another --out"
        raise BadManifest(f"{path}: holds something that is no manifest; {remedy}") from None
    if (old.name, old.version) == (manifest.name, manifest.version):
        raise BadManifest(
            f"{path}: {old.name} {old.version} is there with other content, and a version "
            "never changes; raise the version, or pass --redo if nobody has it yet"
        )
