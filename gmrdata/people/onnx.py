"""Masks from a YOLOX detector in an ONNX file, run by OpenCV: boxes, joined over time, filled."""

import shutil
from collections.abc import Callable, Iterator, Sequence
from math import prod
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass as part

from gmrdata.people import linking, yolox
from gmrdata.people.linking import Detection, Detections
from gmrdata.read.frames import read_color, write_gray
from gmrdata.read.models import require_model
from gmrdata.stage.progress import track as with_bar
from gmrdata.stage.run import DEFAULT_RUN, Run
from gmrdata.stage.store import Resumable, run_stage
from gmrdata.values.errors import BadDetector
from gmrdata.values.files import read_json, write_json
from gmrdata.values.frame_set import FrameSet
from gmrdata.values.limits import MOST_INPUT_SIDE_PX, MOST_NETWORK_NUMBERS
from gmrdata.values.records import PART, Record

DETECTIONS_FILE = "detections.json"
_NUMBERS = ("float_data", "int32_data", "int64_data", "double_data", "uint64_data", "string_data")
"""Fields of onnx.proto's TensorProto."""
Detector = Callable[[np.ndarray], Detections]


class OnnxConfig(yolox.DetectorConfig):
    """What the detector looks for, and how its boxes become masks."""

    min_score: float = Field(default=0.35, gt=0, le=1)
    weak_score: float = Field(default=0.15, gt=0, le=1)
    nms_iou: float = Field(default=0.5, gt=0, le=1)
    """Overlap from which the weaker of two boxes of one class is dropped."""
    input_sizes_px: tuple[tuple[int, int], ...] = ()
    """Sizes (width, height) of the network's input, multiples of 32; the boxes of several are
    united, and twice the model's size finds smaller people.  The model's own size if none [px]."""
    grow_share: float = Field(default=0.05, ge=0)
    """Boxes are widened on each side by this share of their shorter side."""
    dilate_px: int = Field(default=4, ge=0, le=1000)
    """Boxes are widened on each side by this as well [px]."""

    @model_validator(mode="after")
    def _sizes_fit(self) -> Self:
        for size_px in self.input_sizes_px:
            fits = all(0 < side <= MOST_INPUT_SIDE_PX for side in size_px)
            if not fits or any(side % yolox.STRIDES_PX[-1] for side in size_px):
                size, most = f"{size_px[0]}x{size_px[1]}", f"at most {MOST_INPUT_SIDE_PX}"
                raise ValueError(f"input_sizes_px: {size}: sides must be multiples of 32, {most}")
        return self


@part(frozen=True, config=PART)
class FrameRecord:
    """What was found in one frame."""

    found: list[Detection]
    masked: list[int]
    """Which of them are masked."""
    filled_px: list[list[float]]
    """Boxes where a track skips the frame: left, top, right, bottom."""


class DetectionsRecord(Record):
    """`detections.json`."""

    format: Literal["gmrdata-detections/1"] = "gmrdata-detections/1"
    frames: dict[str, FrameRecord]
    """By the stem of the image's name."""


def onnx_masks(
    model_path: Path, frames: FrameSet, out_dir: Path, config: OnnxConfig, *, run: Run = DEFAULT_RUN
) -> Path:
    """Stage: `<image stem>.png` per image, 255 in the boxes found, and `detections.json`.

    A run that was stopped goes on at the next frame that the detector has not seen.  The model is
    YOLOX on COCO's 80 classes as an ONNX file with raw output; BadDetector where it is not.
    """

    def work(partial: Path) -> None:
        detections = detect_all(model_path, frames.paths, partial, config)
        chosen = linking.track(detections, config.min_score, config.tracks)
        records = {}
        for image, frame, choice in zip(frames.paths, detections, chosen, strict=True):
            boxes_px = np.concatenate([frame.boxes_px[choice.rows], choice.filled_px])
            boxes_px = linking.grow(boxes_px, config.grow_share, config.dilate_px)
            write_gray(partial / f"{image.stem}.png", linking.fill_boxes(boxes_px, frames.size_px))
            filled_px = np.round(choice.filled_px, 2).tolist()
            as_json = linking.detections_as_json(frame)
            records[image.stem] = FrameRecord(as_json, choice.rows.tolist(), filled_px)
        DetectionsRecord(frames=records).write(partial / DETECTIONS_FILE)
        shutil.rmtree(partial / "seen")

    inputs = {"model": model_path} | frames.inputs
    return run_stage("onnx_masks", out_dir, config, inputs, Resumable(work), run=run)


