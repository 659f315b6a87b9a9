"""A rendered clip at a glance: a contact sheet, and its paths from above."""

from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure
from pydantic import Field

from gmrdata.clip import Clip, load_clip
from gmrdata.config import Config
from gmrdata.errors import BadFrames
from gmrdata.frames import list_images
from gmrdata.report.overlay import draw_mask_outline
from gmrdata.report.strip import tile_sheet
from gmrdata.report.style import picture
from gmrdata.report.topview import true_top_view
from gmrdata.store import atomic_path, run_stage

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
    return run_stage("sheet", out_dir, config, inputs, work, redo=True)


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
