"""A sequence whose lens and bodies before the camera are known, and masks of any frames."""

from collections.abc import Collection
from pathlib import Path

from gmrdata.people import sources
from gmrdata.people.sources import MasksConfig
from gmrdata.read.video import VideoConfig, as_frames
from gmrdata.solve.request import GivenPeople, SequenceConfig, SolveConfig, SolveRequest
from gmrdata.solve.solve import FRAMES, MASKS, solve
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.values.people import PersonFiles


def solve_sequence(
    frames: str | Path,
    people: tuple[PersonFiles, ...],
    out_dir: str | Path,
    config: SequenceConfig,
    *,
    dataset_camera_path: Path | None = None,
    doubts_path: Path | None = None,
    left_out: Collection[int] = (),
    video: VideoConfig | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Make `out_dir/masks` (and `masks_by`), `out_dir/sfm` and, the result, `out_dir/pseudo_gt`.

    The intrinsics of the first of the people are kept.

    Args:
        frames: A folder of numbered images, or a video file, of which `video` says the part.  Where
            bodies are of other times than a video's frames, the verdict says so.
        people: In the camera's frame, all with the same rows.
        dataset_camera_path: Of the data set, by `save_dataset_camera`; right over short times.
        doubts_path: A `Doubts` record: why the data set itself does not vouch for frames.
        left_out: Numbers of images that are known to be unusable.

    Raises:
        NoReconstruction: there is no camera path, or no world.
    """
    given = GivenPeople(people, dataset_camera_path, doubts_path, left_out)
    stages = SolveConfig(masks=config.masks, sfm=config.sfm, pseudo_gt=config.pseudo_gt)
    solved = solve(SolveRequest(Path(frames), given, part=video), Path(out_dir), stages, run)
    if solved.unsolved is not None:
        raise solved.unsolved
    assert solved.world_dir is not None
    return solved.world_dir


def make_masks(
    frames: str | Path,
    out_dir: str | Path,
    config: MasksConfig,
    *,
    people: tuple[PersonFiles, ...] = (),
    video: VideoConfig | None = None,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Make `masks`, `masks_by` and, of a video, `frames` in a folder; gives the path of `masks`.

    Args:
        frames: A folder of numbered images, or a video file, of which `video` says the part.
        people: Camera-frame clips with their bodies, for silhouettes.
    """
    given = as_frames(Path(frames), Path(out_dir) / FRAMES, video, run=run)
    return sources.make_masks(given, Path(out_dir) / MASKS, config, people=people, run=run)
