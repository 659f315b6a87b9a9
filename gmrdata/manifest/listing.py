"""Listings: the hashes of a folder of many files, as a text file beside it.

A line is `sha256 <tab> size in bytes <tab> path relative to the folder`; lines are sorted by path,
UTF-8, without a head line.
`cut -f1,3 --output-delimiter='  ' LISTING | sha256sum -c` checks a folder from inside.
"""

import re
from dataclasses import dataclass
from pathlib import Path

from gmrdata.manifest.current import ClipEntry, FileRecord, FolderRecord
from gmrdata.stage.progress import track
from gmrdata.values import files as disk
from gmrdata.values.errors import BadManifest, MissingInput
from gmrdata.values.files import resolve_inside, sha256_of_file

_LINE = re.compile(r"([0-9a-f]{64})\t(0|[1-9][0-9]{0,17})\t(.+)")
RECORDS = (disk.STAGE_FILE, "masks.json")
"""Files at the top of a folder that are about the folder, and no part of what it holds."""
BAR_FROM = 200  # folders with more files than this show a progress bar
FOLDERS = ("images", "masks", "depth", "normals", "flow", "instances")
FILES = ("joints", "video", "character")


def folders_of(clip: ClipEntry) -> dict[str, FolderRecord]:
    """A clip's folders by field."""
    return {field: folder for field in FOLDERS if (folder := getattr(clip, field)) is not None}


def files_of(clip: ClipEntry) -> dict[str, FileRecord]:
    """A clip's files besides its arrays, by field."""
    files = {field: file for field in FILES if (file := getattr(clip, field)) is not None}
    return files | {f"extras[{n}].arrays": extra.arrays for n, extra in enumerate(clip.extras)}


@dataclass(frozen=True)
class ListedFile:
    path: str  # relative to the folder, with forward slashes
    size_bytes: int
    sha256: str


def file_record(root: Path, path: Path) -> FileRecord:
    """Hash a file below `root`."""
    relative = relative_to_root(root, path)
    digest = sha256_of_file(path)
    return FileRecord(path=relative, size_bytes=path.stat().st_size, sha256=digest)


def folder_record(root: Path, folder: Path) -> FolderRecord:
    """Hash every file of a folder below `root`, also in its sub-folders, and write the listing,
    named after the folder because clips of several manifests may share it."""
    relative = relative_to_root(root, folder)
    listing = root / "listings" / f"{relative}.tsv"
    if listing.resolve().is_relative_to(folder.resolve()):
        raise BadManifest(f"{listing}: a listing must lie outside the folder that it lists")
    names = files_below(folder)
    if not names:
        raise MissingInput(f"{folder}: no files here to list")
    shown = track(names, f"hashing {relative}") if len(names) > BAR_FROM else names
    files = [_hashed(folder, name) for name in shown]
    text = "".join(f"{file.sha256}\t{file.size_bytes}\t{file.path}\n" for file in files)
    if not listing.is_file() or listing.read_text(encoding="utf-8") != text:
        disk.write_text(listing, text)
    return FolderRecord(
        folder=relative,
        count=len(files),
        size_bytes=sum(file.size_bytes for file in files),
        listing=file_record(root, listing),
    )


def read_listing(path: Path) -> list[ListedFile]:
    """Read a listing, whose paths must be safe, in order, and there once."""
    try:
        rows = path.read_bytes().decode("utf-8").split("\n")
    except UnicodeDecodeError:
        raise BadManifest(f"{path}: not UTF-8 text") from None
    if rows.pop() != "":
        raise BadManifest(f"{path}: the last line has no end, the listing is truncated")
    files: list[ListedFile] = []
    for number, row in enumerate(rows, start=1):
        match = _LINE.fullmatch(row)
        if match is None:
            raise BadManifest(f"{path}:{number}: not 'sha256 <tab> size <tab> path'")
        try:
            name = disk.safe_relative(match[3])
        except ValueError as error:
            raise BadManifest(f"{path}:{number}: {error}") from None
        if files and name <= files[-1].path:
            raise BadManifest(f"{path}:{number}: {name} is repeated or out of order")
        files.append(ListedFile(name, int(match[2]), match[1]))
    return files


def files_below(folder: Path) -> list[str]:
    """Sorted relative paths of all files below a folder but `RECORDS` and hidden ones; links are
    not entered."""
    if not folder.is_dir():
        raise MissingInput(f"{folder}: no such folder")
    real = folder.resolve()
    files = (p.relative_to(real) for p in real.rglob("*") if not p.is_dir() or p.is_symlink())
    return sorted(p.as_posix() for p in files if str(p) not in RECORDS and not disk.is_hidden(p))


def relative_to_root(root: Path, path: Path) -> str:
    """`path` relative to `root`, with forward slashes; an error where a link leads out of it."""
    try:
        relative = path.absolute().relative_to(root.absolute()).as_posix()
        _listable(root, relative)
    except ValueError as error:
        raise BadManifest(
            f"{disk.as_text(path)}: can't be listed by a manifest in {root} ({error}); "
            "write the manifest to a folder above its files"
        ) from None
    return relative


def _hashed(folder: Path, name: str) -> ListedFile:
    try:
        file = _listable(folder, name)
    except ValueError as error:
        raise BadManifest(f"{folder}: {error}") from None
    return ListedFile(name, file.stat().st_size, sha256_of_file(file))


def _listable(root: Path, relative: str) -> Path:
    """As `resolve_inside`; ValueError also for a name whose bytes no text can hold."""
    if (text := disk.as_text(relative)) != relative:
        raise ValueError(f"the bytes of {text} are no UTF-8; rename it")
    return resolve_inside(root, relative)
