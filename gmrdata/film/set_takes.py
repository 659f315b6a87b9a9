"""The takes of a set: those whose motion is there, each planned in a stage folder of its own."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from gmrdata.film.programmes import Circular, Linear, LinearPanning, Panning, Programme, Small
from gmrdata.film.set_plan import SyntheticClip, SyntheticRecipe, make_plan, make_twin
from gmrdata.manifest.current import CameraMotion, ListManifest
from gmrdata.manifest.read import read_manifest
from gmrdata.motion.files import find_motions
from gmrdata.stage import resources
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.values.errors import BadMotionFile, BadRecipe, StageFailed

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


@dataclass(frozen=True)
class Planned:
    """What can be filmed, and what can't."""

    paths: Mapping[str, Path]
    """Planned clip file by id."""
    reasons: Mapping[str, str]
    """Why each other clip can't be filmed, by id."""


def plan_takes(
    recipe: SyntheticRecipe,
    selection: Selection,
    body_path: Path,
    plans_dir: Path,
    *,
    run: Run = DEFAULT_RUN,
) -> Planned:
    """Plan every take; one that can't be filmed is named and the others go on.

    Args:
        plans_dir: Gets one stage folder for each take.

    Raises:
        StaleOutput: a folder was made by another recipe.
    """
    paths: dict[str, Path] = {}
    reasons: dict[str, str] = {}
    for take in selection.takes:
        try:
            paths[take.id] = _plan(take, recipe, selection, body_path, plans_dir, run)
        except (BadMotionFile, BadRecipe, StageFailed) as error:
            reasons[take.id] = str(error)
    return Planned(paths, reasons)


def _plan(
    take: Take,
    recipe: SyntheticRecipe,
    selection: Selection,
    body_path: Path,
    plans_dir: Path,
    run: Run,
) -> Path:
    """The take's planned clip; a twin's is made of that of its clip."""
    planned = make_plan(
        take.clip,
        recipe,
        selection.files.get(take.clip.trial or ""),
        body_path,
        plans_dir / take.clip.id,
        run=run,
    )
    if not take.camera_off:
        return planned
    return make_twin(take.id, planned, body_path, plans_dir / take.id, run=run)
