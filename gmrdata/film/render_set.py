"""Render a set of clips to a manifest."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from gmrdata.film.character import residual_figures
from gmrdata.film.render import RenderConfig, RenderJob, optional_outputs, render_clip
from gmrdata.film.render_outputs import IN_FRAME, clearance_figures, whole_person_share
from gmrdata.film.set_plan import Selection, SyntheticRecipe, Take, plan_takes, select
from gmrdata.manifest.current import Clip as ClipEntry
from gmrdata.manifest.current import Quality
from gmrdata.manifest.entry import ClipAbout, ClipFiles, clip_entry, created_by, stage_recipe
from gmrdata.manifest.write import ManifestHead, write_manifest
from gmrdata.motion.cmu import fetch_command
from gmrdata.motion.library import file_source, gait_source, licence_of
from gmrdata.read.bodies import keep_body
from gmrdata.read.body_file import read_body
from gmrdata.stage import jobs as stage_jobs
from gmrdata.stage.progress import remark
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.workers import Pool, worker_pool
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import CHARACTER_FILE, load_character, load_clip
from gmrdata.values.errors import MissingInput
from gmrdata.values.files import remove_orphans, write_text

DESCRIPTION = "rendering frames"
RETRIES = 1  # how often a crashed Blender process is started again


def render_clips(
    jobs: Mapping[str, RenderJob],
    pool: Pool,
    failures_dir: Path,
    *,
    run: Run = DEFAULT_RUN,
) -> None:
    """Render each clip as `try_render_clips` does; StageFailed if some clips failed."""
    outcome = try_render_clips(jobs, pool, failures_dir, run=run)
    stage_jobs.raise_failures(DESCRIPTION, outcome.reasons, len(jobs), failures_dir)


def try_render_clips(
    jobs: Mapping[str, RenderJob],
    pool: Pool,
    failures_dir: Path,
    *,
    run: Run = DEFAULT_RUN,
) -> stage_jobs.Outcome:
    """Render each clip, given by id, in a worker of its own; reasons of failures are kept.
    A Blender process that ends without its result is started once more, at the next missing frame.
    """
    n_frames = {id: load_clip(job.clip_path).motion.n_frames for id, job in jobs.items()}
    calls = [
        stage_jobs.Job(id, render_clip, dict(job) | {"run": run}, RETRIES)
        for id, job in jobs.items()
    ]
    folders = [job.out_dir for job in jobs.values()]
    return stage_jobs.try_jobs(
        DESCRIPTION,
        calls,
        pool,
        failures_dir,
        units=(sum(n_frames.values()), lambda: stage_jobs.count_files(folders, "masks/[0-9]*.png")),
    )


def render_set(
    recipe: SyntheticRecipe,
    out_dir: Path,
    *,
    motions_dir: Path | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Render every clip whose motion is there, and list them in `out_dir/synthetic.yaml`.

    Beside the manifest stands `warnings.txt` where a clip deserves one.  A clip that can't be
    planned or rendered leaves its reason in `failed/<id>.txt` and the others go on; a manifest
    without some of its clips has "incomplete" in its version.  Returns the manifest's path;
    StageFailed where some clips failed, MissingInput where not one can be rendered.
    """
    selection = select(recipe, motions_dir)
    require_takes(selection, motions_dir)
    out_dir = out_dir.resolve()
    failures_dir = out_dir / "failed"
    for folder in (out_dir, failures_dir, *out_dir.glob("listings/**/")):
        remove_orphans(folder)
    body_path = keep_body(recipe.body, out_dir / "body", run=run)
    jobs, reasons = plan_takes(selection, body_path, out_dir / "plan", render_dir(out_dir), run)
    stage_jobs.record_failures(failures_dir, reasons, ())
    if jobs:
        with worker_pool(run, recipe.workers) as pool:
            reasons |= try_render_clips(jobs, pool, failures_dir, run=run).reasons
    done = [take for take in selection.takes if take.id not in reasons]
    if done:
        body = read_body(body_path)
        entries = [_entry(out_dir, take, body, jobs[take.id].config) for take in done]
        _write_listing(recipe, entries, out_dir, body, run, bool(reasons))
    stage_jobs.raise_failures("synthetic set", reasons, len(selection.takes), failures_dir)
    return out_dir / "synthetic.yaml"


