"""Render several clips at once, each in a worker of its own."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gmrdata.film.render import RenderConfig, render_clip
from gmrdata.stage.jobs import Job, Outcome, count_files, raise_failures, try_jobs
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.values.clip import load_clip

DESCRIPTION = "rendering frames"
RETRIES = 1
"""How often a crashed Blender process is started again."""


def render_clips(
    planned: Mapping[str, Path],
    body_path: Path,
    out_dir: Path,
    config: RenderConfig,
    client: Any,
    failures_dir: Path,
    *,
    run: Run = DEFAULT_RUN,
) -> None:
    """Render each planned clip as `try_render_clips` does, for callers that need them all.

    Raises:
        StageFailed: some clips failed; the others are done.
    """
    configs = dict.fromkeys(planned, config)
    outcome = try_render_clips(planned, body_path, out_dir, configs, client, failures_dir, run=run)
    raise_failures(DESCRIPTION, outcome.reasons, len(planned), failures_dir)


def try_render_clips(
    planned: Mapping[str, Path],
    body_path: Path,
    out_dir: Path,
    configs: Mapping[str, RenderConfig],
    client: Any,
    failures_dir: Path,
    *,
    layouts: Mapping[str, Sequence[Path]] | None = None,
    run: Run = DEFAULT_RUN,
) -> Outcome:
    """Render each planned clip to `out_dir/<id>`, with one progress bar over all frames.

    A Blender process that ends without its result is started once more, at the next missing frame.

    Args:
        planned: Clip file by id.
        out_dir: Gets one stage folder for each clip.
        configs: The recipe of each clip, by id.
        client: A Dask client.
        failures_dir: Gets the reasons of clips that failed.
        layouts: By id, the planned clips that share a place with a clip, itself among them.

    Returns:
        Each rendered clip's folder, and why the other clips failed.
    """
    jobs = [
        Job(
            clip_id,
            render_clip,
            {
                "clip_path": path,
                "body_path": body_path,
                "out_dir": out_dir / clip_id,
                "config": configs[clip_id],
                "run": run,
                "layout_paths": tuple((layouts or {}).get(clip_id, ())),
            },
            retries=RETRIES,
        )
        for clip_id, path in planned.items()
    ]
    folders = [out_dir / clip_id for clip_id in planned]
    return try_jobs(
        DESCRIPTION,
        jobs,
        client,
        failures_dir,
        units_total=sum(load_clip(path).motion.n_frames for path in planned.values()),
        units_done=lambda: count_files(folders, "masks/[0-9]*.png"),
    )
