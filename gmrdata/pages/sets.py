"""Pages of a set of rendered clips: its index, and a quick preview of it before it is rendered."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gmrdata.film import render as rendering
from gmrdata.film.render_outputs import IN_FRAME
from gmrdata.film.render_set import frame_warnings, render_dir, require_takes
from gmrdata.film.scene import SceneConfig
from gmrdata.film.set_plan import SyntheticRecipe, plan_takes, select
from gmrdata.manifest.current import ClipEntry, Quality
from gmrdata.manifest.read import read_manifest
from gmrdata.pages import frames
from gmrdata.pages.html import Cell, Table, render, write_page
from gmrdata.pages.plots import picture, plot_clip_view
from gmrdata.read.bodies import keep_body
from gmrdata.read.frames import read_color
from gmrdata.stage.jobs import Job, raise_failures, try_jobs
from gmrdata.stage.progress import remark, track
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.stage.workers import worker_pool
from gmrdata.values.clip import Clip, camera_of, load_clip
from gmrdata.values.errors import EngineMissing
from gmrdata.values.files import remove_orphans, write_bytes
from gmrdata.values.records import Config

PATHS_FILE = "paths.png"
SHEET_FRAMES, SHEET_COLUMNS = 6, 3
PREVIEW_FRAMES, PREVIEW_COLUMNS = 8, 4
PLOT_IN = 4.0
PREVIEW_FOLDER = "preview"
PREVIEW_WIDTH_PX = 240
RETRIES = 1
ANEW = Run(anew=True)


def write_set_pages(recipe: SyntheticRecipe, out_dir: Path) -> None:
    """Draw every clip of a rendered set to `sheets/<id>` and list them in `index.html`; nothing
    where `out_dir` holds no manifest."""
    if not (manifest_path := out_dir / "synthetic.yaml").is_file():
        return
    remove_orphans(out_dir)
    clips = [clip for clip in read_manifest(manifest_path).clips if isinstance(clip, ClipEntry)]
    for clip in track(clips, "drawing contact sheets"):
        make_sheet(render_dir(out_dir, clip.id), out_dir / "sheets" / clip.id)
    warnings = frame_warnings(clips, recipe.min_in_frame_share)
    n_frames = sum(clip.n_frames for clip in clips)
    seconds = sum(clip.n_frames / clip.fps_hz for clip in clips)
    page = render(
        "clips",
        title=f"{recipe.name} {recipe.version}",
        lead=f"{len(clips)} clips, {n_frames} frames, {seconds:.1f} s; exact cameras and masks.",
        table=_clip_table(clips),
        clips=[_clip_section(clip, warnings.get(clip.id)) for clip in clips],
    )
    write_page(out_dir / "index.html", page)


def _clip_table(clips: Sequence[ClipEntry]) -> Table:
    headings = ("clip", "camera", "frames", "frame rate [Hz]", "whole person in frame")
    rows: list[tuple[Cell | str, ...]] = []
    for clip in clips:
        share = (clip.quality or Quality()).figures[IN_FRAME]
        figures = clip.camera_motion, str(clip.n_frames), f"{clip.fps_hz:g}", f"{share:.0%}"
        rows.append((Cell(clip.id, href=f"#{clip.id}"), *figures))
    return Table(headings, rows, "All clips of the set.")


def _clip_section(clip: ClipEntry, warning: str | None) -> dict[str, object]:
    """What the page shows of a clip; (file, alternative text, caption) of each picture."""
    place = "unknown"
    if clip.recipe is not None:
        scene = SceneConfig.of_plain(clip.recipe.config["scene"])
        light = scene.lit_by if scene.backdrop is None else "its own light"
        place = f"{scene.kind}, {light}, seed {scene.seed}"
    rows: list[tuple[str, Cell | str]] = [
        ("motion", f"{clip.source.dataset} {clip.source.sequence}"),
        ("camera", clip.camera_motion),
        ("place", place),
        ("licence", clip.licence),
    ]
    rows += _character_rows(clip)
    rows += [("warning", Cell(warning, kind="bad"))] if warning else []
    captions = (
        (frames.CONTACT_FILE, f"Frames of {clip.id}",
         "Evenly spaced frames; the white line is the mask's outline."),
        (PATHS_FILE, f"Paths of {clip.id} from above",
         "Paths of camera and person from above, with the camera's viewing directions."),
    )  # fmt: skip
    section = {"id": clip.id, "title": clip.id, "folder": f"sheets/{clip.id}"}
    return {**section, "rows": rows, "captions": captions}


def _character_rows(clip: ClipEntry) -> list[tuple[str, Cell | str]]:
    """How far a character's joints and limbs are from those of the body that drives it."""
    figures = (clip.quality or Quality()).figures
    if "character_residual_mm_mean" not in figures:
        return []
    mean_mm, max_mm, mean_deg = (
        figures[f"character_{name}"]
        for name in ("residual_mm_mean", "residual_mm_max", "bone_direction_deg_mean")
    )
    joints = f"joints {mean_mm:.0f} mm in the mean and {max_mm:.0f} mm at most"
    return [("character beside body", f"{joints}; directions of limbs {mean_deg:.2f} degrees")]


