"""The focal length by straight lines alone, of single pictures whose lens somebody calibrated.

Their lines, found by LSD, are kept in two repositories of github.com/fkluger (Kluger et al. 2020),
of which `--clips FOLDER` holds clones: `nyu_vp` has 1,449 rooms (NYU Depth v2), `yud_plus` 102
streets and rooms (York Urban), all of 640x480 px.  On some of them was chosen which errors are told
(`MOST_SIGMA`), and what is added to them (`OWN_SIGMA`).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gmrdata.cameras.lens.vanishing_points import LinesConfig, focal_by, log_evidence

SIZE_PX = np.array([640.0, 480.0])
SETS = {"nyu_vp": ("data/lsd_lines_*.csv", 519.0, 5), "yud_plus": ("data/lines/*.txt", 674.9, 1)}
"""Where lines lie, the focal length [px], and which of the pictures are asked: every so many."""
ENDS = (6, 7, 9, 10)  # columns of a line's two ends
MOST_LINES_ERROR_PERCENT, LEAST_TOLD = 5.0, 0.6
LEAST_LINES_IN_1_SIGMA, LEAST_LINES_IN_2_SIGMA = 0.68, 0.95


@dataclass(frozen=True)
class LinesRow:
    """The pictures of one set."""

    pictures: int
    told: float
    """Share of them that tell a focal length."""
    error_percent_median: float
    error_percent_rms: float
    sigma_percent_median: float
    in_1_sigma: float
    in_2_sigma: float
    most_sigmas: float


def lines_row(folder: Path, *, small: bool) -> LinesRow:
    """What the pictures of a set tell, over what they should."""
    pattern, focal_px, every = SETS[folder.name]
    paths = sorted(folder.glob(pattern))[:: 10 * every if small else every]
    found = [focal_by(log_evidence(ends, end_sigma)) for ends, end_sigma in map(_read, paths)]
    told = [one for one in found if one is not None]
    off = np.array([np.log(one.focal * SIZE_PX[0] / focal_px) for one in told])
    sigmas = np.array([one.focal_sigma for one in told])
    in_sigmas = np.abs(off) / sigmas
    return LinesRow(
        pictures=len(paths),
        told=len(told) / len(paths),
        error_percent_median=100 * float(np.median(np.abs(off))),
        error_percent_rms=100 * float(np.sqrt((off**2).mean())),
        sigma_percent_median=100 * float(np.median(sigmas)),
        in_1_sigma=float((in_sigmas <= 1).mean()),
        in_2_sigma=float((in_sigmas <= 2).mean()),
        most_sigmas=float(in_sigmas.max()),
    )


def lines_rows(folder: Path, *, small: bool) -> Iterator[tuple[str, LinesRow]]:
    """Of the sets that are there."""
    for name in SETS:
        if (folder / name).is_dir():
            yield name, lines_row(folder / name, small=small)


def _read(path: Path) -> tuple[np.ndarray, float]:
    """A picture's lines as `log_evidence` takes them, and the error of their ends."""
    config = LinesConfig()
    ends_px = np.loadtxt(path, skiprows=1, usecols=ENDS).reshape(-1, 2, 2)
    lengths_px = np.linalg.norm(ends_px[:, 1] - ends_px[:, 0], axis=1)
    ends_px = ends_px[lengths_px > config.shortest_share * np.hypot(*SIZE_PX)]
    return (ends_px - SIZE_PX / 2) / SIZE_PX[0], config.end_px / SIZE_PX[0]
