"""Files and folders that are complete when they exist: hashes, atomic writes, and stages."""

import fcntl
import platform
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Any

from gmrdata import __version__
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.values.errors import BadRecord, MissingInput, StaleOutput
from gmrdata.values.files import RECIPE_FILE, STAGE_FILE, read_json, sha256_of_path, write_json
from gmrdata.values.records import Config

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


def run_stage(
    name: str,
    out_dir: Path,
    config: Config,
    inputs: Mapping[str, Path],
    work: Callable[[Path], Mapping[str, Any] | None],
    *,
    resumable: bool = False,
    run: Run = DEFAULT_RUN,
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
        if out_dir.exists() and not _is_stale(out_dir, recipe, run):
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


def _is_stale(out_dir: Path, recipe: dict[str, Any], run: Run) -> bool:
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
    if run.redo:
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
    here = Path(__file__).parents[2]
    if not (here / ".git").exists():
        return None
    git = shutil.which("git")
    if git is None:
        return None
    answer = subprocess.run(
        [git, "-C", str(here), "rev-parse", "HEAD"], capture_output=True, text=True, check=False
    )
    return answer.stdout.strip() or None
