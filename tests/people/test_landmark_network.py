"""The landmark network's real weights and broken ones."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import flatbuffers
import numpy as np
import pytest

from gmrdata.people.landmark_network import (
    CROP_PX,
    LIMBS,
    MIRRORED_LANDMARKS,
    LandmarkNetwork,
    PersonInCrop,
    Square,
    _person,
    crop_around,
    look_mirrored,
    open_landmark_network,
    seen_twice,
)
from gmrdata.read.frames import read_color
from gmrdata.values.errors import BadDetector, MissingInput


def another_network() -> bytes:
    """A TFLite file that only passes 256 x 256 pixels through a ReLU, from TFLite's schema."""
    builder = flatbuffers.Builder(0)

    def vector(items: Sequence[int], tables: bool = False) -> int:
        builder.StartVector(4, len(items), 4)
        for item in reversed(items):
            builder.PrependUOffsetTRelative(item) if tables else builder.PrependInt32(item)
        return int(builder.EndVector())

    def table(n_fields: int, **slots: tuple[str, int]) -> int:
        builder.StartObject(n_fields)
        for slot, (kind, value) in slots.items():
            getattr(builder, f"Prepend{kind}Slot")(int(slot[1:]), value, 0)
        return int(builder.EndObject())

    def tensor(name: str) -> int:
        text, shape = builder.CreateString(name), vector([1, 256, 256, 3])
        return table(8, _0=("UOffsetTRelative", shape), _3=("UOffsetTRelative", text))

    tensors = vector([tensor("in"), tensor("out")], tables=True)
    ends = [vector([0]), vector([1])]
    relu = vector([table(4, _0=("Int8", 19), _2=("Int32", 1), _3=("Int32", 19))], tables=True)
    linked = {f"_{n + 1}": ("UOffsetTRelative", end) for n, end in enumerate(ends)}
    operators = vector([table(9, **linked)], tables=True)
    graph = table(5, _0=("UOffsetTRelative", tensors), **linked, _3=("UOffsetTRelative", operators))
    graphs, buffers = vector([graph], tables=True), vector([table(1)], tables=True)
    model = table(
        8,
        _0=("Uint32", 3),
        _1=("UOffsetTRelative", relu),
        _2=("UOffsetTRelative", graphs),
        _4=("UOffsetTRelative", buffers),
    )
    builder.Finish(model, file_identifier=b"TFL3")
    return bytes(builder.Output())


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        (lambda whole: b"", "truncated, or not a TFLite file"),
        (lambda whole: whole[: len(whole) // 2], "truncated, or not a TFLite file"),
        (lambda whole: whole[:-1000], "truncated, or not a TFLite file"),
        (lambda whole: b"<html>404</html>" * 9, "truncated, or not a TFLite file"),
        (lambda whole: another_network(), r"not BlazePose GHUM: its outputs have \[196608\]"),
    ],
)
def test_a_broken_file_and_another_network_are_told(broken, said, pose_landmarks, tmp_path):
    model = tmp_path / "mine.tflite"
    model.write_bytes(broken(pose_landmarks.read_bytes()))
    with pytest.raises(BadDetector, match=rf"mine\.tflite: {said}.*`gmrdata fetch models` gets it"):
        open_landmark_network(model)


def test_a_missing_file_is_named_with_the_command(tmp_path):
    with pytest.raises(MissingInput, match=r"no\.tflite: .* `gmrdata fetch models` gets it"):
        open_landmark_network(tmp_path / "no.tflite")


def test_a_person_in_a_picture_on_its_side_has_the_same_outline(pose_landmarks, shared_path):
    """The crop that the landmarks give is turned as the person is, so it has the same content."""
    look = open_landmark_network(pose_landmarks)
    image = read_color(shared_path("video/static_people/00001.jpg"))
    person = look(image, crop_around(np.array([545.0, 87.0, 668.0, 372.0])))
    x_px, y_px = person.next_crop.centre_px
    assert abs(person.next_crop.turn_rad) < 0.2 and 545 < x_px < 668 and 87 < y_px < 372
    quarter = Square(
        np.array([image.shape[0] - y_px, x_px]),
        person.next_crop.side_px,
        person.next_crop.turn_rad + np.pi / 2,
    )
    upright = look(image, person.next_crop)
    lying = look(cv2.rotate(image, cv2.ROTATE_90_CLOCKWISE), quarter)
    assert min(upright.score, lying.score) > 0.99
    back = cv2.rotate(lying.mask, cv2.ROTATE_90_COUNTERCLOCKWISE)
    assert (upright.mask & back).sum() > 0.98 * (upright.mask | back).sum()
    turned_rad = lying.next_crop.turn_rad - upright.next_crop.turn_rad
    np.testing.assert_allclose(turned_rad, np.pi / 2, atol=0.02)
    np.testing.assert_allclose(upright.box_px, [545, 87, 668, 372], atol=15)


