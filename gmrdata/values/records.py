"""Records: the typed files that stages leave, and the base of every recipe model.

A record has a `format` tag and one class that writes and reads it.  Its fields are required: a
missing, unknown or wrong key is an error that names file and key, so that no default can let a bad
sequence pass.  A figure that does not exist is written as null.
"""

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar, cast, get_args

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError

from gmrdata.values.errors import BadRecord
from gmrdata.values.files import json_text, read_json, read_npz, write_text

MAKE_AGAIN = "make it again: the same command with --redo, or another --out"
"""The remedy for a record of another version, or one that was changed by hand."""

PART = ConfigDict(extra="forbid", allow_inf_nan=False)
"""What a dataclass within a record is held to: `@pydantic.dataclasses.dataclass(config=PART)`."""

ArrayShapes = Mapping[str, tuple[str, tuple[str | int, ...]]]
"""Kind (numpy's letters) and shape of each array; a letter stands for a length that they share."""


class Config(BaseModel):
    """A frozen recipe: unknown keys are errors, so a typing mistake can't pass as a default.

    NaN and infinities are refused: a comparison with NaN is False, so a limit would let it pass.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def of_plain(cls, value: Any) -> Self:
        """The model that plain data of a JSON or YAML file stands for.

        A text, or `true`, is no number, and 2.0 no whole one; ValidationError for these too.
        """
        # Only from JSON does pydantic's strict mode take lists for tuples and texts for paths.
        return cls.model_validate_json(json.dumps(value), strict=True)


Whole = TypeVar("Whole")


def with_absolute_paths(given: Whole) -> Whole:
    """The same for a worker that may run in another folder: a path, or models, dataclasses and
    tuples with the paths in them."""
    made: Any = given
    if isinstance(given, Path):
        made = given.absolute()
    elif type(made) is tuple:
        made = tuple(map(with_absolute_paths, made))
    elif isinstance(given, BaseModel):
        made = given.model_copy(update={key: with_absolute_paths(value) for key, value in given})
    elif is_dataclass(given) and not isinstance(given, type):
        parts = {one.name: with_absolute_paths(getattr(given, one.name)) for one in fields(given)}
        made = replace(given, **parts)
    return cast(Whole, made)


class Record(Config):
    """A JSON file of a stage.

    A subclass declares `format: Literal["gmrdata-<what>/<version>"] = "gmrdata-<what>/<version>"`
    and its fields, all of them without defaults.
    """

    @classmethod
    def tag(cls) -> str:
        """The format tag of this class."""
        return str(get_args(cls.model_fields["format"].annotation)[0])

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read a record; BadRecord names file and key that are wrong."""
        return cls.of_value(Path(path), read_json(Path(path)))

    @classmethod
    def of_value(cls, path: Path, value: Any) -> Self:
        """The record that a file's JSON value stands for; errors as in `read`."""
        tag = value.get("format") if isinstance(value, dict) else None
        require_tag(path, tag, cls.tag())
        try:
            record = cls.of_plain(value)
        except ValidationError as error:
            raise BadRecord(f"{path}: {first_problem(error)}; {MAKE_AGAIN}") from None
        if lacking := _lacking(value, record.model_dump(mode="json")):
            raise BadRecord(f"{path}: has no key `{lacking}`; {MAKE_AGAIN}")
        return record

    def write(self, path: Path) -> None:
        """Write the record as a whole or not at all; a file that says the same is left alone."""
        text = json_text(self.model_dump(mode="json"))
        if not path.is_file() or path.read_bytes() != text.encode():
            write_text(path, text)


def figure(value: float | np.floating) -> float:
    """A figure as it stands in records: six significant digits."""
    return float(f"{float(value):.6g}")


def compared(text: str, value: float, limit: float, spec: str) -> str:
    """A text with a value by ".1f", ".0%" or the like and its limit in its two {}; with as many
    more digits as tell them apart, so that no 90% are said to be fewer than 90%."""
    finer = (f".{digits}{spec[-1]}" for digits in range(int(spec[1]), 10))
    spec = next((one for one in finer if format(value, one) != format(limit, one)), spec)
    return text.format(format(value, spec), format(limit, spec if spec[-1] == "%" else "g"))


Figure = Annotated[float, AfterValidator(figure)]  # rounded to six significant digits


def read_arrays(path: Path, tag: str, shapes: ArrayShapes) -> dict[str, np.ndarray]:
    """The arrays of an .npz record: `format` is checked and left out, exactly `shapes` is there."""
    arrays = read_npz(path)
    require_tag(path, arrays.pop("format", None), tag)
    check_shapes(path, arrays, shapes)
    return arrays


def check_shapes(path: Path, arrays: Mapping[str, np.ndarray], shapes: ArrayShapes) -> None:
    """Raise BadRecord unless exactly the arrays of `shapes` are there, and fit together."""
    for said, keys in (("no", shapes.keys() - arrays), ("an unknown", arrays.keys() - shapes)):
        if keys:
            raise BadRecord(f"{path}: has {said} array {min(keys)!r}; {MAKE_AGAIN}")
    lengths: dict[str, int] = {}
    for key, (kinds, shape) in shapes.items():
        array = arrays[key]
        wanted = tuple(
            lengths.setdefault(size, length) if isinstance(size, str) else size
            for size, length in zip(shape, array.shape, strict=False)
        )
        if array.dtype.kind not in kinds or array.ndim != len(shape) or array.shape != wanted:
            known = ", ".join(f"{name} = {length}" for name, length in lengths.items())
            what = f"array {key!r} has shape {array.shape} and type {array.dtype}, which does not"
            fit = f"{shape} with {known or 'any length'}"
            raise BadRecord(f"{path}: {what} fit {fit}; {MAKE_AGAIN}")


def require_tag(path: Path, found: Any, tag: str) -> None:
    """Raise BadRecord unless the tag that was found is the one that is expected."""
    found = str(found) if isinstance(found, np.ndarray) else found
    what = f"`format` is {found!r}, not {tag!r}"
    if found is None:
        what = f"has no `format`, so it is no {tag} or an older gmrdata wrote it"
    if found != tag:
        raise BadRecord(f"{path}: {what}; {MAKE_AGAIN}")


def _lacking(value: Any, whole: Any) -> str:
    """The first key that a value lacks: the `format` of a record within it, which has a default."""
    if not isinstance(whole, dict):
        return ""
    for key, inner in whole.items():
        if key not in value:
            return str(key)
        if lacking := _lacking(value[key], inner):
            return f"{key}.{lacking}"
    return ""


def first_problem(error: ValidationError) -> str:
    """The first wrong key of a record or of settings, in words."""
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"]) or "the record"
    if first["type"] == "missing":
        return f"has no key `{key}`"
    if first["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        return f"has an unknown key `{key}`"
    return f"`{key}` is wrong: {first['msg']}"
