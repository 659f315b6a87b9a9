"""Throughput of two workers against one, and whether a clip comes out the same twice."""

import time
from pathlib import Path
from typing import Any

from render.clips import PROGRAMMES, walk_clip
from render.overhead import CONFIG
from render.scale import Scale

from gmrdata.film.render import RenderJob
from gmrdata.film.render_set import render_clips
from gmrdata.stage.run import Run
from gmrdata.stage.workers import worker_pool
from gmrdata.values.files import sha256_of_path


def measure_workers(root: Path, body_path: Path, scale: Scale) -> dict[str, Any]:
    """Wall time of the same clips with one and with two workers, the pool's start included."""
    (root / "clips").mkdir(parents=True)
    size_px = scale.overhead_sizes_px[0]
    clips = {
        f"walk{seed}": walk_clip(
            root / "clips" / f"walk{seed}.npz",
            body_path,
            PROGRAMMES["circular"],
            scale.pool_frames,
            size_px,
            seed,
        )
        for seed in range(scale.pool_clips)
    }
    wall_s = {}
    for count in (1, 2):
        start_s = time.perf_counter()
        with worker_pool(Run(workers=count)) as pool:
            jobs = {
                id: RenderJob(
                    clip_path=path,
                    body_path=body_path,
                    out_dir=root / f"by_{count}" / id,
                    config=CONFIG,
                )
                for id, path in clips.items()
            }
            render_clips(jobs, pool, root / "failed")
        wall_s[count] = time.perf_counter() - start_s
    return {
        "clips": scale.pool_clips,
        "frames_per_clip": scale.pool_frames,
        "one_worker_s": round(wall_s[1], 2),
        "two_workers_s": round(wall_s[2], 2),
        "ratio": round(wall_s[1] / wall_s[2], 3),
        "clips_that_repeat": sum(
            sha256_of_path(root / "by_1" / clip_id) == sha256_of_path(root / "by_2" / clip_id)
            for clip_id in clips
        ),
    }
