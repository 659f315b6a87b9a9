"""Render a set of clips to a manifest, or say what it would be and cost."""

import math
import os
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.film.character import residual_figures
from gmrdata.film.render import RenderConfig, RenderJob, optional_outputs, render_clip, render_job
from gmrdata.film.render_outputs import IN_FRAME, clearance_figures, whole_person_share
from gmrdata.film.set_plan import (
    PlannedClip,
    Selection,
    SyntheticRecipe,
    passing_dirs,
    plan_takes,
    select,
)
from gmrdata.manifest.current import ClipEntry, Quality, Source
from gmrdata.manifest.write import (
    ClipAbout,
    ClipFiles,
    ManifestHead,
    clip_entry,
    made_by,
    stage_recipe,
    write_manifest,
)
from gmrdata.motion.cmu import fetch_command
from gmrdata.motion.library import READING_FILE, ReadingRecord, licence_of, motion_source
from gmrdata.read.bodies import keep_body
from gmrdata.read.body_file import read_body
from gmrdata.stage import jobs as stage_jobs
from gmrdata.stage.progress import remark
from gmrdata.stage.recipes import read_recipe
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import is_made
from gmrdata.stage.workers import Pool, worker_pool
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import CHARACTER_FILE, Clip, load_character, load_clip, save_clip
from gmrdata.values.errors import BadRecipe, MissingInput, RenderOverLimit, StageFailed
from gmrdata.values.files import remove_orphans, write_text
from gmrdata.values.limits import MIB
from gmrdata.values.records import compared, with_absolute_paths

DESCRIPTION = "rendering frames"
MASKS = "masks/[0-9]*.png"  # one for each frame
OTHER_VALUES = "made with other values, needs --redo"
RETRIES = 1  # how often a crashed Blender process is started again


def render_clips(
    jobs: Mapping[str, RenderJob], pool: Pool, failures_dir: Path, *, run: Run = DEFAULT_RUN
) -> None:
    """Render each clip as `try_render_clips` does; StageFailed if some clips failed."""
    outcome = try_render_clips(jobs, pool, failures_dir, run=run)
    stage_jobs.raise_failures(DESCRIPTION, outcome.reasons, len(jobs), failures_dir)


def try_render_clips(
    jobs: Mapping[str, RenderJob], pool: Pool, failures_dir: Path, *, run: Run = DEFAULT_RUN
) -> stage_jobs.Outcome:
    """Render each clip, given by id, in a worker of its own; reasons of failures are kept.
    A Blender process that ends without its result is started once more, at the next missing frame.
    """
    own = [job for id, job in jobs.items() if pool.is_own(id)]
    n_frames = sum(load_clip(job.clip_path).motion.n_frames for job in own)
    said = {
        id: {"job": with_absolute_paths(job), "recorded": job.config} for id, job in jobs.items()
    }
    calls = [stage_jobs.Job(id, render_job, said[id] | {"run": run}, RETRIES) for id in jobs]
    folders, counted = [job.out_dir for job in own], dict[Path, int]()
    return stage_jobs.try_jobs(
        DESCRIPTION,
        calls,
        pool,
        failures_dir,
        units=(n_frames, lambda: stage_jobs.count_files(folders, MASKS, counted)),
    )