def make_sheet(rendered_dir: Path, out_dir: Path) -> Path:
    """Stage: `contact.jpg` and `paths.png` of a rendered clip, made anew when it changed."""
    names = {"clip": "clip.npz", "frames": "frames", "masks": "masks"}
    inputs = {role: rendered_dir / name for role, name in names.items()}

    def work(partial_dir: Path) -> None:
        some = frames.masked_frames(inputs["frames"], inputs["masks"], SHEET_FRAMES)
        tiles = [frames.draw_mask_outline(*one) for one in some]
        _write_pictures(partial_dir, tiles, SHEET_COLUMNS, load_clip(inputs["clip"]))

    return run_stage("sheet", out_dir, Config(), inputs, work, run=ANEW)


def _write_pictures(folder: Path, tiles: Sequence[np.ndarray], columns: int, clip: Clip) -> None:
    write_bytes(folder / frames.CONTACT_FILE, frames.jpeg(frames.tile_sheet(tiles, columns)))
    paths = picture(lambda plot: plot_clip_view(plot.subplots(), clip), PLOT_IN, PLOT_IN, dpi=100)
    write_bytes(folder / PATHS_FILE, paths)


class PreviewConfig(Config):
    """What a preview shows."""

    render: rendering.RenderConfig
    """The clip's settings, for its place and its people."""
    engine: rendering.PreviewEngine


def preview_set(
    recipe: SyntheticRecipe,
    out_dir: Path,
    *,
    motions_dir: Path | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Draw a few small frames and the paths of every clip to `out_dir/preview/index.html`.

    Nothing else below `out_dir` is read or written.  A clip whose plan changed is drawn again.
    StageFailed names clips that can't be filmed or drawn; the others are on the page.
    """
    selection = select(recipe, motions_dir)
    require_takes(selection)
    out_dir = out_dir.resolve() / PREVIEW_FOLDER
    body_path = keep_body(recipe.body, out_dir / "body", run=ANEW)
    todo, reasons = plan_takes(selection, body_path, out_dir / "plan", out_dir / "clips", ANEW)
    engine = _choose_engine()
    jobs = [
        Job(id, preview_clip, {"job": job, "engine": engine, "run": ANEW}, retries=RETRIES)
        for id, job in todo.items()
    ]
    failures_dir = out_dir / "failed"
    with worker_pool(run, recipe.workers) as pool:
        outcome = try_jobs("preview", jobs, pool, failures_dir)
    drawn = [take for take in selection.takes if take.id in outcome.results]
    title = f"{recipe.name} {recipe.version}: preview"
    lead = "clips. Quick drawings to look at: the set's own frames have other light and colours."
    captions = (frames.CONTACT_FILE, "Evenly spaced frames."), (PATHS_FILE, "Paths.")
    sections = [
        {"id": take.id, "title": f"{take.id}, {take.camera_motion}", "folder": f"clips/{take.id}",
         "rows": (), "captions": [(file, take.id, said) for file, said in captions]}
        for take in drawn
    ]  # fmt: skip
    page = render("clips", title=title, lead=f"{len(drawn)} {lead}", table=None, clips=sections)
    index = write_page(out_dir / "index.html", page)
    raise_failures("preview", reasons | outcome.reasons, len(selection.takes), failures_dir)
    return index


def preview_clip(job: rendering.RenderJob, engine: rendering.PreviewEngine, *, run: Run) -> Path:
    """Stage: `contact.jpg` and `paths.png` of a planned clip, made anew when anything changed."""
    config = PreviewConfig(render=job.config, engine=engine)
    cycles = job.config.model_copy(update={"engine": "cycles", "device": "cpu"})

    def work(partial_dir: Path) -> None:
        clip = load_clip(job.clip_path)
        preview = rendering.PreviewJob(
            render=job.model_copy(update={"out_dir": partial_dir, "config": cycles}),
            rows=tuple(frames.spaced(clip.motion.n_frames, PREVIEW_FRAMES)),
            percent=min(100, max(1, round(100 * PREVIEW_WIDTH_PX / camera_of(clip).width_px))),
            engine=engine,
        )
        rendering.run_blender(preview, partial_dir, lambda _: None, module="blender.preview")
        tiles = [read_color(path) for path in sorted((partial_dir / "frames").glob("*.jpg"))]
        _write_pictures(partial_dir, tiles, PREVIEW_COLUMNS, clip)
        shutil.rmtree(partial_dir / "frames")

    return run_stage("preview", job.out_dir, config, job.inputs, work, run=run)


def _choose_engine() -> rendering.PreviewEngine:
    """Workbench where it runs, else Cycles, which is said."""
    try:
        rendering.find_renderer("workbench", "cpu")
    except EngineMissing:
        what = "Workbench can't draw here (it needs OpenGL through EGL)"
        instead = "the preview is drawn by Cycles with one ray per pixel"
        remark(f"{what}; {instead}")
        return "cycles"
    return "workbench"
