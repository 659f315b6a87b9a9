"""Clips of a manifest that can be trained on or scored."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import overload

from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip
from gmrdata.errors import BadManifest
from gmrdata.manifest.current import Clip as ClipEntry
from gmrdata.manifest.current import ListManifest
from gmrdata.manifest.read import load_entry, read_manifest


@dataclass(frozen=True, eq=False)
class UsableClip:
    """A clip with what the manifest says of its camera."""

    clip: Clip
    """The clip."""
    camera_motion: str
    """Class of the camera's motion; "none" without a camera."""


@dataclass(frozen=True, eq=False)
class UsableClips:
    """What a manifest offers."""

    clips: tuple[UsableClip, ...]
    """Clips that the manifest vouches for."""
    skipped: dict[str, str]
    """Reason by id of those that it does not."""


@dataclass(frozen=True)
class ClipFile:
    """A clip that the manifest vouches for, still on disk."""

    manifest_path: Path
    """The manifest."""
    entry: ClipEntry
    """What it says of the clip."""

    def load(self) -> Clip:
        """Read the clip; errors as in `usable_clips`."""
        return load_entry(self.manifest_path, self.entry)


class LazyClips(Sequence[Clip]):
    """Clips that are read from disk each time that they are asked for, and not kept: a set may be
    larger than the memory."""

    def __init__(self, files: Sequence[ClipFile]) -> None:
        self._files = files

    def __len__(self) -> int:
        return len(self._files)

    @overload
    def __getitem__(self, index: int) -> Clip: ...
    @overload
    def __getitem__(self, index: slice) -> "LazyClips": ...
    def __getitem__(self, index: int | slice) -> "Clip | LazyClips":
        if isinstance(index, slice):
            return LazyClips(self._files[index])
        return self._files[index].load()


def usable_files(path: Path) -> tuple[list[ClipFile], dict[str, str]]:
    """The clips of a manifest that its quality record does not reject, and why by id for the rest.

    Raises:
        MissingInput: the manifest is not there.
        BadManifest: the manifest is broken, or only a list.
    """
    manifest = read_manifest(path)
    if isinstance(manifest, ListManifest):
        raise BadManifest(f"{path}: only lists clips and has no files. Make the clips first")
    files, skipped = [], {}
    for entry in manifest.clips:
        if entry.quality is not None and entry.quality.verdict == "rejected":
            skipped[entry.id] = "rejected: " + "; ".join(entry.quality.reasons)
        else:
            files.append(ClipFile(path, entry))
    return files, skipped


def usable_clips(path: Path) -> UsableClips:
    """Load the clips of a manifest, except those that its quality record rejects.

    Raises:
        MissingInput: the manifest or a clip's file is not there.
        BadManifest: the manifest is broken, or only a list.
        BadMotionFile: a clip's file is broken.
    """
    files, skipped = usable_files(path)
    clips = tuple(UsableClip(file.load(), file.entry.camera_motion) for file in files)
    return UsableClips(clips, skipped)


def check_clips_fit(clips: Iterable[Clip], body: BodyModel) -> None:
    """Refuse clips of another body, or that are not in the world.

    Raises:
        BadManifest: there is such a clip, or no clip at all.
    """
    for _ in fitting_clips(clips, body):
        pass


def fitting_clips(clips: Iterable[Clip], body: BodyModel) -> Iterator[Clip]:
    """The clips one by one, each checked as `check_clips_fit` does when its turn comes."""
    clip = None
    for clip in clips:
        if clip.motion.frame != "world":
            raise BadManifest(
                f"clip {clip.id}: its motion is in the camera's frame, which moves. Give clips in"
                " the world frame"
            )
        if clip.motion.body != body.name or clip.motion.shape.shape != (body.n_shape,):
            raise BadManifest(
                f"clip {clip.id}: of body {clip.motion.body} with {clip.motion.shape.size} shape"
                f" coefficients, but the given body is {body.name} with {body.n_shape}."
                " Give the clips' own body"
            )
        yield clip
    if clip is None:
        raise BadManifest("no usable clips. Give manifests with clips that are not rejected")
