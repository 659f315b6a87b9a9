"""The page's sections about the whole run: summary, GMR, how it was made, what the numbers mean.

What the figures mean and where they end, as HTML.

One clip's section of the page.

The report: one HTML file that needs nothing beside it.
"""

from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure

from gmrdata.pages.curves import error_panels, learning_curve, relative_sigma_percent, scale_panel
from gmrdata.pages.document import document, figure, image, key, mark, pairs, table, text
from gmrdata.pages.report_data import (
    BARS,
    ClipReport,
    ManifestScore,
    ReportData,
    RunReport,
    figure_texts,
    score_texts,
    verdicts,
)
from gmrdata.pages.strip import BODY_BGR, OUTLINE_BGR, PATH_BGR, Tile, frame_tiles
from gmrdata.pages.style import svg
from gmrdata.pages.topview import motion_top_view, top_view
from gmrdata.values.errors import BadFrames
from gmrdata.values.files import write_text

MEANINGS = (
    (
        "A motion",
        "How the body turns and moves from one frame to the next, in its own frame: T frames give "
        "T − 1 motions. R is the root’s orientation and T the pelvis’ position in the world "
        "(eqs. 2–4).",
        "ΔR<sub>i</sub> = R<sub>i</sub><sup>⊤</sup> R<sub>i+1</sub>,&emsp;"
        "ΔT<sub>i</sub> = R<sub>i</sub><sup>⊤</sup> (T<sub>i+1</sub> − T<sub>i</sub>)",
    ),
    (
        "OME, orientation motion error [°]",
        "The angle between the estimated and the true turn, averaged over all motions (eq. 15).",
        "mean<sub>i</sub> ‖ log( ΔR*<sub>i</sub> ΔR<sub>i</sub><sup>⊤</sup> ) ‖",
    ),
    (
        "TME, translation motion error [mm]",
        "The distance between the estimated and the true step, averaged over all motions (eq. 16).",
        "mean<sub>i</sub> ‖ ΔT<sub>i</sub> − ΔT*<sub>i</sub> ‖",
    ),
    (
        "VME, vertex motion error [mm]",
        "The body in its pose, turned and moved by one motion from the origin: how far its "
        "vertices then lie from where the true motion takes them, averaged over all motions and "
        "vertices (eq. 17).",
        "mean<sub>i,j</sub> ‖ ΔM<sub>i</sub>[j] − ΔM*<sub>i</sub>[j] ‖",
    ),
    (
        "Camera rotation error [°]",
        "The angle between the recovered and the true orientation of the camera, averaged over the "
        "frames, after one rotation A of the whole recovered world onto the true one.",
        "mean<sub>i</sub> ∠( A C<sub>i</sub>, C*<sub>i</sub> )",
    ),
    (
        "Scale error [%]",
        "A moving camera alone gives its path only up to a factor; the size of the body and its "
        "feet on the floor give metres. This is that factor against the truth. A camera that only "
        "turns has no path, so no scale enters.",
        "100 · ( recovered / true − 1 )",
    ),
)
"""(name, words, equation) per figure."""

LIMITS = (
    "OME, TME and VME compare steps, not paths: a small error that always points the same way "
    "bends a long path more than these figures show. The views from above show that.",
    "The figures are per motion, so they depend on the frame rate. Compare them only with figures "
    "at the same rate.",
    "The reconstruction is given the body in the camera’s frame. Where that is the truth, as for a "
    "rendered clip, the errors here are those of cameras and scale alone; on a real video the "
    "body’s own error adds to them.",
    "Rendered frames are sharp, evenly lit and rich in texture. Real video is harder.",
)
"""Sentences that hold for every report."""


JPEG_QUALITY = 88
CLOSE_UP_PX = (300, 380)
"""Width and height of a close-up: people stand."""

GEOMETRY_WORDS = {
    "full": "full (the camera translates)",
    "rotation_only": "rotation only (the camera pans)",
    "static": "static (the camera doesn't move)",
}


def clip_section(index: int, clip: ClipReport) -> str:
    """HTML of a clip: figures, frames with overlays, paths from above, errors over time."""
    paths = svg(lambda fig: _paths(fig, clip), 5.2, 5.0, f"paths-{index}")
    errors = svg(lambda fig: error_panels(fig, clip), 7.4, 5.0, f"errors-{index}")
    return (
        f'<section class="clip" id="clip-{index}"><h2>{text(clip.id)} '
        f'<span class="kind">{text(clip.camera_motion)} camera</span></h2>'
        f"{_figures(clip)}{_frames(clip)}"
        f'<div class="plots">{figure(paths, _PATHS_CAPTION)}'
        f"{figure(errors, _errors_caption(clip))}</div>"
        f"<h3>The reconstruction’s own record</h3>{_record(clip)}</section>"
    )


