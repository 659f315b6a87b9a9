"""The index page of a synthetic set: every clip's contact sheet and paths.

A rendered clip at a glance: a contact sheet, and its paths from above.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure
from pydantic import Field

from gmrdata.film.render_outputs import IN_FRAME
from gmrdata.film.render_set import frame_warnings, render_dir
from gmrdata.film.scene import SceneConfig
from gmrdata.film.set_plan import SyntheticRecipe
from gmrdata.manifest.current import Clip as ClipEntry
from gmrdata.manifest.current import Quality
from gmrdata.manifest.read import read_manifest
from gmrdata.pages.document import document, figure, pairs, table, text
from gmrdata.pages.strip import draw_mask_outline, tile_sheet
from gmrdata.pages.style import picture
from gmrdata.pages.topview import true_top_view
from gmrdata.read.frames import list_images
from gmrdata.stage.progress import track
from gmrdata.stage.run import Run
from gmrdata.stage.store import run_stage
from gmrdata.values.clip import Clip, load_clip
from gmrdata.values.errors import BadFrames
from gmrdata.values.files import atomic_path, remove_orphans, write_text
from gmrdata.values.records import Config

CONTACT_FILE = "contact.jpg"
PATHS_FILE = "paths.png"
COLUMNS = 3
GAP_PX = 4
JPEG_QUALITY = 88
PLOT_IN = 4.0


class SheetConfig(Config):
    """What a contact sheet shows."""

    n_frames: int = Field(default=6, ge=1)
    """Frames, evenly spaced from the first to the last."""


def make_sheet(rendered_dir: Path, out_dir: Path, config: SheetConfig | None = None) -> Path:
    """Stage: `contact.jpg`, frames with the mask's outline, and `paths.png`, the paths from above.

    Args:
        rendered_dir: A finished render stage: frames/, masks/ and clip.npz.
        out_dir: The stage's folder; made anew when the clip changed.
        config: What the sheet shows.

    Returns:
        `out_dir`.

    Raises:
        BadFrames: an image or mask is missing or can't be read.
    """
    config = config or SheetConfig()
    clip_path = rendered_dir / "clip.npz"

    def work(partial_dir: Path) -> None:
        clip = load_clip(clip_path)
        write_bytes(partial_dir / CONTACT_FILE, contact_sheet(rendered_dir, config.n_frames))
        write_bytes(partial_dir / PATHS_FILE, paths_picture(clip))

    inputs = {
        "clip": clip_path,
        "frames": rendered_dir / "frames",
        "masks": rendered_dir / "masks",
    }
    return run_stage("sheet", out_dir, config, inputs, work, run=Run(redo=True))


def contact_sheet(rendered_dir: Path, n_frames: int) -> bytes:
    """JPEG bytes of evenly spaced frames, each with the outline of its mask.

    Raises:
        BadFrames: there are no frames, or one or its mask can't be read.
    """
    images = list_images(rendered_dir / "frames")
    spaced = np.linspace(0, len(images) - 1, min(n_frames, len(images))).round().astype(int)
    tiles = [
        draw_mask_outline(
            _read(images[i], cv2.IMREAD_COLOR),
            _read(rendered_dir / "masks" / f"{images[i].stem}.png", cv2.IMREAD_GRAYSCALE),
        )
        for i in spaced
    ]
    sheet = tile_sheet(tiles, COLUMNS, GAP_PX)
    ok, encoded = cv2.imencode(".jpg", sheet, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not ok:
        raise BadFrames(f"{rendered_dir}: its contact sheet can't be encoded as JPEG")
    return encoded.tobytes()


def paths_picture(clip: Clip) -> bytes:
    """PNG bytes: the paths of camera and person from above."""

    def draw(figure: Figure) -> None:
        true_top_view(figure.subplots(), clip)

    return picture(draw, PLOT_IN, PLOT_IN, dpi=100)


def _read(path: Path, mode: int) -> np.ndarray:
    image = cv2.imread(str(path), mode)
    if image is None:
        raise BadFrames(f"{path}: missing, or not an image; render the clip again")
    return np.asarray(image)


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file as a whole or not at all."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def write_set_pages(recipe: SyntheticRecipe, out_dir: Path) -> None:
    """Draw every clip of a rendered set to `sheets/<id>` and list them in `index.html`.

    Args:
        recipe: The set's recipe.
        out_dir: Where the set is; nothing is drawn where it holds no manifest.
    """
    manifest_path = out_dir / "synthetic.yaml"
    if not manifest_path.is_file():
        return
    remove_orphans(out_dir)
    clips = [clip for clip in read_manifest(manifest_path).clips if isinstance(clip, ClipEntry)]
    for clip in track(clips, "drawing contact sheets"):
        make_sheet(render_dir(out_dir, clip.id), out_dir / "sheets" / clip.id)
    warnings = frame_warnings(clips, recipe.min_in_frame_share)
    write_index(out_dir / "index.html", recipe, clips, warnings)


def write_index(
    path: Path, recipe: SyntheticRecipe, clips: Sequence[ClipEntry], warnings: Mapping[str, str]
) -> Path:
    """Write the page; its pictures are `sheets/<id>/...` below the page's folder.

    Args:
        path: The file to write, as a whole or not at all.
        recipe: The set's recipe.
        clips: The manifest's clips, in the order of the page.
        warnings: A line for each clip that deserves one, by id.
    """
    n_frames = sum(clip.n_frames for clip in clips)
    seconds = sum(clip.n_frames / clip.fps_hz for clip in clips)
    title = f"{recipe.name} {recipe.version}"
    header = (
        f'<h1>{text(title)}</h1><p class="lead">{len(clips)} clips, {n_frames} frames, '
        f"{seconds:.1f} s; exact cameras and masks.</p>"
    )
    sections = [_section(clip, warnings.get(clip.id)) for clip in clips]
    write_text(path, document(title, header, [_overview(clips), *sections]))
    return path


def _overview(clips: Sequence[ClipEntry]) -> str:
    rows = [
        (
            f'<a href="#{text(clip.id)}">{text(clip.id)}</a>',
            text(clip.camera_motion),
            str(clip.n_frames),
            f"{clip.fps_hz:g}",
            f"{_in_frame(clip):.0%}",
        )
        for clip in clips
    ]
    headings = ("clip", "camera", "frames", "frame rate [Hz]", "whole person in frame")
    return f"<section><h2>Clips</h2>{table(headings, rows, 'All clips of the set.')}</section>"


def _section(clip: ClipEntry, warning: str | None) -> str:
    rows = [
        ("motion", text(f"{clip.source.dataset} {clip.source.sequence}")),
        ("camera", text(clip.camera_motion)),
        ("place", text(_place(clip))),
        ("licence", text(clip.licence)),
    ]
    if warning:
        rows.append(("warning", f'<span class="bad">{text(warning)}</span>'))
    return (
        f'<section id="{text(clip.id)}"><h2>{text(clip.id)}</h2>{pairs(rows)}'
        + figure(
            _picture(clip, CONTACT_FILE, f"Frames of {clip.id}"),
            "Evenly spaced frames; the white line is the mask's outline.",
        )
        + figure(
            _picture(clip, PATHS_FILE, f"Paths of {clip.id} from above"),
            "Paths of camera and person from above, with the camera's viewing directions.",
        )
        + "</section>"
    )


def _picture(clip: ClipEntry, name: str, alt: str) -> str:
    return (
        f'<img src="sheets/{text(clip.id)}/{name}" alt="{text(alt)}" loading="lazy" '
        'style="max-width:100%">'
    )


def _place(clip: ClipEntry) -> str:
    """Where the clip was filmed, as its recipe says."""
    if clip.recipe is None:
        return "unknown"
    scene = SceneConfig.model_validate(clip.recipe.config["scene"])
    return f"{scene.kind}, {scene.lit_by}, seed {scene.seed}"


def _in_frame(clip: ClipEntry) -> float:
    return (clip.quality or Quality()).figures[IN_FRAME]
