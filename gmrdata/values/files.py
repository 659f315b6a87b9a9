"""Files that are whole when they exist: hashes, atomic writes, JSON, .npz, paths in a folder."""

import hashlib
import io
import json
import os
import re
import socket
import sys
import threading
import time
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from itertools import islice
from pathlib import Path, PurePath, PurePosixPath
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gmrdata.values.errors import BadMotionFile, BadRecord, GmrdataError, MissingInput
from gmrdata.values.limits import Budget, OverBudget

STAGE_FILE, RECIPE_FILE = "stage.json", "recipe.json"
_TEMPORARY_NAME = re.compile(r"\..+\.(?P<host>[0-9a-f]{12})-(?P<pid>\d+)-\d+\.tmp(\..*)?")
"""`temporary_name`: what the file is called that a process writes."""
ORPHAN_AGE_S = 86400.0  # after which another machine's unfinished file has lost its process


def visible(paths: Iterable[Path]) -> Iterator[Path]:
    """Those that a person put there: macOS leaves `._name`, `.DS_Store` and `__MACOSX` beside them,
    and other systems what begins with a dot too."""
    for path in paths:
        if not path.name.startswith(".") and "__MACOSX" not in path.parts:
            yield path


def files_inside(folder: Path, paths: Iterable[Path]) -> list[Path]:
    """Those of a folder's paths that are files, sorted; links that lead out of it are left out."""
    root = folder.resolve()
    # A link to itself is no file, and can't be followed.
    return sorted(path for path in paths if path.is_file() and path.resolve().is_relative_to(root))


def is_hidden(relative: PurePath) -> bool:
    """Whether a path in a folder has a part that begins with a dot, as what desktops leave has,
    and what tools like git keep."""
    return any(part.startswith(".") for part in relative.parts)


def as_text(name: object) -> str:
    """A name as records and pages can hold it: bytes that are no UTF-8 as `\\xfc`."""
    return str(name).encode(errors="surrogateescape").decode(errors="backslashreplace")


def require_text(path: Path, error: type[GmrdataError]) -> None:
    """Raise an error for a name whose bytes are no UTF-8, as zip files of Windows unpack them."""
    if as_text(path.name) != path.name:
        raise error(f"{as_text(path)}: the bytes of its name are no UTF-8. Rename it")


def as_paths(given: str | Path | Iterable[str | Path]) -> list[Path]:
    """A list of paths; one that is no list is a path, not its letters."""
    return [Path(one) for one in ([given] if isinstance(given, str | Path) else given)]


def require_file(path: Path) -> None:
    """MissingInput where there is no such file."""
    if not path.is_file():
        raise MissingInput(f"{path}: no such file{', but a folder' if path.is_dir() else ''}")


