"""Render a set of clips: motions under camera programmes, with exact truth, to a manifest."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from gmrdata import resources
from gmrdata.body.file import read_body
from gmrdata.body.keep import keep_body
from gmrdata.body.model import BodyModel
from gmrdata.clip import load_clip, save_clip
from gmrdata.config import Config
from gmrdata.errors import BadRecipe, MissingInput
from gmrdata.film import Film, film_motion, plan_clip
from gmrdata.geometry.programmes import Circular, Linear, LinearPanning, Panning, Programme, Small
from gmrdata.jobs import Job, Workers, count_files, run_jobs, worker_pool
from gmrdata.manifest.current import Clip as ClipEntry
from gmrdata.manifest.current import ListManifest, Quality
from gmrdata.manifest.entry import clip_entry
from gmrdata.manifest.read import read_manifest
from gmrdata.manifest.recipe import created_by, stage_recipe
from gmrdata.manifest.write import write_manifest
from gmrdata.motion.gait import make_gait
from gmrdata.motion.motion import Motion
from gmrdata.motion.read import find_motions, read_motion
from gmrdata.progress import console
from gmrdata.render import RenderConfig, render_clip
from gmrdata.sources import file_source, gait_source, licence_of
from gmrdata.store import run_stage

PROGRAMMES: dict[str, Programme] = {
    "circular": Circular(),
    "linear": Linear(),
    "linear_panning": LinearPanning(),
    "panning": Panning(),
    "small": Small(),
}
"""What a published list's class of camera motion is rendered with."""


class SyntheticClip(Config):
    """One clip of a set."""

    id: str = Field(pattern=r"^[A-Za-z0-9_-]+$")
    """Name of the clip and of its folders."""
    trial: str | None = None
    """Name of a motion file, without suffix."""
    gait: str | None = None
    """Or kind of embedded gait."""
    programme: Programme
    """Camera programme."""
    duration_s: float | None = Field(default=None, gt=0)
    """Length to film, from the motion's start [s]; the set's when left out."""

    @model_validator(mode="after")
    def _one_motion(self) -> "SyntheticClip":
        if (self.trial is None) == (self.gait is None):
            raise ValueError("give either `trial` or `gait`")
        return self


class SyntheticRecipe(Config):
    """A set of clips to render."""

    recipe: Literal["synthetic"]
    """Kind of recipe."""
    name: str = Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$")
    """Name of the data set."""
    version: str = "1.0.0"
    """Its version, major.minor.patch."""
    seed: int = Field(default=0, ge=0)
    """Seed of every random choice."""
    body: str = "anny"
    """Body model: "anny", or the path of an SMPL model file."""
    workers: int = Field(default=2, ge=1)
    """Worker processes, one thread each."""
    published_list: str | None = None
    """A published list whose trials are rendered, each under its programme."""
    clips: tuple[SyntheticClip, ...] = ()
    """Further clips."""
    film: Film = Film()
    """What the clips share."""
    render: RenderConfig = RenderConfig()
    """The Blender stage."""


class PlanConfig(Config):
    """What decides one planned clip."""

    seed: int
    """Seed of the gait and of the camera."""
    clip: SyntheticClip
    """The clip."""
    film: Film
    """What the set's clips share."""


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


def plan(
    recipe: SyntheticRecipe, motions_dir: Path | None, out_dir: Path
) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    """A table of what `render_set` would do, without doing any of it."""
    selection = select(recipe, motions_dir)
    rows: list[Sequence[str]] = [
        (
            clip.id,
            clip.trial or f"gait {clip.gait}",
            clip.programme.kind,
            "done" if _render_dir(out_dir, clip.id).is_dir() else "to do",
        )
        for clip in selection.clips
    ]
    rows += [(trial, trial, "", "no motion file") for trial in selection.missing]
    return ("clip", "motion", "camera", "state"), rows


