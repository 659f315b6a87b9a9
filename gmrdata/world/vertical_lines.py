"""Stage: straight lines of the background.  Most of the steep ones, as edges of walls, doors,
shelves and poles, are vertical, so where they meet (the vertical vanishing point) tells up.

Lines are found by LSD (von Gioi et al. 2010), in OpenCV.  Which way is up is a posterior over
directions about that of bodies: each line is vertical, or one of any others (a mixture).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from gmrdata.cameras.files import load_cameras
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.lens.vanishing_points import (
    PARTS,
    SLANT_RAD,
    TOLD_SHARE,
    LinesConfig,
    apart,
    straight_lines,
)
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.camera import Lens, straightened
from gmrdata.values.clip import rows_of_numbers
from gmrdata.values.files import write_npz
from gmrdata.values.frame_set import Filmed
from gmrdata.values.records import ArrayShapes, Config, read_arrays
from gmrdata.world.level import UpCue, across

LINES_FILE = "lines.npz"
_FORMAT = "gmrdata-lines/1"
_SHAPES: ArrayShapes = {
    "ends": ("f", ("N", 2, 2)), "ends_sigma": ("f", ()), "rotmats": ("f", ("N", 3, 3)),
    "radial": ("f", (2,)), "lens_sigmas": ("f", (2,)),
}  # fmt: skip

VERTICAL_SHARE = 0.2  # of the lines: 0.12 to 0.28 in five rooms
MOST_LINES = 400  # the longest
LINES_SIGMA_RAD = np.deg2rad(1.0)
"""Of all lines of a place together, along each axis: poles and planks lean alike."""
REACH_SIGMAS, MOST_SIGMA_RAD = 3.0, np.deg2rad(10.0)
"""How far lines may be from the other cue's up, in its standard errors, and the largest of these,
along each axis: with less to go by, lines of a ceiling are as good."""
STEP_RAD = np.deg2rad(0.5)
LEAST_SIGMA_RAD = np.deg2rad(15.0)  # of a tilt of which lines tell nothing
ASSUMED_K1_SIGMA = 0.1  # of a lens whose distortion nobody knows
NODES = ((0.0, 2 / 3), (-(3**0.5), 1 / 6), (3**0.5, 1 / 6))
"""Of a normal distribution, in standard errors, and their weights (Gauss-Hermite)."""
CERTAIN = ((0.0, 1.0),)
LEAST_FOCAL = 0.5  # over the given one


class _LinesRecipe(Config):
    """What the stage's record holds: the recipe, and the lens with its errors."""

    lines: LinesConfig
    lens: Lens


@dataclass(frozen=True, eq=False)
class Lines:
    """Straight lines of the background, in pictures of a reconstruction."""

    ends: np.ndarray  # (N, 2, 2) as the lens shows them, in focal lengths from its middle
    ends_sigma: float  # standard error of an end across its line
    rotmats: np.ndarray  # (N, 3, 3) world_from_cam of each one's picture
    radial: tuple[float, float]  # k1 and k2 of the lens
    lens_sigmas: tuple[float, float]  # errors of its focal length, as a share of it, and of k1


