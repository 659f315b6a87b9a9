"""Twelve rendered clips of known cameras and lenses, whose focal length nobody is told.

    FOLDER/<clip>/clip.json        what `VideoFacts` lists
                  frames/          00000.jpg, 00001.jpg, ...: bent by the lens where it has one
                  masks/           00000.png, ...: 255 where the person is
                  clip.npz         the person and the camera, without the lens's distortion

People of their own in four kinds of places, under every camera programme.  The lens of `bent` is
put into frames that were rendered wider.  `python benchmarks/video/clips.py FOLDER` makes them.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np

from gmrdata.film.render_set import render_dir, render_set
from gmrdata.film.set_plan import SyntheticRecipe
from gmrdata.read.frames import list_images
from gmrdata.values.clip import camera_of, load_clip, save_clip
from gmrdata.values.records import Record

SEED, DURATION_S, FPS_HZ = 17, 4.0, 15.0
FACTS_FILE, FRAMES_FOLDER, MASKS_FOLDER, CLIP_FILE = "clip.json", "frames", "masks", "clip.npz"
JPEG_QUALITY = 92


@dataclass(frozen=True)
class Lens:
    """A lens, and what is rendered for it."""

    size_px: tuple[int, int]
    focal_px: float
    radial_k1: float = 0.0
    """A point at r, in units of the focal length, is seen at r + k1 r^3."""
    rendered_px: tuple[int, int] | None = None
    """Size of the frames before they are bent, around the same middle; None: the same."""


LENSES = {
    "wide": Lens((640, 480), 480.0),
    "usual": Lens((640, 480), 620.0),
    "upright": Lens((480, 640), 820.0),
    "bent": Lens((640, 480), 540.0, -0.15, (720, 540)),
}
HAND: dict[str, float] = {"handheld_m": 0.012, "handheld_deg": 0.3}
Clip = tuple[str, str, dict[str, Any]]
"""Lens, motion and camera programme; its place is the first word of its name."""
CLIPS: dict[str, Clip] = {
    "courtyard_circular": ("wide", "walk", {"kind": "circular", "rate_deg_per_s": 20.0} | HAND),
    "street_circular": ("usual", "walk", {"kind": "circular", "rate_deg_per_s": 15.0} | HAND),
    "room_circular": ("bent", "circle", {"kind": "circular", "rate_deg_per_s": 20.0} | HAND),
    "park_linear": ("usual", "walk", {"kind": "linear"} | HAND),
    "street_linear": ("upright", "walk", {"kind": "linear"} | HAND),
    "courtyard_linear": ("bent", "walk", {"kind": "linear"} | HAND),
    "courtyard_beside": ("wide", "walk", {"kind": "linear_panning"} | HAND),
    "park_beside": ("bent", "walk", {"kind": "linear_panning"} | HAND),
    "park_panning": ("upright", "walk", {"kind": "panning"} | HAND),
    "street_panning": ("bent", "walk", {"kind": "panning"} | HAND),
    "room_small": ("wide", "circle", {"kind": "small"}),
    "room_static": ("usual", "circle", {"kind": "static"}),
}
SMALL = ("courtyard_circular", "park_beside")


class VideoFacts(Record):
    """`clip.json`."""

    format: Literal["gmrdata-bench-video-clip/1"] = "gmrdata-bench-video-clip/1"
    name: str
    programme: str
    fps_hz: float
    size_px: tuple[int, int]
    focal_px: float
    centre_px: tuple[float, float]
    radial_k1: float


def make_video_clips(folder: Path, *, small: bool = False) -> list[Path]:
    """Render and bend what is not there yet; the clips' folders, of two clips if it is `small`."""
    clips = {name: CLIPS[name] for name in SMALL} if small else CLIPS
    rendered = folder / ("rendered_small" if small else "rendered")
    return render_clips(clips, folder, rendered, Take("video", "gait", SEED, DURATION_S))


@dataclass(frozen=True)
class Take:
    """What clips have in common but for their lens."""

    name: str
    moved_by: str
    """What their motions are: "gait", or "trial" of files in `motions_dir`."""
    seed: int
    duration_s: float
    motions_dir: Path | None = None


def render_clips(clips: Mapping[str, Clip], folder: Path, rendered: Path, take: Take) -> list[Path]:
    """Render, one set for each lens, and bend what is not there yet; the clips' folders."""
    for lens in LENSES:
        wanted = {name: clip for name, clip in clips.items() if clip[0] == lens}
        if all((folder / name / FACTS_FILE).is_file() for name in wanted):
            continue
        recipe = _recipe(wanted, lens, take)
        render_set(recipe, rendered / lens, motions_dir=take.motions_dir)
        for name, (_, _, programme) in wanted.items():
            clip_dir = render_dir(rendered / lens, name)
            _lay_out(clip_dir, name, LENSES[lens], folder / name, programme)
    return [folder / name for name in clips]


