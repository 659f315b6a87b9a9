"""Pages of a set of rendered clips: its index, and a quick preview of it before it is rendered."""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from pydantic import Field

from gmrdata.film.render import (
    PreviewEngine,
    PreviewJob,
    RenderConfig,
    RenderJob,
    find_renderer,
    run_blender,
)
from gmrdata.film.render_outputs import IN_FRAME
from gmrdata.film.render_set import frame_warnings, render_dir, require_takes
from gmrdata.film.scene import SceneConfig
from gmrdata.film.set_plan import SyntheticRecipe, plan_takes, select
from gmrdata.manifest.current import Clip as ClipEntry
from gmrdata.manifest.current import Quality
from gmrdata.manifest.read import read_manifest
from gmrdata.pages.frames import (
    CONTACT_FILE,
    draw_mask_outline,
    jpeg,
    read_image,
    spaced,
    tile_sheet,
    write_bytes,
)
from gmrdata.pages.html import Cell, Table, render
from gmrdata.pages.plots import picture, plot_clip_view
from gmrdata.read.bodies import keep_body
from gmrdata.read.frames import list_images
from gmrdata.stage.jobs import Job, raise_failures, try_jobs, worker_pool
from gmrdata.stage.progress import console, track
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.clip import Clip, camera_of, load_clip
from gmrdata.values.errors import EngineMissing
from gmrdata.values.files import remove_orphans, write_text
from gmrdata.values.records import Config

PATHS_FILE = "paths.png"
SHEET_COLUMNS, PREVIEW_COLUMNS = 3, 4
PLOT_IN = 4.0
PREVIEW_FOLDER = "preview"
PREVIEW_WIDTH_PX = 240
RETRIES = 1


class ClipSection(NamedTuple):
    """One clip of a page."""

    id: str
    folder: str
    """Where its pictures are, from the page."""
    title: str
    rows: Sequence[tuple[str, Cell | str]]
    captions: Sequence[tuple[str, str, str]]
    """(file, alternative text, caption) of each picture."""


def write_set_pages(recipe: SyntheticRecipe, out_dir: Path) -> None:
    """Draw every clip of a rendered set to `sheets/<id>` and list them in `index.html`.

    Nothing is drawn where `out_dir` holds no manifest.
    """
    manifest_path = out_dir / "synthetic.yaml"
    if not manifest_path.is_file():
        return
    remove_orphans(out_dir)
    clips = [clip for clip in read_manifest(manifest_path).clips if isinstance(clip, ClipEntry)]
    for clip in track(clips, "drawing contact sheets"):
        make_sheet(render_dir(out_dir, clip.id), out_dir / "sheets" / clip.id)
    warnings = frame_warnings(clips, recipe.min_in_frame_share)
    n_frames = sum(clip.n_frames for clip in clips)
    seconds = sum(clip.n_frames / clip.fps_hz for clip in clips)
    lead = f"{len(clips)} clips, {n_frames} frames, {seconds:.1f} s; exact cameras and masks."
    page = render(
        "clips",
        title=f"{recipe.name} {recipe.version}",
        lead=lead,
        table=_clip_table(clips),
        clips=[_clip_section(clip, warnings.get(clip.id)) for clip in clips],
    )
    write_text(out_dir / "index.html", page)


def _clip_table(clips: Sequence[ClipEntry]) -> Table:
    headings = ("clip", "camera", "frames", "frame rate [Hz]", "whole person in frame")
    rows = [
        (
            Cell(clip.id, href=f"#{clip.id}"),
            clip.camera_motion,
            str(clip.n_frames),
            f"{clip.fps_hz:g}",
            f"{(clip.quality or Quality()).figures[IN_FRAME]:.0%}",
        )
        for clip in clips
    ]
    return Table(headings, rows, "All clips of the set.")


def _clip_section(clip: ClipEntry, warning: str | None) -> ClipSection:
    place = "unknown"
    if clip.recipe is not None:
        scene = SceneConfig.model_validate(clip.recipe.config["scene"])
        place = f"{scene.kind}, {scene.lit_by}, seed {scene.seed}"
    rows: list[tuple[str, Cell | str]] = [
        ("motion", f"{clip.source.dataset} {clip.source.sequence}"),
        ("camera", clip.camera_motion),
        ("place", place),
        ("licence", clip.licence),
    ]
    rows += [("warning", Cell(warning, kind="bad"))] if warning else []
    captions = (
        (CONTACT_FILE, f"Frames of {clip.id}",
         "Evenly spaced frames; the white line is the mask's outline."),
        (PATHS_FILE, f"Paths of {clip.id} from above",
         "Paths of camera and person from above, with the camera's viewing directions."),
    )  # fmt: skip
    return ClipSection(clip.id, f"sheets/{clip.id}", clip.id, rows, captions)