def find_lines(
    filmed: Filmed,
    masks_dir: Path | None,
    sfm_dir: Path,
    out_dir: Path,
    config: LinesConfig,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Make `out_dir` with `lines.npz`: lines outside of masks, in pictures that have a camera.

    Raises:
        BadFrames: a frame or a mask is missing, or is no image of the frames' size.
        BadRecord: the cameras are of another version.
    """
    frames, lens = filmed

    def work(partial: Path) -> None:
        cameras = load_cameras(sfm_dir)
        known = np.flatnonzero(cameras.path.has_camera)
        some = np.linspace(0, len(known) - 1, min(len(known), config.frames)).round().astype(int)
        rows = rows_of_numbers(frames.numbers, cameras.image_numbers[known[some]])
        given = Frames(list(frames.paths), masks_dir, lens.matrix_px, frames.size_px).some(rows)
        rotmats = cameras.path.world_from_cam[known[some], :3, :3]
        lines, end_px = straight_lines(given, config)
        ends_px = np.concatenate([np.zeros((0, 2, 2)), *lines])
        arrays: dict[str, ArrayLike] = {
            "format": _FORMAT,
            "ends": (ends_px - lens.centre_px) / lens.focal_px,
            "ends_sigma": np.array(end_px / min(lens.focal_px)),
            "rotmats": np.repeat(rotmats, list(map(len, lines)), axis=0),
            "radial": np.array(lens.radial, dtype=np.float64),
            "lens_sigmas": np.array(_lens_sigmas(lens), dtype=np.float64),
        }
        write_npz(partial / LINES_FILE, arrays)

    inputs = {"images": frames.folder, "sfm": sfm_dir, "masks": masks_dir}
    recipe = _LinesRecipe(lines=config, lens=lens)
    return run_stage("lines", out_dir, recipe, inputs, work, run=run)


def load_lines(lines_dir: Path) -> Lines:
    """Read them; BadRecord for those of another version, BadMotionFile for a broken file."""
    arrays = read_arrays(lines_dir / LINES_FILE, _FORMAT, _SHAPES)
    radial, sigmas = (tuple(arrays[key].tolist()) for key in ("radial", "lens_sigmas"))
    ends_sigma = float(arrays["ends_sigma"])
    return Lines(arrays["ends"], ends_sigma, arrays["rotmats"], radial, sigmas)


def _lens_sigmas(lens: Lens) -> tuple[float, float]:
    assumed = lens.radial_from.source == "prior" and not lens.radial_from.sigma
    k1_sigma = ASSUMED_K1_SIGMA if assumed else lens.radial_from.sigma or 0.0
    return lens.focal_from.sigma or 0.0, k1_sigma


def line_cue(lines: Lines, about: UpCue) -> UpCue | None:
    """What lines tell of up near what another cue says; None where they tell nothing.

    The lens may be off by its errors, of which lines tell too: vertical ones are straight, and meet
    in one point.
    """
    axes = across(about.up)
    own = axes @ about.precision @ axes.T
    normals, angles_rad = _planes(lines)
    kept = _apart(normals, angles_rad)
    if not len(kept) or np.linalg.eigvalsh(own)[0] < MOST_SIGMA_RAD**-2:
        return None
    lines = replace(lines, ends=lines.ends[kept], rotmats=lines.rotmats[kept])
    tilts = _tilts(own)
    ups = about.up + np.tan(tilts) @ axes
    ups /= np.linalg.norm(ups, axis=1, keepdims=True)
    asked = -0.5 * np.einsum("nk,kl,nl->n", tilts, own, tilts)
    sigmas = np.hypot(SLANT_RAD, lines.ends_sigma / angles_rad[kept])
    # All lines, and all but each fifth of them: what hangs on one or two is none of a place.
    parts = 1.0 - (np.arange(len(kept))[:, None] % PARTS == np.arange(-1, PARTS))
    chances = []
    for one, weight in _as_lens_errs(lines):
        off = ups @ _planes(one)[0].T / sigmas
        vertical = np.sqrt(2 / np.pi) / sigmas * np.exp(-0.5 * off**2)
        told = TOLD_SHARE * np.log1p(VERTICAL_SHARE * (vertical - 1)) @ parts
        # There may be none that stand, as in a forest.
        chances.append(np.log(weight) + np.logaddexp(0.0, told) + asked[:, None])
    weights = np.exp(np.array(chances) - np.max(chances, axis=(0, 1))).sum(axis=0)
    mean, *others = (weights / weights.sum(axis=0)).T @ tilts
    from_mean = tilts - mean
    spread = from_mean.T @ (from_mean * weights[:, :1]) / weights[:, 0].sum()
    spread += STEP_RAD**2 / 12 * np.eye(2)
    moved = np.array(others) - np.mean(others, axis=0)
    return _without(about, own, mean, spread + (PARTS - 1) / PARTS * moved.T @ moved)


def _tilts(precision: np.ndarray) -> np.ndarray:
    """A grid of tilts (M, 2) as far as a cue of that precision (2, 2) may be off."""
    reach_rad = REACH_SIGMAS * float(np.trace(precision) / 2) ** -0.5
    most = int(np.ceil(reach_rad / STEP_RAD))
    steps = STEP_RAD * np.arange(-most, most + 1)
    return np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)


def _without(about: UpCue, own: np.ndarray, mean: np.ndarray, spread: np.ndarray) -> UpCue | None:
    """What lines alone tell, of a posterior's mean tilt (2,) and covariance (2, 2) to which another
    cue gave its own precision (2, 2)."""
    whole = np.linalg.inv(spread)
    told, along = np.linalg.eigh(whole - own)
    tells = told > LEAST_SIGMA_RAD**-2
    if not tells.any():
        return None
    told = np.where(tells, told, 1.0)
    tilt = along @ np.where(tells, along.T @ (whole @ mean) / told, 0.0)
    sure = np.where(tells, 1 / (1 / told + LINES_SIGMA_RAD**2), 0.0)
    axes = across(about.up)
    up = about.up + tilt @ axes
    return UpCue("lines", up / np.linalg.norm(up), axes.T @ (along * sure) @ along.T @ axes)


def _planes(lines: Lines) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (N, 3) in the world of the planes through the camera and each line, and the
    angles (N,) that lines span [rad]."""
    rays = straightened(lines.ends, *lines.radial)
    rays = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    normals = np.cross(rays[:, 0], rays[:, 1])
    sines = np.clip(np.linalg.norm(normals, axis=1), 1e-9, 1.0)
    return np.einsum("nij,nj->ni", lines.rotmats, normals / sines[:, None]), np.arcsin(sines)


def _apart(normals: np.ndarray, angles_rad: np.ndarray) -> np.ndarray:
    """Rows of the longest lines of which no two are in one plane."""
    longest = np.argsort(-angles_rad, kind="stable")
    return np.asarray(longest[apart(normals[longest])[:MOST_LINES]])


def _as_lens_errs(lines: Lines) -> Iterator[tuple[Lines, float]]:
    """The lines as lenses show them that are off by the lens's errors, and how likely those are."""
    focal_sigma, k1_sigma = lines.lens_sigmas
    for focal, focal_weight in NODES if focal_sigma else CERTAIN:
        for k1, k1_weight in NODES if k1_sigma else CERTAIN:
            radial = lines.radial[0] + k1 * k1_sigma, lines.radial[1]
            ends = lines.ends / max(LEAST_FOCAL, 1 + focal * focal_sigma)
            yield replace(lines, ends=ends, radial=radial), focal_weight * k1_weight
