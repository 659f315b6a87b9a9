"""The demo's three manifests: what was trained on, what was rendered, and what was regenerated."""

from collections.abc import Sequence
from pathlib import Path

from gmrdata.cli.demo_motions import MotionFiles
from gmrdata.cli.demo_recipe import DemoClip, DemoPaths, DemoRecipe
from gmrdata.film.render import optional_outputs
from gmrdata.manifest.current import Clip as ClipEntry
from gmrdata.manifest.current import Quality, Source
from gmrdata.manifest.entry import clip_entry, created_by, stage_recipe
from gmrdata.manifest.write import write_manifest
from gmrdata.motion.library import file_source, gait_source, licence_of
from gmrdata.read.bodies import read_body
from gmrdata.world.quality import load_record, quality_record


def write_manifests(paths: DemoPaths, recipe: DemoRecipe, files: MotionFiles) -> None:
    """Write the three manifests; the same clips give the same bytes."""
    # How many workers there were decides nothing, so it is no part of what made the clips.
    by = created_by(recipe.model_dump(mode="json", exclude={"workers"}), {"demo": recipe.seed})
    licence = f"clips as stated by each; body: {read_body(paths.body).licence}"

    def write(path: Path, kind: str, description: str, clips: Sequence[ClipEntry]) -> None:
        about = {"description": description, "kind": kind, "licence": licence, "version": "1.0.0"}
        name = f"demo-{path.stem.replace('_', '-')}"
        write_manifest(path, name=name, clips=clips, created_by=by, redo=True, **about)

    write(
        paths.training_manifest,
        "motions",
        "Motions that the demo's GMR is trained on.",
        [_training_entry(paths, path, files) for path in sorted(paths.training_dir.glob("*.npz"))],
    )
    filmed = [
        (clip, file_source(files.filmed[index].stem) if files.filmed else gait_source(clip.gait))
        for index, clip in enumerate(recipe.clips)
    ]
    write(
        paths.synthetic_manifest,
        "synthetic",
        "Rendered clips with exact cameras and exact world motions.",
        [_true_entry(paths, recipe, clip, source) for clip, source in filmed],
    )
    write(
        paths.pseudo_gt_manifest,
        "pseudo_gt",
        "The same clips, their world motions regenerated from frames, intrinsics and camera-frame "
        "bodies.",
        [_pseudo_entry(paths, clip, source) for clip, source in filmed],
    )


def _training_entry(paths: DemoPaths, path: Path, files: MotionFiles) -> ClipEntry:
    given = {file.stem for file in files.training}
    source = file_source(path.stem) if path.stem in given else gait_source(path.stem)
    return clip_entry(
        paths.root, clip_path=path, camera_motion="none", licence=licence_of(source), source=source
    )


def _true_entry(paths: DemoPaths, recipe: DemoRecipe, clip: DemoClip, source: Source) -> ClipEntry:
    files = paths.clip(clip.id)
    return clip_entry(
        paths.root,
        id=clip.id,
        clip_path=files.true,
        images_dir=files.frames_dir,
        masks_dir=files.render_dir / "masks",
        **optional_outputs(files.render_dir, recipe.render),
        camera_motion=clip.programme.kind,
        licence=licence_of(source),
        source=source,
        quality=Quality(geometry="exact"),
        recipe=stage_recipe(files.render_dir),
    )


def _pseudo_entry(paths: DemoPaths, clip: DemoClip, source: Source) -> ClipEntry:
    files = paths.clip(clip.id)
    record = load_record(files.pseudo_gt_dir)
    return clip_entry(
        paths.root,
        id=clip.id,
        clip_path=files.pseudo,
        images_dir=files.frames_dir,
        masks_dir=files.masks_dir,
        camera_motion=record.camera_motion,
        licence=licence_of(source),
        source=source,
        dropped_reason=record.people[0].row_reasons,
        quality=quality_record(record, 0),
        recipe=stage_recipe(files.pseudo_gt_dir),
    )
