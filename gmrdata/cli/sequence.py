"""Verbs for one video: masks and sfm."""

from pathlib import Path

from gmrdata.cli import options as flags
from gmrdata.cli.answers import answer
from gmrdata.stage.progress import console
from gmrdata.stage.run import Run


def masks(
    frames: flags.Frames,
    out: Path,
    masks: flags.Masks = ("onnx",),
    camera_body: Path | None = None,
    body: flags.Body = "anny",
    redo: flags.Redo = False,
    *,
    part: flags.PartFlags,
    networks: flags.NetworkFlags,
) -> None:
    """Mask what moves in frames or a video: people, vehicles, animals, or a known body.

    Args:
        out: Output folder: masks/ (`<image stem>.png`, 255 = dynamic), masks_by/ with each
            source's own, sheet/contact.jpg to look at, and frames/ of a video. A run that was
            stopped goes on at the next missing frame.
        camera_body: Clip file (.npz) in the camera's frame, for the silhouette.
    """
    from gmrdata.pages.frames import make_mask_sheet
    from gmrdata.people.sources import masks_named
    from gmrdata.solve.sequence import make_masks

    flags.need(masks, "a source of masks: --masks onnx")
    config = masks_named(masks, **vars(networks))
    people = () if camera_body is None else flags.one_person(camera_body, body)
    run = Run(redo=redo)
    masks_dir = make_masks(frames, out, config, people=people, video=part, run=run)
    answer(masks_dir)
    answer(make_mask_sheet(frames if frames.is_dir() else out / "frames", masks_dir, out / "sheet"))
    flags.say_lost(out / "frames")


def sfm(
    frames: flags.Frames,
    camera_body: Path,
    out: Path,
    masks: flags.Masks = ("silhouette",),
    body: flags.Body = "anny",
    seed: int = 0,
    page: flags.Page = True,
    redo: flags.Redo = False,
    *,
    part: flags.PartFlags,
    networks: flags.NetworkFlags,
) -> None:
    """World motion of one person from a moving-camera video and the person's camera-frame body.

    Args:
        camera_body: Clip file (.npz) whose motion is in the camera's frame; its intrinsics are
            used as they are.
        out: Output folder: masks/, masks_by/, sfm/, pseudo_gt/; index.html, overlay/ and files/.
        seed: Seed of the reconstruction.
    """
    from gmrdata.cameras.files import load_quality
    from gmrdata.cameras.recipe import SfmConfig
    from gmrdata.cli.video import write_page
    from gmrdata.people.sources import masks_named
    from gmrdata.solve.request import SequenceConfig
    from gmrdata.solve.sequence import solve_sequence

    flags.need(masks, "a source of masks: --masks silhouette")
    named = masks_named(masks, **vars(networks))
    config = SequenceConfig(masks=named, sfm=SfmConfig(seed=seed))
    people = flags.one_person(camera_body, body)
    answer(solve_sequence(frames, people, out, config, video=part, run=Run(redo=redo)))
    flags.say_lost(out / "frames")
    for name, figure in load_quality(out / "sfm").lens_in_words:
        console.print(f"{name}: {figure}", markup=False, soft_wrap=True)
    if page:
        answer(write_page(out, images=frames if frames.is_dir() else None, body=body))
