"""The text of a manifest: plain YAML, of a size that a manifest has.

A long manifest has a line of JSON for each clip, which is YAML too, and is read many times as fast:
libraries for YAML need about a millisecond and 20 kB for each clip.  A manifest of 100,000 clips
takes minutes then, and more memory than a laptop has.
"""

import json
import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from gmrdata.values import limits, plain_yaml
from gmrdata.values.errors import BadManifest, MissingInput
from gmrdata.values.files import taken_for
from gmrdata.values.plain_yaml import NotPlain

FieldPath = plain_yaml.FieldPath
LINES_FROM = 1000  # clips; shorter manifests are for people to read
MAX_BYTES = 1 << 30
CLIPS_KEY, BEGIN = b"clips:\n", b'- {"'

PlainData = dict[str, Any]  # by key, as JSON has it

_NOT_IN_YAML = re.compile("[\x7f-\x9f\u2028\u2029\ufeff\ufffe\uffff]")
"""Characters that JSON has in texts as they are, and YAML reads as ends of lines or not at all."""
_TEXT_OR_DOTLESS = re.compile(r'("(?:[^"\\]|\\.)*")|((?<![\d.])\d+e[-+]\d+)')


def load(path: Path) -> tuple[Any, dict[FieldPath, int]]:
    """Read YAML of plain data, and the line of each field, as `plain_yaml.parse` gives them."""
    require_size(path, limits.MOST_MANIFEST_BYTES)
    return parse(path, path.read_bytes())


def require_size(path: Path, max_bytes: int) -> None:
    """MissingInput where there is no file, BadManifest where it is larger."""
    if not path.is_file():
        if path.is_dir():
            raise BadManifest(f"{path}: not a manifest; it is a folder. Name the .yaml file in it")
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
        raise BadManifest(
            f"{path}: not a manifest: not UTF-8 text ({where}){taken_for(path)}"
        ) from None
    except NotPlain as error:
        where = str(path) if error.line is None else f"{path}:{error.line}"
        raise BadManifest(f"{where}: {error.problem}") from None


def dump_lines(head: PlainData, clips: Iterable[PlainData]) -> str:
    """The text of a manifest; `head` is all but its clips."""
    lines = [f"- {_line(clip)}\n" for clip in clips]
    return "".join([plain_yaml.dump(head), CLIPS_KEY.decode(), *lines])


def _line(clip: PlainData) -> str:
    text = json.dumps(clip, ensure_ascii=False, allow_nan=False)
    # A number like 1e-05 with a dot: YAML takes it for a text else.
    text = _TEXT_OR_DOTLESS.sub(lambda m: (m[1] or "") + (m[2] or "").replace("e", ".0e"), text)
    return _NOT_IN_YAML.sub(lambda match: f"\\u{ord(match[0]):04x}", text)


class ClipLines(Sequence[Any]):
    """The clips of a long manifest, each read when it is asked for."""

    def __init__(self, path: Path, texts: list[bytes], first_line: int) -> None:
        self.path, self.texts, self.first_line = path, texts, first_line

    def __len__(self) -> int:
        return len(self.texts)

    @property
    def lines(self) -> range:
        """Of the file, from 1, in the order of the clips."""
        return range(self.first_line, self.first_line + len(self))

    def __getitem__(self, at: Any) -> Any:
        """BadManifest where it is no JSON, or a key stands twice in it."""
        try:
            return json.loads(
                self.texts[at], object_pairs_hook=_once, parse_float=_finite, parse_constant=_refuse
            )
        except (ValueError, RecursionError) as error:
            where = f"{self.path}:{self.first_line + at}"
            raise BadManifest(f"{where}: not a line of plain JSON: {error}") from None


def load_lines(path: Path) -> tuple[PlainData, dict[FieldPath, int], ClipLines] | None:
    """Head, the line of each of its fields, and the clips; None where clips are not in lines.

    BadManifest where a line is no clip's.
    """
    with path.open("rb") as stream:
        start = stream.read(limits.MOST_MANIFEST_BYTES)  # the head holds a recipe of any length
        at = start.find(b"\n" + CLIPS_KEY + BEGIN) + 1
        if not at:
            return None
        require_size(path, MAX_BYTES)
        stream.seek(at + len(CLIPS_KEY))
        texts = stream.read().removesuffix(b"\n").split(b"\n")
    head, lines = parse(path, start[:at])
    if ("clips",) in lines:
        raise BadManifest(f"{path}:{lines['clips',]}: key 'clips' stands twice; remove one")
    clips = ClipLines(path, [text[2:] for text in texts], start[:at].count(b"\n") + 2)
    for number, text in enumerate(texts):
        if not text.startswith(BEGIN):
            raise BadManifest(
                f"{path}:{clips.first_line + number}: a clip must be one line, as on the lines "
                "before; write the manifest again"
            )
    return head, lines, clips


def as_json(head_json: str, clips: ClipLines) -> bytes:
    """The whole manifest as JSON; BadManifest as `ClipLines` has it."""
    for number in range(len(clips)):
        clips[number]
    return b"".join([head_json.encode()[:-1], b', "clips": [', b",".join(clips.texts), b"]}"])


def _once(pairs: list[tuple[str, Any]]) -> PlainData:
    mapping = dict(pairs)
    if len(mapping) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"key {twice!r} stands twice; remove one")
    return mapping


def _finite(text: str) -> float:
    number = float(text)
    if math.isinf(number):  # 1e999
        _refuse(text)
    return number


def _refuse(text: str) -> None:
    raise ValueError(f"holds {text}; leave out what is not known")