def open_detector(model_path: Path, config: OnnxConfig) -> Detector:
    """A function from a BGR picture (H, W, 3) to what it shows, weak boxes too."""
    own_size_px = _input_size_px(model_path)
    check_sizes(model_path)
    net = _open(model_path)
    sizes_px = config.input_sizes_px or ((own_size_px,) if own_size_px else ())
    if not sizes_px:
        raise BadDetector(f"{model_path}: leaves its input's size open; give input_sizes_px")
    indices = yolox.class_indices(config.classes)

    def detect(image: np.ndarray) -> Detections:
        by_size = []
        for size_px in sizes_px:
            blob, input_from_frame = yolox.letterbox(image, size_px)
            output = _forward(net, blob, model_path)
            if problem := yolox.problem_with(output, size_px):
                raise BadDetector(f"{model_path}: {problem}")
            least = config.weak_score
            by_size.append(yolox.decode(output, size_px, input_from_frame, indices, least))
        parts = zip(*((f.boxes_px, f.scores, f.classes) for f in by_size), strict=True)
        return linking.keep_best(Detections(*map(np.concatenate, parts)), config.nms_iou)

    return detect


class OnnxInput(NamedTuple):
    """One input of a network."""

    name: str
    shape: tuple[int | None, ...]  # None where the file leaves a size open


def read_inputs(path: Path) -> list[OnnxInput]:
    """The inputs that an ONNX file wants to be given, which OpenCV does not tell.
    Weights are none of them; those that lie in other files are not looked for."""
    from google.protobuf.message import DecodeError
    from onnx import ModelProto

    content = require_model(path).read_bytes()
    if not content:
        raise BadDetector(f"{path}: empty file (0 bytes); fetch the model again")
    try:
        graph = ModelProto.FromString(content).graph
        inputs = [OnnxInput(value.name, _shape(value)) for value in graph.input]
        weights = {tensor.name for tensor in graph.initializer}
    except (DecodeError, ValueError) as error:
        fault = f"truncated, or not an ONNX file ({error})"
        raise BadDetector(f"{path}: {fault}; fetch the model again") from None
    if not inputs:
        raise BadDetector(f"{path}: not an ONNX file: it has no graph with inputs")
    return [known for known in inputs if known.name not in weights]


def _shape(value: Any) -> tuple[int | None, ...]:
    sizes = value.type.tensor_type.shape.dim
    return tuple(size.dim_value if size.dim_value > 0 else None for size in sizes)


def detect_all(
    model_path: Path, images: Sequence[Path], partial: Path, config: OnnxConfig
) -> list[Detections]:
    """Detections of all frames, weak ones too, which `<partial>/seen` keeps for a later run."""
    detect = open_detector(model_path, config)
    return [detect_once(detect, image, partial)[1] for image in with_bar(images, "detecting")]


def detect_once(
    detect: Detector, image: Path, partial: Path
) -> tuple[np.ndarray | None, Detections]:
    """What a frame shows, kept as in `detect_all`, and its picture unless it was seen before."""
    seen, picture = partial / "seen" / f"{image.stem}.json", None
    if not seen.is_file():
        picture = read_color(image)
        write_json(seen, linking.detections_as_json(detect(picture)))
    # Read back, so that a resumed run works on the very same numbers.
    return picture, linking.detections_from_json(read_json(seen))


def _input_size_px(model_path: Path) -> tuple[int, int] | None:
    """(width, height) that a model names; None if it leaves them open."""
    inputs = read_inputs(model_path)
    shape = inputs[0].shape if len(inputs) == 1 else ()
    if len(shape) != 4 or shape[1] not in (3, None):
        named = ", ".join(f"{known.name} {known.shape}" for known in inputs) or "none"
        wanted = "one input of the shape (1, 3, height, width)"
        raise BadDetector(f"{model_path}: not YOLOX: it should have {wanted}, but has {named}")
    if shape[2] is None or shape[3] is None:
        return None
    if max(shape[2], shape[3]) > MOST_INPUT_SIDE_PX:
        size = f"{shape[3]}x{shape[2]} px"
        most = f"{MOST_INPUT_SIDE_PX} px a side are the most"
        raise BadDetector(f"{model_path}: wants pictures of {size}, and {most}; export it anew")
    return (shape[3], shape[2])


