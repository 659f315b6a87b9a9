"""The text of a manifest: plain YAML, of a size that a manifest has."""

from pathlib import Path
from typing import Any

from gmrdata.values import limits, plain_yaml
from gmrdata.values.errors import BadManifest, MissingInput
from gmrdata.values.plain_yaml import NotPlain

FieldPath = plain_yaml.FieldPath


def load(path: Path) -> tuple[Any, dict[FieldPath, int]]:
    """Read YAML of plain data, and the line of each field, as `plain_yaml.parse` gives them."""
    require_size(path, limits.MOST_MANIFEST_BYTES)
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
        return plain_yaml.parse(content.decode("utf-8"))
    except UnicodeDecodeError as error:
        where = f"{error.reason} at byte {error.start}"
        raise BadManifest(f"{path}: not UTF-8 text ({where})") from None
    except NotPlain as error:
        where = str(path) if error.line is None else f"{path}:{error.line}"
        raise BadManifest(f"{where}: {error.problem}") from None