def mirrored(image: np.ndarray, crop: Square) -> tuple[np.ndarray, Square]:
    centre_px = np.array([image.shape[1] - 1 - crop.centre_px[0], crop.centre_px[1]])
    return np.ascontiguousarray(image[:, ::-1]), Square(centre_px, crop.side_px, -crop.turn_rad)


@pytest.fixture
def seen(pose_landmarks, shared_path):
    """The network, a picture, and a crop of the person in it."""
    look = open_landmark_network(pose_landmarks)
    image = read_color(shared_path("video/static_people/00001.jpg"))
    return look, image, look(image, crop_around(np.array([545.0, 87.0, 668.0, 372.0]))).next_crop


def twice(look: LandmarkNetwork, image: np.ndarray, crop: Square) -> PersonInCrop:
    return seen_twice(look(image, crop), look_mirrored(look, image, crop), 0.5)


def test_a_person_seen_twice_is_the_mirror_image_of_one_who_is_mirrored(seen):
    look, image, crop = seen
    person = twice(look, image, crop)
    other_image, other_crop = mirrored(image, crop)
    other = twice(look, other_image, other_crop)
    sides = list(MIRRORED_LANDMARKS)
    back_px = np.array([image.shape[1], 0]) + other.image_px[sides] * (-1, 1)
    np.testing.assert_allclose(back_px, person.image_px, atol=1e-6)
    np.testing.assert_allclose(other.world_m[sides] * (-1, 1, 1), person.world_m, atol=1e-9)
    np.testing.assert_allclose(other.visibility[sides], person.visibility, atol=1e-9)
    # One look is not: the network errs otherwise of the mirror image.
    assert np.linalg.norm(look(image, crop).world_m - person.world_m, axis=1).max() > 0.01


def test_landmarks_count_from_the_corner_of_a_pixel(seen, shared_path):
    """They lay half a pixel of the network's too far to the right, in mirror images as well."""
    look, _, crop = seen
    apart = []
    for number in range(3, 27, 2):
        image = read_color(shared_path(f"video/static_people/{number:05}.jpg"))
        once, other = look(image, crop), look(*mirrored(image, crop))
        back_px = image.shape[1] - other.image_px[list(MIRRORED_LANDMARKS), 0]
        apart.append((once.image_px[:, 0] - back_px)[list(LIMBS)] * CROP_PX / crop.side_px)
        crop = once.next_crop
    assert abs(np.mean(apart)) < 0.5


@pytest.mark.parametrize("turn_rad", [0.0, 0.7])
@pytest.mark.parametrize("side_px", [256.0, 768.0])
def test_landmarks_of_the_picture_count_from_its_corner(turn_rad, side_px):
    """As the lens does: what lies on a pixel's middle lay half a pixel up and left of it."""
    at_px = np.random.default_rng(0).uniform(200, 500, (39, 2))  # from the picture's corner
    crop = Square(np.array([350.0, 340.0]), side_px, turn_rad)
    # Both OpenCV's from middles of pixels to such, and the network's from the corner of its own.
    in_crop_px = (at_px - 0.5) @ crop.crop_from_image[:, :2].T + crop.crop_from_image[:, 2] + 0.5
    outputs = {
        "landmarks": np.c_[in_crop_px, np.zeros((39, 3))].ravel(),
        "score": np.ones(1),
        "mask": np.ones(CROP_PX * CROP_PX, np.float32),
        "world": np.zeros(39 * 3),
    }
    person = _person(outputs, crop, (640, 480))
    np.testing.assert_allclose(person.image_px, at_px[:33], atol=1e-9)


@pytest.mark.parametrize(
    ("changed", "is_mean"),
    [({}, True), ({"score": 0.4}, False), ({"world_m": None}, False)],
)
def test_a_mirror_image_in_which_nobody_is_or_who_faces_the_other_way_tells_nothing(
    seen, changed, is_mean
):
    look, image, crop = seen
    person, other = look(image, crop), look_mirrored(look, image, crop)
    if "world_m" in changed:  # left and right exchanged
        changed = {"world_m": other.world_m[list(MIRRORED_LANDMARKS)]}
    found = seen_twice(person, replace(other, **changed), 0.5)
    assert (found is person) is not is_mean
