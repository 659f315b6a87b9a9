"""The landmark network's real weights and broken ones, and its landmarks on the body."""

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import flatbuffers
import numpy as np
import pytest
import torch

from gmrdata.motion.gait import make_gait
from gmrdata.people.landmark_network import (
    LANDMARKS,
    LEG_M,
    MIRRORED_LANDMARKS,
    Crop,
    crop_around,
    landmark_offsets_m,
    landmarks_on,
    open_landmark_network,
    tree_joints,
)
from gmrdata.read.frames import read_color
from gmrdata.values.body import JOINT, BodyModel, leg_length_m
from gmrdata.values.errors import BadDetector, MissingInput
from gmrdata.values.skinning import posed_joints_m


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
def test_a_broken_file_and_another_network_are_told(
    broken: Callable[[bytes], bytes], said: str, pose_landmarks: Path, tmp_path: Path
) -> None:
    model = tmp_path / "mine.tflite"
    model.write_bytes(broken(pose_landmarks.read_bytes()))
    with pytest.raises(BadDetector, match=rf"mine\.tflite: {said}.*`gmrdata fetch models` gets it"):
        open_landmark_network(model)


def test_a_missing_file_is_named_with_the_command(tmp_path: Path) -> None:
    with pytest.raises(MissingInput, match=r"no\.tflite: .* `gmrdata fetch models` gets it"):
        open_landmark_network(tmp_path / "no.tflite")


def test_a_person_in_a_picture_on_its_side_has_the_same_outline(
    pose_landmarks: Path, shared_path: Callable[[str], Path]
) -> None:
    """The crop that the landmarks give is turned as the person is, so it has the same content."""
    look = open_landmark_network(pose_landmarks)
    image = read_color(shared_path("video/static_people/00001.jpg"))
    person = look(image, crop_around(np.array([545.0, 87.0, 668.0, 372.0])))
    x_px, y_px = person.next_crop.centre_px
    assert abs(person.next_crop.turn_rad) < 0.2 and 545 < x_px < 668 and 87 < y_px < 372
    quarter = Crop(
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


def test_joints_are_those_of_the_body(anny: BodyModel) -> None:
    motion = make_gait("walk", 0.5, 10.0, anny, np.random.default_rng(0))
    rest_joints_m = anny.rest_joints_m(motion.shape)
    wanted, turned = posed_joints_m(rest_joints_m, motion.rotmats, np.zeros((motion.n_frames, 3)))
    found, rotmats = tree_joints(torch.as_tensor(rest_joints_m), torch.as_tensor(motion.rotmats))
    np.testing.assert_allclose(found.numpy(), wanted, atol=1e-9)
    np.testing.assert_allclose(rotmats.numpy(), turned, atol=1e-9)


def test_the_offsets_that_travel_have_two_like_sides() -> None:
    offsets_m = landmark_offsets_m()
    other_side_m = offsets_m[list(MIRRORED_LANDMARKS)] * [-1.0, 1.0, 1.0]
    np.testing.assert_allclose((offsets_m + other_side_m) / 2, offsets_m, atol=1e-4)
    assert [LANDMARKS[n] for n in MIRRORED_LANDMARKS[11:13]] == ["right_shoulder", "left_shoulder"]
    assert np.linalg.norm(offsets_m, axis=1).max() < 0.3


def test_landmarks_lie_where_anatomy_has_them(anny: BodyModel) -> None:
    """On a body in its rest pose: the nose in front of the head, ears beside it, heels behind."""
    rest_joints_m = anny.rest_joints_m(np.zeros(anny.n_shape))
    rotmats = torch.eye(3, dtype=torch.float64).expand(24, 3, 3)
    joints_m, turned = tree_joints(torch.as_tensor(rest_joints_m), rotmats)
    leg_m = torch.tensor(leg_length_m(rest_joints_m))
    found = landmarks_on(joints_m, turned, leg_m, torch.as_tensor(landmark_offsets_m())).numpy()
    at = dict(zip(LANDMARKS, found, strict=True))
    ankle_m = joints_m[JOINT["left_ankle"]].numpy()
    assert at["nose"][2] > at["left_ear"][2] + 0.05
    assert at["left_ear"][0] > 0.03 > -0.03 > at["right_ear"][0]
    assert at["left_heel"][2] < ankle_m[2] < at["left_foot_index"][2]
    assert at["left_hip"][0] > 0.05 and at["left_shoulder"][0] > at["left_hip"][0]


def test_offsets_grow_with_the_legs() -> None:
    joints_m, turned = torch.zeros(24, 3), torch.eye(3).expand(24, 3, 3)
    offsets_m = torch.ones(33, 3)
    found = landmarks_on(joints_m, turned, torch.tensor(1.5 * LEG_M), offsets_m)
    np.testing.assert_allclose(found.numpy(), 1.5, rtol=1e-6)
