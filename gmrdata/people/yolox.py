"""YOLOX's picture in and its raw answer out.

Ge et al., "YOLOX: Exceeding YOLO Series in 2021".  The picture is reduced with its aspect kept, put
into the upper left corner of the input, and the rest is filled with grey 114; channels are BGR from
0 to 255.  The answer has one row per cell of three grids (8, 16 and 32 px wide, each row by row):
box centre from the cell's corner in cells, logarithms of width and height in cells, the score
of there being an object, and one score for each class.

Its classes are those of COCO (Lin et al., "Microsoft COCO: Common Objects in Context", 2014): 80,
whose category numbers run from 1 to 90 with gaps.  YOLOX counts the classes from 0 without gaps;
torchvision's detectors answer with the category numbers.
"""

from typing import Annotated, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from gmrdata.people.linking import Detections, TrackConfig
from gmrdata.values.records import Config

COCO_NAMES: tuple[str, ...] = (  # The 80 classes in the order of their category numbers
    *("person", "bicycle", "car", "motorcycle", "airplane", "bus", "train", "truck", "boat"),
    *("traffic light", "fire hydrant", "stop sign", "parking meter", "bench", "bird", "cat"),
    *("dog", "horse", "sheep", "cow", "elephant", "bear", "zebra", "giraffe", "backpack"),
    *("umbrella", "handbag", "tie", "suitcase", "frisbee", "skis", "snowboard", "sports ball"),
    *("kite", "baseball bat", "baseball glove", "skateboard", "surfboard", "tennis racket"),
    *("bottle", "wine glass", "cup", "fork", "knife", "spoon", "bowl", "banana", "apple"),
    *("sandwich", "orange", "broccoli", "carrot", "hot dog", "pizza", "donut", "cake", "chair"),
    *("couch", "potted plant", "bed", "dining table", "toilet", "tv", "laptop", "mouse"),
    *("remote", "keyboard", "cell phone", "microwave", "oven", "toaster", "sink"),
    *("refrigerator", "book", "clock", "vase", "scissors", "teddy bear", "hair drier"),
    "toothbrush",
)
UNUSED_CATEGORIES = frozenset({12, 26, 29, 30, 45, 66, 68, 69, 71, 83})  # Numbers that no class has
CATEGORY_NUMBERS: tuple[int, ...] = tuple(  # Category number of each of COCO_NAMES
    number for number in range(1, 91) if number not in UNUSED_CATEGORIES
)

DYNAMIC = (  # What the paper masks in 3DPW: people, vehicles and animals
    *("person", "bicycle", "car", "motorcycle", "airplane", "bus", "train", "truck", "boat"),
    *("bird", "cat", "dog", "horse", "sheep", "cow", "elephant", "bear", "zebra", "giraffe"),
)


def class_indices(names: tuple[str, ...]) -> list[int]:
    """Index of each name in COCO_NAMES, without repeats, in rising order."""
    return sorted({COCO_NAMES.index(name) for name in names})


def _known(names: tuple[str, ...]) -> tuple[str, ...]:
    unknown = [name for name in names if name not in COCO_NAMES]
    if unknown:
        known = ", ".join(COCO_NAMES)
        raise ValueError(f"not classes of COCO: {', '.join(unknown)}; there are: {known}")
    return names


CocoClasses = Annotated[tuple[str, ...], Field(min_length=1), AfterValidator(_known)]
"""A recipe's list of class names; a name that COCO lacks is refused."""


class DetectorConfig(Config):
    """What a detector looks for.  Each detector has its own scores."""

    classes: CocoClasses = DYNAMIC
    """COCO's names of what moves; people, vehicles and animals unless other names are given."""
    min_score: float
    """An object is masked if its score reaches this in some frame of its track."""
    weak_score: float
    """What is found down to this score counts in a track that reaches `min_score`."""
    tracks: TrackConfig = TrackConfig()
    """How detections of neighbouring frames are joined; frames between get a filled box."""

    @model_validator(mode="after")
    def _scores_fit(self) -> Self:
        if self.weak_score > self.min_score:
            raise ValueError("weak_score: must not be above min_score")
        return self


