"""`scores.json`: its format, and reading it back."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from gmrdata.errors import BadRecord
from gmrdata.evaluate.protocol_names import ProtocolName
from gmrdata.evaluate.protocols import PROTOCOLS
from gmrdata.store import read_json

FORMAT = "gmrdata-scores/2"
"""Name and version of the format."""


def protocol_record(name: ProtocolName | None) -> dict[str, Any] | None:
    """A protocol as JSON values; None without one."""
    if name is None:
        return None
    return {
        key: list(value) if isinstance(value, tuple) else value
        for key, value in asdict(PROTOCOLS[name]).items()
    }


def read_scores(path: Path) -> dict[str, Any]:
    """Read a `scores.json`.

    Raises:
        MissingInput: there is no such file.
        BadRecord: it isn't JSON, or no scores of this format.
    """
    record = read_json(path)
    found = record.get("format") if isinstance(record, dict) else None
    if found != FORMAT:
        raise BadRecord(
            f"{path}: of format {found!r}, not {FORMAT!r}. Give the scores.json that "
            "`gmrdata evaluate` wrote; score again with --redo what an older version scored"
        )
    return dict(record)
