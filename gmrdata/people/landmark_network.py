"""BlazePose GHUM: a person's outline and landmarks from a square crop of a picture, by LiteRT.

Bazarevsky et al., "BlazePose" (2020), and Grishchenko et al., "BlazePose GHUM Holistic" (2022).
The network wants a crop of 256 x 256 pixels in which the person stands upright.  Two of its
landmarks, the middle of the hips and a point above it, give the crop of the next frame.  The others
are of the body, in the picture and in metres; those in metres are as seen in the crop, and are
turned back here with it.

Of a crop and of its mirror image it gives landmarks that are 80 mm apart in the mean, about as much
as each are wrong.  `seen_twice` takes the mean of both, as is usual for networks of keypoints.

LiteRT, of the network's own makers, takes 0.4 of the time of OpenCV 5 and gives the same to 0.001
pixels.
"""

import os
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.models import REMEDY, require_model
from gmrdata.values.errors import BadDetector
from gmrdata.values.transforms import about_z

CROP_PX = 256
CORNER_PX = 0.5
"""The network counts from the corner of the crop's first pixel, as we do in the picture, OpenCV
from its middle [px]."""
LANDMARKS = (
    "nose", "left_eye_inner", "left_eye", "left_eye_outer", "right_eye_inner", "right_eye",
    "right_eye_outer", "left_ear", "right_ear", "mouth_left", "mouth_right",
    "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
    "left_pinky", "right_pinky", "left_index", "right_index", "left_thumb", "right_thumb",
    "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
    "left_heel", "right_heel", "left_foot_index", "right_foot_index",
)  # fmt: skip
"""The body's landmarks in the network's order."""
N_LANDMARKS = len(LANDMARKS)
TRUNK = tuple(LANDMARKS.index(f"{side}_{part}") for part in ("shoulder", "hip")
              for side in ("left", "right"))  # fmt: skip
LIMBS = (*TRUNK, *(LANDMARKS.index(f"{side}_{part}") for part in ("elbow", "wrist", "knee", "ankle")
                   for side in ("left", "right")))  # fmt: skip
MIRRORED_LANDMARKS = tuple(
    LANDMARKS.index(
        name.replace("left", "*").replace("right", "left").replace("*", "right")
        if "left" in name or "right" in name
        else name
    )
    for name in LANDMARKS
)
"""Index of each landmark's counterpart on the other side of the body."""
HIP_CENTRE, UPRIGHT = 33, 34  # Two more: the middle of the hips, and half a person above it
CROP_MARGIN = 1.25  # A crop is larger than the person by this
OUTPUT_SIZES = {"landmarks": 39 * 5, "score": 1, "mask": CROP_PX * CROP_PX, "world": 39 * 3}
"""Numbers in each output, by which they are told apart."""


@dataclass(frozen=True, eq=False)
class Square:
    """A square of the picture in which a person is looked for."""

    centre_px: np.ndarray  # (2,) in the picture [px]
    side_px: float
    turn_rad: float = 0.0  # Turn of the person's upright against the picture's, clockwise [rad]

    @property
    def as_array(self) -> np.ndarray:
        """(4,) centre x and y, side [px], turn [rad]."""
        return np.array([*self.centre_px, self.side_px, self.turn_rad])

    @property
    def crop_from_image(self) -> np.ndarray:
        """(2, 3) from points of the picture to points of the network's input [px]."""
        cos, sin = np.cos(self.turn_rad), np.sin(self.turn_rad)
        linear = np.array([[cos, sin], [-sin, cos]]) * CROP_PX / self.side_px
        return np.c_[linear, CROP_PX / 2 - linear @ self.centre_px]


@dataclass(frozen=True, eq=False)
class PersonInCrop:
    """What the network says of one crop."""

    score: float  # From 0 to 1: that there is a person
    mask: np.ndarray  # (H, W) uint8, 255 on the person
    box_px: np.ndarray  # (4,) left, top, right, bottom of the mask; all 0 where it is empty [px]
    next_crop: Square
    image_px: np.ndarray  # (33, 2) the body's landmarks in the picture [px]
    world_m: np.ndarray  # (33, 3) the same in metres from the middle of the hips, camera's axes
    visibility: np.ndarray  # (33,) from 0 to 1