def sha256_of_file(path: Path) -> str:
    """Hex SHA-256 of a file's bytes."""
    require_file(path)
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def sha256_of_path(
    path: Path,
    hash_file: Callable[[Path], str] = sha256_of_file,
    *,
    is_flat: bool = False,
    without: Path | None = None,
) -> str:
    """Hex SHA-256 of a file, or of a folder's paths and contents but for hidden files and what
    stages keep of it; without its folders if `is_flat`, or `without` one, an absolute path."""
    if not path.is_dir():
        return hash_file(path)
    digest = hashlib.sha256()
    # Folders that are links are not entered.
    folders = islice(os.walk(path), 1 if is_flat else None)
    for file in sorted(Path(root, name) for root, _, names in folders for name in names):
        kept = file.name in (STAGE_FILE, RECIPE_FILE) or is_hidden(file.relative_to(path))
        if kept or without in file.absolute().parents or not file.is_file():
            continue
        line = f"{file.relative_to(path).as_posix()}\0{hash_file(file)}\n"
        digest.update(line.encode(errors="surrogateescape"))  # a name's bytes may be no UTF-8
    return digest.hexdigest()


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A temporary sibling of `path` to write to; it replaces `path` when the block ends well."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(temporary_name(path) + path.suffix)
    try:
        yield temporary
        with temporary.open("r+b") as stream:  # Windows forces only what may be written to
            os.fsync(stream.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def temporary_name(path: Path) -> str:
    """Name of a sibling that no other thread, process or machine uses."""
    return f".{path.name}.{host_word()}-{os.getpid()}-{threading.get_ident()}.tmp"


def partial_of(folder: Path) -> Path:
    """Where a folder is made, which then gets its name at once; what was cut short stays there."""
    return folder.with_name(f"{folder.name}.partial")


@cache
def host_word() -> str:
    """12 hex digits for this machine, its boot and the namespace of its process numbers."""
    parts = [socket.gethostname()]
    with suppress(OSError):
        parts.append(Path("/proc/sys/kernel/random/boot_id").read_text())
        parts.append(str(Path("/proc/self/ns/pid").readlink()))
    return hashlib.sha256("/".join(parts).encode()).hexdigest()[:12]


def remove_orphans(folder: Path) -> None:
    """Remove what `atomic_path` left right in a folder for processes that were killed."""
    for leftover in folder.glob(".*.tmp*"):
        written_by = _TEMPORARY_NAME.fullmatch(leftover.name)
        if written_by and leftover.is_file() and _is_orphan(leftover, **written_by.groupdict()):
            leftover.unlink(missing_ok=True)


def _is_orphan(path: Path, host: str, pid: str) -> bool:
    if host == host_word():
        return not _is_running(int(pid))
    return time.time() - path.stat().st_mtime > ORPHAN_AGE_S


def _is_running(pid: int) -> bool:
    if sys.platform == "win32":  # there the signal 0 would end it
        import psutil  # which distributed brings

        return bool(psutil.pid_exists(pid))
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # somebody else's
        return True
    return True


def write_npz(path: Path, arrays: Mapping[str, ArrayLike], *, compressed: bool = False) -> None:
    """Write arrays as an .npz as a whole or not at all; the same arrays give the same bytes.

    The archive is made in memory: a disk that fills up in the middle of one leaves zipfile with an
    archive that it can neither finish nor give up quietly.
    """
    archive = io.BytesIO()
    save = np.savez_compressed if compressed else np.savez
    save(archive, **arrays)  # type: ignore[arg-type]
    write_bytes(path, archive.getbuffer())


def write_bytes(path: Path, content: bytes | memoryview) -> None:
    """Write a file as a whole or not at all."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: Path, text: str) -> None:
    """The same for a text."""
    write_bytes(path, text.encode())


def write_json(path: Path, value: Any) -> None:
    """Write JSON with sorted keys, as a whole or not at all.  NaN and infinities are refused."""
    write_text(path, json_text(value))


def json_text(value: Any) -> str:
    """What `write_json` writes."""
    text = json.dumps(value, indent=2, sort_keys=True, allow_nan=False) + "\n"
    # Names whose bytes are no UTF-8 stand in it as halves of surrogate pairs, which nobody reads.
    return _LONE_HALF.sub(r"\\\\x\1", text) if "\\udc" in text else text


_LONE_HALF = re.compile(r"(?<!\\)(?<!\\ud[89ab][0-9a-f]{2})\\udc([89a-f][0-9a-f])")


def read_json(path: Path) -> Any:
    """Read a JSON file; BadRecord if it isn't JSON."""
    require_file(path)
    try:
        return parse_json(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise BadRecord(f"{path}: not JSON ({error}); make it again") from None


def parse_json(text: str) -> Any:
    """The value of a JSON text; ValueError for half a character too, which no file can hold."""
    value = json.loads(text)
    if "\\ud" in text.lower():
        try:
            json.dumps(value, ensure_ascii=False).encode()
        except UnicodeEncodeError:
            raise ValueError("a text has half of a surrogate pair (\\ud800 and the like)") from None
    return value


def read_json_lines(path: Path) -> list[dict[str, Any]]:
    """The objects of a file with one in each line; BadRecord names the line that is none."""
    require_file(path)
    rows: list[dict[str, Any]] = []
    try:
        for line in path.read_text(encoding="utf-8").splitlines():
            row = parse_json(line)
            if not isinstance(row, dict):
                raise ValueError("it is no object")
            rows.append(row)
    except (ValueError, RecursionError) as error:
        where = f"{path}:{len(rows) + 1}"
        raise BadRecord(f"{where}: not a line of JSON ({error}); make it again") from None
    return rows


def read_npz(
    path: Path, budget: Budget | None = None, *, plain_alone: bool = False
) -> dict[str, np.ndarray]:
    """All arrays of an .npz, without unpickling anything; within the file's own budget for None.

    With `plain_alone` Python's objects are left out, unless there is nothing else: AMASS's SMPL-X
    files have the markers' vertices so, beside the motion.  What says whose body it is never is.
    """
    require_file(path)
    budget = budget or Budget.of(path)
    try:
        check_archive(path, budget)
        plain: dict[str, np.ndarray] = {}
        objects: ValueError | None = None
        with np.load(path, allow_pickle=False) as arrays:
            for key in arrays.files:
                try:
                    plain[key] = _plain_array(arrays, key, budget)
                except ValueError as error:
                    left_out = plain_alone and key not in ("gender", "betas")
                    if not left_out or "allow_pickle" not in str(error):
                        raise
                    objects = error
        if objects and not plain:
            raise objects
        return plain
    except OverBudget as error:
        raise BadMotionFile(f"{path}: {error}; {error.remedy}") from None
    except NUMPY_ERRORS as error:
        said: object = error
        if "allow_pickle" in str(error):  # numpy's own remedy runs what the file holds
            said = "it holds Python's objects; save each array of theirs by its name, np.savez"
        raise BadMotionFile(f"{path}: not a readable .npz of plain arrays ({said})") from None


def npz_format(path: Path) -> str | None:
    """What an .npz says of itself as `format`; None where it says nothing, or is no .npz."""
    if path.suffix.lower() != ".npz" or not path.is_file():
        return None
    try:
        check_archive(path, budget := Budget.of(path))
        with np.load(path, allow_pickle=False) as arrays:
            return str(_plain_array(arrays, "format", budget)) if "format" in arrays else None
    except NUMPY_ERRORS:
        return None


def _plain_array(arrays: Mapping[str, Any], key: str, budget: Budget) -> np.ndarray:
    array = arrays[key]
    if not isinstance(array, np.ndarray):  # numpy gives other files as bytes
        raise ValueError(f"{key!r} is no array")
    budget.take_numbers(np.size(array))
    if array.dtype.kind == "U":
        require_texts(f"{key!r}", array)
    return array


def require_texts(what: str, texts: np.ndarray) -> None:
    """ValueError for codes that no letter has, or only half of one."""
    native = np.ascontiguousarray(texts, texts.dtype.newbyteorder("="))
    codes = np.frombuffer(native.tobytes(), np.uint32)
    if ((codes > sys.maxunicode) | ((codes >= 0xD800) & (codes < 0xE000))).any():
        raise ValueError(f"{what} is a text of no letters")


def check_archive(path: Path, budget: Budget) -> None:
    """Refuse a zip file of too many files, or of more bytes than it may unpack to."""
    with zipfile.ZipFile(path) as archive:
        entries = archive.infolist()
    budget.check_members(len(entries))
    budget.take_bytes(sum(entry.file_size for entry in entries))


NUMPY_ERRORS = (
    zipfile.BadZipFile, zlib.error, ValueError, TypeError, OSError, EOFError, MemoryError,
    RuntimeError,  # an encrypted or strangely compressed member
    SyntaxError, TokenError,  # an array's header, which is Python's text
)  # fmt: skip
"""What numpy and zipfile raise for .npy and .npz that are not what they say."""


_KINDS = (
    (re.compile(r"^format: *['\"]?gmrdata/\d", re.M), "a manifest"),
    (re.compile(r"^recipe: *['\"]?\w", re.M), "a recipe"),
    (re.compile(r"^\{.*\"format\": *\"gmrdata-", re.S), "a record that a stage left"),
    (re.compile(r"^HIERARCHY"), "a BVH motion"),
    (
        re.compile(r"^version https://git-lfs"),
        "a Git LFS pointer: fetch the file with git lfs pull",
    ),
)
_BEGIN_CHARS = 1 << 16


def taken_for(path: Path) -> str:
    """What a file or folder is that stands where another belongs, to end a message: ", it is a clip
    ..."; empty where nothing tells."""
    if path.is_dir():
        return "; it is a folder"
    with path.open("rb") as stream:
        begin = stream.read(_BEGIN_CHARS).decode("utf-8", "replace")
    if begin.startswith("PK"):
        return "; it is an archive: a clip or other arrays (.npz), or a file of torch"
    kind = next((kind for pattern, kind in _KINDS if pattern.search(begin)), "")
    return kind and f"; it is {kind}"


LONGEST_NAME_BYTES = 255  # of one part of a path, on the disks of all systems
LONGEST_PATH = 1000  # letters, with room for the folder that it lies in


def safe_relative(text: str) -> str:
    """`text` if it is a plain relative path with forward slashes, else ValueError.

    Refused is also what another system would read differently: backslashes, drive letters, `a//b`.
    """
    if not text:
        raise ValueError("path is empty")
    if text.startswith("/") or re.match(r"[A-Za-z]:", text):
        raise ValueError(f"path {text!r} is absolute; write it relative to the manifest's folder")
    if "\\" in text or any(ord(letter) < 32 or ord(letter) == 127 for letter in text):
        raise ValueError(f"path {text!r} has a backslash or control character; use forward slashes")
    if ".." in (parts := text.split("/")):
        raise ValueError(f"path {text!r} climbs out with '..'; keep files below the manifest")
    names_bytes = (len(part.encode(errors="surrogatepass")) for part in parts)
    if len(text) > LONGEST_PATH or max(names_bytes) > LONGEST_NAME_BYTES:
        most = f"{LONGEST_PATH} letters, or a name of more than {LONGEST_NAME_BYTES} bytes"
        raise ValueError(f"path {text[:40]!r}... has more than {most}")
    if text == ".":
        raise ValueError("path '.' is the manifest's folder itself; name a file or folder below it")
    if PurePosixPath(text).as_posix() != text:
        raise ValueError(f"path {text!r} is not in its short form {PurePosixPath(text).as_posix()}")
    return text


def resolve_inside(root: Path, relative: str) -> Path:
    """The real path of `root / relative`; ValueError where it, or a link on it, leaves `root`."""
    real_root = root.resolve()
    try:
        target = (real_root / safe_relative(relative)).resolve()
    except (OSError, RuntimeError) as error:  # links that point at each other
        raise ValueError(f"path {relative!r} can't be followed ({error})") from None
    if not target.is_relative_to(real_root):
        what = f"path {relative!r} is or passes a link out of the manifest's folder"
        raise ValueError(f"{what}; copy the file in place of the link")
    return target
