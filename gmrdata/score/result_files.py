"""Where other systems' results lie in a folder: by names, as systems and users leave them.

A result is of a clip when its file, or the folder that it lies in, is named after the clip's id or
the clip's sequence.  In a folder of that name the systems' own file names are looked for.  Where a
manifest has one sequence, the systems' own files may lie in the folder itself.  Each of the
folder's own folders may hold a set of results by the same rules: a system, or a version of one.
"""

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path

from gmrdata.read.systems.result import POSES_FILES, read_system
from gmrdata.read.systems.slahmr import RUN, SLAHMR_FILE
from gmrdata.read.systems.tram import HPS_FOLDER, is_tram_folder
from gmrdata.values.clip import CLIP_FORMAT
from gmrdata.values.errors import BadMotionFile, MissingInput
from gmrdata.values.files import npz_format
from gmrdata.values.people import EstimatedPeople

SUFFIXES = (".npz", ".pkl", ".pt")
PHALPS = "demo_"  # what PHALP puts before the video's name
SLAHMR_PHASES = ("motion_refine", "motion_chunks", "smooth_fit", "smpl_fit", "root_fit", ".")
"""SLAHMR's folders of results, the last phase of its optimization first."""
COMPARISON = "comparison"
"""Folder of the comparison beside those of the sets, so no set has this name."""
RULES = "docs/scores.md says how files are named"


@dataclass(frozen=True)
class ClipName:
    """What results of a clip may be named after."""

    id: str
    sequence: str
    person: str = ""  # which person of the sequence it is; the same for parts of one take
    n_people: int = 1  # how many people of the sequence the manifest has

    def names(self) -> tuple[str, ...]:
        """Names of files and folders: never a path, whatever a manifest calls a sequence."""
        last = re.split(r"[/\\]", self.sequence)[-1]
        return tuple(dict.fromkeys(name for name in (self.id, last) if name not in ("", ".", "..")))


@dataclass(frozen=True, eq=False)
class ResultSet:
    """The results of one system, or of one version of it."""

    name: str
    system: str
    results: Mapping[str, EstimatedPeople]  # by the clip's id
    by_id: frozenset[str]  # clips whose id, not only their sequence, the file or folder is named by


@dataclass(frozen=True)
class ClipFolder:
    """A folder with `<clip id>.npz` of gmrdata's own, as `predictions.file_clip` reads them."""

    name: str
    folder: Path


def find_result_sets(
    path: Path, clips: Sequence[ClipName], others: Sequence[ClipName] = ()
) -> list[ResultSet | ClipFolder]:
    """The sets of results of some clips in a folder, or a single file, by name.

    Results of other systems are read; of gmrdata's own, folders are named.  MissingInput where
    there is none, BadMotionFile where two results are of one clip and system.  `others` are the
    manifest's clips whose results are not wanted.
    """
    if not path.exists():
        raise MissingInput(f"{path}: no such file or folder of predictions")
    if npz_format(path) == CLIP_FORMAT:
        remedy = "Name it by the clip's id, and give the folder that it is in"
        raise BadMotionFile(f"{path}: a clip of gmrdata's own. {remedy}")
    read: dict[Path, EstimatedPeople] = {}
    sequences: dict[Path, str] = {}
    sets: dict[tuple[Path, str], dict[str, EstimatedPeople]] = defaultdict(dict)
    by_id: set[tuple[Path, str]] = set()
    for root, clip, file in _candidates(path, clips, others):
        result = read[file] if file in read else read_system(file, "world")
        read[file] = result
        if sequences.setdefault(file, clip.sequence) != clip.sequence:
            both = f"{sequences[file]} and {clip.sequence}"
            raise BadMotionFile(
                f"{file}: named after two sequences, {both}. Name it by a clip's id"
            )
        of_system = sets[root, result.system]
        if (other := of_system.get(clip.id)) and other is not result:
            both = f"{other.files[0]} and {result.files[0]}"
            raise BadMotionFile(
                f"{path}: {both} are both {result.system}'s of clip {clip.id}. Keep one"
            )
        of_system[clip.id] = result
        if _is_named(file.relative_to(root.parent), clip.id):
            by_id.add((root, clip.id))
    own = _clip_folders(path, clips)
    if not sets and not own:
        named = ", ".join(clips[0].names()) if clips else "no clip"
        raise MissingInput(
            f"{path}: no result named after a clip or its sequence ({named}); {RULES}"
        )
    return _distinct(path, [*_named(path, sets, by_id), *own])