def _paths(fig: Figure, clip: ClipReport) -> None:
    top_view(fig.subplots(), clip)


def _figures(clip: ClipReport) -> str:
    texts, met = figure_texts(clip.figures), verdicts(clip.figures)
    scale, camera_rotation = texts["scale_error_percent"], texts["camera_rotation_deg"]
    if clip.figures.camera_rotation_deg is not None:
        camera_rotation += "°"
    if clip.figures.scale_error_percent is not None:
        scale = mark(f"{scale} %", met["scale_error_percent"])
    return pairs(
        [
            ("Frames with a camera", mark(texts["cameras"], met["frames_with_camera"])),
            ("Orientation motion error", mark(f"{texts['ome_deg']}°", met["ome_deg"])),
            ("Translation motion error", mark(f"{texts['tme_mm']} mm", met["tme_mm"])),
            ("Camera rotation error", camera_rotation),
            ("Error of the metric scale", scale),
        ]
    )


def _frames(clip: ClipReport) -> str:
    tiles = frame_tiles(clip)
    frames = "".join(
        _picture(clip, tile, tile.frame(), f"frame {tile.image_number} · {tile.time_s:.1f} s")
        for tile in tiles
    )
    close_ups = "".join(
        _picture(clip, tile, tile.close_up(*CLOSE_UP_PX), f"{tile.time_s:.1f} s") for tile in tiles
    )
    caption = f"Frames and close-ups with {_swatch(BODY_BGR, 'key')} the recovered body; "
    if clip.masks_dir is not None:
        outline = _swatch(OUTLINE_BGR, "key thin edged")
        caption += f"{outline} the outline of the mask, outside which features are found; "
    caption += (
        f"{_swatch(PATH_BGR)} the recovered path on the floor, a dot each second. Body and outline "
        "fit whatever the camera is, because they come from the body in the camera’s frame; the "
        "path is fixed in the world, so it stays in its place on the floor only if the camera is "
        "right."
    )
    strip = f'<div class="tiles">{frames}</div><div class="tiles six">{close_ups}</div>'
    return figure(strip, caption)


def _swatch(colour_bgr: tuple[int, int, int], css_class: str = "key thin") -> str:
    blue, green, red = colour_bgr
    return f'<span class="{css_class}" style="background:rgb({red} {green} {blue})"></span>'


def _picture(clip: ClipReport, tile: Tile, drawn: np.ndarray, name: str) -> str:
    ok, encoded = cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not ok:
        raise BadFrames(f"clip {clip.id}: image {tile.image_number} can't be encoded as JPEG")
    height, width = drawn.shape[:2]
    if not tile.has_camera:
        name += " · no camera"
    picture = image(encoded.tobytes(), "jpeg", f"{clip.id}, {name}", width, height)
    return f"<div>{picture}<span>{text(name)}</span></div>"


_PATHS_CAPTION = (
    "From above, in the true world [m], z up. "
    f"Camera: {key('camera-pale')} true, {key('camera', thin=True)} recovered, with its viewing "
    f"directions. Person: {key('person-pale')} true, {key('person', thin=True)} recovered. "
    "Dots: where they start. The recovered world was moved rigidly onto the true one, never scaled."
)


def _errors_caption(clip: ClipReport) -> str:
    fps_hz = clip.figures_fps_hz or clip.true.motion.fps_hz
    return (
        f"Errors over time. Orientation and translation: over 1/{fps_hz:g} s from each frame on, "
        "in the body’s own frame, so no alignment enters. "
        "Camera rotation: per frame, after one rotation of the recovered world. Bars for the "
        f"means: {BARS['ome_deg']:g}° and {BARS['tme_mm']:g} mm."
    )


def _record(clip: ClipReport) -> str:
    quality = clip.quality
    rows = [("Geometry", GEOMETRY_WORDS.get(quality.geometry, quality.geometry))]
    if quality.scale is None:
        rows.append(("Metric scale", "does not enter"))
    else:
        sigma = relative_sigma_percent(clip)
        spread = "" if sigma is None else f" ± {quality.scale_sigma:.3g} (± {sigma:.2g} %)"
        rows.append(("Metric scale, metres per unit", f"{quality.scale:.4g}{spread}"))
    if quality.reprojection_error_px is not None:
        rows.append(("Reprojection error", f"{quality.reprojection_error_px:.2f} px"))
    if quality.inliers is not None and len(quality.inliers):
        low, high = int(quality.inliers.min()), int(quality.inliers.max())
        rows.append(("Inliers per frame", f"{low} to {high}"))
    rows += quality.notes
    rows.append(("Motion", clip.true.motion.source))
    listed = pairs([(text(name), text(value)) for name, value in rows])
    return listed.replace("<dl>", '<dl class="small">', 1)


