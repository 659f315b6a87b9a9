"""Files and folders that are complete when they exist: hashes, atomic writes, and stages."""

import fcntl
import hashlib
import io
import json
import os
import platform
import re
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gmrdata import __version__
from gmrdata.config import Config
from gmrdata.errors import BadRecord, MissingInput, StaleOutput

STAGE_FILE = "stage.json"
RECIPE_FILE = "recipe.json"
_LOCK_NAME = re.compile(r"\..+\.lock")
_TEMPORARY_NAME = re.compile(r"\..+\.(?P<pid>\d+)-\d+\.tmp(\..*)?")
"""What `atomic_path` calls the file that a process writes."""
RECORDED_PACKAGES = (
    "numpy",
    "scipy",
    "torch",
    "torchvision",
    "roma",
    "safetensors",
    "pycolmap",
    "opencv-python-headless",
    "bpy",
    "anny",
    "av",
)


def sha256_of_file(path: Path) -> str:
    """Hex SHA-256 of a file's bytes.

    Raises:
        MissingInput: there is no such file.
    """
    if not path.is_file():
        raise MissingInput(f"{path}: no such file")
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def sha256_of_path(path: Path) -> str:
    """Hex SHA-256 of a file, or of a folder's relative paths and contents.

    A stage's own record is left out, since it holds times, and so are the lock files of stages.

    Raises:
        MissingInput: there is nothing at the path.
    """
    if not path.is_dir():
        return sha256_of_file(path)
    digest = hashlib.sha256()
    for file in sorted(p for p in path.rglob("*") if p.is_file()):
        if file.name in (STAGE_FILE, RECIPE_FILE) or _LOCK_NAME.fullmatch(file.name):
            continue
        digest.update(f"{file.relative_to(path).as_posix()}\0{sha256_of_file(file)}\n".encode())
    return digest.hexdigest()


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A temporary sibling of `path` to write to; it replaces `path` when the block ends well."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unique = f"{os.getpid()}-{threading.get_ident()}"
    temporary = path.with_name(f".{path.name}.{unique}.tmp{path.suffix}")
    try:
        yield temporary
        with temporary.open("rb") as stream:
            os.fsync(stream.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def remove_orphans(folder: Path) -> None:
    """Remove what `atomic_path` left right in a folder for processes that were killed."""
    for leftover in folder.glob(".*.tmp*"):
        written_by = _TEMPORARY_NAME.fullmatch(leftover.name)
        if written_by and leftover.is_file() and not _is_running(int(written_by["pid"])):
            leftover.unlink(missing_ok=True)


def _is_running(pid: int) -> bool:
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
    save(archive, **arrays)
    with atomic_path(path) as temporary:
        temporary.write_bytes(archive.getbuffer())


def write_text(path: Path, text: str) -> None:
    """Write a text file as a whole or not at all."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, value: Any) -> None:
    """Write JSON with sorted keys, as a whole or not at all.  NaN and infinities are refused."""
    write_text(path, json.dumps(value, indent=2, sort_keys=True, allow_nan=False) + "\n")


def read_json(path: Path) -> Any:
    """Read a JSON file.

    Raises:
        MissingInput: there is no such file.
        BadRecord: it isn't JSON.
    """
    if not path.is_file():
        raise MissingInput(f"{path}: no such file")
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise BadRecord(f"{path}: not JSON ({error}); make it again") from None


def run_stage(
    name: str,
    out_dir: Path,
    config: Config,
    inputs: Mapping[str, Path],
    work: Callable[[Path], Mapping[str, Any] | None],
    *,
    resumable: bool = False,
    redo: bool = False,
) -> Path:
    """Make `out_dir` by calling `work(partial_dir)`, once.

    `out_dir` appears by one rename after the stage's record was written, so a folder that exists is
    complete.  Called again with the same recipe and inputs it does nothing.

    Args:
        name: The stage's name, for the record.
        out_dir: The folder to make.
        config: The recipe.
        inputs: Files and folders that the result depends on; their hashes are recorded.
        work: Fills the folder that it is given; may return facts for the record that don't decide
            the result, such as the device that was used.
        resumable: Hand a killed run's unfinished folder to `work` again instead of an empty one.
            `work` must then write each of its files atomically and skip those that are there.
        redo: Throw away a result that another recipe made.

    Returns:
        `out_dir`.

    Raises:
        MissingInput: an input is not there.
        StaleOutput: the folder was made by another recipe or from other inputs.
    """
    recipe = _recipe(name, config, inputs)
    partial = out_dir.with_name(out_dir.name + ".partial")
    retired = out_dir.with_name(f".{out_dir.name}.old")
    out_dir.parent.mkdir(parents=True, exist_ok=True)
    with locked(out_dir.with_name(f".{out_dir.name}.lock")):
        if retired.exists():
            shutil.rmtree(retired)
        if out_dir.exists() and not _is_stale(out_dir, recipe, redo):
            return out_dir
        if partial.exists() and not (resumable and _read_recipe(partial / RECIPE_FILE) == recipe):
            shutil.rmtree(partial)
        partial.mkdir(exist_ok=True)
        _remove_temporaries(partial)
        write_json(partial / RECIPE_FILE, recipe)
        start_s = time.monotonic()
        facts = dict(work(partial) or {})
        write_json(partial / STAGE_FILE, recipe | facts | _provenance(time.monotonic() - start_s))
        (partial / RECIPE_FILE).unlink()
        # Two renames, so that at no time a half-deleted folder has the result's name.
        if out_dir.exists():
            out_dir.rename(retired)
        partial.rename(out_dir)
        shutil.rmtree(retired, ignore_errors=True)
    return out_dir


def is_made(name: str, out_dir: Path, config: Config, inputs: Mapping[str, Path]) -> bool:
    """Whether `run_stage` would find its folder complete; arguments as there."""
    made_by = _read_recipe(out_dir / STAGE_FILE)
    # By name first: only then are the inputs worth hashing.
    return made_by.get("stage") == name and made_by == _recipe(name, config, inputs)


def _recipe(name: str, config: Config, inputs: Mapping[str, Path]) -> dict[str, Any]:
    return {
        "stage": name,
        "config": config.model_dump(mode="json"),
        "inputs": {key: sha256_of_path(path) for key, path in sorted(inputs.items())},
    }


def stage_seconds(out_dir: Path) -> float:
    """Wall time that a finished stage took [s]."""
    return float(read_json(out_dir / STAGE_FILE)["seconds"])


@contextmanager
def locked(lock_path: Path) -> Iterator[None]:
    """Hold an advisory lock; the kernel drops it when the process dies, however it dies."""
    with lock_path.open("w") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        yield


def _is_stale(out_dir: Path, recipe: dict[str, Any], redo: bool) -> bool:
    if out_dir.is_dir() and not any(out_dir.iterdir()):
        return True
    if not (out_dir / STAGE_FILE).is_file():
        # Never deleted, not even with --redo: it could be anybody's folder.
        raise StaleOutput(
            f"{out_dir}: is there, and no gmrdata stage made it. Pass another --out, or move it"
        )
    made_by = _read_recipe(out_dir / STAGE_FILE)
    if made_by == recipe:
        return False
    if redo:
        return True
    keys = ", ".join(_differing_keys(made_by, recipe)) or "the stage's record"
    raise StaleOutput(
        f"{out_dir}: made with other values of {keys}. "
        "Pass --redo to make it again, or another --out"
    )


def _read_recipe(path: Path) -> dict[str, Any]:
    """What a record says about the recipe; nothing if there is no record or it was cut off."""
    try:
        record = read_json(path)
    except (MissingInput, BadRecord):
        return {}
    if not isinstance(record, dict):
        return {}
    return {key: record[key] for key in ("stage", "config", "inputs") if key in record}


def _remove_temporaries(partial: Path) -> None:
    """Remove what `atomic_path` left in a folder whose process was killed."""
    for leftover in partial.rglob(".*.tmp*"):
        if leftover.is_file():
            leftover.unlink()


def _differing_keys(a: Any, b: Any, prefix: str = "") -> list[str]:
    if isinstance(a, dict) and isinstance(b, dict):
        return [
            found
            for key in sorted(a.keys() | b.keys())
            for found in _differing_keys(
                a.get(key), b.get(key), f"{prefix}.{key}" if prefix else key
            )
        ]
    return [] if a == b else [prefix]


def package_versions() -> dict[str, str]:
    """Installed versions of the packages that decide what bytes come out."""
    versions = {}
    for package in RECORDED_PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return versions


def _provenance(seconds: float) -> dict[str, Any]:
    return {
        "gmrdata": __version__,
        "git_commit": _git_commit(),
        "python": platform.python_version(),
        "packages": package_versions(),
        "seconds": round(seconds, 2),
    }


def _git_commit() -> str | None:
    """Commit of the checkout that gmrdata runs from, or None for an installed wheel."""
    here = Path(__file__).parent.parent
    if not (here / ".git").exists():
        return None
    git = shutil.which("git")
    if git is None:
        return None
    answer = subprocess.run(
        [git, "-C", str(here), "rev-parse", "HEAD"], capture_output=True, text=True, check=False
    )
    return answer.stdout.strip() or None
