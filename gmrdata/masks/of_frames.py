"""Frames or a video to masks and a picture of them: what `gmrdata masks` does."""

from pathlib import Path

from gmrdata.masks.sheet import make_mask_sheet
from gmrdata.masks.sources import MasksConfig, make_masks
from gmrdata.people import PersonFiles
from gmrdata.video import extract_video, is_video


def masks_of_frames(
    frames: Path,
    out_dir: Path,
    config: MasksConfig,
    *,
    people: tuple[PersonFiles, ...] = (),
    redo: bool = False,
) -> tuple[Path, Path]:
    """Make `out_dir/masks` (and `masks_by`), `out_dir/sheet`, and `out_dir/frames` of a video.

    Args:
        frames: Folder of numbered images, or a video file.
        out_dir: The output folder.
        config: The recipe.
        people: Camera-frame clips and their bodies, which silhouettes need.
        redo: Make anew what another recipe made.

    Returns:
        The folder of the masks, and the contact sheet.

    Raises:
        GmrdataError: as `make_masks` says.
    """
    if is_video(frames):
        frames = extract_video(frames, out_dir / "frames", redo=redo)
    masks_dir = make_masks(frames, out_dir / "masks", config, people=people, redo=redo)
    return masks_dir, make_mask_sheet(frames, masks_dir, out_dir / "sheet")
