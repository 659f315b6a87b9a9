"""The demo from end to end: every stage in order, each of them done once."""

from pathlib import Path

import yaml

from gmrdata.body.keep import keep_body
from gmrdata.body.load import load_body
from gmrdata.demo.manifests import write_manifests
from gmrdata.demo.motions import MotionFiles, choose_files, make_motions
from gmrdata.demo.paths import DemoPaths
from gmrdata.demo.recipe import DemoRecipe
from gmrdata.demo.regenerate import regenerate
from gmrdata.demo.show import show
from gmrdata.evaluate.score import score_manifest
from gmrdata.gmr.train import train
from gmrdata.jobs import Job, Workers, run_jobs, worker_pool
from gmrdata.progress import console
from gmrdata.render_jobs import render_clips
from gmrdata.store import write_text


def run_demo(
    recipe: DemoRecipe,
    out_dir: Path,
    *,
    motions_dir: Path | None = None,
    trials: tuple[str, ...] = (),
    scheduler: str | None = None,
    redo: bool = False,
) -> Path:
    """Run every stage that isn't done; a run that was killed goes on where it was.

    Args:
        recipe: The recipe.
        out_dir: The output folder.
        motions_dir: Folder of motion files to film and train on; the embedded gait when None.
        trials: Names of the files to film, without suffix; the first that fit when empty.
        scheduler: Address of a Dask cluster for the clips; local processes when None.
        redo: Make stages anew that another recipe made.

    Returns:
        Path of the report.
    """
    paths = DemoPaths(out_dir.resolve())
    _step(1, "body")
    keep_body(recipe.body, paths.body_dir, redo=redo)
    _step(2, "motions")
    files = MotionFiles()
    if motions_dir is not None:
        files = choose_files(motions_dir, trials, recipe, load_body(str(paths.body)))
        console.print("  filming " + ", ".join(path.stem for path in files.filmed))
    make_motions(paths, recipe, files, redo=redo)
    with worker_pool(Workers(recipe.workers, scheduler)) as client:
        _step(3, "render")
        render_clips(
            {clip.id: paths.planned_clip(clip.id) for clip in recipe.clips},
            paths.body,
            paths.all_renders_dir,
            recipe.render,
            client,
            paths.failures_dir,
            redo=redo,
        )
        _step(4, "masks, cameras, scale, world motion")
        _regenerate(paths, recipe, client, redo)
    _step(5, "manifests")
    write_manifests(paths, recipe, files)
    _step(6, "train GMR")
    train([paths.training_manifest], paths.gmr_dir, recipe.gmr, body_path=paths.body, redo=redo)
    _step(7, "score GMR")
    for manifest in (paths.synthetic_manifest, paths.pseudo_gt_manifest):
        score_manifest(
            paths.gmr_dir, manifest, paths.body, paths.scores_dir(manifest.stem), redo=redo
        )
    _step(8, "report")
    write_text(paths.recipe, yaml.safe_dump(recipe.model_dump(mode="json"), sort_keys=False))
    return show(paths, recipe)


def _step(number: int, what: str) -> None:
    console.rule(f"[bold]{number}/8[/bold] {what}", align="left")


def _regenerate(paths: DemoPaths, recipe: DemoRecipe, client: object, redo: bool) -> None:
    jobs = [
        Job(
            clip.id,
            regenerate,
            {
                "root": paths.root,
                "clip_id": clip.id,
                "config": recipe.sequence,
                "redo": redo,
            },
        )
        for clip in recipe.clips
    ]
    stage_dirs = [
        folder
        for clip in recipe.clips
        for folder in (
            paths.sequence_dir(clip.id),
            paths.masks_dir(clip.id),
            paths.sfm_dir(clip.id),
            paths.pseudo_gt_dir(clip.id),
        )
    ]
    run_jobs(
        "regenerating world poses",
        jobs,
        client,
        paths.failures_dir,
        units_total=len(stage_dirs),
        units_done=lambda: sum(folder.is_dir() for folder in stage_dirs),
    )


def plan(recipe: DemoRecipe, out_dir: Path) -> list[tuple[str, str]]:
    """What a run would do: (stage, "done" or "to do"), without doing any of it."""
    paths = DemoPaths(out_dir.resolve())
    stages = [("body", paths.body_dir), ("motions", paths.motions_dir)]
    for clip in recipe.clips:
        stages += [
            (f"render {clip.id}", paths.render_dir(clip.id)),
            (f"masks {clip.id}", paths.masks_dir(clip.id)),
            (f"cameras {clip.id}", paths.sfm_dir(clip.id)),
            (f"world motion {clip.id}", paths.pseudo_gt_dir(clip.id)),
        ]
    stages += [("train GMR", paths.gmr_dir)]
    stages += [(f"score on {name}", paths.scores_dir(name)) for name in ("synthetic", "pseudo_gt")]
    return [(name, "done" if folder.is_dir() else "to do") for name, folder in stages]
