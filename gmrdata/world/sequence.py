"""One sequence through the COLMAP stage: from frames and camera-frame bodies to world motions."""

from collections.abc import Collection
from pathlib import Path

from gmrdata.cameras.recipe import SfmConfig
from gmrdata.cameras.reconstruct import reconstruct
from gmrdata.masks.sources import MasksConfig, make_masks
from gmrdata.read.video import extract_video, is_video
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.values.clip import camera_of, load_clip
from gmrdata.values.people import PersonFiles
from gmrdata.values.records import Config
from gmrdata.world.pseudo_gt import make_pseudo_gt
from gmrdata.world.recipe import PseudoGtConfig


class SequenceConfig(Config):
    """The stages of one sequence."""

    masks: MasksConfig = MasksConfig()
    """Masks of what moves; the body's silhouette unless other sources are named."""
    sfm: SfmConfig = SfmConfig()
    pseudo_gt: PseudoGtConfig = PseudoGtConfig()


def regenerate_sequence(
    frames: Path,
    people: tuple[PersonFiles, ...],
    out_dir: Path,
    config: SequenceConfig,
    *,
    dataset_camera_path: Path | None = None,
    doubts_path: Path | None = None,
    left_out: Collection[int] = (),
    run: Run = DEFAULT_RUN,
) -> Path:
    """Make `out_dir/masks` (and `masks_by`), `out_dir/sfm` and, the result, `out_dir/pseudo_gt`.

    `frames` is a folder of numbered images, or a video file; the intrinsics of the first of the
    people are kept; the other files are those of `make_pseudo_gt`.
    """
    if is_video(frames):
        frames = extract_video(frames, out_dir / "frames", run=run)
    sfm_dir = out_dir / "sfm"
    masks_dir = make_masks(
        frames, out_dir / "masks", config.masks, people=people, left_out=left_out, run=run
    )
    intrinsics_px = camera_of(load_clip(people[0].clip_path)).intrinsics_px
    reconstruct(frames, masks_dir, intrinsics_px, sfm_dir, config.sfm, left_out=left_out, run=run)
    return make_pseudo_gt(
        sfm_dir,
        people,
        out_dir / "pseudo_gt",
        config.pseudo_gt,
        dataset_camera_path=dataset_camera_path,
        doubts_path=doubts_path,
        run=run,
    )