def summary_section(report: ReportData) -> str:
    """HTML: whether the bars are met, every clip's figures, and the scales with their sigmas."""
    plot = ""
    if any(clip.figures.scale_error_percent is not None for clip in report.clips):
        height_in = 0.75 + 0.38 * len(report.clips)
        picture = svg(lambda fig: scale_panel(fig, report.clips), 7.4, height_in, "scales")
        caption = (
            "Metric scale against the truth. The bar of each point is the estimate’s own standard "
            f"deviation; the band is what counts as good, ± {BARS['scale_error_percent']:g} %."
        )
        plot = figure(picture, caption, "narrow")
    return (
        '<section id="summary"><h2>Pseudo ground truth against the truth</h2>'
        f"{_verdict(report)}{_clip_table(report)}{plot}</section>"
    )


def _verdict(report: ReportData) -> str:
    good = sum(all(verdicts(clip.figures).values()) for clip in report.clips)
    n = len(report.clips)
    if n == 0:
        return '<p class="verdict">No clip was recovered.</p>'
    name = "good" if good == n else "bad"
    which = "The clip meets" if n == 1 == good else f"{good} of {n} clips meet"
    sign = f'<span class="{name}">{"✓" if good == n else "✗"}</span>'
    return (
        f'<p class="verdict {name}">{sign}<span>{which} every bar: a camera for every frame, '
        f"orientation motion error at most {BARS['ome_deg']:g}°, translation motion error at most "
        f"{BARS['tme_mm']:g} mm, and, where the camera translates, a scale within "
        f"{BARS['scale_error_percent']:g} %.</span></p>"
    )


def _heading(name: str, unit: str) -> str:
    return f'{name}<span class="unit">[{unit}]</span>'


def _clip_table(report: ReportData) -> str:
    headings = (
        "clip", "camera", "frames with<br>a camera", _heading("OME", "°"),
        _heading("TME", "mm"), _heading("camera rotation", "°"), _heading("scale", "%"),
    )  # fmt: skip
    foot = (
        "bar", "", "all", f"≤ {BARS['ome_deg']:g}", f"≤ {BARS['tme_mm']:g}", "",
        f"≤ {BARS['scale_error_percent']:g}",
    )  # fmt: skip
    rows = [_clip_row(i, clip) for i, clip in enumerate(report.clips)]
    caption = (
        "Mean errors of the recovered world motion per frame-to-frame motion (OME, TME), of the "
        "camera’s rotation per frame, and of the metric scale."
    )
    return table(headings, rows, caption, foot)


def _clip_row(index: int, clip: ClipReport) -> tuple[str, ...]:
    texts, met = figure_texts(clip.figures), verdicts(clip.figures)
    return (
        f'<a href="#clip-{index}">{text(clip.id)}</a>',
        text(clip.camera_motion),
        mark(texts["cameras"], met["frames_with_camera"]),
        mark(texts["ome_deg"], met["ome_deg"]),
        mark(texts["tme_mm"], met["tme_mm"]),
        texts["camera_rotation_deg"],
        mark(texts["scale_error_percent"], met.get("scale_error_percent")),
    )


def gmr_section(report: ReportData) -> str:
    """HTML: GMR's scores beside no motion at all, its paths from above, the training loss."""
    parts = [
        '<section id="gmr"><h2>GMR</h2><p>The global motion regressor sees only the local pose, '
        "and predicts how the body turns and moves in the world from frame to frame.</p>"
    ]
    if report.scores:
        parts.append(_score_table(report.scores))
    paths = [_predicted_path(i, clip) for i, clip in enumerate(report.clips) if clip.predicted]
    if paths:
        parts.append(f'<h3>Paths from above</h3><div class="plots even">{"".join(paths)}</div>')
    if report.learning_curve:
        picture = svg(
            lambda fig: learning_curve(fig, report.learning_curve), 7.4, 2.8, "learning-curve"
        )
        caption = "Training loss (eq. 5, no unit) by step: each value, and their running median."
        parts.append(f"<h3>Training</h3>{figure(picture, caption, 'narrow')}")
    return "".join([*parts, "</section>"])


