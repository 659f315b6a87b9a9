"""One sequence through the COLMAP stage: from frames and camera-frame body to a world motion."""

from pathlib import Path

from gmrdata.body.load import anny_file
from gmrdata.clip import camera_of, load_clip
from gmrdata.config import Config
from gmrdata.masks.folder import FolderMaskConfig, folder_masks
from gmrdata.masks.silhouette import SilhouetteConfig, silhouette_masks
from gmrdata.pseudogt.make import PseudoGtConfig, make_pseudo_gt
from gmrdata.sfm.config import SfmConfig
from gmrdata.sfm.reconstruct import reconstruct
from gmrdata.video import extract_video, is_video


class SequenceConfig(Config):
    """The stages of one sequence."""

    masks: SilhouetteConfig = SilhouetteConfig()
    """Masks from the projected body, where no folder of masks is given."""
    folder_masks: FolderMaskConfig = FolderMaskConfig()
    """How a given folder of masks is read."""
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
    masks_dir: Path | None = None,
    body_path: Path | None = None,
    redo: bool = False,
) -> Path:
    """Make `out_dir/masks`, `out_dir/sfm` and `out_dir/pseudo_gt`.

    Args:
        frames: Folder of numbered images, or a video file.
        camera_clip_path: Clip file whose motion is in the camera's frame; its intrinsics are kept.
        out_dir: The output folder.
        config: The recipe of all stages.
        masks_dir: Folder of masks that somebody made; the body's silhouette when None.
        body_path: The clip's body; the default body when None.
        redo: Make anew what another recipe made.

    Returns:
        The folder of the pseudo ground truth.
    """
    body_path = anny_file() if body_path is None else body_path
    if is_video(frames):
        frames = extract_video(frames, out_dir / "frames", redo=redo)
    made_masks, sfm_dir = out_dir / "masks", out_dir / "sfm"
    if masks_dir is None:
        silhouette_masks(camera_clip_path, body_path, frames, made_masks, config.masks, redo=redo)
    else:
        folder_masks(masks_dir, frames, made_masks, config.folder_masks, redo=redo)
    intrinsics_px = camera_of(load_clip(camera_clip_path)).intrinsics_px
    reconstruct(frames, made_masks, intrinsics_px, sfm_dir, config.sfm, redo=redo)
    return make_pseudo_gt(
        sfm_dir, camera_clip_path, body_path, out_dir / "pseudo_gt", config.pseudo_gt, redo=redo
    )
