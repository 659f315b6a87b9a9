"""What a set would be and cost, without making any of it."""

import resource
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gmrdata.film.render import RenderConfig, render_clip
from gmrdata.film.render_set import render_dir
from gmrdata.film.set_plan import SyntheticRecipe, plan_takes, select
from gmrdata.read.bodies import keep_body
from gmrdata.read.body_file import read_body
from gmrdata.stage.jobs import count_files
from gmrdata.values.clip import Clip, camera_of, load_clip, save_clip

PROBE_FRAMES = 2  # the first frame pays for the scene, the second is what a frame costs
HEADINGS = ("clip", "motion", "camera", "frames", "state")


@dataclass(frozen=True)
class Probe:
    """What was measured on a slice of one clip, rendered at its real settings."""

    frame_cpu_s: float
    clip_cpu_s: float  # before its first frame: Blender's start, the scene [s]
    frame_bytes: float  # of all files of a frame
    memory_mib: float  # of this process and Blender's, at their largest [MiB]


@dataclass(frozen=True)
class DryRun:
    rows: Sequence[Sequence[str]]
    clips: int
    clips_to_do: int
    frames: int  # of all clips that can be filmed
    frames_to_do: int
    workers: int  # that have a clip to render
    probe: Probe | None  # None when there is nothing to do, or no probe was wanted

    @property
    def cpu_s(self) -> float | None:
        """Estimate of the processor time of all that is to do [s]."""
        if (probe := self.probe) is None:
            return None
        return self.clips_to_do * probe.clip_cpu_s + self.frames_to_do * probe.frame_cpu_s

    @property
    def seconds(self) -> float | None:
        """Estimate of the wall time when each worker has a core of its own [s]."""
        return None if self.cpu_s is None else self.cpu_s / self.workers

    @property
    def size_bytes(self) -> float | None:
        """Estimate of the disk that the frames to do take [bytes]."""
        return None if self.probe is None else self.frames_to_do * self.probe.frame_bytes


def dry_run(
    recipe: SyntheticRecipe, out_dir: Path, *, motions_dir: Path | None = None, probe: bool = True
) -> DryRun:
    """Plan every clip in a temporary folder and, for a probe, render two frames of one there.
    Nothing is written below `out_dir`, and what is done there counts as done."""
    selection = select(recipe, motions_dir)
    with tempfile.TemporaryDirectory(prefix="gmrdata-") as name:
        folder = Path(name)
        body_path = keep_body(recipe.body, folder / "body")
        jobs, reasons = plan_takes(selection, body_path, folder / "plan", render_dir(out_dir))
        clips = {id: load_clip(job.clip_path) for id, job in jobs.items()}
        todo = [id for id, job in jobs.items() if not job.out_dir.is_dir()]
        measured = None
        if probe and todo:
            config = jobs[todo[0]].config
            measured = probe_clip(clips[todo[0]], body_path, config, folder / "probe")
    states = dict.fromkeys(clips, "done") | dict.fromkeys(todo, "to do")
    states |= {id: f"can't be filmed: {reason}" for id, reason in reasons.items()}
    frames = {id: clip.motion.n_frames for id, clip in clips.items()}
    rows: list[tuple[str, ...]] = []
    for take in selection.takes:
        motion, count = take.clip.trial or f"gait {take.clip.gait}", str(frames.get(take.id, ""))
        rows.append((take.id, motion, take.camera_motion, count, states[take.id]))
    rows += [(trial, trial, "", "", "no motion file") for trial in selection.missing]
    there = count_files([jobs[id].out_dir for id in todo], "masks/[0-9]*.png")
    frames_to_do = max(0, sum(frames[id] for id in todo) - there)
    workers = max(1, min(recipe.workers, len(todo)))
    counts = (len(clips), len(todo), sum(frames.values()), frames_to_do)
    return DryRun(rows, *counts, workers, measured)


def probe_clip(clip: Clip, body_path: Path, config: RenderConfig, folder: Path) -> Probe:
    """Render two frames from the middle of a clip to a folder and measure them."""
    rows = np.arange(clip.motion.n_frames)[clip.motion.n_frames // 2 :][:PROBE_FRAMES]
    motion, camera = clip.motion.take(rows), camera_of(clip).at_rows(rows)
    piece = Clip(clip.id, motion, clip.valid[rows], np.arange(len(rows)), camera)
    files = (folder / "slice.npz", body_path, folder / "render")
    told_s: list[float] = []
    save_clip(files[0], piece, read_body(body_path).rest_pelvis_m(motion.shape))
    before_cpu_s, start_s = _children_cpu_s(), time.monotonic()
    made = render_clip(*files, config, on_frame=lambda _: told_s.append(time.monotonic()))
    wall_s, cpu_s = time.monotonic() - start_s, _children_cpu_s() - before_cpu_s
    # Blender's time is known as a whole; the clock says which share of it the last frame took.
    frame_s = (told_s[-1] - told_s[0]) / (len(told_s) - 1) if len(told_s) > 1 else wall_s
    frame_cpu_s = cpu_s * frame_s / wall_s
    size_bytes = sum(path.stat().st_size for path in made.glob("*/*") if path.is_file())
    clip_cpu_s = max(0.0, cpu_s - len(rows) * frame_cpu_s)
    return Probe(frame_cpu_s, clip_cpu_s, size_bytes / len(rows), _memory_mib())


def summary_lines(plan: DryRun) -> list[str]:
    """The sums of a dry run, for a person."""
    to_do = f"to do: {plan.clips_to_do} clips, {plan.frames_to_do} frames"
    lines = [f"{plan.clips} clips, {plan.frames} frames; {to_do}"]
    if probe := plan.probe:
        lines.append(
            f"about {_duration(plan.seconds or 0.0)} with {plan.workers} workers on as many cores, "
            f"{(plan.size_bytes or 0.0) / 1e6:,.1f} MB (measured on {PROBE_FRAMES} "
            f"frames: {probe.frame_cpu_s:.2f} s a frame and {probe.clip_cpu_s:.1f} s a clip of "
            f"processor time, {probe.frame_bytes / 1e3:.0f} kB a frame, {probe.memory_mib:.0f} MiB "
            "of memory for each worker)"
        )
    return lines


def _memory_mib() -> float:
    """The largest memory of this process and of its largest ended child, together [MiB]."""
    whose = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    return sum(resource.getrusage(who).ru_maxrss for who in whose) / 1024.0


def _children_cpu_s() -> float:
    """Processor time of all ended child processes so far [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