def _score_table(scores: tuple[ManifestScore, ...]) -> str:
    rows = [_score_row(score) for score in scores]
    headings = ["manifest"]
    for name, unit in (("OME", "°"), ("TME", "mm"), ("VME", "mm")):
        headings += [_heading(name, unit), _heading("zero motion", unit)]
    caption = (
        "Mean errors per frame-to-frame motion. In grey, the same for zero motion, that is for a "
        "body that neither turns nor moves: a model that learned something stays below it."
    )
    return table(headings, rows, caption)


def _score_row(score: ManifestScore) -> tuple[str, ...]:
    ours, zero = score_texts(score.gmr), score_texts(score.zero_motion)
    cells = [text(score.name)]
    for metric in ours:
        cells += [ours[metric], f'<span class="beside">{zero[metric]}</span>']
    return tuple(cells)


def _predicted_path(index: int, clip: ClipReport) -> str:
    true, predicted = clip.true.motion, clip.predicted
    if predicted is None:
        return ""

    def draw(fig: Figure) -> None:
        motion_top_view(fig.subplots(), true, predicted)

    picture = svg(draw, 4.2, 4.0, f"gmr-{index}")
    caption = (
        f"{text(clip.id)}: path of the pelvis in the world [m], z up, {key('person-pale')} true "
        f"and {key('gmr', thin=True)} predicted, accumulated from the true first frame (dot) "
        "without any later correction."
    )
    return figure(picture, caption)


def making_section(run: RunReport) -> str:
    """HTML: seconds per stage, versions, the recipe."""
    parts = [f'<section id="making"><h2>How it was made</h2><p>{text(run.data_source)}</p>']
    if run.seconds:
        rows = [(text(stage), f"{seconds:.1f} s") for stage, seconds in run.seconds.items()]
        rows.append(("All stages", f"{sum(run.seconds.values()):.1f} s"))
        parts.append(f"<h3>Wall time</h3>{_small(rows)}")
    if run.versions:
        versions = [(text(name), text(version)) for name, version in run.versions.items()]
        parts.append(f"<h3>Versions</h3>{_small(versions)}")
    if run.recipe:
        parts.append(
            "<details open><summary>The whole recipe</summary>"
            f"<pre>{text(run.recipe)}</pre></details>"
        )
    return "".join([*parts, "</section>"])


def _small(rows: list[tuple[str, str]]) -> str:
    return pairs(rows).replace("<dl>", '<dl class="small">', 1)


def meaning_section(run: RunReport) -> str:
    """HTML: the metrics in words and symbols, and what they do not say."""
    meanings = "".join(
        f'<div><h3>{name}</h3><p>{words}</p><p class="equation">{equation}</p></div>'
        for name, words, equation in MEANINGS
    )
    limits = "".join(f"<li>{words}</li>" for words in (*LIMITS, *map(text, run.limits)))
    return (
        '<section id="meaning"><h2>What the numbers mean</h2>'
        f'<div class="words">{meanings}</div><h3>Limits</h3><ul>{limits}</ul></section>'
    )


def write_report(path: Path, report: ReportData) -> Path:
    """Write the report as one self-contained HTML file; the same input gives the same bytes.

    Args:
        path: The file to write, as a whole or not at all.
        report: Everything on the page.

    Returns:
        `path`.

    Raises:
        BadFrames: a clip's image or mask is missing or can't be read.
    """
    write_text(path, page(report))
    return path


def page(report: ReportData) -> str:
    """The whole page as HTML."""
    sections = [summary_section(report)]
    sections += [clip_section(i, clip) for i, clip in enumerate(report.clips)]
    if report.scores or report.learning_curve or any(clip.predicted for clip in report.clips):
        sections.append(gmr_section(report))
    sections += [making_section(report.run), meaning_section(report.run)]
    return document(report.run.title, _header(report), sections)


def _header(report: ReportData) -> str:
    links = [("summary", "Summary")]
    links += [(f"clip-{i}", clip.id) for i, clip in enumerate(report.clips)]
    if report.scores or report.learning_curve or any(clip.predicted for clip in report.clips):
        links.append(("gmr", "GMR"))
    links += [("making", "How it was made"), ("meaning", "What the numbers mean")]
    anchors = "".join(f'<a href="#{target}">{text(name)}</a>' for target, name in links)
    return (
        f"<h1>{text(report.run.title)}</h1>"
        f'<p class="lead">{text(report.run.data_source)}</p>'
        f'<nav aria-label="Sections">{anchors}</nav>'
    )
