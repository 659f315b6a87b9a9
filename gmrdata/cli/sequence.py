"""Verbs for one video: masks and sfm."""

from pathlib import Path

from tyro.conf import Positional

from gmrdata.cli.answers import answer
from gmrdata.cli.options import need, one_person
from gmrdata.stage.run import Run


def masks(
    frames: Positional[Path],
    out: Path,
    sources: tuple[str, ...] = ("onnx",),
    model: Path | None = None,
    weights: Path | None = None,
    classes: tuple[str, ...] = (),
    camera_body: Path | None = None,
    body: str = "anny",
    redo: bool = False,
) -> None:
    """Mask what moves in frames or a video: people, vehicles, animals, or a known body.

    Args:
        frames: Folder of numbered images, or a video file.
        out: Output folder: masks/ (`<image stem>.png`, 255 = dynamic), masks_by/ with each
            source's own, sheet/contact.jpg to look at, and frames/ of a video. A run that was
            stopped goes on at the next missing frame.
        sources: Where masks come from; several are united: onnx (a YOLOX detector), maskrcnn
            (torchvision's, extra `maskrcnn`), silhouette (the projected body), a folder of masks,
            or a recipe (.yaml) of kind `masks`.
        model: ONNX file of the detector: YOLOX on COCO, raw output.
        weights: State dict of Mask R-CNN; torchvision fetches its own when left out.
        classes: COCO's names of what to mask; people, vehicles and animals when left out.
        camera_body: Clip file (.npz) in the camera's frame, for the silhouette.
        body: "anny", or the path of the body model of that clip.
        redo: Make anew what other settings made.
    """
    from gmrdata.masks.sources import masks_named
    from gmrdata.pages.masks_sheet import masks_of_frames

    need(sources, "a source of masks: --sources onnx")
    config = masks_named(sources, model=model, weights=weights, classes=classes)
    people = () if camera_body is None else one_person(camera_body, body)
    for made in masks_of_frames(frames, out, config, people=people, run=Run(redo=redo)):
        answer(made)


def sfm(
    frames: Path,
    camera_body: Path,
    out: Path,
    masks: tuple[str, ...] = ("silhouette",),
    model: Path | None = None,
    weights: Path | None = None,
    classes: tuple[str, ...] = (),
    body: str = "anny",
    seed: int = 0,
    redo: bool = False,
) -> None:
    """World motion of one person from a moving-camera video and the person's camera-frame body.

    Args:
        frames: Folder of numbered images, or a video file.
        camera_body: Clip file (.npz) whose motion is in the camera's frame; its intrinsics are
            used as they are.
        out: Output folder: masks/, masks_by/, sfm/, pseudo_gt/.
        masks: Where masks of what moves come from; several are united: silhouette (the projected
            body), onnx (a YOLOX detector), maskrcnn (torchvision's, extra `maskrcnn`), a folder of
            masks `<image stem>.png` with 255 = dynamic, or a recipe (.yaml) of kind `masks`.
        model: ONNX file of the detector: YOLOX on COCO, raw output.
        weights: State dict of Mask R-CNN; torchvision fetches its own when left out.
        classes: COCO's names of what to mask; people, vehicles and animals when left out.
        body: "anny", or the path of the body model of the clip.
        seed: Seed of the reconstruction.
        redo: Make anew what other settings made.
    """
    from gmrdata.cameras.recipe import SfmConfig
    from gmrdata.masks.sources import masks_named
    from gmrdata.world.sequence import SequenceConfig, regenerate_sequence

    need(masks, "a source of masks: --masks silhouette")
    config = masks_named(masks, model=model, weights=weights, classes=classes)
    made = regenerate_sequence(
        frames,
        one_person(camera_body, body),
        out,
        SequenceConfig(masks=config, sfm=SfmConfig(seed=seed)),
        run=Run(redo=redo),
    )
    answer(made)
