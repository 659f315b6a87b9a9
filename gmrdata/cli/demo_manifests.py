"""The demo's three manifests: what was trained on, what was rendered, and what was regenerated."""

from pathlib import Path
from typing import Any

from gmrdata.cli.demo_motions import MotionFiles
from gmrdata.cli.demo_recipe import DemoPaths, DemoRecipe
from gmrdata.film.render import optional_outputs
from gmrdata.manifest.current import Clip as ClipEntry
from gmrdata.manifest.current import Quality, Source
from gmrdata.manifest.entry import clip_entry, created_by, stage_recipe
from gmrdata.manifest.write import write_manifest
from gmrdata.motion.library import file_source, gait_source, licence_of
from gmrdata.read.bodies import read_body
from gmrdata.world.quality import dropped_reasons, load_record, quality_record


def write_manifests(paths: DemoPaths, recipe: DemoRecipe, files: MotionFiles) -> None:
    """Write the three manifests; the same clips give the same bytes."""
    # How many workers there were decides nothing, so it is no part of what made the clips.
    by = created_by(recipe.model_dump(mode="json", exclude={"workers"}), {"demo": recipe.seed})
    licence = _body_licence(paths)
    training = [
        _training_entry(paths, path, files) for path in sorted(paths.training_dir.glob("*.npz"))
    ]
    common: dict[str, Any] = {
        "version": "1.0.0",
        "licence": licence,
        "created_by": by,
        "redo": True,
    }
    write_manifest(
        paths.training_manifest,
        name="demo-training",
        kind="motions",
        description="Motions that the demo's GMR is trained on.",
        clips=training,
        **common,
    )
    write_manifest(
        paths.synthetic_manifest,
        name="demo-synthetic",
        kind="synthetic",
        description="Rendered clips with exact cameras and exact world motions.",
        clips=[_true_entry(paths, recipe, files, index) for index in range(len(recipe.clips))],
        **common,
    )
    write_manifest(
        paths.pseudo_gt_manifest,
        name="demo-pseudo-gt",
        kind="pseudo_gt",
        description="The same clips, their world motions regenerated from frames, intrinsics "
        "and camera-frame bodies.",
        clips=[_pseudo_entry(paths, recipe, files, index) for index in range(len(recipe.clips))],
        **common,
    )


def _true_entry(paths: DemoPaths, recipe: DemoRecipe, files: MotionFiles, index: int) -> ClipEntry:
    clip = recipe.clips[index]
    return clip_entry(
        paths.root,
        id=clip.id,
        clip_path=paths.true_clip(clip.id),
        images_dir=paths.frames_dir(clip.id),
        masks_dir=paths.render_dir(clip.id) / "masks",
        **optional_outputs(paths.render_dir(clip.id), recipe.render),
        camera_motion=clip.programme.kind,
        licence=licence_of(_source(recipe, files, index)),
        source=_source(recipe, files, index),
        quality=Quality(geometry="exact"),
        recipe=stage_recipe(paths.render_dir(clip.id)),
    )


def _pseudo_entry(
    paths: DemoPaths, recipe: DemoRecipe, files: MotionFiles, index: int
) -> ClipEntry:
    clip = recipe.clips[index]
    record = load_record(paths.pseudo_gt_dir(clip.id))
    return clip_entry(
        paths.root,
        id=clip.id,
        clip_path=paths.pseudo_clip(clip.id),
        images_dir=paths.frames_dir(clip.id),
        masks_dir=paths.masks_dir(clip.id),
        camera_motion=record["camera_motion"],
        licence=licence_of(_source(recipe, files, index)),
        source=_source(recipe, files, index),
        dropped_reason=dropped_reasons(record, 0),
        quality=quality_record(record, 0),
        recipe=stage_recipe(paths.pseudo_gt_dir(clip.id)),
    )


def _training_entry(paths: DemoPaths, path: Path, files: MotionFiles) -> ClipEntry:
    given = {file.stem for file in files.training}
    source = file_source(path.stem) if path.stem in given else gait_source(path.stem)
    return clip_entry(
        paths.root,
        clip_path=path,
        camera_motion="none",
        licence=licence_of(source),
        source=source,
        recipe=None,
    )


def _source(recipe: DemoRecipe, files: MotionFiles, index: int) -> Source:
    if files.filmed:
        return file_source(files.filmed[index].stem)
    return gait_source(recipe.clips[index].gait)


def _body_licence(paths: DemoPaths) -> str:
    return f"clips as stated by each; body: {read_body(paths.body).licence}"
