"""Trials of the CMU motion capture database, fetched file by file, complete or not at all."""

import shlex
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from gmrdata.manifest.current import ListManifest
from gmrdata.manifest.read import read_manifest
from gmrdata.read.amc import read_amc, read_asf
from gmrdata.read.download import FetchConfig, download, drop_part, folder_address, part_of
from gmrdata.read.source_motion import is_trial
from gmrdata.stage import recipes
from gmrdata.stage.locks import locked
from gmrdata.stage.progress import console, progress_bar
from gmrdata.values.errors import BadMotionFile, BadRecipe, BadRecord, FetchFailed
from gmrdata.values.files import sha256_of_file, write_text
from gmrdata.values.records import Config, Record

CMU_URL = "http://mocap.cs.cmu.edu/subjects"
RECORD = "fetched.json"
SUMS = "SHA256SUMS"


def check_trials(names: Iterable[str]) -> tuple[str, ...]:
    """The names, each once, in their order."""
    trials = tuple(dict.fromkeys(names))
    if wrong := [repr(name) for name in trials if not is_trial(name)]:
        what = "no name of a CMU trial; write subject and trial like 02_03"
        raise BadRecipe(f"{', '.join(wrong)}: {what}")
    return trials


def listed_trials(name: str) -> tuple[str, ...]:
    """CMU's trials in a list that gmrdata publishes, e.g. "paper_table8"; BadRecipe if none."""
    published = read_manifest(recipes.published_manifest(name))
    rows = published.clips if isinstance(published, ListManifest) else ()
    trials = [row.source.sequence for row in rows if row.source.dataset == "CMU"]
    if not trials:
        raise BadRecipe(f"--list {name}: names no CMU trials; paper_table8 does")
    return check_trials(trials)


def skeleton_of(trial: str) -> str:
    """File name of a trial's skeleton: 02_03 -> 02.asf."""
    return f"{trial.partition('_')[0]}.asf"


def file_url(base_url: str | None, name: str) -> str:
    """Address of `02.asf` or `02_03.amc` on CMU's site or below a mirror's `base_url`."""
    subject = Path(name).stem.partition("_")[0]
    return f"{folder_address(base_url or CMU_URL)}/{subject}/{name}"


def fetch_command(trials: Sequence[str], folder: Path | None) -> str | None:
    """The command that gets these trials, or None if none of them is CMU's."""
    wanted = [trial for trial in dict.fromkeys(trials) if is_trial(trial)]
    out = "FOLDER" if folder is None else shlex.quote(str(folder))
    return f"gmrdata fetch cmu {' '.join(wanted)} --out {out}" if wanted else None


class FetchedFile(Config):
    url: str
    size_bytes: int
    sha256: str


class Fetched(Record):
    """What was fetched into a folder, by file name."""

    format: Literal["gmrdata-fetched/1"] = "gmrdata-fetched/1"
    files: dict[str, FetchedFile]


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

    `out_dir`, which is given back, gets `02.asf`, `02_03.amc`, `SHA256SUMS` and `fetched.json`.
    With `redo` what is there and has another hash, or none on record, is fetched again.
    FetchFailed lists what could not be fetched, the others are there; BadRecord: `fetched.json` is
    broken.
    """
    trials = check_trials(trials)
    names = _files(trials)
    urls = {name: file_url(config.base_url, name) for name in names}
    out_dir.mkdir(parents=True, exist_ok=True)
    problems: dict[str, str] = {}
    get = partial(download, config=config, rng=rng, sleep=sleep)
    with locked(out_dir / "fetch"), progress_bar() as bar:
        task = bar.add_task("fetching", total=len(names))
        for name in names:
            bar.update(task, description=f"fetching {name}")
            try:
                skeleton = skeleton_of(Path(name).stem)
                if name != skeleton and skeleton in problems:
                    raise FetchFailed(f"its skeleton {skeleton} is missing")
                _fetch_file(out_dir / name, urls[name], get, redo)
            except FetchFailed as error:
                problems[name] = str(error)
                console.print(f"{_what(name)}: {error}", markup=False, soft_wrap=True)
            bar.advance(task)
    if missing := [trial for trial in trials if f"{trial}.amc" in problems]:
        reasons = "\n".join(f"  {_what(name)}: {said}" for name, said in problems.items())
        raise FetchFailed(
            f"{len(missing)} of {len(trials)} trials missing: {', '.join(missing)}\n{reasons}"
        )
    return out_dir


def plan(
    trials: Sequence[str], out_dir: Path, config: FetchConfig
) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    """A table of what `fetch_trials` would do, without doing or asking anything."""
    record = _recorded(out_dir)
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


def _state(path: Path, record: Mapping[str, FetchedFile]) -> str:
    if not path.is_file():
        return "unfinished" if part_of(path).is_file() else "to do"
    if path.name not in record:
        return "there, not recorded"
    same = sha256_of_file(path) == record[path.name].sha256
    return "done" if same else "there, with another hash"


def _fetch_file(path: Path, url: str, get: Callable[[str, Path], Path], redo: bool) -> None:
    record = _recorded(path.parent, redo=redo)
    state = _state(path, record)
    if state == "done":
        return
    if path.exists() and not redo:
        raise FetchFailed(f"{path} is {state}: move it away, or pass --redo to fetch it again")
    part = get(url, path)
    try:
        _check_content(part, path)
    except BadMotionFile as error:
        drop_part(path)
        said = f"no usable {path.suffix}: {str(error).replace(str(part), path.name)}"
        raise FetchFailed(f"{url}: what the server sent is {said}") from None
    entry = FetchedFile(url=url, size_bytes=part.stat().st_size, sha256=sha256_of_file(part))
    # The record first: a run that is killed in between then fetches the file once more.
    files = record | {path.name: entry}
    Fetched(files=files).write(path.parent / RECORD)
    lines = [f"{file.sha256}  {name}\n" for name, file in sorted(files.items())]
    write_text(path.parent / SUMS, "".join(lines))
    part.replace(path)
    drop_part(path)


def _check_content(part: Path, path: Path) -> None:
    """Read the file as what it should be, so that no error page gets a motion's name."""
    with part.open("rb") as stream:
        start = stream.read(512).lstrip().lower()
    if start.startswith((b"<!doctype", b"<html", b"<?xml")):
        raise BadMotionFile("a web page")
    if path.suffix == ".asf":
        read_asf(part)
    else:  # the rate does not matter; it is given since a .part's name does not tell the subject
        read_amc(part, asf_path=path.with_name(skeleton_of(path.stem)), fps_hz=120.0)


def _recorded(folder: Path, *, redo: bool = False) -> dict[str, FetchedFile]:
    """The fetched files by name; with `redo` a record that can't be read counts for nothing."""
    path = folder / RECORD
    with suppress(BadRecord) if redo else nullcontext():
        return Fetched.read(path).files if path.exists() else {}
    return {}
