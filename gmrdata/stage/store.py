"""Stages: folders that are complete when they exist, and the records that say what made them."""

import errno
import logging
import platform
import shutil
import subprocess
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self, TypeVar

from pydantic import Field, JsonValue

from gmrdata import __version__
from gmrdata.stage.locks import locked
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.values.errors import BadRecord, MissingInput, StaleOutput
from gmrdata.values.files import (
    RECIPE_FILE,
    STAGE_FILE,
    host_word,
    json_text,
    partial_of,
    sha256_of_file,
    sha256_of_path,
    temporary_name,
)
from gmrdata.values.records import Config, Record

RECORDED_PACKAGES = (
    "numpy", "scipy", "torch", "torchvision", "roma", "safetensors", "pycolmap",
    "opencv-python-headless", "bpy", "av",
)  # fmt: skip
LOG = logging.getLogger("gmrdata.stage")
"""Which stage begins, is made or was found; shown by `-v`."""
MOMENT_S = 1.0  # after which a folder is there that another process renames now
AGAIN = "Pass --redo to make it again, or another --out"
FRAMES_ROLE = "images"
"""Of an input that is a folder of frames: folders in it are not read, and may be results."""
FRESH_NS = 2_000_000_000
"""A file that was written so short a time before it was hashed is hashed again [ns]."""


class _Recipe(Record):
    """What decides a stage's result."""

    stage: str
    config: dict[str, JsonValue]
    inputs: dict[str, str]
    """Hex SHA-256 of each file or folder that it read, by role."""

    def differences(self, other: "_Recipe") -> list[str]:
        """Keys whose values differ, with dots between a key and those below it."""
        a, b = (one.model_dump(include={"stage", "config", "inputs"}) for one in (self, other))
        return _differing_keys(a, b)


class RecipeRecord(_Recipe):
    """`recipe.json` of an unfinished folder."""

    format: Literal["gmrdata-recipe/2"] = "gmrdata-recipe/2"
    host: str = Field(default_factory=host_word)
    """Whose process began it."""


class StageRecord(_Recipe):
    """`stage.json` of a finished folder."""

    format: Literal["gmrdata-stage/1"] = "gmrdata-stage/1"
    facts: dict[str, JsonValue]
    """What the stage says of its work that doesn't decide the result, such as the device."""
    gmrdata: str
    git_commit: str | None
    """None where gmrdata was installed."""
    python: str
    packages: dict[str, str]
    """Versions of the packages that decide what bytes come out."""
    seconds: float
    """Wall time of the work; where a killed run's went on, of what was left of it."""

    @classmethod
    def of(cls, stage_dir: Path) -> Self:
        """The record of a finished folder; errors as `read` has them."""
        return cls.read(stage_dir / STAGE_FILE)


Kind = TypeVar("Kind", bound=Record)


class NotMade(Exception):
    """A run that only looks met a stage that has work to do."""

    def __init__(self, out_dir: Path, *, begun: bool = False) -> None:
        super().__init__(out_dir)
        self.begun = begun  # by a killed run, whose costly work goes on


Inputs = Mapping[str, Path | None]
"""Files and folders that a stage reads, by role; None for one that is not asked for."""
Work = Callable[[Path], Mapping[str, Any] | None]
"""Fills the folder that it is given; may return facts for the record that don't decide the result,
such as the device that was used."""


@dataclass(frozen=True)
class Resumable:
    """Work that goes on in a killed run's unfinished folder instead of an empty one.

    It writes each of its files atomically and skips those that are there.
    """

    work: Work
    costly: bool = False
    """Whether what another recipe began, days of a training, stays until --redo is given."""


