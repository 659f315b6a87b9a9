"""YAML as manifests use it: plain data, one meaning, and the line of every field."""

from pathlib import Path
from typing import Any

import yaml

from gmrdata.values.errors import BadManifest, MissingInput

MAX_BYTES = 64 << 20
MAX_DEPTH = 32
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)

FieldPath = tuple[str | int, ...]


def dump(value: Any) -> str:
    """YAML text of plain data, keys in the order given, so that equal values give equal bytes."""
    return str(yaml.dump(value, Dumper=_DUMPER, sort_keys=False, allow_unicode=True, width=100))


def load(path: Path) -> tuple[Any, dict[FieldPath, int]]:
    """Read YAML of plain data; and the line (from 1) of each field, like `("clips", 3, "fps_hz")`.

    Aliases, repeated keys, tags that build objects, deep nesting and files above 64 MiB are
    refused.
    """
    require_size(path, MAX_BYTES)
    return parse(path, path.read_bytes())


def require_size(path: Path, max_bytes: int) -> None:
    """MissingInput where there is no file, BadManifest where it is larger."""
    if not path.is_file():
        raise MissingInput(f"{path}: no such manifest")
    size_bytes = path.stat().st_size
    if size_bytes > max_bytes:
        raise BadManifest(
            f"{path}: {size_bytes} bytes, more than a manifest's {max_bytes}; split the data set"
        )


def parse(path: Path, content: bytes) -> tuple[Any, dict[FieldPath, int]]:
    """The same of a file's content."""
    try:
        text = content.decode("utf-8")
        _refuse_aliases_and_depth(path, text)
        loader = _LOADER(text)
        try:
            node = loader.get_single_node()
            lines: dict[FieldPath, int] = {}
            if node is not None:
                _record_lines(path, node, (), lines)
            return (None if node is None else loader.construct_document(node)), lines
        finally:
            loader.dispose()
    except UnicodeDecodeError as error:
        raise BadManifest(
            f"{path}: not UTF-8 text ({error.reason} at byte {error.start})"
        ) from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"{path}:{mark.line + 1}" if mark else str(path)
        raise BadManifest(f"{where}: not plain YAML: {error.problem}") from None
    except (yaml.YAMLError, ValueError) as error:
        raise BadManifest(f"{path}: not plain YAML: {error}") from None


def _refuse_aliases_and_depth(path: Path, text: str) -> None:
    """Look at the events before anything is built: an alias can stand for millions of nodes."""
    depth = 0
    for event in yaml.parse(text, Loader=_LOADER):
        line = event.start_mark.line + 1 if event.start_mark else 0
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise BadManifest(
                f"{path}:{line}: YAML anchors and aliases are not allowed; write it out"
            )
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > MAX_DEPTH:
            raise BadManifest(f"{path}:{line}: nested more than {MAX_DEPTH} levels deep")


def _record_lines(path: Path, node: yaml.Node, at: FieldPath, lines: dict[FieldPath, int]) -> None:
    lines.setdefault(at, node.start_mark.line + 1)
    if isinstance(node, yaml.SequenceNode):
        for i, item in enumerate(node.value):
            _record_lines(path, item, (*at, i), lines)
    elif isinstance(node, yaml.MappingNode):
        seen = set()
        for key, value in node.value:
            line = key.start_mark.line + 1
            if not isinstance(key, yaml.ScalarNode) or key.tag == "tag:yaml.org,2002:merge":
                raise BadManifest(f"{path}:{line}: a key must be plain text")
            if key.value in seen:
                raise BadManifest(f"{path}:{line}: key {key.value!r} stands twice; remove one")
            seen.add(key.value)
            lines[(*at, key.value)] = line
            _record_lines(path, value, (*at, key.value), lines)