def _clip_folders(path: Path, clips: Sequence[ClipName]) -> list[ClipFolder]:
    """The folder and those in it that hold clips, or a folder `predictions` with clips."""
    if not path.is_dir():
        return []
    folders = []
    for folder in (path, *(one for one in sorted(path.iterdir()) if one.is_dir())):
        for made in (folder, folder / "predictions"):
            if any(npz_format(made / f"{clip.id}.npz") == CLIP_FORMAT for clip in clips):
                full = made.resolve()
                name = full.parent.name if full.name == "predictions" else full.name
                folders.append(ClipFolder(name, made))
    return list({one.folder: one for one in folders}.values())


def _distinct(path: Path, sets: Sequence[ResultSet | ClipFolder]) -> list[ResultSet | ClipFolder]:
    """The sets in the order of their names, which must tell them apart."""
    names = [one.name for one in sets]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise BadMotionFile(f"{path}: two sets of results are called {twice[0]}. Rename a folder")
    if len(names) > 1 and COMPARISON in names:
        raise BadMotionFile(f"{path / COMPARISON}: a set can't be called so. Rename the folder")
    return sorted(sets, key=lambda one: one.name)


def _named(
    path: Path,
    people_of: Mapping[tuple[Path, str], Mapping[str, EstimatedPeople]],
    by_id: Set[tuple[Path, str]],
) -> list[ResultSet]:
    """Sets named after their system, or after their folder where that says more."""
    sets = []
    for (root, system), results in people_of.items():
        several = sum(other == root for other, _ in people_of) > 1
        own = root == path or root.name in (system, "smpl") or path.is_file()
        name = system if own else f"{root.name}-{system}" if several else root.name
        named = frozenset(id for id in results if (root, id) in by_id)
        sets.append(ResultSet(name, system, results, named))
    return sets


def _candidates(
    path: Path, clips: Sequence[ClipName], others: Sequence[ClipName]
) -> Iterator[tuple[Path, ClipName, Path]]:
    """Folder of the set, clip, and file or folder of its result."""
    listed = (*clips, *others)
    one_sequence = len({clip.sequence for clip in listed}) == 1
    if path.is_file() or (one_sequence and is_tram_folder(path)):
        for clip in clips:
            if one_sequence or any(_is_named(Path(path.name), name) for name in clip.names()):
                yield path, clip, path
        return
    taken = {name for clip in listed for name in clip.names()} | {HPS_FOLDER}
    inside = [
        one
        for one in sorted(path.iterdir())
        if one.is_dir() and one.name not in taken and not any(_is_run(one.name, n) for n in taken)
    ]
    for root in (path, *inside):
        own = list(_own_files(root)) if one_sequence else []
        runs = [one for one in sorted(root.glob("*-shot-*")) if one.is_dir()]
        for clip in clips:
            files = [file for name in clip.names() for file in _of_name(root, name, runs)]
            yield from ((root, clip, file) for file in dict.fromkeys([*files, *own]))


def _of_name(root: Path, name: str, runs: Sequence[Path]) -> Iterator[Path]:
    """The results in a folder that are named so; `runs` are those of SLAHMR's in it."""
    if root.name == "camera" and (root.with_name("smpl") / f"{name}.npz").is_file():
        return  # TRAM's cameras, which are read beside its people
    for file_name in (*(f"{name}{suffix}" for suffix in SUFFIXES), f"{PHALPS}{name}.pkl"):
        file = root / file_name
        if file.is_file() and npz_format(file) != CLIP_FORMAT:
            yield file
    if (root / name).is_dir():
        yield from _own_files(root / name)
    for run in runs:
        if _is_run(run.name, name):
            yield from _slahmr_files(run)


def _is_named(file: Path, name: str) -> bool:
    """Whether a result, or a folder that it is in, is named so, by its user or by its system."""
    named = name in (*file.parts, file.stem, file.stem.removeprefix(PHALPS))
    return named or any(_is_run(folder, name) for folder in file.parts)


def _is_run(folder: str, sequence: str) -> bool:
    """Whether a folder is named as SLAHMR names its runs of a sequence."""
    after = folder.removeprefix(sequence)
    return after != folder and re.fullmatch(RUN, after) is not None


def _own_files(folder: Path) -> Iterator[Path]:
    """What a folder holds under the systems' own names."""
    yield from (folder / name for name in POSES_FILES if (folder / name).is_file())
    if is_tram_folder(folder):
        yield folder
    yield from _slahmr_files(folder)


def _slahmr_files(folder: Path) -> list[Path]:
    """The result of SLAHMR's last phase and last step."""
    for phase in SLAHMR_PHASES:
        steps = {
            int(match[1]): file
            for file in (folder / phase).glob("*_world_results.npz")
            if (match := SLAHMR_FILE.fullmatch(file.name))
        }
        if steps:
            return [steps[max(steps)]]
    return []