def render_set(
    recipe: SyntheticRecipe | str | Path,
    out_dir: str | Path,
    *,
    motions_dir: str | Path | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Render every clip whose motion is there, and list them in `out_dir/synthetic.yaml`.

    Beside the manifest stands `warnings.txt` where a clip deserves one.  A clip that can't be
    planned or rendered leaves its reason in `failed/<id>.txt` and the others go on.  A manifest
    without some of its clips has "incomplete" in its version, and replaces no complete one.
    Returns its path; StageFailed where some clips failed, MissingInput where none can be rendered.
    """
    motions_dir = None if motions_dir is None else Path(motions_dir)
    return render_selected(select(read_recipe(recipe, SyntheticRecipe), motions_dir), out_dir, run)


def render_selected(selection: Selection, out_dir: str | Path, run: Run = DEFAULT_RUN) -> Path:
    """`render_set` of clips whose motions are found already."""
    require_takes(selection)
    recipe, out_dir = selection.recipe, Path(out_dir).resolve()
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
        entries = [
            _entry(out_dir, take, body, jobs[take.id].config, selection.source(take.clip))
            for take in done
        ]
        _write_listing(recipe, entries, out_dir, body, run, bool(reasons))
        unframed = frame_warnings(entries, recipe.min_in_frame_share).values()
        _write_warnings(out_dir, [*_reading_warnings(out_dir, done, jobs), *unframed])
    stage_jobs.raise_failures("synthetic set", reasons, len(selection.takes), failures_dir)
    return out_dir / "synthetic.yaml"


def require_takes(selection: Selection) -> None:
    """Say which motions are missing, and how to get them; MissingInput if all of them are."""
    command = fetch_command(selection.missing, selection.motions_dir)
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
    about = "Rendered clips with exact cameras and exact world motions."
    licence = f"clips as stated by each; body: {body.licence}"
    head = ManifestHead(recipe.name, recipe.version, about, "synthetic", licence)
    by, path = made_by(recipe, {"render": recipe.seed}), out_dir / "synthetic.yaml"
    write_manifest(path, head, entries, created_by=by, redo=run.redo, incomplete=incomplete)


def _write_warnings(out_dir: Path, warnings: Sequence[str]) -> None:
    """Say lines that don't stop a set, and keep them in `warnings.txt`, if there are any."""
    warnings_path = out_dir / "warnings.txt"
    warnings_path.unlink(missing_ok=True)
    if warnings:
        for line in warnings:
            remark(f"warning: {line}", style="yellow")
        write_text(warnings_path, "".join(f"{line}\n" for line in warnings))


def _reading_warnings(
    out_dir: Path, takes: Sequence[PlannedClip], jobs: Mapping[str, RenderJob]
) -> list[str]:
    """A line for each thing that may be wrong with a motion file, of clips and of passers-by."""
    plans_dir = out_dir / "plan"
    plans = {f"clip {take.clip.id}": plans_dir / take.clip.id for take in takes}
    for extras in (jobs[take.id].config.scene.extras for take in takes):
        read = passing_dirs(extras, plans_dir)
        plans |= {f"passer-by {path}": folder for path, folder in read.items()}
    said = {
        who: ReadingRecord.read(folder / READING_FILE).remarks
        for who, folder in plans.items()
        if (folder / READING_FILE).is_file()  # not of a gait, nor of older plans
    }
    remedy = "(in a recipe: the keys of `read`)"
    return [f"{who}: {remark} {remedy}" for who, remarks in said.items() for remark in remarks]


def frame_warnings(entries: Sequence[ClipEntry], min_share: float) -> dict[str, str]:
    """One line for each clip that has the person out of frame too often, by id."""
    shares = {entry.id: (entry.quality or Quality()).figures[IN_FRAME] for entry in entries}
    seen = "the whole person is in {} of the frames, less than {}"
    return {
        id: f"clip {id}: {compared(seen, share, min_share, '.0%')}; give its camera more "
        "distance_m (of a circular one: radius_m), or leave that out"
        for id, share in shares.items()
        if share < min_share
    }


def _entry(
    out_dir: Path, take: PlannedClip, body: BodyModel, config: RenderConfig, source: Source
) -> ClipEntry:
    folder = render_dir(out_dir, take.id)
    licence = _licence(source, config.scene.extras.motions)
    if config.character is None:
        figures = {IN_FRAME: whole_person_share(load_clip(folder / "clip.npz"), body)}
    else:
        record = load_character(folder / CHARACTER_FILE)
        figures = {IN_FRAME: float(record.in_frame.mean())} | residual_figures(record)
        licence = f"{licence}; character: {config.character.licence}"
    pictures: dict[str, Any] = {"images": folder / "frames", "masks": folder / "masks"}
    listed = ClipFiles(folder / "clip.npz", **(pictures | optional_outputs(folder, config)))
    about = ClipAbout(
        id=take.id,
        camera_motion=take.camera_motion,
        licence=licence,
        source=source,
        quality=Quality(geometry="exact", figures={**figures, **clearance_figures(folder)}),
        recipe=stage_recipe(folder),
    )
    return clip_entry(out_dir, listed, about)


def _licence(source: Source, passing: Sequence[Path]) -> str:
    """The terms of a clip's motion, and what those of its passers-by add to them."""
    own = licence_of(source)
    parts = {path: path.absolute().parts[1:][-3:] for path in passing}
    others = {licence_of(motion_source(path, Path(*inside))) for path, inside in parts.items()}
    return "; passers-by: ".join([own, *sorted(others - {own})])


PROBE_FRAMES = 2  # the first frame pays for the scene, the second is what a frame costs
HEADINGS = ("clip", "motion", "camera", "frames", "state")


@dataclass(frozen=True)
class ClipCost:
    """What was measured on a slice of one clip, rendered at its real settings."""

    frame_cpu_s: float
    clip_cpu_s: float  # before its first frame: Blender's start, the scene [s]
    frame_bytes: float  # of all files of a frame, and its share of those that grow with a clip
    clip_bytes: float  # of what a clip has besides, as its saved scene
    memory_mib: float  # of this process and Blender's, at their largest [MiB]; NaN: not known


@dataclass(frozen=True)
class DryRun:
    rows: Sequence[Sequence[str]]
    clips: int
    clips_to_do: int
    frames: int  # of all clips that can be filmed
    frames_to_do: int
    workers: int  # that have a clip to render
    probe: ClipCost | None  # None when there is nothing to do, or no probe was wanted

    @property
    def seconds(self) -> float | None:
        """Estimate of the wall time when each worker has a core of its own [s]."""
        if (probe := self.probe) is None:
            return None
        cpu_s = self.clips_to_do * probe.clip_cpu_s + self.frames_to_do * probe.frame_cpu_s
        return cpu_s / self.workers

    @property
    def size_bytes(self) -> float | None:
        """Estimate of the disk that what is to do takes [bytes]."""
        if (probe := self.probe) is None:
            return None
        return self.clips_to_do * probe.clip_bytes + self.frames_to_do * probe.frame_bytes


def dry_run(
    recipe: SyntheticRecipe, out_dir: Path, *, motions_dir: Path | None = None, probe: bool = True
) -> DryRun:
    """Plan every clip in a temporary folder and, for a probe, render two frames of one there.
    Nothing is written below `out_dir`, and what is done there counts as done.  A clip that no probe
    can be made of leaves its reason in its row, and another is taken."""
    selection = select(recipe, motions_dir)
    with tempfile.TemporaryDirectory(prefix="gmrdata-") as name:
        folder = Path(name)
        body_path = keep_body(recipe.body, folder / "body")
        jobs, reasons = plan_takes(selection, body_path, folder / "plan", render_dir(out_dir))
        clips = {id: load_clip(job.clip_path) for id, job in jobs.items()}
        todo, faults, measured = list[str](), dict[str, str](), None
        for id, job in jobs.items():
            try:
                if not is_made("render", job.out_dir, job.config, job.inputs):
                    todo.append(id)
                    if probe and measured is None:
                        place = folder / "probe" / id
                        measured = probe_clip(clips[id], body_path, job.config, place)
            except (BadRecipe, RenderOverLimit, StageFailed) as error:
                faults[id] = f"no probe could be rendered: {error}"
    new = [id for id in todo if not jobs[id].out_dir.exists()]
    states = dict.fromkeys(clips, "done") | dict.fromkeys(todo, OTHER_VALUES)
    states |= dict.fromkeys(new, "to do")
    states |= faults | {id: f"can't be filmed: {reason}" for id, reason in reasons.items()}
    frames = {id: clip.motion.n_frames for id, clip in clips.items()}
    rows: list[tuple[str, ...]] = []
    for take in selection.takes:
        motion, count = take.clip.trial or f"gait {take.clip.gait}", str(frames.get(take.id, ""))
        rows.append((take.id, motion, take.camera_motion, count, states[take.id]))
    rows += [(trial, trial, "", "", "no motion file") for trial in selection.missing]
    there = stage_jobs.count_files([jobs[id].out_dir for id in new], MASKS, {})
    frames_to_do = max(0, sum(frames[id] for id in todo) - there)
    workers = max(1, min(recipe.workers, len(todo)))
    counts = (len(clips), len(todo), sum(frames.values()), frames_to_do)
    return DryRun(rows, *counts, workers, measured)


def probe_clip(clip: Clip, body_path: Path, config: RenderConfig, folder: Path) -> ClipCost:
    """Render two frames from the middle of a clip to a folder and measure them."""
    rows = np.arange(clip.motion.n_frames)[clip.motion.n_frames // 2 :][:PROBE_FRAMES]
    piece = replace(clip.take(rows), image_numbers=np.arange(len(rows)))
    files = (folder / "slice.npz", body_path, folder / "render")
    told_s: list[float] = []
    save_clip(files[0], piece, read_body(body_path).rest_pelvis_m(piece.motion.shape))
    before_cpu_s, start_s = sum(os.times()[2:4]), time.monotonic()  # of child processes that ended
    made = render_clip(*files, config, on_frame=lambda _: told_s.append(time.monotonic()))
    wall_s, cpu_s = time.monotonic() - start_s, sum(os.times()[2:4]) - before_cpu_s
    cpu_s = cpu_s or wall_s  # Windows does not say
    # Blender's time is known as a whole; the clock says which share of it the last frame took.
    frame_s = (told_s[-1] - told_s[0]) / (len(told_s) - 1) if len(told_s) > 1 else wall_s
    frame_cpu_s = cpu_s * frame_s / wall_s
    clip_cpu_s = max(0.0, cpu_s - len(rows) * frame_cpu_s)
    sizes = {path: path.stat().st_size for path in made.glob("*/*") if path.is_file()}
    frame_bytes = sum(size for path, size in sizes.items() if path.stem.isdigit()) / len(rows)
    caches_bytes = sum(size for path, size in sizes.items() if path.suffix == ".pc2")
    frame_bytes += caches_bytes / (len(rows) + 2)  # which have a frame more at either end
    clip_bytes = sum(sizes.values()) - len(rows) * frame_bytes
    return ClipCost(frame_cpu_s, clip_cpu_s, frame_bytes, clip_bytes, _memory_mib())


def summary_lines(plan: DryRun) -> list[str]:
    """The sums of a dry run, for a person."""
    to_do = f"to do: {plan.clips_to_do} clips, {plan.frames_to_do} frames"
    lines = [f"{plan.clips} clips, {plan.frames} frames; {to_do}"]
    if probe := plan.probe:
        known = math.isfinite(probe.memory_mib)
        memory = f", {probe.memory_mib:.0f} MiB of memory for each worker" if known else ""
        lines.append(
            f"about {_duration(plan.seconds or 0.0)} with {plan.workers} workers on as many cores, "
            f"{(plan.size_bytes or 0.0) / 1e6:,.1f} MB (measured on {PROBE_FRAMES} "
            f"frames: {probe.frame_cpu_s:.2f} s a frame and {probe.clip_cpu_s:.1f} s a clip of "
            f"processor time, {probe.frame_bytes / 1e3:.0f} kB a frame and "
            f"{probe.clip_bytes / 1e3:.0f} kB a clip{memory})"
        )
    return lines


def _memory_mib() -> float:
    """The largest memory of this process and of its largest ended child, together [MiB]; NaN where
    the system does not say (Windows)."""
    try:
        import resource
    except ImportError:
        return math.nan
    whose = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    unit = float(MIB) if sys.platform == "darwin" else 1024.0
    return sum(resource.getrusage(who).ru_maxrss for who in whose) / unit


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
