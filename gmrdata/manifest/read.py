"""Read a manifest, and the clips that it lists.

`python -m gmrdata.manifest.read` writes the JSON Schema of the format, which is generated from the
models, to manifests/schema/v1.json of a checkout; a test compares the two.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from gmrdata import __version__
from gmrdata.manifest import yaml_text
from gmrdata.manifest.current import (
    READS,
    AnyManifest,
    ClipEntry,
    FrameRange,
    ListedClip,
    ListManifest,
    Manifest,
)
from gmrdata.stage.progress import console
from gmrdata.stage.recipes import published_manifest, schema_v1
from gmrdata.values.clip import Clip, load_clip
from gmrdata.values.errors import BadManifest
from gmrdata.values.files import resolve_inside, taken_for, write_json

ADAPTER: TypeAdapter[Manifest | ListManifest] = TypeAdapter(AnyManifest)
KINDS = ("synthetic", "pseudo_gt", "motions", "list")
MAX_PROBLEMS = 50


def read_manifest(path: str | Path) -> Manifest | ListManifest:
    """Read a manifest, not its files; a BadManifest names each wrong field with line and path."""
    path = Path(path)
    yaml_text.require_size(path, yaml_text.MAX_BYTES)
    in_lines = yaml_text.load_lines(path)
    data, lines = yaml_text.load(path) if in_lines is None else in_lines[:2]
    _refuse_others(path, data)
    text: str | bytes = _as_json(path, data)
    if in_lines is not None:
        text = yaml_text.as_json(str(text), in_lines[2])
    try:
        # Only from JSON does pydantic's strict mode take lists for tuples; "12" never passes as 12.
        return ADAPTER.validate_json(text, strict=True)
    except ValidationError as error:
        if in_lines is not None:
            data["clips"] = in_lines[2]
            lines["clips",] = in_lines[2].first_line - 1
            lines |= {("clips", number): line for number, line in enumerate(in_lines[2].lines)}
        problems = [
            f"{path}:{_line(problem['loc'], lines)}: {_field(problem['loc'], data)}: "
            f"{problem['msg'].removeprefix('Value error, ')}"
            for problem in error.errors()
        ]
        raise BadManifest(join_problems(path, problems)) from None


def published_list(name: str) -> tuple[ListedClip, ...]:
    """The rows of a list that gmrdata publishes, e.g. "paper_table8"; MissingInput if none."""
    published = read_manifest(published_manifest(name))
    assert isinstance(published, ListManifest)  # as all are
    return published.clips


def load_clips(path: str | Path) -> list[Clip]:
    """Load every clip of a manifest; `valid` is False outside the manifest's kept ranges.

    Hashes are not checked here, `gmrdata manifest check` does that.  BadManifest also where a
    clip's file is not what the manifest says (`disagreements`), or the manifest is a list without
    files.
    """
    path = Path(path)
    return [load_entry(path, entry) for entry in read_data_set(path).clips]


def read_data_set(path: Path) -> Manifest:
    """Read a manifest whose clips have files; BadManifest also for a list of clips alone."""
    manifest = read_manifest(path)
    if isinstance(manifest, ListManifest):
        what = f"{manifest.name} only lists clips and has no files"
        raise BadManifest(f"{path}: {what}; make them first")
    return manifest


def load_entry(path: Path, entry: ClipEntry) -> Clip:
    """Load one clip of the manifest at `path`; see `load_clips`."""
    clip = load_clip(listed_path(path, entry, "arrays.path", entry.arrays.path))
    if problems := list(disagreements(entry, clip)):
        said = [f"{path}: clip {entry.id}: {problem}" for problem in problems]
        raise BadManifest(join_problems(path, said))
    return replace(clip, valid=clip.valid & rows_in(entry.kept, entry.n_frames))


def listed_path(path: Path, entry: ClipEntry, field: str, relative: str) -> Path:
    """Where a file or folder lies that a field of an entry of the manifest at `path` names;
    BadManifest where a link leads out of the manifest's folder."""
    try:
        return resolve_inside(path.parent, relative)
    except ValueError as error:
        raise BadManifest(f"{path}: clip {entry.id}: {field}: {error}") from None


def disagreements(entry: ClipEntry, clip: Clip) -> Iterator[str]:
    """What a manifest says of a motion and its file says otherwise, one line each, field first."""
    for field in ("id", "n_frames", "fps_hz", "body", "frame"):
        said, held = getattr(entry, field), getattr(clip if field == "id" else clip.motion, field)
        if said != held:
            yield f"{field}: is {said}, but the file has {held}; write the manifest again"


def rows_in(ranges: tuple[FrameRange, ...], n_frames: int) -> np.ndarray:
    """(T,) bool: True for rows inside any of the ranges."""
    inside = np.zeros(n_frames, dtype=bool)
    for part in ranges:
        inside[part.start : part.stop] = True
    return inside


def join_problems(path: Path, problems: list[str]) -> str:
    """One message out of many; the first 50 are spelled out."""
    if len(problems) == 1:
        return problems[0]
    shown = [f"  {problem}" for problem in problems[:MAX_PROBLEMS]]
    if len(problems) > MAX_PROBLEMS:
        shown.append(f"  ... and {len(problems) - MAX_PROBLEMS} more")
    return f"{path}: {len(problems)} problems\n" + "\n".join(shown)


def _refuse_others(path: Path, data: Any) -> None:
    reads = f"gmrdata {__version__} reads {' and '.join(READS)}"
    if not isinstance(data, dict) or "format" not in data:
        what = f"not a manifest, it has no top key 'format'{taken_for(path)}"
        raise BadManifest(f"{path}: {what}. {reads}")
    if data["format"] not in READS:
        remedy = "install the gmrdata that wrote it, or correct the key"
        raise BadManifest(f"{path}: format is {data['format']!r}, but {reads}; {remedy}")
    if (kind := data.get("kind")) not in KINDS:
        what = f"kind is {kind!r}" if "kind" in data else "has no top key 'kind'"
        raise BadManifest(f"{path}: {what}; write what it lists: {', '.join(KINDS)}")


def _as_json(path: Path, data: Any) -> str:
    try:
        return json.dumps(data, allow_nan=False)
    except ValueError:
        raise BadManifest(
            f"{path}: holds .nan, .inf or an endless number; leave out what is not known"
        ) from None


def _plain(location: tuple[str | int, ...]) -> tuple[str | int, ...]:
    """A field's path without the union tag that pydantic puts in front."""
    return location[1:] if location[:1] and location[0] in KINDS else location


def _line(location: tuple[str | int, ...], lines: dict[yaml_text.FieldPath, int]) -> int:
    at = _plain(location)
    while at not in lines:
        at = at[:-1]
    return lines[at]


def _field(location: tuple[str | int, ...], data: Any) -> str:
    """The field's path for a reader, with the clip's id in place of its index where it has one."""
    text = ""
    for part in _plain(location):
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
        if isinstance(part, int) and text == f"clips[{part}]":
            clip = data["clips"][part]
            text += f" (clip {clip['id']})" if isinstance(clip, dict) and "id" in clip else ""
    return text or "manifest"


def json_schema() -> Mapping[str, Any]:
    """JSON Schema (draft 2020-12) of `format: gmrdata/1`.

    It can't say everything: that kept and dropped ranges tile a clip, that ids are unique and that
    paths stay inside are checked by `gmrdata manifest check` alone.
    """
    return ADAPTER.json_schema() | {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "gmrdata manifest, format gmrdata/1",
    }


if __name__ == "__main__":
    write_json(schema_v1().resolve(), json_schema())
    console.print(f"wrote {schema_v1().resolve()}")
