"""Masks from torchvision's Mask R-CNN (He et al., 2017), trained on COCO: instances, united.

Needs the extra `maskrcnn`.  torchvision's compiled operators fit one build of torch only, so it is
imported where the network is made, and an installation that doesn't fit is told with its remedy.
"""

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from gmrdata.people.linking import Detections, TrackedFrame, fill_boxes, track
from gmrdata.people.silhouette import dilate
from gmrdata.people.yolox import CATEGORY_NUMBERS, DetectorConfig, class_indices
from gmrdata.read.frames import read_color, write_gray
from gmrdata.stage.progress import track as with_bar
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import Resumable, run_stage
from gmrdata.values.errors import BadDetector, FetchFailed, MissingExtra, MissingInput, StageFailed
from gmrdata.values.files import read_npz, write_npz
from gmrdata.values.frame_set import FrameSet
from gmrdata.values.limits import Budget

Segmenter = Callable[[np.ndarray], Mapping[str, np.ndarray]]


class MaskRcnnConfig(DetectorConfig):
    """What the network looks for, and how its instances become masks."""

    network: Literal["maskrcnn_resnet50_fpn", "maskrcnn_resnet50_fpn_v2"] = (
        "maskrcnn_resnet50_fpn_v2"
    )
    min_score: float = Field(default=0.5, gt=0, le=1)
    weak_score: float = Field(default=0.2, gt=0, le=1)
    mask_threshold: float = Field(default=0.5, gt=0, lt=1)
    """A pixel belongs to an instance if the network's probability reaches this."""
    dilate_px: int = Field(default=8, ge=0, le=1000)
    """Radius by which the masked part is widened."""
    device: Literal["cpu", "cuda"] = "cpu"


@dataclass(frozen=True, eq=False)
class Instances:
    """What the network found in one frame."""

    found: Detections
    masks: np.ndarray  # (N, H, W) bool


def maskrcnn_masks(
    weights_path: Path | None,
    frames: FrameSet,
    out_dir: Path,
    config: MaskRcnnConfig,
    *,
    run: Run = DEFAULT_RUN,
) -> Path:
    """Stage: `<image stem>.png` per image, 255 on people, vehicles and animals.

    A run that was stopped goes on at the next frame that the network has not seen.  The weights are
    the network's state dict as torch.save wrote it; None: torchvision fetches its own (COCO_V1).
    """

    def work(partial: Path) -> None:
        seen = _segment_all(weights_path, frames.paths, partial, config)
        chosen = track([_load(path).found for path in seen], config.min_score, config.tracks)
        for image, path, choice in zip(frames.paths, seen, chosen, strict=True):
            mask = united_mask(_load(path), choice, frames.size_px, config.dilate_px)
            write_gray(partial / f"{image.stem}.png", mask)
        shutil.rmtree(partial / "seen")

    inputs = {**frames.inputs, "weights": weights_path}
    return run_stage("maskrcnn_masks", out_dir, config, inputs, Resumable(work), run=run)


def instances_of(output: Mapping[str, np.ndarray], config: MaskRcnnConfig) -> Instances:
    """The wanted instances of an answer for one frame: `boxes` (N, 4) [px], `scores` (N,), `labels`
    (N,), which are category numbers of COCO, and `masks` (N, 1, H, W), which are probabilities."""
    wanted = class_indices(config.classes)
    index_of_number = {CATEGORY_NUMBERS[index]: index for index in wanted}
    scores = output["scores"].astype(np.float64)
    is_wanted = np.isin(output["labels"], list(index_of_number)) & (scores >= config.weak_score)
    rows = np.flatnonzero(is_wanted)
    classes = [index_of_number[number] for number in output["labels"][rows].tolist()]
    detections = Detections(
        output["boxes"][rows].astype(np.float64), scores[rows], np.array(classes, dtype=np.int64)
    )
    return Instances(detections, output["masks"][rows, 0] >= config.mask_threshold)