def _open(model_path: Path) -> Any:
    import cv2

    content = np.frombuffer(model_path.read_bytes(), dtype=np.uint8)
    try:
        net = cv2.dnn.readNetFromONNX(content)
        names = net.getUnconnectedOutLayersNames()
    except cv2.error as error:
        fault = f"OpenCV can't open this network ({_short(error)})"
        raise BadDetector(f"{model_path}: {fault}; fetch or export the model again") from None
    if len(names) != 1:
        fault = f"it should have one output, but has {', '.join(names)}"
        raise BadDetector(f"{model_path}: not YOLOX: {fault}")
    net.setPreferableBackend(cv2.dnn.DNN_BACKEND_OPENCV)
    return net


def _forward(net: Any, blob: np.ndarray, model_path: Path) -> np.ndarray:
    import cv2

    try:
        net.setInput(blob)
        return np.asarray(net.forward())
    except cv2.error as error:
        size = f"{blob.shape[3]}x{blob.shape[2]} px"
        fault = f"OpenCV can't run this network on {size} ({_short(error)})"
        raise BadDetector(f"{model_path}: {fault}") from None


def _short(error: Exception) -> str:
    """The first sentence of an OpenCV error, without its place in OpenCV's source."""
    lines = str(error).strip().splitlines()
    return lines[0].split("error: ")[-1].split(" in function")[0] if lines else "no reason given"


def check_sizes(path: Path) -> None:
    """Before OpenCV makes arrays of them: BadDetector for weights that aren't in the file in the
    number that it says, and for a node whose output has more numbers than any network's that we
    run.  Also for a branch that hangs on no input, over which OpenCV 5.0 ends the process."""
    from onnx import ModelProto

    model = ModelProto.FromString(path.read_bytes())
    for tensor in _tensors(model.graph):
        said, held = prod(tensor.dims), _numbers_held(tensor)
        if min(tensor.dims, default=0) < 0 or said > held:
            fault = f"its weights {tensor.name!r} should be {said} numbers, and {held} are there"
            raise BadDetector(f"{path}: {fault}; fetch or export the model again")
    for name in _fixed_branches(model.graph, set()):
        fault = f"its branch {name!r} hangs on no input"
        raise BadDetector(f"{path}: {fault}; export the model without branches")
    for name, shape in _inferred(path, model):
        if (count := prod(shape)) > MOST_NETWORK_NUMBERS:
            fault = f"{name!r} would have {count} numbers, and {MOST_NETWORK_NUMBERS} are the most"
            raise BadDetector(f"{path}: {fault}; export a smaller model")


def _tensors(graph: Any) -> Iterator[Any]:
    """Every array that stands in a graph: its weights, and the constants of its nodes."""
    yield from graph.initializer
    for node in graph.node:
        for attribute in node.attribute:
            yield from attribute.tensors
            yield from (attribute.t,) if attribute.HasField("t") else ()
        for inner in _graphs(node):
            yield from _tensors(inner)


def _graphs(node: Any) -> Iterator[Any]:
    """The graphs that a node runs: branches, the body of a loop."""
    for attribute in node.attribute:
        yield from attribute.graphs
        yield from (attribute.g,) if attribute.HasField("g") else ()


def _fixed_branches(graph: Any, outside: set[str]) -> Iterator[str]:
    """Outputs of the branches in a graph whose condition hangs on none of its inputs, nor on what
    hangs on them `outside` of it."""
    weights = {tensor.name for tensor in graph.initializer}
    varying = outside | {value.name for value in graph.input} - weights
    for node in graph.node:
        if node.op_type == "If" and not varying.intersection(node.input):
            yield ", ".join(node.output)
        for inner in _graphs(node):
            yield from _fixed_branches(inner, varying)
        if varying.intersection(node.input):
            varying.update(node.output)


def _numbers_held(tensor: Any) -> int:
    from onnx.helper import tensor_dtype_to_np_dtype

    if not tensor.raw_data:
        return max(len(getattr(tensor, field)) for field in _NUMBERS)
    try:
        return len(tensor.raw_data) // int(tensor_dtype_to_np_dtype(tensor.data_type).itemsize)
    except KeyError:  # a type that ONNX doesn't have
        return 0


def _inferred(path: Path, model: Any) -> list[tuple[str, list[int]]]:
    """Names and sizes of what the nodes make, as far as the file settles them."""
    from onnx.shape_inference import InferenceError, infer_shapes

    try:
        graph = infer_shapes(model, data_prop=True).graph
    except (InferenceError, ValueError, RuntimeError, MemoryError) as error:
        why = " ".join(str(error).split())[:200] or type(error).__name__
        raise BadDetector(f"{path}: its sizes don't fit ({why}); export or fetch it anew") from None
    named = (*graph.input, *graph.value_info, *graph.output)
    return [
        (value.name, [max(1, size.dim_value) for size in value.type.tensor_type.shape.dim])
        for value in named
    ]
