"""A quick look at every clip of a set, apart from the set itself."""

import shutil
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path

import cv2
import numpy as np
from pydantic import Field

from gmrdata.film.render import (
    PreviewEngine,
    PreviewJob,
    RenderConfig,
    RenderJob,
    find_renderer,
    render_inputs,
    run_blender,
    with_full_paths,
)
from gmrdata.film.render_set import layouts_of, require_takes
from gmrdata.film.set_plan import SyntheticRecipe, render_config
from gmrdata.film.set_takes import plan_takes, select
from gmrdata.pages.document import figure, text
from gmrdata.pages.strip import tile_sheet
from gmrdata.pages.synthetic import CONTACT_FILE, GAP_PX, PATHS_FILE, paths_picture, write_bytes
from gmrdata.read.bodies import keep_body
from gmrdata.stage.jobs import Job, raise_failures, try_jobs, worker_pool
from gmrdata.stage.progress import console
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.clip import camera_of, load_clip
from gmrdata.values.errors import EngineMissing
from gmrdata.values.files import write_text
from gmrdata.values.records import Config

FOLDER = "preview"
WIDTH_PX = 240
COLUMNS = 4
RETRIES = 1


class PreviewConfig(Config):
    """What a preview shows."""

    render: RenderConfig
    """The clip's settings, for its place and its people."""
    engine: PreviewEngine
    """What draws it."""
    n_frames: int = Field(default=8, ge=1)
    """Frames, evenly spaced from the first to the last."""


def preview_set(
    recipe: SyntheticRecipe,
    out_dir: Path,
    *,
    motions_dir: Path | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Draw a few small frames and the paths of every clip to `out_dir/preview/index.html`.

    Nothing else below `out_dir` is read or written.  A clip whose plan changed is drawn again.

    Returns:
        Path of the page.

    Raises:
        MissingInput: not one clip of the recipe can be filmed.
        StageFailed: some clips can't be filmed or drawn; the others are on the page.
    """
    selection = select(recipe, motions_dir)
    require_takes(recipe, selection, motions_dir)
    out_dir = out_dir.resolve() / FOLDER
    body_path = keep_body(recipe.body, out_dir / "body", run=Run(redo=True))
    planned = plan_takes(recipe, selection, body_path, out_dir / "plan", run=Run(redo=True))
    engine = _choose_engine()
    renders = {take.id: render_config(recipe, take.clip) for take in selection.takes}
    layouts = layouts_of(selection.takes, planned.paths)
    jobs = [
        Job(
            id,
            preview_clip,
            {
                "clip_path": path,
                "body_path": body_path,
                "out_dir": out_dir / "clips" / id,
                "config": PreviewConfig(render=renders[id], engine=engine),
                "layout_paths": tuple(layouts.get(id, ())),
            },
            retries=RETRIES,
        )
        for id, path in planned.paths.items()
    ]
    failures_dir = out_dir / "failed"
    with worker_pool(run, recipe.workers) as client:
        outcome = try_jobs("preview", jobs, client, failures_dir)
    reasons = {**planned.reasons, **outcome.reasons}
    motions = {take.id: take.camera_motion for take in selection.takes}
    page = _write_page(out_dir / "index.html", recipe, list(outcome.results), motions)
    raise_failures("preview", reasons, len(selection.takes), failures_dir)
    return page


def preview_clip(
    clip_path: Path,
    body_path: Path,
    out_dir: Path,
    config: PreviewConfig,
    *,
    layout_paths: Sequence[Path] = (),
) -> Path:
    """Stage: `contact.jpg` and `paths.png` of a planned clip.

    Args:
        clip_path: The planned clip.
        body_path: Its body.
        out_dir: The stage's folder; made anew when anything changed.
        config: What to show.
        layout_paths: Clips that share its place, as for `render_clip`.

    Raises:
        RenderFailed: Blender ended without its result.
    """

    def work(partial_dir: Path) -> None:
        clip = load_clip(clip_path)
        n_shown = min(config.n_frames, clip.motion.n_frames)
        rows = np.linspace(0, clip.motion.n_frames - 1, n_shown).round().astype(int)
        render = RenderJob(
            clip_path=clip_path.resolve(),
            body_path=body_path.resolve(),
            out_dir=partial_dir.resolve(),
            config=with_full_paths(config.render).model_copy(
                update={"engine": "cycles", "device": "cpu"}
            ),
            layout_paths=tuple(path.resolve() for path in layout_paths),
        )
        job = PreviewJob(
            render=render,
            rows=tuple(int(row) for row in rows),
            percent=min(100, max(1, round(100 * WIDTH_PX / camera_of(clip).width_px))),
            engine=config.engine,
        )
        run_blender(job, partial_dir, lambda _: None, module="blender.preview")
        pictures = sorted((partial_dir / "frames").glob("*.jpg"))
        tiles = [np.asarray(cv2.imread(str(path), cv2.IMREAD_COLOR)) for path in pictures]
        _, sheet = cv2.imencode(".jpg", tile_sheet(tiles, COLUMNS, GAP_PX))
        write_bytes(partial_dir / CONTACT_FILE, sheet.tobytes())
        write_bytes(partial_dir / PATHS_FILE, paths_picture(clip))
        shutil.rmtree(partial_dir / "frames")

    inputs = render_inputs(clip_path, body_path, config.render, layout_paths)
    return run_stage("preview", out_dir, config, inputs, work, run=Run(redo=True))


def _choose_engine() -> PreviewEngine:
    """Workbench where it runs, else Cycles, which is said."""
    try:
        find_renderer("workbench", "cpu")
    except EngineMissing:
        console.print(
            "Workbench can't draw here (it needs OpenGL through EGL); "
            "the preview is drawn by Cycles with one ray per pixel",
            markup=False,
            soft_wrap=True,
        )
        return "cycles"
    return "workbench"


def _write_page(
    path: Path, recipe: SyntheticRecipe, ids: Sequence[str], motions: Mapping[str, str]
) -> Path:
    style = resources.files("gmrdata.pages").joinpath("report.css").read_text(encoding="utf-8")
    title = text(f"{recipe.name} {recipe.version}: preview")
    sections = "\n".join(_section(id, motions[id]) for id in ids)
    write_text(
        path,
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{title}</title>\n<style>\n{style}</style></head>\n<body>\n"
        f'<header><h1>{title}</h1><p class="lead">{len(ids)} clips. Quick drawings to look at: '
        "the set's own frames have other light and colours.</p></header>\n"
        f"<main>\n{sections}\n</main>\n</body></html>\n",
    )
    return path


def _section(id: str, camera_motion: str) -> str:
    pictures = "".join(
        figure(f'<img src="clips/{text(id)}/{name}" alt="{text(id)}" loading="lazy">', caption)
        for name, caption in ((CONTACT_FILE, "Evenly spaced frames."), (PATHS_FILE, "Paths."))
    )
    return (
        f'<section id="{text(id)}"><h2>{text(id)}, {text(camera_motion)}</h2>{pictures}</section>'
    )