def run_stage(
    name: str,
    out_dir: Path,
    config: Config,
    inputs: Inputs,
    work: Work | Resumable,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Make `out_dir` by calling `work(partial_dir)`, once.

    `out_dir` appears by one rename after the stage's record was written, so a folder that exists is
    complete.  Called again with the same recipe and content of inputs it does nothing.  The content
    of an input `images` is without the folders in it.

    Raises:
        MissingInput: an input is not there.
        StaleOutput: the folder was made by another recipe, another version or from other inputs, or
            costly work was begun so; or an input is in it.
        NotMade: there is work to do, and the run only looks.
    """
    if run.only_look:
        check_out(name, out_dir, config, inputs, run, work)
        return out_dir
    folder = _behind_link(out_dir)
    _keep_inputs(folder, inputs)
    with locked(folder) as alone:
        hashes = _InputHashes(folder, run)
        recipe = _recipe(name, config, hashes.of(inputs))
        shutil.rmtree(folder.with_name(f".{folder.name}.old"), ignore_errors=True)
        if not folder.exists() or _is_stale(folder, recipe, run):
            partial = _partial_dir(folder, recipe, work, alone, run)
            LOG.info("%s: begins in %s", name, folder)
            _make(folder, recipe, work, partial)
            LOG.info("%s: made in %.1f s", name, stage_seconds(folder))
        else:
            LOG.info("%s: there in %s", name, folder)
        hashes.remember()
    return out_dir


def _behind_link(out_dir: Path) -> Path:
    """The folder that is meant where `out_dir` is a link to it, as to a larger disk: a rename would
    take the link's own place."""
    if not out_dir.name:
        raise StaleOutput(f"{out_dir}: a folder without a name can't be made. Pass another --out")
    return out_dir.resolve() if out_dir.is_symlink() else out_dir


def _keep_inputs(out_dir: Path, inputs: Inputs) -> None:
    """Refuse a folder with an input in it, which would go when the folder is replaced."""
    whole = out_dir.resolve()
    for path in filter(None, inputs.values()):
        if path.resolve().is_relative_to(whole):
            raise StaleOutput(f"{out_dir}: holds {path}, which is read. Pass another --out")


def check_out(
    name: str,
    out_dir: Path,
    config: Config,
    inputs: Inputs,
    run: Run,
    work: Work | Resumable | None = None,
) -> bool:
    """Whether `run_stage` would find its folder complete; StaleOutput for one that it refuses, and
    NotMade for none where the run only looks.

    Nobody is waited for: the folder appears as a whole.  A stage that works for long before it
    calls `run_stage` asks this first.
    """
    folder = _behind_link(out_dir)
    _keep_inputs(folder, inputs)
    hashes = _InputHashes(folder, run)
    if folder.exists() and not _is_stale(folder, _recipe(name, config, hashes.of(inputs)), run):
        hashes.remember()
        return True
    if run.only_look:
        partial, begun = partial_of(folder), False
        if isinstance(work, Resumable) and work.costly and partial.is_dir():  # else not hashed
            begun = _goes_on(partial, _recipe(name, config, hashes.of(inputs)), work, run)
        raise NotMade(out_dir, begun=begun)
    return False


def state_of(look: Callable[[], object]) -> str:
    """What a call that only looks at a stage finds, in a word; errors are its own."""
    try:
        look()
    except NotMade as error:
        return "begun" if error.begun else "to make"
    return "made"


def is_made(
    name: str, out_dir: Path, config: Config, inputs: Inputs, run: Run = DEFAULT_RUN
) -> bool:
    """Whether `run_stage` would find its folder complete; arguments as there."""
    made_by = _read_or_none(StageRecord, out_dir / STAGE_FILE)
    # By name first: only then are the inputs worth hashing.
    if made_by is None or made_by.stage != name:
        return False
    hashes = _InputHashes(_behind_link(out_dir), run)
    return not made_by.differences(_recipe(name, config, hashes.of(inputs)))


def stage_seconds(out_dir: Path) -> float:
    """Wall time that a finished stage took [s]."""
    return StageRecord.of(out_dir).seconds


@cache
def package_versions() -> dict[str, str]:
    """Installed versions of `RECORDED_PACKAGES`; looking them up takes as long as a small stage."""
    versions = {}
    for package in RECORDED_PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            versions[package] = metadata.version(package)
    return versions


def _recipe(name: str, config: Config, hashes: dict[str, str]) -> RecipeRecord:
    return RecipeRecord(stage=name, config=config.model_dump(mode="json"), inputs=hashes)


def _make(out_dir: Path, recipe: RecipeRecord, work: Work | Resumable, partial: Path) -> None:
    resumes = isinstance(work, Resumable)
    try:
        _fill(partial, recipe, work.work if isinstance(work, Resumable) else work)
        _publish(partial, out_dir, recipe)
    except Exception as error:
        # Where no lock reaches, another process may have been first, or taken the folder away.
        if isinstance(error, FileNotFoundError):
            time.sleep(MOMENT_S)
        made = _is_made(out_dir, recipe)
        if made or not resumes or {path.name for path in partial.glob("*")} <= {RECIPE_FILE}:
            shutil.rmtree(partial, ignore_errors=True)  # nothing goes on from it
        if not made:
            if isinstance(error, RuntimeError) and "disk is full" in str(error):  # COLMAP's word
                raise OSError(errno.ENOSPC, str(error), str(partial)) from error
            raise


def _partial_dir(
    out_dir: Path, recipe: RecipeRecord, work: Work | Resumable, alone: bool, run: Run
) -> Path:
    """An empty folder to work in, or that of a killed run whose work can go on.

    Another machine's process may live and write on in the folder that it began: not every disk's
    locks reach so far.  Files of a resumable stage are the same then, each whole; another stage
    works in a folder of its own name.
    """
    partial = partial_of(out_dir)
    begun_by = _read_or_none(RecipeRecord, partial / RECIPE_FILE)
    if isinstance(work, Resumable):
        if not _goes_on(partial, recipe, work, run):
            shutil.rmtree(partial, ignore_errors=True)
    elif alone and (begun_by is None or begun_by.host == recipe.host):
        shutil.rmtree(partial, ignore_errors=True)
    else:
        partial = partial_of(out_dir.with_name(temporary_name(out_dir)))
    partial.mkdir(exist_ok=True)
    return partial


def _goes_on(partial: Path, recipe: RecipeRecord, work: Resumable, run: Run) -> bool:
    """Whether work goes on in what is unfinished; StaleOutput where another recipe's is kept."""
    begun_by = _read_or_none(RecipeRecord, partial / RECIPE_FILE)
    keys = [] if begun_by is None else begun_by.differences(recipe)
    begun = {path.name for path in partial.glob("*")} != {RECIPE_FILE}
    if keys and begun and work.costly and not run.replaces:
        raise StaleOutput(f"{partial}: begun with other values of {', '.join(keys)}. {AGAIN}")
    return begun_by is not None and not keys


def _fill(partial: Path, recipe: RecipeRecord, work: Work) -> None:
    _remove_unfinished(partial)
    # Not forced to the disk, which takes longer than a small stage: torn, it only starts anew.
    (partial / RECIPE_FILE).write_text(json_text(recipe.model_dump(mode="json")))
    start_s = time.monotonic()
    facts = dict(work(partial) or {})
    StageRecord(
        **recipe.model_dump(include={"stage", "config", "inputs"}),
        facts=facts,
        gmrdata=__version__,
        git_commit=git_commit(),
        python=platform.python_version(),
        packages=package_versions(),
        seconds=round(time.monotonic() - start_s, 2),
    ).write(partial / STAGE_FILE)


def _publish(partial: Path, out_dir: Path, recipe: RecipeRecord) -> None:
    (partial / RECIPE_FILE).unlink()
    _remove_unfinished(partial)
    # Two renames, so that at no time a half-deleted folder has the result's name.  The second fails
    # where another process was first.
    retired = out_dir.with_name(f".{out_dir.name}.old")
    if out_dir.exists() and not _is_made(out_dir, recipe):
        out_dir.rename(retired)
    partial.rename(out_dir)
    for left in (retired, partial_of(out_dir)):
        shutil.rmtree(left, ignore_errors=True)


def _remove_unfinished(folder: Path) -> None:
    """Remove what `atomic_path` left for processes that were killed, or that nobody waits for."""
    for leftover in filter(Path.is_file, folder.rglob(".*.tmp*")):
        leftover.unlink(missing_ok=True)


def _is_made(out_dir: Path, recipe: _Recipe) -> bool:
    made_by = _read_or_none(StageRecord, out_dir / STAGE_FILE)
    return made_by is not None and not made_by.differences(recipe)


def _is_stale(out_dir: Path, recipe: RecipeRecord, run: Run) -> bool:
    if out_dir.is_dir() and not any(out_dir.iterdir()):
        return True
    if not (out_dir / STAGE_FILE).is_file():
        # Never deleted, not even with --redo: it could be anybody's folder.
        fault = "is there, and no gmrdata stage made it"
        raise StaleOutput(f"{out_dir}: {fault}. Pass another --out, or move it")
    try:
        keys = StageRecord.of(out_dir).differences(recipe)
        fault = f"made with other values of {', '.join(keys)}" if keys else ""
    except BadRecord as error:
        fault = f"what made it can't be read ({error})"
    if fault and not run.replaces:
        raise StaleOutput(f"{out_dir}: {fault}. {AGAIN}")
    return bool(fault)


def _read_or_none(kind: type[Kind], path: Path) -> Kind | None:
    """A record; None if there is none, or it was cut off, or another version wrote it."""
    try:
        return kind.read(path)
    except (MissingInput, BadRecord):
        return None


def _differing_keys(a: Any, b: Any, prefix: str = "") -> list[str]:
    if not (isinstance(a, dict) and isinstance(b, dict)):
        return [] if a == b else [prefix]
    differing: list[str] = []
    for key in sorted(a.keys() | b.keys()):
        differing += _differing_keys(a.get(key), b.get(key), f"{prefix}.{key}" if prefix else key)
    return differing


@cache
def git_commit() -> str | None:
    """Commit of the checkout that gmrdata runs from, or None for an installed wheel."""
    here, git = Path(__file__).parents[2], shutil.which("git")
    if git is None or not (here / ".git").exists():
        return None
    answer = subprocess.run(
        [git, "-C", str(here), "rev-parse", "HEAD"], capture_output=True, text=True, check=False
    )
    return answer.stdout.strip() or None


class FileState(NamedTuple):
    """What the system says of a file."""

    inode: int
    size_bytes: int
    mtime_ns: int  # when its content was last changed; anybody may set this
    ctime_ns: int  # when the system last changed anything of it; nobody can set this


class KnownFile(NamedTuple):
    """A file's hash, and what the system said of the file then."""

    sha256: str
    state: FileState  # unchanged as long as the content is


class InputsRecord(Record):
    """`.<stage>.inputs` beside a stage's folder: hashes that need not be worked out again."""

    format: Literal["gmrdata-inputs/1"] = "gmrdata-inputs/1"
    files: dict[str, KnownFile]
    """By role, with the path below an input that is a folder."""


_HASHED: dict[tuple[int, FileState], str] = {}
"""What this process has hashed, by device and state: stages that read the same frames share it."""


class _InputHashes:
    """Hashes of a stage's inputs; a file that is as it was when it was hashed is not read again.

    As git does it: size, times and inode stand for the content.  A write within the clock's
    grain of the hashing could leave all of them as they were, so a file is only remembered if it
    was `FRESH_NS` old by then.  What remains is a disk whose clock is wrong by more than that;
    `--redo` believes nothing that an earlier process remembered.
    """

    def __init__(self, out_dir: Path, run: Run) -> None:
        self._out_dir = out_dir.absolute()  # which may lie in an input, and is no part of it
        self._path = out_dir.with_name(f".{out_dir.name}.inputs")
        record = None if run.redo else _read_or_none(InputsRecord, self._path)
        self._earlier = {} if record is None else record.files
        self._known: dict[str, KnownFile] = {}

    def of(self, inputs: Inputs) -> dict[str, str]:
        """Hex SHA-256 of each input, by role."""
        there = {role: path for role, path in inputs.items() if path is not None}
        return {role: self._of_input(role, there[role]) for role in sorted(there)}

    def remember(self) -> None:
        """Keep what was found for the next process.  It only saves time, so it may fail."""
        if self._known != self._earlier:
            with suppress(OSError):
                InputsRecord(files=self._known).write(self._path)

    def _of_input(self, role: str, path: Path) -> str:
        def hash_file(file: Path) -> str:
            return self._of_file(role + str(file)[len(str(path)) :], file)

        return sha256_of_path(path, hash_file, is_flat=role == FRAMES_ROLE, without=self._out_dir)

    def _of_file(self, key: str, file: Path) -> str:
        if not file.is_file():
            return sha256_of_file(file)  # which says what is missing
        device, state = file_state(file)
        earlier = self._earlier.get(key)
        if earlier is not None and earlier.state == state:
            self._known[key] = earlier
            return earlier.sha256
        began_ns = time.time_ns()
        digest = _HASHED.get((device, state)) or sha256_of_file(file)
        is_old = max(state.mtime_ns, state.ctime_ns) < began_ns - FRESH_NS
        if is_old and file_state(file) == (device, state):
            _HASHED[device, state] = digest
            self._known[key] = KnownFile(digest, state)
        return digest


def file_state(file: Path) -> tuple[int, FileState]:
    """Its device, and what stays as long as the content does."""
    stat = file.stat()
    state = FileState(stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns)
    return stat.st_dev, state
