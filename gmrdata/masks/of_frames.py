"""Frames or a video to masks and a picture of them: what `gmrdata masks` does."""

from pathlib import Path

from gmrdata.masks.sheet import make_mask_sheet
from gmrdata.masks.sources import MasksConfig, SilhouetteSource, make_masks
from gmrdata.video import extract_video, is_video


def masks_of_frames(
    frames: Path,
    out_dir: Path,
    config: MasksConfig,
    *,
    clip_path: Path | None = None,
    body_path: Path | None = None,
    redo: bool = False,
) -> tuple[Path, Path]:
    """Make `out_dir/masks` (and `masks_by`), `out_dir/sheet`, and `out_dir/frames` of a video.

    Args:
        frames: Folder of numbered images, or a video file.
        out_dir: The output folder.
        config: The recipe.
        clip_path: Camera-frame clip, which silhouettes need.
        body_path: Its body; the default body when None.
        redo: Make anew what another recipe made.

    Returns:
        The folder of the masks, and the contact sheet.

    Raises:
        GmrdataError: as `make_masks` says.
    """
    silhouettes = any(isinstance(source, SilhouetteSource) for source in config.sources)
    if silhouettes and clip_path is not None and body_path is None:
        from gmrdata.body.load import anny_file

        body_path = anny_file()
    if is_video(frames):
        frames = extract_video(frames, out_dir / "frames", redo=redo)
    masks_dir = make_masks(
        frames,
        out_dir / "masks",
        config,
        clip_path=clip_path,
        body_path=body_path,
        redo=redo,
    )
    return masks_dir, make_mask_sheet(frames, masks_dir, out_dir / "sheet")
