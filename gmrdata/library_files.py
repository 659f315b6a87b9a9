"""Which motion files go into a library of clips, and what each clip is called."""

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from gmrdata.errors import BadRecipe, MissingInput
from gmrdata.manifest.current import Source
from gmrdata.motion.read import find_motions
from gmrdata.sources import motion_source

LONGEST_ID = 150


@dataclass(frozen=True)
class LibraryFile:
    """A motion file and its clip's names."""

    path: Path
    """The file."""
    id: str
    """Id of the clip."""
    source: Source
    """What the manifest says of its origin."""


def library_files(sources: tuple[Path, ...]) -> list[LibraryFile]:
    """The motion files among files and folders, each once.

    A clip is called as its file.  An .npz that was found in a folder has its folders in the name
    as well, `CMU.01.01_01_poses`, since AMASS's data sets repeat the names of files; so has any
    file whose name another one has too.

    Raises:
        MissingInput: nothing is given, or a folder is not there or holds no motion file.
        BadRecipe: two files would make clips of one name.
    """
    if not sources:
        raise MissingInput("nothing given. Name motion files or folders of them")
    found = [
        (path, path.relative_to(source) if source.is_dir() else Path(path.name))
        for source in sources
        for path in (_in_folder(source) if source.is_dir() else [source])
    ]
    once = {path.resolve(): (path, inside) for path, inside in reversed(found)}
    found = list(reversed(once.values()))
    stems = Counter(path.stem for path, _ in found)
    files = []
    for path, inside in found:
        with_folders = path.suffix.lower() == ".npz" or stems[path.stem] > 1
        name = ".".join(inside.with_suffix("").parts) if with_folders else path.stem
        files.append(LibraryFile(path, clip_id(name), motion_source(path, _tail(path, inside))))
    by_id: dict[str, Path] = {}
    for file in files:
        other = by_id.setdefault(file.id, file.path)
        if other is not file.path:
            raise BadRecipe(
                f"{other} and {file.path} would both be clip {file.id}. Give the folder that holds"
                " both, or import them into two folders"
            )
    return files


def clip_id(name: str) -> str:
    """A name with the letters that a clip's id may have; AMASS has files with spaces."""
    plain = re.sub(r"[^A-Za-z0-9_.-]+", "_", name)[-LONGEST_ID:]
    return plain if re.match(r"[A-Za-z0-9_]", plain) else f"_{plain}"


def _in_folder(folder: Path) -> list[Path]:
    found = find_motions(folder)
    if not found:
        raise MissingInput(f"{folder}: holds no .bvh, .amc or .npz with a motion")
    return found


def _tail(path: Path, inside: Path) -> PurePosixPath:
    """The last three parts of a file's path, as far as they lie in the folder that was given or are
    that folder's name: data set, subject and trial in AMASS."""
    n_inside = len(inside.parts)
    given = (path.resolve().parents[n_inside - 1].name,) if n_inside > 1 else ()
    return PurePosixPath(*(*given, *inside.parts)[-3:])