def _recipe(clips: Mapping[str, Clip], lens: str, take: Take) -> SyntheticRecipe:
    of = LENSES[lens]
    width_px, height_px = of.rendered_px or of.size_px
    film = {
        "duration_s": take.duration_s,
        "fps_hz": FPS_HZ,
        "width_px": width_px,
        "height_px": height_px,
        "hfov_deg": float(np.rad2deg(2 * np.arctan(width_px / 2 / of.focal_px))),
    }
    entries = [
        {
            "id": name,
            take.moved_by: motion,
            "programme": programme,
            "scene": {"kind": name.split("_")[0], "seed": 30 + row},
        }
        for row, (name, (_, motion, programme)) in enumerate(clips.items())
    ]
    return SyntheticRecipe.model_validate(
        {
            "recipe": "synthetic",
            "name": f"{take.name}_{lens}",
            "seed": take.seed,
            "workers": 1,
            "people": {"vary": True},
            "film": film,
            "render": {"samples": 3, "shutter": 0.25},
            "clips": entries,
        }
    )


def _lay_out(
    rendered: Path, name: str, lens: Lens, out_dir: Path, programme: dict[str, Any]
) -> None:
    """Frames and masks through the lens, the truth beside them; the facts come last."""
    (width_px, height_px), focal_px = lens.size_px, lens.focal_px
    for folder in (FRAMES_FOLDER, MASKS_FOLDER):
        (out_dir / folder).mkdir(parents=True, exist_ok=True)
    maps = _seen_from(lens)
    for image in list_images(rendered / FRAMES_FOLDER):
        _bend(image, out_dir / FRAMES_FOLDER / image.name, maps, cv2.INTER_LANCZOS4)
        mask = rendered / MASKS_FOLDER / f"{image.stem}.png"
        _bend(mask, out_dir / MASKS_FOLDER / mask.name, maps, cv2.INTER_NEAREST)
    clip = load_clip(rendered / "clip.npz")
    centre_px = (width_px / 2, height_px / 2)
    intrinsics_px = np.array([[focal_px, 0, centre_px[0]], [0, focal_px, centre_px[1]], [0, 0, 1]])
    camera = replace(
        camera_of(clip), intrinsics_px=intrinsics_px, width_px=width_px, height_px=height_px
    )
    with np.load(rendered / "clip.npz", allow_pickle=False) as arrays:
        rest_pelvis_m = arrays["rest_pelvis_m"]
    save_clip(out_dir / CLIP_FILE, replace(clip, camera=camera), rest_pelvis_m)
    VideoFacts(
        name=name,
        programme=str(programme["kind"]),
        fps_hz=FPS_HZ,
        size_px=lens.size_px,
        focal_px=focal_px,
        centre_px=centre_px,
        radial_k1=lens.radial_k1,
    ).write(out_dir / FACTS_FILE)


def _seen_from(lens: Lens) -> tuple[np.ndarray, np.ndarray] | None:
    """Where in the rendered frames each pixel of the lens's frames is, as cv2.remap has it."""
    if lens.rendered_px is None:
        return None
    (width_px, height_px), (wide_px, high_px) = lens.size_px, lens.rendered_px
    x, y = np.meshgrid(np.arange(width_px) + 0.5, np.arange(height_px) + 0.5)
    bent = np.stack([x - width_px / 2, y - height_px / 2], -1) / lens.focal_px
    straight = bent
    for _ in range(30):
        straight = bent / (1 + lens.radial_k1 * (straight**2).sum(-1, keepdims=True))
    # OpenCV counts from the middle of the first pixel.
    at = lens.focal_px * straight + np.array([wide_px / 2, high_px / 2]) - 0.5
    return at[..., 0].astype(np.float32), at[..., 1].astype(np.float32)


def _bend(source: Path, target: Path, maps: tuple[np.ndarray, np.ndarray] | None, how: int) -> None:
    if maps is None:
        target.write_bytes(source.read_bytes())
        return
    picture = np.asarray(cv2.imread(str(source), cv2.IMREAD_UNCHANGED))
    seen = cv2.remap(picture, *maps, how, borderMode=cv2.BORDER_REPLICATE)
    cv2.imwrite(str(target), seen, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])


if __name__ == "__main__":
    make_video_clips(Path(sys.argv[1]))
