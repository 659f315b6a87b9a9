"""Which videos a batch is of, what each is called, and which poses are whose, by their names."""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gmrdata.read.frames import IMAGE_SUFFIXES
from gmrdata.read.systems.result import result_file
from gmrdata.values.errors import BadRecipe, MissingInput, some

VIDEO_SUFFIXES = (
    ".mp4", ".m4v", ".mov", ".qt", ".3gp", ".3g2", ".mkv", ".webm", ".avi", ".flv", ".wmv", ".asf",
    ".mpg", ".mpeg", ".m2v", ".vob", ".ts", ".mts", ".m2ts", ".mxf", ".ogv", ".ogm", ".dv", ".ivf",
    ".y4m",
)  # fmt: skip
"""Names of files that are taken for videos in a folder; a file that is named may have any."""
POSES_SUFFIXES = (".pkl", ".pt", ".npz")
LONGEST_NAME_BYTES = 150
MAX_LISTED = 5


@dataclass(frozen=True)
class NamedVideo:
    """One video of a batch."""

    name: str
    path: Path  # a video file, or a folder of numbered images; absolute
    poses_path: Path | None = None  # of its people; None for cameras alone


@dataclass(frozen=True)
class FoundVideos:
    """The videos of a batch, in the order of their names, and what was passed over."""

    videos: tuple[NamedVideo, ...]
    remarks: tuple[str, ...]


def find_videos(sources: Sequence[Path]) -> FoundVideos | None:
    """The videos of several sources, or of a folder of video files; None for one video alone.

    A source is a video file, a folder of numbered images, or a folder with video files, whose own
    folders are not entered.  A video is called as its file without the suffix, or as its folder.

    Raises:
        MissingInput: a source is not there.
        BadRecipe: a folder holds both kinds, two videos have one name, or a name can't be one.
    """
    listed = [_videos_in(source) for source in sources]
    if len(sources) == 1 and listed[0] is None:
        return None
    paths, remarks = [], []
    for source, (files, others) in zip(sources, (one or ([], []) for one in listed), strict=True):
        paths += files or [source]
        if others:
            what = f"{len(others)} that are not named as videos are left out"
            remarks.append(f"{source}: {what}: {some(others, MAX_LISTED)}")
    named: dict[str, Path] = {}
    for path in dict.fromkeys(map(_absolute, paths)):
        name = _name_of(path)
        if (other := named.setdefault(name, path)) != path:
            what = f"{other} and {path} would both be video {name}"
            raise BadRecipe(f"{what}. Rename one, or solve them into two folders")
    videos = tuple(NamedVideo(name, named[name]) for name in sorted(named))
    return FoundVideos(videos, tuple(remarks))


def _videos_in(source: Path) -> tuple[list[Path], list[str]] | None:
    """A folder's video files and the names of what else it holds; None for what is one video."""
    if not source.exists():
        raise MissingInput(f"{source}: no such video, or folder of images or videos")
    if not source.is_dir():
        return None
    entries = sorted(path for path in source.iterdir() if not path.name.startswith("."))
    videos = [path for path in entries if _is_file_of(path, VIDEO_SUFFIXES)]
    if not videos:
        return None
    images = [path for path in entries if _is_file_of(path, IMAGE_SUFFIXES)]
    if images:
        both = f"holds videos ({videos[0].name}) and images ({images[0].name})"
        remedy = "Put them into two folders, or name the videos one by one"
        raise BadRecipe(f"{source}: {both}. {remedy}")
    return videos, [path.name for path in entries if path not in set(videos)]


def _is_file_of(path: Path, suffixes: Collection[str]) -> bool:
    return path.suffix.lower() in suffixes and path.is_file()


def _absolute(path: Path) -> Path:
    """A link keeps its name."""
    return path.resolve() if path.name in ("", "..") else path.absolute()


def _name_of(path: Path) -> str:
    """A name that can be a folder's on every disk, and stand in records and pages."""
    name = path.name if path.is_dir() else path.stem
    try:
        n_bytes = len(name.encode())
    except UnicodeEncodeError:
        n_bytes = 0  # bytes that are no text
    odd = name.startswith(".") or name.endswith((".", ".partial")) or "\\" in name
    if not 0 < n_bytes <= LONGEST_NAME_BYTES or odd or re.search(r"[\0-\x1f\x7f]", name):
        what = f"{str(path)!r}: {name!r} can't be the name of a video's folder"
        remedy = f"Use letters and digits, {LONGEST_NAME_BYTES} bytes at most"
        raise BadRecipe(f"{what}. Rename it. {remedy}")
    return name


def with_poses(found: FoundVideos, folder: Path) -> FoundVideos:
    """Videos with the poses that a folder holds under their names.

    An entry is `<name>.pkl`, `.pt` or `.npz`, PHALP's `demo_<name>.pkl`, or a folder `<name>` as
    TRAM leaves it, or as `result_file` takes it.  Remarks name the videos without poses,
    which end in cameras alone, and the poses without a video.

    Raises:
        BadRecipe: no folder, or two entries for one video.
        MissingInput: it holds poses of none of the videos.
        BadMotionFile: as `result_file`.
    """
    if not folder.is_dir():
        what = "the poses of several videos are a folder with <name>.pkl or a folder for each"
        raise BadRecipe(f"--poses {folder}: {what}. Give that, or one video alone")
    entries = _poses_in(folder)
    videos = [
        replace(v, poses_path=entries.pop(v.name, None) or entries.pop(f"demo_{v.name}", None))
        for v in found.videos
    ]
    without = [video.name for video in videos if video.poses_path is None]
    if len(without) == len(videos):
        like = f"Name them as the videos, like {videos[0].name}.pkl or {videos[0].name}/"
        raise MissingInput(f"{folder}: holds poses of none of the {len(videos)} videos. {like}")
    remarks = list(found.remarks)
    if without:
        what = f"{len(without)} of {len(videos)} videos have no poses and end in cameras alone"
        remarks.append(f"{folder}: {what}: {some(without, MAX_LISTED)}")
    if entries:
        what = "poses that belong to no video"
        remarks.append(f"{folder}: {what}: {some(sorted(entries), MAX_LISTED)}")
    return FoundVideos(tuple(videos), tuple(remarks))


def _poses_in(folder: Path) -> dict[str, Path]:
    """A folder's poses by the name of their video; absolute paths."""
    named: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") or not (path.is_dir() or _is_file_of(path, POSES_SUFFIXES)):
            continue
        name = path.name if path.is_dir() else path.stem
        if (other := named.setdefault(name, path)) != path:
            raise BadRecipe(f"{other} and {path} are both poses of video {name}. Leave one there")
    return {name: result_file(path.absolute()) for name, path in named.items()}
