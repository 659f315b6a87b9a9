"""What a clip costs beside Blender's bare render of it, and beside a script that starts anew."""

import shutil
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

from render.clips import PROGRAMMES, walk_clip
from render.scale import Scale
from render.timing import Spent, run_in_blender, run_python

from gmrdata.film.render import RenderConfig, RenderJob, render_clip
from gmrdata.film.scene import SceneConfig
from gmrdata.values.files import write_text

HERE = Path(__file__).parent
CONFIG = RenderConfig(scene=SceneConfig(kind="street", seed=1))


def measure_overhead(
    root: Path, body_path: Path, size_px: tuple[int, int], scale: Scale
) -> dict[str, Any]:
    """Wall time of a clip over that of the bare render; processes from start to end.

    The machine's speed drifts while it is measured, so each clip is compared with the mean of the
    bare renders right before and right after it; what counts is the median of these ratios.
    """
    root.mkdir(parents=True)
    clip_path = walk_clip(
        root / "clip.npz", body_path, PROGRAMMES["circular"], scale.overhead_frames, size_px
    )
    blend_dir = render_clip(
        clip_path,
        body_path,
        root / "blend",
        CONFIG.model_copy(update={"blend": True}),
        on_frame=lambda _: None,
    )
    blend = blend_dir / "scene" / "scene.blend"
    ours: list[Spent] = []
    bare = [_bare(blend, root / "bare", scale)]
    for run in range(scale.overhead_runs):
        ours.append(_ours(clip_path, body_path, root / f"ours{run}"))
        bare.append(_bare(blend, root / f"bare{run}", scale))
    figures = {
        "size_px": list(size_px),
        "frames": scale.overhead_frames,
        "clip_wall_s": [round(spent.wall_s, 2) for spent in ours],
        "bare_wall_s": [round(spent.wall_s, 2) for spent in bare],
        "clip_cpu_s": [round(spent.cpu_s, 2) for spent in ours],
        "bare_cpu_s": [round(spent.cpu_s, 2) for spent in bare],
        "ratio": _ratio([s.wall_s for s in ours], [s.wall_s for s in bare]),
        "cpu_ratio": _ratio([s.cpu_s for s in ours], [s.cpu_s for s in bare]),
    }
    shutil.rmtree(root / "blend")
    return figures


def _ratio(ours_s: list[float], bare_s: list[float]) -> float:
    """Median of each clip's time over the mean of its two neighbours'; one bare more than ours."""
    around_s = [(before + after) / 2 for before, after in pairwise(bare_s)]
    return round(median(a / b for a, b in zip(ours_s, around_s, strict=True)), 4)


def _ours(clip_path: Path, body_path: Path, out_dir: Path) -> Spent:
    return run_python(HERE / "one_clip.py", clip_path, body_path, out_dir, CONFIG.model_dump_json())


def _bare(blend: Path, out_dir: Path, scale: Scale) -> Spent:
    spent = run_in_blender(HERE / "bare.py", blend, out_dir, str(CONFIG.jpeg_quality))
    for kind in ("frames/*.jpg", "masks/*.png"):
        assert len(list(out_dir.glob(kind))) == scale.overhead_frames, f"no {kind} in {out_dir}"
    return spent


def measure_script(root: Path, body_path: Path, clip_wall_s: float, scale: Scale) -> dict[str, Any]:
    """Wall time of a frame where the scene is set up anew for it, over that of one of a clip."""
    root.mkdir(parents=True)
    size_px, n_frames = scale.overhead_sizes_px[0], scale.overhead_frames
    clip_path = walk_clip(root / "clip.npz", body_path, PROGRAMMES["circular"], n_frames, size_px)
    job = RenderJob(
        clip_path=clip_path,
        body_path=body_path,
        out_dir=root / "out",
        config=CONFIG,
        layout_paths=(clip_path,),
    )
    write_text(root / "job.json", job.model_dump_json())
    spent = run_in_blender(HERE / "anew.py", root / "job.json", str(scale.script_frames))
    assert len(list((root / "out").glob("*.jpg"))) == scale.script_frames
    frame_s = spent.wall_s / scale.script_frames
    return {
        "frames": scale.script_frames,
        "script_s_per_frame": round(frame_s, 3),
        "clip_s_per_frame": round(clip_wall_s / n_frames, 3),
        "ratio": round(frame_s / (clip_wall_s / n_frames), 3),
    }