class SheetConfig(Config):
    """What a contact sheet shows."""

    n_frames: int = Field(default=6, ge=1)
    """Frames, evenly spaced from the first to the last."""


def make_sheet(rendered_dir: Path, out_dir: Path) -> Path:
    """Stage: `contact.jpg`, frames with the mask's outline, and `paths.png`, the paths from above.

    It is made anew when the rendered clip changed.
    """
    config = SheetConfig()
    inputs = {"clip": rendered_dir / "clip.npz"}
    inputs |= {name: rendered_dir / name for name in ("frames", "masks")}

    def work(partial_dir: Path) -> None:
        images = list_images(inputs["frames"])
        tiles = []
        for image in (images[row] for row in spaced(len(images), config.n_frames)):
            mask = read_image(inputs["masks"] / f"{image.stem}.png", cv2.IMREAD_GRAYSCALE)
            tiles.append(draw_mask_outline(read_image(image, cv2.IMREAD_COLOR), mask))
        _write_pictures(partial_dir, tiles, SHEET_COLUMNS, load_clip(inputs["clip"]))

    return run_stage("sheet", out_dir, config, inputs, work, run=Run(redo=True))


def _write_pictures(folder: Path, tiles: Sequence[np.ndarray], columns: int, clip: Clip) -> None:
    write_bytes(folder / CONTACT_FILE, jpeg(tile_sheet(tiles, columns)))
    paths = picture(lambda plot: plot_clip_view(plot.subplots(), clip), PLOT_IN, PLOT_IN, dpi=100)
    write_bytes(folder / PATHS_FILE, paths)


class PreviewConfig(Config):
    """What a preview shows."""

    render: RenderConfig
    """The clip's settings, for its place and its people."""
    engine: PreviewEngine
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

    Raises:
        StageFailed: some clips can't be filmed or drawn; the others are on the page.
    """
    selection = select(recipe, motions_dir)
    require_takes(selection, motions_dir)
    out_dir = out_dir.resolve() / PREVIEW_FOLDER
    anew = Run(redo=True)
    body_path = keep_body(recipe.body, out_dir / "body", run=anew)
    planned = plan_takes(selection, body_path, out_dir / "plan", run=anew)
    engine = _choose_engine()
    todo = {id: planned.render_job(id, out_dir / "clips" / id) for id in planned.paths}
    jobs = [
        Job(id, preview_clip, {"job": job, "engine": engine}, retries=RETRIES)
        for id, job in todo.items()
    ]
    failures_dir = out_dir / "failed"
    with worker_pool(run, recipe.workers) as client:
        outcome = try_jobs("preview", jobs, client, failures_dir)
    motions = {take.id: take.camera_motion for take in selection.takes}
    page = _write_preview(out_dir, recipe, list(outcome.results), motions)
    reasons = {**planned.reasons, **outcome.reasons}
    raise_failures("preview", reasons, len(selection.takes), failures_dir)
    return page


def _write_preview(
    out_dir: Path, recipe: SyntheticRecipe, ids: Sequence[str], motions: Mapping[str, str]
) -> Path:
    sections = [
        ClipSection(
            id, f"clips/{id}", f"{id}, {motions[id]}", (),
            ((CONTACT_FILE, id, "Evenly spaced frames."), (PATHS_FILE, id, "Paths.")),
        )
        for id in ids
    ]  # fmt: skip
    lead = f"{len(ids)} clips. Quick drawings to look at: the set's own frames have other light "
    title = f"{recipe.name} {recipe.version}: preview"
    page = render("clips", title=title, lead=lead + "and colours.", table=None, clips=sections)
    write_text(out_dir / "index.html", page)
    return out_dir / "index.html"


def preview_clip(job: RenderJob, engine: PreviewEngine) -> Path:
    """Stage: `contact.jpg` and `paths.png` of a planned clip, made anew when anything changed."""
    config = PreviewConfig(render=job.config, engine=engine)
    cycles = job.config.model_copy(update={"engine": "cycles", "device": "cpu"})

    def work(partial_dir: Path) -> None:
        clip = load_clip(job.clip_path)
        preview = PreviewJob(
            render=job.model_copy(update={"out_dir": partial_dir, "config": cycles}),
            rows=tuple(spaced(clip.motion.n_frames, config.n_frames)),
            percent=min(100, max(1, round(100 * PREVIEW_WIDTH_PX / camera_of(clip).width_px))),
            engine=config.engine,
        )
        run_blender(preview, partial_dir, lambda _: None, module="blender.preview")
        pictures = sorted((partial_dir / "frames").glob("*.jpg"))
        tiles = [read_image(path, cv2.IMREAD_COLOR) for path in pictures]
        _write_pictures(partial_dir, tiles, PREVIEW_COLUMNS, clip)
        shutil.rmtree(partial_dir / "frames")

    return run_stage("preview", job.out_dir, config, job.inputs, work, run=Run(redo=True))


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