LandmarkNetwork = Callable[[np.ndarray, Square], PersonInCrop]


def crop_around(box_px: np.ndarray) -> Square:
    """The upright crop around a person's box (4,) [px]."""
    low, high = box_px[:2], box_px[2:]
    return Square((low + high) / 2, CROP_MARGIN * float((high - low).max()))


def open_landmark_network(model_path: Path) -> LandmarkNetwork:
    """A function from a BGR picture (H, W, 3) and a crop of it to what the network says.
    MissingInput where there is no file; BadDetector for one that is no such TFLite network."""
    net = _open(model_path)

    def look(image: np.ndarray, crop: Square) -> PersonInCrop:
        outputs = _outputs(net, _square(image, crop), model_path)
        return _person(outputs, crop, image.shape[1::-1])

    _outputs(net, np.zeros((CROP_PX, CROP_PX, 3), np.uint8), model_path)
    return look


def look_mirrored(look: LandmarkNetwork, image: np.ndarray, crop: Square) -> PersonInCrop:
    """What the network says of a crop's mirror image; landmarks are mirrored back."""
    centre_px = np.array([image.shape[1] - 1 - crop.centre_px[0], crop.centre_px[1]])
    mirror = Square(centre_px, crop.side_px, -crop.turn_rad)
    other = look(np.ascontiguousarray(image[:, ::-1]), mirror)
    sides = list(MIRRORED_LANDMARKS)
    image_px, world_m = other.image_px[sides], other.world_m[sides] * (-1.0, 1.0, 1.0)
    image_px[:, 0] = image.shape[1] - image_px[:, 0]
    visibility = other.visibility[sides]
    return replace(other, image_px=image_px, world_m=world_m, visibility=visibility)


def seen_twice(person: PersonInCrop, other: PersonInCrop, least_score: float) -> PersonInCrop:
    """The person of a crop, whose landmarks are the mean of that look and of `look_mirrored`; as it
    is where that one sees nobody, or a body that faces the other way."""
    faces_alike = to_the_left(other.world_m) @ to_the_left(person.world_m) > 0
    if not faces_alike or other.score < least_score:
        return person
    return replace(
        person,
        image_px=(person.image_px + other.image_px) / 2,
        world_m=(person.world_m + other.world_m) / 2,
        visibility=(person.visibility + other.visibility) / 2,
    )


def to_the_left(world_m: np.ndarray) -> np.ndarray:
    """(..., 3) from the right side of the trunk to the left, of landmarks (..., 33, 3) [m]."""
    left_m, right_m = (world_m[..., list(side), :].sum(-2) for side in (TRUNK[::2], TRUNK[1::2]))
    return np.asarray(left_m - right_m)


LandmarkFeatures = Callable[[np.ndarray, Square], np.ndarray]
FEATURE_LAYER = re.compile(r"/re_lu_(\d+)/Relu6;[^;]*/add_")
FEATURE_SHAPES = (1, 2, 2, 192), (1, 2, 2, 288)
"""The last layer before landmarks and score part, by its name, of lite, and of full and heavy."""


def open_landmark_features(model_path: Path) -> LandmarkFeatures:
    """A function from a BGR picture (H, W, 3) and a crop of it to what the network has seen before
    it answers: (1152,) numbers of heavy, 288 channels at 2 x 2 places.  Errors as in
    `open_landmark_network`."""
    net = _open(model_path, all_layers=True)
    fitting = [one for one in net.get_tensor_details() if tuple(one["shape"]) in FEATURE_SHAPES]
    named = [(FEATURE_LAYER.search(one["name"]), one["index"]) for one in fitting]
    numbered = [(int(match[1]), index) for match, index in named if match]
    if not numbered:
        raise BadDetector(f"{model_path}: not BlazePose GHUM: no such layer; {REMEDY}")
    _, index = max(numbered)

    def look(image: np.ndarray, crop: Square) -> np.ndarray:
        _run(net, _square(image, crop), model_path)
        return np.moveaxis(net.get_tensor(index), 3, 1).astype(np.float32).ravel()

    look(np.zeros((CROP_PX, CROP_PX, 3), np.uint8), Square(np.full(2, CROP_PX / 2), CROP_PX))
    return look


