"""The index page of a synthetic set: every clip's contact sheet and paths."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from gmrdata.manifest.current import Clip, Quality
from gmrdata.report.document import document
from gmrdata.report.markup import figure, pairs, table, text
from gmrdata.scene_config import SceneConfig
from gmrdata.store import write_text
from gmrdata.synthetic.in_view import IN_FRAME
from gmrdata.synthetic.recipe import SyntheticRecipe
from gmrdata.synthetic.sheet import CONTACT_FILE, PATHS_FILE


def write_index(
    path: Path, recipe: SyntheticRecipe, clips: Sequence[Clip], warnings: Mapping[str, str]
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


def _overview(clips: Sequence[Clip]) -> str:
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


def _section(clip: Clip, warning: str | None) -> str:
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


def _picture(clip: Clip, name: str, alt: str) -> str:
    return (
        f'<img src="sheets/{text(clip.id)}/{name}" alt="{text(alt)}" loading="lazy" '
        'style="max-width:100%">'
    )


def _place(clip: Clip) -> str:
    """Where the clip was filmed, as its recipe says."""
    if clip.recipe is None:
        return "unknown"
    scene = SceneConfig.model_validate(clip.recipe.config["scene"])
    return f"{scene.kind}, {scene.lit_by}, seed {scene.seed}"


def _in_frame(clip: Clip) -> float:
    return (clip.quality or Quality()).figures[IN_FRAME]
