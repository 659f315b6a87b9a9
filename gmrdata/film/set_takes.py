"""The takes of a set: those whose motion is there, each planned in a stage folder of its own."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gmrdata.film.programmes import camera_programme
from gmrdata.film.render import RenderConfig, RenderJob
from gmrdata.film.set_plan import (
    SyntheticClip,
    SyntheticRecipe,
    make_plan,
    make_twin,
    render_config,
)
from gmrdata.manifest.current import CameraMotion, ListManifest
from gmrdata.manifest.read import read_manifest
from gmrdata.motion.files import find_motions
from gmrdata.stage import recipes
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.values.errors import BadMotionFile, BadRecipe, StageFailed

PROGRAMMES = {
    kind: camera_programme(kind)
    for kind in ("circular", "linear", "linear_panning", "panning", "small")
}
"""What a published list's class of camera motion is rendered with."""


@dataclass(frozen=True)
class Take:
    """One clip to render: a clip of the recipe, or its twin with the camera's motion off."""

    id: str
    """Name of the clip in the manifest."""
    clip: SyntheticClip
    camera_off: bool = False

    @property
    def camera_motion(self) -> CameraMotion:
        """The camera's class."""
        return "static" if self.camera_off else self.clip.programme.kind


@dataclass(frozen=True)
class Selection:
    """The clips of a recipe that can be rendered, and those whose motion is not there."""

    recipe: SyntheticRecipe
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
    takes = []
    for clip in wanted:
        if clip.trial is None or clip.trial in files:
            takes.append(Take(clip.id, clip))
            if recipe.camera_off and clip.programme.kind != "static":
                takes.append(Take(f"{clip.id}_off", clip, camera_off=True))
    if repeated := sorted(id for id, n in Counter(take.id for take in takes).items() if n > 1):
        raise BadRecipe(
            f"clip ids must be unique, but these are repeated: {', '.join(repeated)}; "
            "rename clips (camera_off adds _off to each)"
        )
    missing = tuple(clip.trial for clip in wanted if clip.trial and clip.trial not in files)
    return Selection(recipe, tuple(takes), files, missing)


def _listed(name: str | None) -> list[SyntheticClip]:
    if name is None:
        return []
    published = read_manifest(recipes.published_manifest(name))
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

    body_path: Path
    configs: Mapping[str, RenderConfig]
    """How each clip is rendered, by id."""
    paths: Mapping[str, Path]
    """Planned clip file by id."""
    layouts: Mapping[str, tuple[Path, ...]]
    """By id of a clip that has a twin, or of the twin: the files of both, which share one place
    (Table 6)."""
    reasons: Mapping[str, str]
    """Why each other clip can't be filmed, by id."""

    def render_job(self, id: str, out_dir: Path) -> RenderJob:
        """The job that renders a clip to a folder."""
        return RenderJob(
            clip_path=self.paths[id],
            body_path=self.body_path,
            out_dir=out_dir,
            config=self.configs[id],
            layout_paths=self.layouts.get(id, ()),
        )


def plan_takes(
    selection: Selection, body_path: Path, plans_dir: Path, *, run: Run = DEFAULT_RUN
) -> Planned:
    """Plan every take in a stage folder of its own below `plans_dir`.

    One that can't be filmed is named and the others go on.
    """
    recipe = selection.recipe
    paths: dict[str, Path] = {}
    reasons: dict[str, str] = {}
    for take in selection.takes:
        clip, out_dir = take.clip, plans_dir / take.clip.id
        motion_path = selection.files.get(clip.trial or "")
        try:
            path = make_plan(clip, recipe, motion_path, body_path, out_dir, run=run)
            if take.camera_off:
                path = make_twin(take.id, path, body_path, plans_dir / take.id, run=run)
            paths[take.id] = path
        except (BadMotionFile, BadRecipe, StageFailed) as error:
            reasons[take.id] = str(error)
    configs = {take.id: render_config(recipe, take.clip) for take in selection.takes}
    return Planned(body_path, configs, paths, _layouts(selection.takes, paths), reasons)


def _layouts(takes: Sequence[Take], paths: Mapping[str, Path]) -> dict[str, tuple[Path, ...]]:
    sharing: dict[str, list[Path]] = {}
    for take in takes:
        if take.id in paths:
            sharing.setdefault(take.clip.id, []).append(paths[take.id])
    together = {take.id: tuple(sharing.get(take.clip.id, ())) for take in takes}
    return {id: shared for id, shared in together.items() if len(shared) > 1}
