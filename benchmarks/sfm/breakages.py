"""A good twin broken on purpose in six ways, as data sets in 3DPW's layout.

The annotations stay as they are but for the intrinsics of one: what is broken is what a camera
would have recorded, or what a user would have handed in.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import yaml

from gmrdata.read.frames import read_color, read_gray
from gmrdata.read.threedpw_files import SequenceFiles, read_sequence_file
from gmrdata.stage.recipes import find_recipe
from gmrdata.write.threedpw import write_sequence

SPLIT = "test"
WALL_GREY, NOISE_GREY = 128, 2.0
"""A textureless wall, and a sensor's noise on it [grey levels]."""
CONTOUR_PX = 4
"""What stays of a person lies this far inside the mask, so that no contour shows outside [px]."""
WRONG_FOCAL = 1.3
JPEG_QUALITY = 95


@dataclass(frozen=True)
class Breakage:
    """One way to break a sequence, and what must be said of it."""

    id: str
    """What was done."""
    sequence: str
    """Name of the broken sequence; it must not name the cause, since reasons hold paths."""
    cause: re.Pattern[str]
    """What a reason that names the true cause says."""
    half: bool
    """Whether only the second half of the frames is bad; else all are."""


BREAKAGES = (
    Breakage(
        "textureless", "twin_00", re.compile(r"textur|featureless|too few features"), half=False
    ),
    Breakage("shuffled", "twin_01", re.compile(r"out of order|shuffle"), half=False),
    Breakage("wrong_intrinsics", "twin_02", re.compile(r"intrinsics|focal length"), half=False),
    Breakage("masked_everywhere", "twin_03", re.compile(r"\bmask(s|ed)?\b"), half=False),
    Breakage("half_black", "twin_04", re.compile(r"\bblack\b|\bdark\b|no light"), half=True),
    Breakage(
        "cut",
        "twin_05",
        re.compile(r"another place|another scene|\bcut\b|several takes"),
        half=True,
    ),
)


@dataclass(frozen=True)
class Broken:
    """The broken data set."""

    root: Path
    """In 3DPW's layout; one sequence for each breakage."""
    white_recipe: Path
    """The recipe with a folder of masks that cover everything, for `masked_everywhere` alone."""
    n_frames: int
    """Frames of each sequence; the second half begins at `n_frames // 2`."""


def break_sequence(
    good: SequenceFiles,
    masks_dir: Path,
    other: SequenceFiles,
    out_dir: Path,
    recipe: str,
    rng: np.random.Generator,
) -> Broken:
    """Write the six broken sequences.

    Args:
        good: A sequence with a moving camera.
        masks_dir: Its masks (255 = dynamic).
        other: A sequence of another place, at least half as long and of the same size.
        out_dir: Folder to make.
        recipe: The recipe of the good ones, by name.
        rng: Source of order and noise.
    """
    arrays = read_sequence_file(good.pickle_path)
    n_frames = arrays.n_frames
    middle, root = n_frames // 2, out_dir / "3DPW"
    order = rng.permutation(n_frames)

    def wall(row: int) -> bytes:
        return _before_a_wall(good.image_path(row), masks_dir, rng)

    def dark(row: int) -> bytes:
        return _black(good.image_path(row)) if row >= middle else _content(good, row)

    def beyond(row: int) -> bytes:
        return _content(other, row - middle) if row >= middle else _content(good, row)

    images: dict[str, Callable[[int], bytes]] = {
        "textureless": wall,
        "shuffled": lambda row: _content(good, int(order[row])),
        "wrong_intrinsics": lambda row: _content(good, row),
        "masked_everywhere": lambda row: _content(good, row),
        "half_black": dark,
        "cut": beyond,
    }
    for broken in BREAKAGES:
        focal = WRONG_FOCAL if broken.id == "wrong_intrinsics" else 1.0
        intrinsics_px = arrays.intrinsics_px * [[focal], [focal], [1.0]]
        intrinsics_px[:2, 2] = arrays.intrinsics_px[:2, 2]
        files = SequenceFiles(root, broken.sequence, SPLIT)
        files.image_dir.mkdir(parents=True)
        for row in range(n_frames):
            files.image_path(row).write_bytes(images[broken.id](row))
        write_sequence(
            root, SPLIT, replace(arrays, name=broken.sequence, intrinsics_px=intrinsics_px)
        )
    return Broken(root, _white_recipe(good, out_dir, recipe, n_frames), n_frames)


def _content(files: SequenceFiles, row: int) -> bytes:
    return files.image_path(row).read_bytes()


def _black(like: Path) -> bytes:
    return _jpeg(np.zeros_like(read_color(like)))


def _before_a_wall(path: Path, masks_dir: Path, rng: np.random.Generator) -> bytes:
    """The picture with all that isn't masked replaced by an even wall."""
    image = read_color(path)
    mask = read_gray(masks_dir / f"{path.stem}.png", (image.shape[1], image.shape[0]))
    person = cv2.erode(mask, np.ones((2 * CONTOUR_PX + 1,) * 2, np.uint8)) > 127
    wall = rng.normal(WALL_GREY, NOISE_GREY, image.shape).round().clip(0, 255).astype(np.uint8)
    return _jpeg(np.where(person[..., None], image, wall))


def _jpeg(image: np.ndarray) -> bytes:
    _, encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return encoded.tobytes()


def _white_recipe(good: SequenceFiles, out_dir: Path, recipe: str, n_frames: int) -> Path:
    """The recipe, with masks that cover everything as its only source."""
    folder = out_dir / "white"
    folder.mkdir()
    white = np.full(read_color(good.image_path(0)).shape[:2], 255, np.uint8)
    content = cv2.imencode(".png", white)[1].tobytes()
    for row in range(n_frames):
        (folder / f"{good.image_path(row).stem}.png").write_bytes(content)
    settings = yaml.safe_load(find_recipe(recipe).read_text(encoding="utf-8"))
    sequence = settings.setdefault("sequence", {})
    sequence["masks"] = {"sources": [{"kind": "folder", "path": str(folder.resolve())}]}
    path = out_dir / "white.yaml"
    path.write_text(yaml.safe_dump(settings), encoding="utf-8")
    return path
