"""Files of torch.save, without torch: its tensors become arrays, and nothing else is admitted.

Since version 1.6 torch writes a zip archive: `<name>/data.pkl`, a pickle whose tensors are calls on
storages, and `<name>/data/<key>` with the bytes of each storage (torch/serialization.py).  The
pickle is read as every other is (`gmrdata.read.safe_pickle`), within the same budget.  A sparse,
quantized or nested tensor, or one of no device, is a call that is not admitted.
"""

import zipfile
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read import pickle_records
from gmrdata.read.safe_pickle import Import, Interpreter, explained
from gmrdata.values.errors import BadMotionFile
from gmrdata.values.files import check_archive, require_file
from gmrdata.values.limits import Budget

PROGRAM = "data.pkl"


def load_tensors(path: Path) -> Mapping[str, Any]:
    """The dict that torch.save wrote to a file, with its tensors as arrays.

    BadMotionFile where it is broken, too large, of torch's form from before 1.6 or no dict;
    UnsafePickle where it holds more than tensors and plain data.
    """
    require_file(path)
    budget = Budget.of(path)
    with explained(path, "a file of torch.save", BadMotionFile):
        check_archive(path, budget)
        with zipfile.ZipFile(path) as archive:
            unpickled = _Reader(archive, _folder_in(archive), budget).load()
        content = pickle_records.plain(unpickled, budget)
    if not isinstance(content, Mapping):
        raise BadMotionFile(f"{path}: holds no dict; give the file that the system wrote")
    return content


class _Reader(Interpreter):
    """Python's pickle interpreter on an archive's program, with storages from its other files."""

    def __init__(self, archive: zipfile.ZipFile, folder: str, budget: Budget) -> None:
        super().__init__(BytesIO(archive.read(f"{folder}{PROGRAM}")), budget)
        self._archive, self._folder = archive, folder
        self._storages: dict[str, np.ndarray] = {}

    def persistent_load(self, pid: Any) -> Any:
        match pid:
            case ("storage", Import(name), str() as key, str(), int()):
                if key not in self._storages:
                    raw = self._archive.read(f"{self._folder}data/{key}")
                    self._storages[key] = pickle_records.storage_of(name, raw)
                return self._storages[key]
        return super().persistent_load(pid)


def _folder_in(archive: zipfile.ZipFile) -> str:
    """The folder that all is in, with its slash."""
    names = archive.namelist()
    programs = [name for name in names if name.rpartition("/")[2] == PROGRAM]
    if len(programs) != 1 or len({name.casefold() for name in names}) < len(names):
        raise ValueError(f"it has {len(programs)} files {PROGRAM}, or two of one name")
    folder = programs[0].removesuffix(PROGRAM)
    order = f"{folder}byteorder"
    if order in names and archive.read(order) != b"little":
        raise ValueError("its numbers have the byte order of another machine")
    return folder
