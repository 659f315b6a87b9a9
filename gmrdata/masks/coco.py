"""The classes of COCO, by the names that detectors trained on it answer with.

Lin et al., "Microsoft COCO: Common Objects in Context" (2014).  The data set has 80 classes, whose
category numbers run from 1 to 90 with gaps.  YOLOX counts the classes from 0 without gaps;
torchvision's detectors answer with the category numbers.
"""

from typing import Annotated

from pydantic import AfterValidator, Field

COCO_NAMES: tuple[str, ...] = (
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
"""The 80 classes in the order of their category numbers."""
UNUSED_CATEGORIES = frozenset({12, 26, 29, 30, 45, 66, 68, 69, 71, 83})
"""Numbers from 1 to 90 that no class has."""
CATEGORY_NUMBERS: tuple[int, ...] = tuple(
    number for number in range(1, 91) if number not in UNUSED_CATEGORIES
)
"""Category number of each of COCO_NAMES."""

PEOPLE = ("person",)
VEHICLES = ("bicycle", "car", "motorcycle", "airplane", "bus", "train", "truck", "boat")
ANIMALS = (
    *("bird", "cat", "dog", "horse", "sheep", "cow", "elephant", "bear", "zebra", "giraffe"),
)
DYNAMIC = PEOPLE + VEHICLES + ANIMALS
"""What the paper masks in 3DPW: people, vehicles and animals."""


def class_indices(names: tuple[str, ...]) -> list[int]:
    """Index of each name in COCO_NAMES, without repeats, in rising order."""
    return sorted({COCO_NAMES.index(name) for name in names})


def _known(names: tuple[str, ...]) -> tuple[str, ...]:
    unknown = [name for name in names if name not in COCO_NAMES]
    if unknown:
        raise ValueError(
            f"not classes of COCO: {', '.join(unknown)}; there are: {', '.join(COCO_NAMES)}"
        )
    return names


CocoClasses = Annotated[tuple[str, ...], Field(min_length=1), AfterValidator(_known)]
"""A recipe's list of class names; a name that COCO lacks is refused."""
