"""Which clips of a recipe can be rendered: those whose motion is there."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from gmrdata import resources
from gmrdata.errors import BadRecipe
from gmrdata.geometry.programmes import Circular, Linear, LinearPanning, Panning, Programme, Small
from gmrdata.manifest.current import CameraMotion, ListManifest
from gmrdata.manifest.read import read_manifest
from gmrdata.motion.read import find_motions
from gmrdata.synthetic.recipe import SyntheticClip, SyntheticRecipe

PROGRAMMES: dict[str, Programme] = {
    "circular": Circular(),
    "linear": Linear(),
    "linear_panning": LinearPanning(),
    "panning": Panning(),
    "small": Small(),
}
"""What a published list's class of camera motion is rendered with."""


@dataclass(frozen=True)
class Take:
    """One clip to render: a clip of the recipe, or its twin with the camera's motion off."""

    id: str
    """Name of the clip in the manifest."""
    clip: SyntheticClip
    """The recipe's clip."""
    camera_off: bool = False
    """Whether this is the twin."""

    @property
    def camera_motion(self) -> CameraMotion:
        """Class of the camera's motion."""
        return "static" if self.camera_off else self.clip.programme.kind


@dataclass(frozen=True)
class Selection:
    """The clips of a recipe that can be rendered, and those whose motion is not there."""

    takes: tuple[Take, ...]
    """A clip's twin follows it."""
    files: dict[str, Path]
    """Motion file by trial."""
    missing: tuple[str, ...]
    """Trials without a file."""


def select(recipe: SyntheticRecipe, motions_dir: Path | None) -> Selection:
    """Find the motion files of a recipe's clips."""
    wanted = (*_listed(recipe.published_list), *recipe.clips)
    if not wanted:
        raise BadRecipe(f"recipe {recipe.name}: no clips; give `clips` or `published_list`")
    files = {} if motions_dir is None else {path.stem: path for path in find_motions(motions_dir)}
    there = tuple(clip for clip in wanted if clip.trial is None or clip.trial in files)
    missing = tuple(clip.trial for clip in wanted if clip.trial and clip.trial not in files)
    return Selection(_takes(there, recipe.camera_off), files, missing)


def _takes(clips: tuple[SyntheticClip, ...], camera_off: bool) -> tuple[Take, ...]:
    takes = []
    for clip in clips:
        takes.append(Take(clip.id, clip))
        if camera_off and clip.programme.kind != "static":
            takes.append(Take(f"{clip.id}_off", clip, camera_off=True))
    repeated = sorted(id for id, n in Counter(take.id for take in takes).items() if n > 1)
    if repeated:
        raise BadRecipe(
            f"clip ids must be unique, but these are repeated: {', '.join(repeated)}; "
            "rename clips (camera_off adds _off to each)"
        )
    return tuple(takes)


def _listed(name: str | None) -> list[SyntheticClip]:
    if name is None:
        return []
    published = read_manifest(resources.published_manifest(name))
    if not isinstance(published, ListManifest):
        raise BadRecipe(f"published_list: {name} is no list of trials")
    return [
        SyntheticClip(
            id=row.id,
            trial=row.source.sequence,
            programme=PROGRAMMES[row.programme],
            duration_s=row.frames.stop / row.fps_hz,
        )
        for row in published.clips
        if row.programme in PROGRAMMES
    ]
