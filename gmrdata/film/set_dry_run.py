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
from gmrdata.film.set_plan import SyntheticRecipe, render_config
from gmrdata.film.set_takes import plan_takes, select
from gmrdata.motion.resample import slice_motion
from gmrdata.read.bodies import keep_body, read_body
from gmrdata.stage.jobs import count_files
from gmrdata.values.clip import Clip, load_clip, save_clip

PROBE_FRAMES = 2
"""The first frame pays for the scene, the second is what a frame costs."""
HEADINGS = ("clip", "motion", "camera", "frames", "state")


@dataclass(frozen=True)
class Probe:
    """What was measured on a slice of one clip, rendered at its real settings."""

    frame_cpu_s: float
    """Processor time of a frame [s]."""
    clip_cpu_s: float
    """Processor time that a clip takes before its first frame: Blender's start, the scene [s]."""
    frame_bytes: float
    """Size of a frame's files [bytes]."""


@dataclass(frozen=True)
class DryRun:
    """What a run would do."""

    rows: Sequence[Sequence[str]]
    """A table with `HEADINGS`."""
    clips: int
    """Clips that can be filmed."""
    clips_to_do: int
    """Those of them that aren't done."""
    frames: int
    """Frames of all clips that can be filmed."""
    frames_to_do: int
    """Frames that aren't there."""
    workers: int
    """Workers that have a clip to render."""
    probe: Probe | None
    """None when there is nothing to do, or no probe was wanted."""

    @property
    def seconds(self) -> float | None:
        """Estimate of the wall time when each worker has a core of its own [s]."""
        if self.probe is None:
            return None
        cpu_s = (
            self.clips_to_do * self.probe.clip_cpu_s + self.frames_to_do * self.probe.frame_cpu_s
        )
        return cpu_s / self.workers

    @property
    def size_bytes(self) -> float | None:
        """Estimate of the disk that the frames to do take [bytes]."""
        return None if self.probe is None else self.frames_to_do * self.probe.frame_bytes


def dry_run(
    recipe: SyntheticRecipe, out_dir: Path, *, motions_dir: Path | None = None, probe: bool = True
) -> DryRun:
    """Plan every clip in a temporary folder and, for a probe, render two frames of one there.

    Nothing is written below `out_dir`.

    Args:
        out_dir: Where the set would be; what is done there counts as done.
        probe: Render two frames of the first clip that isn't done.

    Raises:
        RenderFailed: the probe can't be rendered.
    """
    selection = select(recipe, motions_dir)
    with tempfile.TemporaryDirectory(prefix="gmrdata-") as folder:
        body_path = keep_body(recipe.body, Path(folder) / "body")
        planned = plan_takes(recipe, selection, body_path, Path(folder) / "plan")
        clips = {id: load_clip(path) for id, path in planned.paths.items()}
        todo = [id for id in clips if not render_dir(out_dir, id).is_dir()]
        measured = None
        if probe and todo:
            take = next(take for take in selection.takes if take.id == todo[0])
            config = render_config(recipe, take.clip)
            measured = probe_clip(clips[take.id], body_path, config, Path(folder) / "probe")
    rows: list[Sequence[str]] = []
    for take in selection.takes:
        done = "to do" if take.id in todo else "done"
        clip = clips.get(take.id)
        rows.append(
            (
                take.id,
                take.clip.trial or f"gait {take.clip.gait}",
                take.camera_motion,
                "" if clip is None else str(clip.motion.n_frames),
                done if clip is not None else f"can't be filmed: {planned.reasons[take.id]}",
            )
        )
    rows += [(trial, trial, "", "", "no motion file") for trial in selection.missing]
    frames = {id: clip.motion.n_frames for id, clip in clips.items()}
    there = count_files([render_dir(out_dir, id) for id in todo], "masks/[0-9]*.png")
    return DryRun(
        rows=rows,
        clips=len(clips),
        clips_to_do=len(todo),
        frames=sum(frames.values()),
        frames_to_do=max(0, sum(frames[id] for id in todo) - there),
        workers=max(1, min(recipe.workers, len(todo))),
        probe=measured,
    )


def probe_clip(clip: Clip, body_path: Path, config: RenderConfig, folder: Path) -> Probe:
    """Render two frames from the middle of a clip and measure them.

    Args:
        folder: Where to; the caller removes it.

    Raises:
        RenderFailed: Blender ended without its result.
    """
    piece = _slice(clip, clip.motion.n_frames // 2, PROBE_FRAMES)
    clip_path = folder / "slice.npz"
    save_clip(clip_path, piece, read_body(body_path).rest_pelvis_m(clip.motion.shape))
    told_s: list[float] = []
    before_cpu_s, start_s = _children_cpu_s(), time.monotonic()
    made = render_clip(
        clip_path,
        body_path,
        folder / "render",
        config,
        on_frame=lambda _: told_s.append(time.monotonic()),
    )
    wall_s, cpu_s = time.monotonic() - start_s, _children_cpu_s() - before_cpu_s
    # Blender's time is known as a whole; the clock says which share of it the last frame took.
    frame_s = (told_s[-1] - told_s[0]) / (len(told_s) - 1) if len(told_s) > 1 else wall_s
    frame_cpu_s = cpu_s * frame_s / wall_s
    size_bytes = sum(path.stat().st_size for path in made.glob("*/*") if path.is_file())
    return Probe(
        frame_cpu_s=frame_cpu_s,
        clip_cpu_s=max(0.0, cpu_s - piece.motion.n_frames * frame_cpu_s),
        frame_bytes=size_bytes / piece.motion.n_frames,
    )


def summary_lines(plan: DryRun) -> list[str]:
    """The sums of a dry run, for a person."""
    lines = [
        f"{plan.clips} clips, {plan.frames} frames; to do: {plan.clips_to_do} clips, "
        f"{plan.frames_to_do} frames"
    ]
    seconds, size_bytes = plan.seconds, plan.size_bytes
    if plan.probe is not None and seconds is not None and size_bytes is not None:
        lines.append(
            f"about {_duration(seconds)} with {plan.workers} workers on as many cores, "
            f"{size_bytes / 1e6:,.1f} MB (measured on {PROBE_FRAMES} frames: "
            f"{plan.probe.frame_cpu_s:.2f} s a frame and {plan.probe.clip_cpu_s:.1f} s a clip of "
            f"processor time, {plan.probe.frame_bytes / 1e3:.0f} kB a frame)"
        )
    return lines


def _slice(clip: Clip, start: int, count: int) -> Clip:
    rows = np.arange(start, min(start + count, clip.motion.n_frames))
    return Clip(
        id=clip.id,
        motion=slice_motion(clip.motion, int(rows[0]), int(rows[-1]) + 1),
        valid=clip.valid[rows],
        image_numbers=np.arange(len(rows)),
        camera=None if clip.camera is None else clip.camera.at_rows(rows),
    )


def _children_cpu_s() -> float:
    """Processor time of all ended child processes so far [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
