"""Stage: the same frames solved again, backward, every second one and by other seeds."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic.dataclasses import dataclass as part

from gmrdata.cameras.check.agreement import agreement, least_extent
from gmrdata.cameras.check.verdict import agreement_reasons
from gmrdata.cameras.files import Agreement, Geometry, load_cameras, load_points
from gmrdata.cameras.frames import linked
from gmrdata.cameras.recipe import CamerasVerdictConfig, SfmConfig
from gmrdata.cameras.reconstruct import known_radial, leave_cameras
from gmrdata.read.frames import read_frames
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import run_stage
from gmrdata.values.errors import NoReconstruction
from gmrdata.values.frame_set import FrameSet
from gmrdata.values.records import PART, Record

AGAIN_FILE = "again.json"


@dataclass(frozen=True)
class _Way:
    """One more way to solve a video's frames."""

    name: str
    step: int = 1  # from frame to frame; backward where it is negative
    seed: int = 0  # what is added to the recipe's

    def rows(self, n_frames: int) -> np.ndarray:
        """The rows of the frames in their order."""
        return np.arange(n_frames)[:: self.step]


WAYS = (
    _Way("backward, the video", step=-1),
    _Way("every second frame, solved alone,", step=2),
    _Way("with another seed, the video", seed=1),
    _Way("with a third seed, the video", seed=2),
)


@part(frozen=True, config=PART)
class SolvedAgain:
    """What one more solution says."""

    name: str
    geometry: Geometry | None
    """Null where no camera path was found."""
    agreement: Agreement | None
    """With the first solution; null where they have too few cameras in common."""
    failure: str
    """Why no camera path was found; empty where one was."""


class AgainRecord(Record):
    """`again.json`: how other solutions of the same frames agree with the first."""

    format: Literal["gmrdata-again/1"] = "gmrdata-again/1"
    solutions: tuple[SolvedAgain, ...]

    def reasons(self, config: CamerasVerdictConfig) -> Iterator[str]:
        """Why the first solution can't be used."""
        for solved in self.solutions:
            if solved.agreement is not None:
                yield from agreement_reasons(solved.name, solved.agreement, config)
            else:
                yield f"{solved.name} gives no path to compare: {solved.failure or 'few cameras'}"


def solve_again(
    sfm_dir: Path,
    frames: FrameSet,
    masks_dir: Path | None,
    out_dir: Path,
    config: SfmConfig,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Solve frames four more times and leave `again.json`.

    `sfm_dir` is the first solution, by `config` of the same frames and masks, whose intrinsics are
    kept.  BadFrames, MissingInput: as of `leave_cameras`.
    """

    def work(partial: Path) -> None:
        solutions = []
        for way in WAYS:
            folder = partial / "again"
            solutions.append(_solved(way, sfm_dir, frames, masks_dir, folder, config))
            shutil.rmtree(folder)
        AgainRecord(solutions=tuple(solutions)).write(partial / AGAIN_FILE)

    inputs = {"sfm": sfm_dir, "images": frames.folder, "masks": masks_dir}
    return run_stage("sfm_again", out_dir, config, inputs, work, run=run)


def _solved(
    way: _Way,
    sfm_dir: Path,
    frames: FrameSet,
    masks_dir: Path | None,
    folder: Path,
    config: SfmConfig,
) -> SolvedAgain:
    first, points = load_cameras(sfm_dir).path, load_points(sfm_dir)
    rows = way.rows(len(frames.paths))
    chosen = {f"{number:05d}": frames.paths[row] for number, row in enumerate(rows)}
    given, masks = linked(chosen, masks_dir, folder)
    lens = replace(first.lens, radial=known_radial(sfm_dir))
    try:
        times_s, again = frames.times_s[rows] / way.step, read_frames(given[0].parent)
        again = replace(again, times_s=times_s, rate_hz=frames.rate_hz)
        leave_cameras(folder, again, masks, lens, config.reseeded(way.seed))
    except NoReconstruction as error:
        return SolvedAgain(way.name, None, None, error.why)
    cameras, other = load_cameras(folder), np.full_like(first.world_from_cam, np.nan)
    other[rows] = cameras.path.world_from_cam
    ours, theirs = (first.world_from_cam, points), (other, load_points(folder))
    # Of a camera that is said to stay in its place, the other path says how far it goes.
    if not len(points) and len(theirs[1]):
        ours, theirs = theirs, ours
    least = least_extent(*ours, config.small_travel_share)
    agree = agreement(ours[0], theirs[0], least)
    return SolvedAgain(way.name, cameras.geometry, agree, "")