def require_takes(selection: Selection, motions_dir: Path | None) -> None:
    """Say which motions are missing, and how to get them; MissingInput if all of them are."""
    command = fetch_command(selection.missing, motions_dir)
    how = "" if command is None else f". To get what is missing:\n  {command}"
    if not selection.takes:
        what = f"recipe {selection.recipe.name}: none of its trials found"
        raise MissingInput(f"{what}. Give their folder with --motions{how}")
    if selection.missing:
        missing = ", ".join(selection.missing)
        remark(f"no motion file for {missing}: left out{how}")


def render_dir(out_dir: Path, clip_id: str = "") -> Path:
    """Stage folder of a rendered clip, or the folder of them all."""
    return out_dir / "render" / clip_id


def _write_listing(
    recipe: SyntheticRecipe,
    entries: Sequence[ClipEntry],
    out_dir: Path,
    body: BodyModel,
    run: Run,
    incomplete: bool,
) -> None:
    tag = f"{'.' if '-' in recipe.version else '-'}incomplete" if incomplete else ""
    recorded = recipe.model_dump(mode="json", exclude={"workers"})
    write_manifest(
        out_dir / "synthetic.yaml",
        ManifestHead(
            name=recipe.name,
            version=f"{recipe.version}{tag}",
            description="Rendered clips with exact cameras and exact world motions.",
            kind="synthetic",
            licence=f"clips as stated by each; body: {body.licence}",
        ),
        entries,
        created_by=created_by(recorded, {"render": recipe.seed}),
        redo=run.redo or incomplete,
    )
    warnings_path = out_dir / "warnings.txt"
    warnings_path.unlink(missing_ok=True)
    if warnings := frame_warnings(entries, recipe.min_in_frame_share).values():
        for line in warnings:
            remark(f"warning: {line}", style="yellow")
        write_text(warnings_path, "".join(f"{line}\n" for line in warnings))


def frame_warnings(entries: Sequence[ClipEntry], min_share: float) -> dict[str, str]:
    """One line for each clip that has the person out of frame too often, by id."""
    shares = {entry.id: (entry.quality or Quality()).figures[IN_FRAME] for entry in entries}
    return {
        id: f"clip {id}: the whole person is in {share:.0%} of the frames, less than "
        f"{min_share:.0%}; give its camera more distance_m, or leave distance_m out"
        for id, share in shares.items()
        if share < min_share
    }


def _entry(out_dir: Path, take: Take, body: BodyModel, config: RenderConfig) -> ClipEntry:
    folder = render_dir(out_dir, take.id)
    clip = take.clip
    source = file_source(clip.trial) if clip.trial else gait_source(clip.gait or "")
    licence = licence_of(source)
    if config.character is None:
        figures = {IN_FRAME: whole_person_share(load_clip(folder / "clip.npz"), body)}
    else:
        record = load_character(folder / CHARACTER_FILE)
        figures = {IN_FRAME: float(record.in_frame.mean())} | residual_figures(record)
        licence = f"{licence}; character: {config.character.licence}"
    return clip_entry(
        out_dir,
        ClipFiles(
            folder / "clip.npz",
            images=folder / "frames",
            masks=folder / "masks",
            **optional_outputs(folder, config),
        ),
        ClipAbout(
            id=take.id,
            camera_motion=take.camera_motion,
            licence=licence,
            source=source,
            quality=Quality(geometry="exact", figures={**figures, **clearance_figures(folder)}),
            recipe=stage_recipe(folder),
        ),
    )
