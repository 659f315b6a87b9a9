"""YAML as gmrdata's files use it: mappings of texts, lists, texts, numbers, true, false, null.

What YAML has besides is text or refused: dates, numbers in base 60, 8 or 16, yes and no, merges,
anchors and aliases (which can stand for millions of nodes), binary data, sets, tags of Python's.
Numbers are YAML 1.2's, so that `02_03` is a name and `1e-3` a number.
"""

import re
from typing import Any

import yaml

from gmrdata.values import limits

_BASE = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
FieldPath = tuple[str | int, ...]
_TAG = "tag:yaml.org,2002:"
_WHOLE = re.compile(r"[-+]?(0|[1-9][0-9]*)")
_REAL = re.compile(
    r"[-+]?([0-9]+\.[0-9]*([eE][-+]?[0-9]+)?|\.[0-9]+([eE][-+]?[0-9]+)?|[0-9]+[eE][-+]?[0-9]+"
    r"|\.(inf|Inf|INF))|\.(nan|NaN|NAN)"
)
_TRUTH = {word: word[0] in "tT" for word in ["true", "True", "TRUE", "false", "False", "FALSE"]}
_TOO_DEEP = f"nested more than {limits.DEEPEST_YAML} levels deep"
_NOTHING = ("", "~", "null", "Null", "NULL")


class NotPlain(ValueError):
    """A text is no YAML, or more than plain data; `line` counts from 1, None if it is unknown."""

    def __init__(self, line: int | None, problem: str) -> None:
        super().__init__(problem if line is None else f"line {line}: {problem}")
        self.line, self.problem = line, problem


def parse(text: str) -> tuple[Any, dict[FieldPath, int]]:
    """The one value of a text; and the line (from 1) of each field, like `("clips", 3, "fps_hz")`.

    NotPlain where it is anything else, has a key twice, or is nested too deeply.
    """
    try:
        _refuse_aliases_and_depth(text)
        loader = _Loader(text)
        try:
            node = loader.get_single_node()
            lines: dict[FieldPath, int] = {}
            if node is not None:
                _record_lines(node, (), lines)
            return (None if node is None else loader.construct_document(node)), lines
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else None
        if "nesting depth" in str(error.problem):  # PyYAML looks ahead, and has a limit of its own
            raise NotPlain(line, _TOO_DEEP) from None
        raise NotPlain(line, f"not plain YAML: {error.problem}") from None
    except yaml.YAMLError as error:
        raise NotPlain(None, f"not plain YAML: {error}") from None


def dump(value: Any) -> str:
    """YAML of plain data that `parse` reads back: keys in the order given, the same bytes again."""
    return str(yaml.dump(value, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100))


class _Loader(_BASE):  # type: ignore[misc,valid-type]
    """PyYAML's, which resolves less."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012
    yaml_constructors: dict[str | None, Any] = {}  # noqa: RUF012


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    """PyYAML's, which quotes what is no text in YAML 1.1; this one what is none here too."""


def _scalar(loader: Any, node: yaml.Node) -> str:
    if not isinstance(node, yaml.ScalarNode):
        raise yaml.constructor.ConstructorError(
            None, None, "a list or mapping is tagged as text", node.start_mark
        )
    return str(node.value)


def _wrong(node: yaml.Node, text: str, what: str) -> yaml.YAMLError:
    return yaml.constructor.ConstructorError(
        None, None, f"{text[:40]!r} is {what}", node.start_mark
    )


def _whole(loader: Any, node: yaml.Node) -> int:
    text = _scalar(loader, node)
    if not _WHOLE.fullmatch(text):
        raise _wrong(node, text, "no whole number")
    if len(text.lstrip("+-")) > limits.MOST_YAML_DIGITS:
        raise _wrong(node, text, "an endless number")
    return int(text)


def _real(loader: Any, node: yaml.Node) -> float:
    text = _scalar(loader, node)
    if not (_REAL.fullmatch(text) or _WHOLE.fullmatch(text)):
        raise _wrong(node, text, "no number")
    return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))


def _truth(loader: Any, node: yaml.Node) -> bool:
    text = _scalar(loader, node)
    if text not in _TRUTH:
        raise _wrong(node, text, "neither true nor false")
    return _TRUTH[text]


def _nothing(loader: Any, node: yaml.Node) -> None:
    if (text := _scalar(loader, node)) not in _NOTHING:
        raise _wrong(node, text, "not null")


def _unknown(loader: Any, node: yaml.Node) -> None:
    raise _wrong(node, node.tag, "a tag of no plain data")


_NOT_TEXT = (
    (f"{_TAG}bool", re.compile(f"(?:{'|'.join(_TRUTH)})$"), [*"tTfF"]),
    (f"{_TAG}int", re.compile(f"(?:{_WHOLE.pattern})$"), [*"-+0123456789"]),
    (f"{_TAG}float", re.compile(f"(?:{_REAL.pattern})$"), [*"-+.0123456789"]),
    (f"{_TAG}null", re.compile("(?:~|null|Null|NULL|)$"), ["~", "n", "N", ""]),
)
"""Tag, pattern and first letters of what is no text without quotes."""
for _resolver in _NOT_TEXT:
    _Loader.add_implicit_resolver(*_resolver)
    _Dumper.add_implicit_resolver(*_resolver)
for _name, _make in (
    ("str", _scalar),
    ("int", _whole),
    ("float", _real),
    ("bool", _truth),
    ("null", _nothing),
    ("seq", _BASE.construct_yaml_seq),
    ("map", _BASE.construct_yaml_map),
):
    _Loader.add_constructor(f"{_TAG}{_name}", _make)
_Loader.add_constructor(None, _unknown)


def _refuse_aliases_and_depth(text: str) -> None:
    """Look at the events before anything is built."""
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        line = event.start_mark.line + 1 if event.start_mark else None
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise NotPlain(line, "YAML anchors and aliases are not allowed; write it out")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > limits.DEEPEST_YAML:
            raise NotPlain(line, _TOO_DEEP)


def _record_lines(node: yaml.Node, at: FieldPath, lines: dict[FieldPath, int]) -> None:
    """Note the lines, and make each key the text that it is."""
    lines.setdefault(at, node.start_mark.line + 1)
    if isinstance(node, yaml.SequenceNode):
        for i, item in enumerate(node.value):
            _record_lines(item, (*at, i), lines)
    elif isinstance(node, yaml.MappingNode):
        seen = set()
        for key, value in node.value:
            line = key.start_mark.line + 1
            if not isinstance(key, yaml.ScalarNode) or (key.value == "<<" and not key.style):
                raise NotPlain(line, "a key must be plain text")
            if key.value in seen:
                raise NotPlain(line, f"key {key.value!r} stands twice; remove one")
            seen.add(key.value)
            key.tag = f"{_TAG}str"
            lines[(*at, key.value)] = line
            _record_lines(value, (*at, key.value), lines)
