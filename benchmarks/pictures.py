"""Make the pictures of the docs, by this version: `make pictures`.

The demo's overview, a synthetic set, a twin beside its truth, the noise floor, a solved video of
the demo's own making, and a scored set.  `--demo FOLDER` takes a demo that is there; what is in
`--out` is kept.  A solved video needs the networks of `gmrdata fetch models`.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure

from gmrdata.cli import main as gmrdata
from gmrdata.pages import frames, plots
from gmrdata.pages.footage import footage_of, footage_picture
from gmrdata.pages.gather import gather_video
from gmrdata.pages.solved_plots import plot_paths
from gmrdata.read.frames import read_color, read_gray
from gmrdata.twins.floor_record import Floor
from gmrdata.values.clip import load_clip

DOCS = Path(__file__).resolve().parents[1] / "docs"
RECIPE = Path(__file__).with_suffix(".yaml")
MOST_BYTES, WIDTH_PX = 150_000, 1200


def save(name: str, image: np.ndarray) -> None:
    """A picture of the docs (H, W, 3) BGR, as JPEG of at most `MOST_BYTES`."""
    image = frames.narrowed(image, WIDTH_PX)
    qualities = (content for q in range(90, 20, -5) if len(content := frames.jpeg(image, q)))
    content = next(one for one in qualities if len(one) <= MOST_BYTES)
    (DOCS / f"{name}.jpg").write_bytes(content)


def plotted(draw: plots.Draw, width_in: float, height_in: float) -> np.ndarray:
    content = np.frombuffer(plots.picture(draw, width_in, height_in, dpi=110), np.uint8)
    return np.asarray(cv2.imdecode(content, cv2.IMREAD_COLOR))


def beside(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Two pictures in one row, the right one as high as the left one."""
    height = left.shape[0]
    width = round(right.shape[1] * height / right.shape[0])
    return np.hstack([left, cv2.resize(right, (width, height), interpolation=cv2.INTER_AREA)])


def doubled(image: np.ndarray) -> np.ndarray:
    """Twice as large: an outline hides less of a small frame."""
    return cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_LANCZOS4)


def synthetic_set(out: Path) -> None:
    gmrdata(["render", str(RECIPE), "--out", str(out)])
    tiles = []
    for clip in sorted((out / "render").iterdir()):
        images = sorted((clip / "frames").glob("*.jpg"))
        for path in (images[row] for row in frames.spaced(len(images), 3)):
            image = read_color(path)
            mask = read_gray(clip / "masks" / f"{path.stem}.png")
            tiles.append(frames.draw_mask_outline(doubled(image), doubled(mask)))
    save("synthetic", frames.tile_sheet(tiles, columns=3))


def twins(out: Path) -> None:
    """Frames of twins, and the noise floor that they have."""
    recipe = RECIPE.with_name("pictures_twin.yaml")
    gmrdata(["threedpw", "twin", str(recipe), "--out", str(out / "twins")])
    gmrdata(["floor", "--twins", str(out / "twins"), "--out", str(out / "floor")])
    floor = Floor.read(out / "floor" / "floor.json")
    tiles = []
    for one in floor.sequences:
        images = sorted((out / "twins/3DPW/imageFiles" / one.id).glob("*.jpg"))
        shown = (images[row] for row in frames.spaced(len(images), 3))
        tiles += [read_color(image) for image in shown]
    sheet = frames.narrowed(frames.tile_sheet(tiles, columns=6), 800)
    save("floor", beside(sheet, plotted(lambda plot: plot_floor(plot, floor), 6.5, 3.4)))


def plot_floor(plot: Figure, floor: Floor) -> None:
    """OME and TME of each sequence that is accepted."""
    shown = [one for one in floor.sequences if one.accepted]
    panels = plot.subplots(1, 2)
    for axes, key, title in zip(
        panels, ("ome_deg", "tme_mm"), ("OME [°]", "TME [mm]"), strict=True
    ):
        values = [max(getattr(person, key) for person in one.people) for one in shown]
        axes.barh(range(len(shown)), values, color=plots.COLOURS["person"], height=0.5)
        plots.name_rows(axes, [one.id for one in shown])
        axes.set_title(title)


def solved_video(demo: Path, out: Path) -> None:
    rate = load_clip(demo / "render/circular/clip.npz").motion.fps_hz
    images = demo / "render/circular/frames"
    gmrdata(["video", str(images), "--out", str(out), "--fps-hz", f"{rate:g}"])
    found = gather_video(out, images)
    footage = footage_of(found)
    picture = footage_picture(footage, len(footage.images) // 2)
    save("solved", beside(picture, plotted(lambda plot: plot_paths(plot, found, None), 4.0, 4.0)))


def scored_set(demo: Path, out: Path) -> None:
    gmrdata(["evaluate", "bundled", str(demo / "synthetic.yaml"), "--out", str(out)])
    save("scored", read_color(out / "over_time.png"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/pictures"))
    parser.add_argument("--demo", type=Path, help="the folder of a demo; made when left out")
    given = parser.parse_args()
    demo = given.demo or given.out / "demo"
    if given.demo is None:
        gmrdata(["demo", "--out", str(demo)])
    save("overview", read_color(demo / "overview.png"))
    synthetic_set(given.out / "set")
    twins(given.out)
    scored_set(demo, given.out / "scores")
    solved_video(demo, given.out / "walk")


if __name__ == "__main__":
    main()
