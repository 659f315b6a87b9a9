"""One clip's section of the page."""

import cv2
import numpy as np
from matplotlib.figure import Figure

from gmrdata.errors import BadFrames
from gmrdata.report.bars import BARS, figure_texts, verdicts
from gmrdata.report.curves import error_panels, relative_sigma_percent
from gmrdata.report.data import ClipReport
from gmrdata.report.markup import figure, image, key, mark, pairs, text
from gmrdata.report.overlay import BODY_BGR, OUTLINE_BGR, PATH_BGR
from gmrdata.report.strip import Tile, frame_tiles
from gmrdata.report.style import svg
from gmrdata.report.topview import top_view

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