def united_mask(
    instances: Instances, choice: TrackedFrame, size_px: tuple[int, int], dilate_px: int
) -> np.ndarray:
    """The chosen instances and the filled boxes of one frame, widened: (H, W) uint8, 255 inside."""
    mask = fill_boxes(choice.filled_px, size_px)
    mask[instances.masks[choice.rows].any(axis=0)] = 255
    return dilate(mask, dilate_px)


def open_segmenter(weights_path: Path | None, config: MaskRcnnConfig) -> Segmenter:
    """A function from a BGR picture (H, W, 3) to the network's answer as arrays."""
    import torch

    detection = _import_detection()
    if config.device == "cuda" and not torch.cuda.is_available():
        raise StageFailed(
            "no GPU here that torch can use. Say device: cpu in the recipe of the masks"
        )
    make = getattr(detection, config.network)
    if weights_path is None:
        network = _with_own_weights(make)
    else:
        network = make(weights=None, weights_backbone=None)
        _load_weights(network, config.network, weights_path)
    network.eval().to(config.device)

    def segment(image: np.ndarray) -> Mapping[str, np.ndarray]:
        rgb = np.ascontiguousarray(image[:, :, ::-1].transpose(2, 0, 1), dtype=np.float32) / 255
        with torch.inference_mode():
            answer = network([torch.from_numpy(rgb).to(config.device)])[0]
        return {key: value.cpu().numpy() for key, value in answer.items()}

    return segment


def _import_detection() -> Any:
    try:
        from torchvision.models import detection
    except ImportError as error:
        raise MissingExtra(
            f"Mask R-CNN needs torchvision ({error}): "
            "pip install torchvision; or mask with --masks onnx, or with a folder of masks"
        ) from None
    except (RuntimeError, OSError) as error:
        import torch

        raise MissingExtra(
            f"torchvision does not fit torch {torch.__version__} ({error}). Install the pair that "
            "was built together, from one source; or mask with --masks onnx, or with a folder"
        ) from None
    return detection


def _with_own_weights(make: Callable[..., Any]) -> Any:
    try:
        return make(weights="COCO_V1")
    except (OSError, RuntimeError) as error:
        fault = f"torchvision could not fetch the weights of {make.__name__} ({error})"
        raise FetchFailed(f"{fault}. Run again, or pass a file of them") from None


def _load_weights(network: Any, name: str, path: Path) -> None:
    import torch

    if not path.is_file():
        raise MissingInput(f"{path}: no such file of weights")
    remedy = "give the state dict of this network as torchvision publishes it"
    try:
        # weights_only: tensors and containers, nothing that a pickle could run.
        state = torch.load(path, map_location="cpu", weights_only=True)
    except Exception:  # errors of many kinds, whose texts advise to load the file unsafely
        raise BadDetector(f"{path}: truncated, or not a file of plain tensors; {remedy}") from None
    try:
        network.load_state_dict(state)
    except (RuntimeError, TypeError, AttributeError):
        raise BadDetector(f"{path}: holds other tensors than {name}; {remedy}") from None


def _segment_all(
    weights_path: Path | None, images: Sequence[Path], partial: Path, config: MaskRcnnConfig
) -> list[Path]:
    """One file of instances per frame, so that a stopped run keeps what it has."""
    segment = open_segmenter(weights_path, config)
    paths = [partial / "seen" / f"{image.stem}.npz" for image in images]
    for image, path in zip(with_bar(images, "segmenting"), paths, strict=True):
        if not path.is_file():
            _save(path, instances_of(segment(read_color(image)), config))
    return paths


def _save(path: Path, instances: Instances) -> None:
    arrays = {
        "boxes_px": instances.found.boxes_px,
        "scores": instances.found.scores,
        "classes": instances.found.classes,
        "masks": np.packbits(instances.masks, axis=-1),
        "width_px": np.array(instances.masks.shape[-1]),
    }
    write_npz(path, arrays, compressed=True)


def _load(path: Path) -> Instances:
    arrays = read_npz(path, Budget.ceiling())
    masks = np.unpackbits(arrays["masks"], axis=-1, count=int(arrays["width_px"]))
    detections = Detections(arrays["boxes_px"], arrays["scores"], arrays["classes"])
    return Instances(detections, masks.astype(bool))
