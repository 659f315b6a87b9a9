"""Trials of the CMU motion capture database, fetched file by file, complete or not at all."""

import shlex
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from gmrdata.manifest.read import published_list
from gmrdata.read.amc import read_amc, read_asf
from gmrdata.read.download import FetchConfig, Wanted, fetch_files, folder_address
from gmrdata.read.source_motion import is_trial
from gmrdata.stage.locks import locked
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
    trials = [row.source.sequence for row in published_list(name) if row.source.dataset == "CMU"]
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
    file_url(config.base_url, "01.asf")  # an address that is none is told before a folder is made
    with locked(out_dir / "fetch"):
        wanted = wanted_trials(trials, out_dir, config, redo=redo)
        problems = fetch_files(wanted, config, rng, sleep, redo)
    if missing := [trial for trial in trials if f"trial {trial}" in problems]:
        reasons = "\n".join(f"  {title}: {said}" for title, said in problems.items())
        raise FetchFailed(
            f"{len(missing)} of {len(trials)} trials missing: {', '.join(missing)}\n{reasons}"
        )
    return out_dir


def wanted_trials(
    trials: Sequence[str], out_dir: Path, config: FetchConfig, *, redo: bool = False
) -> list[Wanted]:
    """The files of `fetch_trials`, each skeleton before the first of its trials."""
    record = _recorded(out_dir, redo=redo)

    def file(title: str, name: str, needs: str = "") -> Wanted:
        path, url = out_dir / name, file_url(config.base_url, name)
        sha256 = record[name].sha256 if name in record else None
        return Wanted(title, path, url, sha256, partial(_accept, path, url, redo), needs)

    files: dict[str, Wanted] = {}
    for trial in check_trials(trials):
        skeleton = skeleton_of(trial)
        files.setdefault(skeleton, file(f"skeleton {skeleton}", skeleton))
        files[trial] = file(f"trial {trial}", f"{trial}.amc", f"skeleton {skeleton}")
    return list(files.values())


def _accept(path: Path, url: str, redo: bool, part: Path) -> None:
    try:
        _check_content(part, path)
    except BadMotionFile as error:
        said = f"no usable {path.suffix}: {str(error).replace(str(part), path.name)}"
        raise FetchFailed(f"{url}: what the server sent is {said}") from None
    # The record first: a run that is killed in between then fetches the file once more.
    entry = FetchedFile(url=url, size_bytes=part.stat().st_size, sha256=sha256_of_file(part))
    files = _recorded(path.parent, redo=redo) | {path.name: entry}
    Fetched(files=files).write(path.parent / RECORD)
    lines = [f"{file.sha256}  {name}\n" for name, file in sorted(files.items())]
    write_text(path.parent / SUMS, "".join(lines))


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