STRIDES_PX = (8, 16, 32)
PADDING = 114
BOX_AND_OBJECT = 5
LARGEST_LOG_SIZE = 20.0  # Nothing is e^20 cells large: such an answer was decoded already


def letterbox(image: np.ndarray, input_size_px: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Bring a picture (H, W, 3), uint8 BGR, into the network's input of (width, height):
    (1, 3, height, width) float32 from 0 to 255, and input_from_frame scales (2,) for x and y."""
    import cv2

    height, width = image.shape[:2]
    ratio = min(input_size_px[0] / width, input_size_px[1] / height)
    # A strip of a picture keeps at least one row.
    reduced = (max(1, int(width * ratio)), max(1, int(height * ratio)))
    padded = np.full((input_size_px[1], input_size_px[0], 3), PADDING, dtype=np.uint8)
    padded[: reduced[1], : reduced[0]] = cv2.resize(image, reduced, interpolation=cv2.INTER_LINEAR)
    blob = np.ascontiguousarray(padded.transpose(2, 0, 1)[None], dtype=np.float32)
    return blob, np.array([reduced[0] / width, reduced[1] / height])


def cells(input_size_px: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Left upper corner (A, 2) [cells] and width (A, 1) [px] of every cell of the three grids."""
    corners, widths = [], []
    for stride in STRIDES_PX:
        columns, rows = input_size_px[0] // stride, input_size_px[1] // stride
        y, x = np.mgrid[:rows, :columns]
        corners.append(np.stack([x.ravel(), y.ravel()], axis=1))
        widths.append(np.full((rows * columns, 1), float(stride)))
    return np.concatenate(corners).astype(np.float64), np.concatenate(widths)


def problem_with(output: np.ndarray, input_size_px: tuple[int, int]) -> str | None:
    """Why an answer isn't YOLOX's raw one for COCO, or None if it may be."""
    n_cells = len(cells(input_size_px)[0])
    expected = (1, n_cells, BOX_AND_OBJECT + len(COCO_NAMES))
    if output.shape != expected:
        return (
            f"its output has the shape {output.shape}, but YOLOX on COCO's 80 classes gives "
            f"{expected} for an input of {input_size_px[0]}x{input_size_px[1]} px"
        )
    if not np.isfinite(output).all():
        return "its output holds values that are not finite"
    scores = output[..., 4:]
    if scores.min() < 0 or scores.max() > 1:
        return "its scores are not between 0 and 1; export it with the sigmoids in the network"
    if output[..., 2:4].max() > LARGEST_LOG_SIZE:
        return "its boxes are decoded already; export it with the raw output (the usual export)"
    return None


def decode(
    output: np.ndarray,
    input_size_px: tuple[int, int],
    input_from_frame: np.ndarray,
    class_indices: list[int],
    min_score: float,
) -> Detections:
    """Boxes of a raw answer, in the frame's pixels, before any of them is suppressed.

    The score is that of the object times that of the best of the wanted classes: a dog that looks
    a little more like a teddy bear is still a dog.  The answer (1, A, 85) is for an input of
    (width, height), `input_from_frame` is from `letterbox`; classes are indices into COCO_NAMES.
    """
    raw = output[0].astype(np.float64)
    wanted = raw[:, 4:5] * raw[:, BOX_AND_OBJECT:][:, class_indices]
    best = wanted.argmax(axis=1)
    scores = wanted[np.arange(len(raw)), best]
    rows = scores >= min_score
    corners, widths = (array[rows] for array in cells(input_size_px))
    centre = (raw[rows, :2] + corners) * widths
    half = 0.5 * np.exp(raw[rows, 2:4]) * widths
    boxes = np.concatenate([centre - half, centre + half], axis=1)
    boxes_px = boxes / np.tile(input_from_frame, 2)
    return Detections(boxes_px, scores[rows], np.array(class_indices)[best[rows]])
