"""Which clips of a recipe can be rendered: those whose motion is there."""

from dataclasses import dataclass
from pathlib import Path

from gmrdata import resources
from gmrdata.errors import BadRecipe
from gmrdata.geometry.programmes import Circular, Linear, LinearPanning, Panning, Programme, Small
from gmrdata.manifest.current import ListManifest
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
class Selection:
    """The clips of a recipe that can be rendered, and those whose motion is not there."""

    clips: tuple[SyntheticClip, ...]
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
    return Selection(there, files, missing)


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