def _open(model_path: Path, *, all_layers: bool = False) -> Any:
    from ai_edge_litert.interpreter import Interpreter

    content = require_model(model_path).read_bytes()
    try:
        # Only what is given as bytes is verified before it is read.  One thread: beside it others
        # look at the mirror image, and for people in the next frames.
        with _in_silence():
            net = Interpreter(
                model_content=content, num_threads=1, experimental_preserve_all_tensors=all_layers
            )
            net.allocate_tensors()
    except (ValueError, RuntimeError, MemoryError):
        fault = "truncated, or not a TFLite file that LiteRT can open"
        raise BadDetector(f"{model_path}: {fault}; {REMEDY} anew with --redo") from None
    return net


@contextmanager
def _in_silence() -> Iterator[None]:
    """LiteRT says on stderr which kernels it takes, and has no switch for it."""
    kept = os.dup(2)
    try:
        with Path(os.devnull).open("wb") as nowhere, warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            os.dup2(nowhere.fileno(), 2)
            yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _square(image: np.ndarray, crop: Square) -> np.ndarray:
    """The crop of a BGR picture (H, W, 3) as the network wants it (256, 256, 3)."""
    import cv2

    return np.asarray(cv2.warpAffine(image, crop.crop_from_image, (CROP_PX, CROP_PX)))


def _run(net: Any, square: np.ndarray, model_path: Path) -> None:
    """Show the network a BGR crop (256, 256, 3)."""
    try:
        rgb = square[None, ..., ::-1].astype(np.float32) / 255
        net.set_tensor(net.get_input_details()[0]["index"], rgb)
        net.invoke()
    except (ValueError, RuntimeError, MemoryError) as error:
        fault = f"LiteRT can't run it ({' '.join(str(error).split()) or type(error).__name__})"
        raise BadDetector(f"{model_path}: not BlazePose GHUM: {fault}; {REMEDY}") from None


def _outputs(net: Any, square: np.ndarray, model_path: Path) -> dict[str, np.ndarray]:
    """The outputs by name, for a BGR crop (256, 256, 3)."""
    _run(net, square, model_path)
    tensors = [net.get_tensor(one["index"]).ravel() for one in net.get_output_details()]
    by_size = {tensor.size: tensor for tensor in tensors}
    if set(OUTPUT_SIZES.values()) - set(by_size):
        what = f"its outputs have {sorted(by_size)} numbers, not {sorted(OUTPUT_SIZES.values())}"
        raise BadDetector(f"{model_path}: not BlazePose GHUM: {what}; {REMEDY}")
    return {name: by_size[size] for name, size in OUTPUT_SIZES.items()}


def _person(outputs: dict[str, np.ndarray], crop: Square, size_px: tuple[int, ...]) -> PersonInCrop:
    import cv2

    image_from_crop = cv2.invertAffineTransform(crop.crop_from_image)
    landmarks = outputs["landmarks"].reshape(39, 5).astype(np.float64)
    seen_px = (landmarks[:, :2] - CORNER_PX) @ image_from_crop[:, :2].T + image_from_crop[:, 2]
    hips_px, up_px = seen_px[HIP_CENTRE], seen_px[UPRIGHT] - seen_px[HIP_CENTRE]
    logits = outputs["mask"].reshape(CROP_PX, CROP_PX)
    # Outside of the crop nobody was looked for.
    whole = cv2.warpAffine(logits, image_from_crop, size_px, borderValue=(-1.0,))
    mask = np.where(whole > 0, np.uint8(255), np.uint8(0))
    left, top, width, height = cv2.boundingRect(mask)
    return PersonInCrop(
        score=float(outputs["score"][0]),
        mask=mask,
        box_px=np.array([left, top, left + width, top + height], dtype=np.float64),
        next_crop=Square(
            centre_px=hips_px,
            side_px=max(1.0, 2 * CROP_MARGIN * float(np.linalg.norm(up_px))),
            turn_rad=float(np.arctan2(up_px[0], -up_px[1])),
        ),
        image_px=seen_px[:N_LANDMARKS] + CORNER_PX,
        world_m=outputs["world"].reshape(39, 3)[:N_LANDMARKS] @ about_z(crop.turn_rad).T,
        visibility=1 / (1 + np.exp(-landmarks[:N_LANDMARKS, 3])),
    )
