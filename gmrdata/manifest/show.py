"""Show a manifest as a table, and the difference of two."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from rich.markup import escape
from rich.table import Table

from gmrdata.manifest.current import ClipEntry, ListedClip, ListManifest, Manifest
from gmrdata.manifest.listing import files_of, folders_of
from gmrdata.manifest.read import read_manifest


def manifest_table(path: Path) -> Table:
    """A table with a row per clip."""
    manifest = read_manifest(path)
    title = f"{manifest.name} {manifest.version} ({manifest.kind}), {len(manifest.clips)} clips"
    table = Table(title=title, caption=escape(_caption(manifest)))
    table.add_column("clip", no_wrap=True)
    for heading in ("source", "camera", "fps", "frames", "kept", "seconds", "licence or note"):
        is_count = heading in ("frames", "kept", "seconds")
        table.add_column(heading, justify="right" if is_count else "left")
    for clip in manifest.clips:
        kept = kept_frames(clip)
        total = clip.n_frames if isinstance(clip, ClipEntry) else kept
        table.add_row(
            clip.id,
            escape(_source(clip)),
            clip.camera_motion,
            f"{clip.fps_hz:g}",
            str(total),
            str(kept),
            f"{kept / clip.fps_hz:.1f}",
            escape(clip.licence if isinstance(clip, ClipEntry) else clip.note or ""),
        )
    return table


def diff_manifests(a: Path, b: Path) -> list[str]:
    """What differs between two manifests, clips matched by id: one line per field, such as
    `clips[walk].fps_hz: 10.0 -> 12.0`; none if the two say the same."""
    old, new = (_by_id(read_manifest(path)) for path in (a, b))
    return _differences(old, new, "")


def kept_frames(clip: ClipEntry | ListedClip) -> int:
    ranges = clip.kept if isinstance(clip, ClipEntry) else (clip.frames,)
    return sum(part.stop - part.start for part in ranges)


def _caption(manifest: Manifest | ListManifest) -> str:
    frames, size_bytes = sum(map(kept_frames, manifest.clips)), 0
    for clip in manifest.clips if isinstance(manifest, Manifest) else ():
        size_bytes += clip.arrays.size_bytes
        size_bytes += sum(file.size_bytes for file in files_of(clip).values())
        size_bytes += sum(folder.size_bytes for folder in folders_of(clip).values())
    size = f", {size_bytes / 1e6:,.1f} MB" if size_bytes else ""
    return f"{frames} frames to use{size}. {manifest.description}"


def _source(clip: ClipEntry | ListedClip) -> str:
    person = f" ({clip.source.person})" if clip.source.person else ""
    return f"{clip.source.dataset}: {clip.source.sequence}{person}"


def _by_id(manifest: Manifest | ListManifest) -> Mapping[str, object]:
    def fields(part: BaseModel, without: str) -> dict[str, object]:
        return part.model_dump(mode="json", exclude_defaults=True, exclude={without})

    clips = {f"[{clip.id}]": fields(clip, "id") for clip in manifest.clips}
    return fields(manifest, "clips") | {"clips": clips}


def _differences(a: Any, b: Any, at: str) -> list[str]:
    if isinstance(a, list) and isinstance(b, list):
        a, b = ({f"[{i}]": item for i, item in enumerate(one)} for one in (a, b))
    if isinstance(a, dict) and isinstance(b, dict):
        lines = []
        for key in [*a, *(key for key in b if key not in a)]:
            name = f"{at}{key}" if key.startswith("[") or not at else f"{at}.{key}"
            if key not in b:
                lines.append(f"{name}: removed" + _value(a[key]))
            elif key not in a:
                lines.append(f"{name}: added" + _value(b[key]))
            else:
                lines += _differences(a[key], b[key], name)
        return lines
    # Both whole: where a text is cut, what differs may be behind.
    return [] if a == b else [f"{at}: {a} -> {b}"]


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return ""
    text = str(value)
    return f" ({text})" if len(text) <= 80 else f" ({text[:77]}...)"
