"""Motions of the CMU motion capture database, file by file, complete or not at all."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.errors import BadMotionFile, BadRecord, FetchFailed
from gmrdata.fetch.config import FetchConfig
from gmrdata.fetch.download import download, drop_part, part_of
from gmrdata.fetch.trials import check_trials, file_url, skeleton_of
from gmrdata.motion.amc import read_amc
from gmrdata.motion.asf import read_asf
from gmrdata.progress import console, progress_bar
from gmrdata.store import locked, read_json, sha256_of_file, write_json, write_text

RECORD = "fetched.json"
SUMS = "SHA256SUMS"


def fetch_trials(
    trials: Sequence[str],
    out_dir: Path,
    config: FetchConfig,
    rng: np.random.Generator,
    *,
    redo: bool = False,
    sleep: Callable[[float], None] = time.sleep,
) -> Path:
    """Get trials and their skeletons; those that are there and have their recorded hash stay.

    Args:
        trials: Names like 02_03.
        out_dir: Gets `02.asf`, `02_03.amc`, ..., `SHA256SUMS` and `fetched.json`.
        config: Where from, and how patiently.
        rng: For the waits between attempts.
        redo: Fetch again what is there and has another hash, or none on record.
        sleep: Waits that many seconds.

    Returns:
        `out_dir`.

    Raises:
        BadRecipe: a name is no trial's, or the address is not one of the web.
        BadRecord: `fetched.json` is broken.
        FetchFailed: some files could not be fetched; the others are there.
    """
    trials = check_trials(trials)
    names = _files(trials)
    urls = {name: file_url(config.base_url, name) for name in names}
    out_dir.mkdir(parents=True, exist_ok=True)
    problems: dict[str, str] = {}
    with locked(out_dir / ".fetch.lock"), progress_bar() as bar:
        task = bar.add_task("fetching", total=len(names))
        for name in names:
            bar.update(task, description=f"fetching {name}")
            try:
                _need_skeleton(name, problems)
                _fetch_file(out_dir / name, urls[name], config, rng, redo, sleep)
            except FetchFailed as error:
                problems[name] = str(error)
                console.print(f"{_what(name)}: {error}", markup=False, soft_wrap=True)
            bar.advance(task)
    missing = [trial for trial in trials if f"{trial}.amc" in problems]
    if missing:
        reasons = "\n".join(f"  {_what(name)}: {said}" for name, said in problems.items())
        raise FetchFailed(
            f"{len(missing)} of {len(trials)} trials missing: {', '.join(missing)}\n{reasons}"
        )
    return out_dir


def plan(
    trials: Sequence[str], out_dir: Path, config: FetchConfig
) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    """A table of what `fetch_trials` would do, without doing or asking anything."""
    record = _read_record(out_dir)
    rows = [
        (name, file_url(config.base_url, name), _state(out_dir / name, record))
        for name in _files(check_trials(trials))
    ]
    return ("file", "address", "state"), rows


def _files(trials: Sequence[str]) -> list[str]:
    """File names, each trial's skeleton before it."""
    pairs = [(skeleton_of(trial), f"{trial}.amc") for trial in trials]
    return list(dict.fromkeys(name for pair in pairs for name in pair))


def _what(name: str) -> str:
    stem = Path(name).stem
    return f"trial {stem}" if name.endswith(".amc") else f"skeleton of subject {stem}"


def _need_skeleton(name: str, problems: dict[str, str]) -> None:
    skeleton = skeleton_of(Path(name).stem)
    if name != skeleton and skeleton in problems:
        raise FetchFailed(f"its skeleton {skeleton} is missing")


def _state(path: Path, record: dict[str, dict[str, Any]]) -> str:
    if not path.is_file():
        return "unfinished" if part_of(path).is_file() else "to do"
    if path.name not in record:
        return "there, not recorded"
    same = sha256_of_file(path) == record[path.name].get("sha256")
    return "done" if same else "there, with another hash"


def _fetch_file(
    path: Path,
    url: str,
    config: FetchConfig,
    rng: np.random.Generator,
    redo: bool,
    sleep: Callable[[float], None],
) -> None:
    record = _read_record(path.parent)
    state = _state(path, record)
    if state == "done":
        return
    if path.exists() and not redo:
        raise FetchFailed(f"{path} is {state}: move it away, or pass --redo to fetch it again")
    part = download(url, path, config, rng, sleep)
    try:
        _check_content(part, path)
    except BadMotionFile as error:
        drop_part(path)
        said = str(error).replace(str(part), path.name)
        raise FetchFailed(
            f"{url}: what the server sent is no usable {path.suffix}: {said}"
        ) from None
    entry = {"url": url, "size_bytes": part.stat().st_size, "sha256": sha256_of_file(part)}
    # The record first: a run that is killed in between then fetches the file once more.
    _write_record(path.parent, record | {path.name: entry})
    part.replace(path)
    drop_part(path)


def _check_content(part: Path, path: Path) -> None:
    """Read the file as what it should be, so that no error page gets a motion's name.

    Raises:
        BadMotionFile: it is something else, or cut off.
    """
    with part.open("rb") as stream:
        start = stream.read(512).lstrip().lower()
    if start.startswith((b"<!doctype", b"<html", b"<?xml")):
        raise BadMotionFile("a web page")
    if path.suffix == ".asf":
        read_asf(part)
        return
    # The rate does not matter here; it is given since a .part's name does not tell the subject.
    read_amc(part, asf_path=path.with_name(skeleton_of(path.stem)), fps_hz=120.0)


def _read_record(folder: Path) -> dict[str, dict[str, Any]]:
    path = folder / RECORD
    if not path.exists():
        return {}
    record = read_json(path)
    files = record.get("files") if isinstance(record, dict) else None
    if not isinstance(files, dict) or not all(isinstance(e, dict) for e in files.values()):
        raise BadRecord(f"{path}: no record of fetched files; move it away, and pass --redo")
    return files


def _write_record(folder: Path, files: dict[str, dict[str, Any]]) -> None:
    write_json(folder / RECORD, {"files": files})
    lines = [f"{entry['sha256']}  {name}\n" for name, entry in sorted(files.items())]
    write_text(folder / SUMS, "".join(lines))
