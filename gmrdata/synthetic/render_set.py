"""Render a set of clips to a manifest."""

from collections.abc import Sequence
from pathlib import Path

from gmrdata.body.file import read_body
from gmrdata.body.keep import keep_body
from gmrdata.errors import MissingInput
from gmrdata.jobs import Workers, worker_pool
from gmrdata.manifest.current import Clip, Quality
from gmrdata.manifest.entry import clip_entry
from gmrdata.manifest.recipe import created_by, stage_recipe
from gmrdata.manifest.write import write_manifest
from gmrdata.progress import console
from gmrdata.render import optional_outputs
from gmrdata.render_jobs import render_clips
from gmrdata.sources import file_source, gait_source, licence_of
from gmrdata.synthetic.plan import make_plan
from gmrdata.synthetic.recipe import SyntheticClip, SyntheticRecipe
from gmrdata.synthetic.select import select


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
    planned = {
        clip.id: make_plan(
            clip,
            index,
            recipe,
            selection.files.get(clip.trial or ""),
            body_path,
            out_dir / "plan" / clip.id,
            redo=redo,
        )
        for index, clip in enumerate(selection.clips)
    }
    with worker_pool(Workers(recipe.workers, scheduler)) as client:
        render_clips(
            planned,
            body_path,
            out_dir / "render",
            recipe.render,
            client,
            out_dir / "failed",
            redo=redo,
        )
    return write_manifest(
        out_dir / "synthetic.yaml",
        name=recipe.name,
        version=recipe.version,
        kind="synthetic",
        description="Rendered clips with exact cameras and exact world motions.",
        licence=f"clips as stated by each; body: {read_body(body_path).licence}",
        clips=[_entry(out_dir, clip, recipe) for clip in selection.clips],
        created_by=created_by(recipe, {"render": recipe.seed}),
        redo=redo,
    )


def _render_dir(out_dir: Path, clip_id: str) -> Path:
    return out_dir / "render" / clip_id


def _entry(out_dir: Path, clip: SyntheticClip, recipe: SyntheticRecipe) -> Clip:
    folder = _render_dir(out_dir, clip.id)
    source = file_source(clip.trial) if clip.trial else gait_source(clip.gait or "")
    return clip_entry(
        out_dir,
        id=clip.id,
        clip_path=folder / "clip.npz",
        images_dir=folder / "frames",
        masks_dir=folder / "masks",
        **optional_outputs(folder, recipe.render),
        camera_motion=clip.programme.kind,
        licence=licence_of(source),
        source=source,
        quality=Quality(geometry="exact"),
        recipe=stage_recipe(folder),
    )