def render_set(
    recipe: SyntheticRecipe,
    out_dir: Path,
    *,
    motions_dir: Path | None = None,
    scheduler: str | None = None,
    redo: bool = False,
) -> Path:
    """Render every clip whose motion is there, and list them in `out_dir/synthetic.yaml`.

    Returns:
        Path of the manifest.

    Raises:
        MissingInput: not one clip of the recipe can be rendered.
        StageFailed: some clips failed; the others are done.
    """
    selection = select(recipe, motions_dir)
    if not selection.clips:
        raise MissingInput(
            f"recipe {recipe.name}: none of its trials found. Give their folder with --motions"
        )
    if selection.missing:
        console.print(f"no motion file for {', '.join(selection.missing)}: left out")
    out_dir = out_dir.resolve()
    body_path = keep_body(recipe.body, out_dir / "body", redo=redo)
    body = read_body(body_path)
    planned = {
        clip.id: _plan(clip, index, recipe, selection, body, out_dir, redo)
        for index, clip in enumerate(selection.clips)
    }
    jobs = [
        Job(
            clip_id,
            render_clip,
            {
                "clip_path": path,
                "body_path": body_path,
                "out_dir": _render_dir(out_dir, clip_id),
                "config": recipe.render,
                "redo": redo,
            },
        )
        for clip_id, path in planned.items()
    ]
    render_dirs = [_render_dir(out_dir, clip_id) for clip_id in planned]
    with worker_pool(Workers(recipe.workers, scheduler)) as client:
        run_jobs(
            "rendering frames",
            jobs,
            client,
            out_dir / "failed",
            units_total=sum(load_clip(path).motion.n_frames for path in planned.values()),
            units_done=lambda: count_files(render_dirs, "masks/[0-9]*.png"),
        )
    return write_manifest(
        out_dir / "synthetic.yaml",
        name=recipe.name,
        version=recipe.version,
        kind="synthetic",
        description="Rendered clips with exact cameras and exact world motions.",
        licence=f"clips as stated by each; body: {body.licence}",
        clips=[_entry(out_dir, clip) for clip in selection.clips],
        created_by=created_by(recipe, {"render": recipe.seed}),
        redo=redo,
    )


def _render_dir(out_dir: Path, clip_id: str) -> Path:
    return out_dir / "render" / clip_id


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


def _plan(
    clip: SyntheticClip,
    index: int,
    recipe: SyntheticRecipe,
    selection: Selection,
    body: BodyModel,
    out_dir: Path,
    redo: bool,
) -> Path:
    film = recipe.film
    if clip.duration_s is not None:
        film = film.model_copy(update={"duration_s": clip.duration_s})

    def work(partial: Path) -> None:
        rng = np.random.default_rng([recipe.seed, index])
        motion = film_motion(_motion(clip, film, selection, body, rng), film)
        planned = plan_clip(clip.id, motion, clip.programme, film, rng)
        save_clip(partial / "clip.npz", planned, body.rest_pelvis_m(motion.shape))

    config = PlanConfig(seed=recipe.seed, clip=clip, film=film)
    inputs = {"body": out_dir / "body" / "body.npz"}
    if clip.trial is not None:
        inputs["motion"] = selection.files[clip.trial]
    folder = run_stage("plan", out_dir / "plan" / clip.id, config, inputs, work, redo=redo)
    return folder / "clip.npz"


def _motion(
    clip: SyntheticClip,
    film: Film,
    selection: Selection,
    body: BodyModel,
    rng: np.random.Generator,
) -> Motion:
    if clip.trial is not None:
        return read_motion(selection.files[clip.trial], body)
    return make_gait(clip.gait or "", film.duration_s, 30.0, body, rng)


def _entry(out_dir: Path, clip: SyntheticClip) -> ClipEntry:
    folder = _render_dir(out_dir, clip.id)
    source = file_source(clip.trial) if clip.trial else gait_source(clip.gait or "")
    return clip_entry(
        out_dir,
        id=clip.id,
        clip_path=folder / "clip.npz",
        images_dir=folder / "frames",
        masks_dir=folder / "masks",
        camera_motion=clip.programme.kind,
        licence=licence_of(source),
        source=source,
        quality=Quality(geometry="exact"),
        recipe=stage_recipe(folder),
    )
