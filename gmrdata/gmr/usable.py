"""Clips of a manifest that can be trained on or scored."""

from dataclasses import dataclass
from pathlib import Path

from gmrdata.body.model import BodyModel
from gmrdata.clip import Clip
from gmrdata.errors import BadManifest
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


def usable_clips(path: Path) -> UsableClips:
    """Load the clips of a manifest, except those that its quality record rejects.

    Raises:
        MissingInput: the manifest or a clip's file is not there.
        BadManifest: the manifest is broken, or only a list.
        BadMotionFile: a clip's file is broken.
    """
    manifest = read_manifest(path)
    if isinstance(manifest, ListManifest):
        raise BadManifest(f"{path}: only lists clips and has no files. Make the clips first")
    clips, skipped = [], {}
    for entry in manifest.clips:
        if entry.quality is not None and entry.quality.verdict == "rejected":
            skipped[entry.id] = "rejected: " + "; ".join(entry.quality.reasons)
        else:
            clips.append(UsableClip(load_entry(path, entry), entry.camera_motion))
    return UsableClips(tuple(clips), skipped)


def check_clips_fit(clips: list[Clip], body: BodyModel) -> None:
    """Refuse clips of another body, or that are not in the world.

    Raises:
        BadManifest: there is such a clip, or no clip at all.
    """
    if not clips:
        raise BadManifest("no usable clips. Give manifests with clips that are not rejected")
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
