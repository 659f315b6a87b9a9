"""Verbs for one video: masks and sfm."""

from pathlib import Path

from tyro.conf import Positional

from gmrdata.cli import options as flags
from gmrdata.cli.answers import answer
from gmrdata.stage.progress import console
from gmrdata.stage.run import Run


def masks(
    frames: Positional[flags.Frames],
    out: Path,
    sources: tuple[str, ...] = ("onnx",),
    model: flags.MaskModel = None,
    landmarks: flags.MaskLandmarks = None,
    weights: flags.MaskWeights = None,
    classes: flags.MaskClasses = (),
    camera_body: Path | None = None,
    body: flags.Body = "anny",
    from_s: flags.FromS = 0.0,
    to_s: flags.ToS = None,
    every: flags.Every = 1,
    take_what_decodes: flags.TakeWhatDecodes = False,
    redo: flags.Redo = False,
) -> None:
    """Mask what moves in frames or a video: people, vehicles, animals, or a known body.

    Args:
        out: Output folder: masks/ (`<image stem>.png`, 255 = dynamic), masks_by/ with each
            source's own, sheet/contact.jpg to look at, and frames/ of a video. A run that was
            stopped goes on at the next missing frame.
        sources: Where masks come from; several are united: onnx (a YOLOX detector's boxes), person
            (people's outlines), maskrcnn (torchvision's, extra `maskrcnn`), silhouette (the
            projected body), a folder of masks, or a recipe (.yaml) of kind `masks`.
        camera_body: Clip file (.npz) in the camera's frame, for the silhouette.
    """
    from gmrdata.pages.frames import make_mask_sheet
    from gmrdata.people.sources import masks_named
    from gmrdata.solve.sequence import make_masks

    flags.need(sources, "a source of masks: --sources onnx")
    config = masks_named(
        sources, model=model, landmarks=landmarks, weights=weights, classes=classes
    )
    people = () if camera_body is None else flags.one_person(camera_body, body)
    video = flags.video_part(from_s, to_s, every, take_what_decodes)
    run = Run(redo=redo)
    masks_dir = make_masks(frames, out, config, people=people, video=video, run=run)
    answer(masks_dir)
    answer(make_mask_sheet(frames if frames.is_dir() else out / "frames", masks_dir, out / "sheet"))
    flags.say_lost(out / "frames")


def sfm(
    frames: flags.Frames,
    camera_body: Path,
    out: Path,
    masks: tuple[str, ...] = ("silhouette",),
    model: flags.MaskModel = None,
    landmarks: flags.MaskLandmarks = None,
    weights: flags.MaskWeights = None,
    classes: flags.MaskClasses = (),
    body: flags.Body = "anny",
    seed: int = 0,
    from_s: flags.FromS = 0.0,
    to_s: flags.ToS = None,
    every: flags.Every = 1,
    take_what_decodes: flags.TakeWhatDecodes = False,
    page: flags.Page = True,
    redo: flags.Redo = False,
) -> None:
    """World motion of one person from a moving-camera video and the person's camera-frame body.

    Args:
        camera_body: Clip file (.npz) whose motion is in the camera's frame; its intrinsics are
            used as they are.
        out: Output folder: masks/, masks_by/, sfm/, pseudo_gt/; index.html, overlay/ and files/.
        masks: Where masks of what moves come from, as `gmrdata masks --sources` takes them.
        seed: Seed of the reconstruction.
    """
    from gmrdata.cameras.files import load_quality
    from gmrdata.cameras.recipe import SfmConfig
    from gmrdata.cli.video import write_page
    from gmrdata.people.sources import masks_named
    from gmrdata.solve.request import SequenceConfig
    from gmrdata.solve.sequence import solve_sequence

    flags.need(masks, "a source of masks: --masks silhouette")
    named = masks_named(masks, model=model, landmarks=landmarks, weights=weights, classes=classes)
    config = SequenceConfig(masks=named, sfm=SfmConfig(seed=seed))
    people = flags.one_person(camera_body, body)
    video = flags.video_part(from_s, to_s, every, take_what_decodes)
    answer(solve_sequence(frames, people, out, config, video=video, run=Run(redo=redo)))
    flags.say_lost(out / "frames")
    for name, figure in load_quality(out / "sfm").lens_in_words:
        console.print(f"{name}: {figure}", markup=False, soft_wrap=True)
    if page:
        answer(write_page(out, images=frames if frames.is_dir() else None, body=body))
