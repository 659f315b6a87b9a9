"""Real frames, small ONNX files, and motions whose landmarks are known."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from onnx import OperatorSetIdProto, TensorProto, helper

from gmrdata.motion.gait import make_gait
from gmrdata.people.following import Networks
from gmrdata.values.motion import Motion
from tests.filming import write_pictures

OnnxWriter = Callable[..., bytes]


@pytest.fixture(scope="session")
def dog_dir(shared_path, tmp_path_factory) -> Path:
    """The first four frames of a real video of a dog, half size."""
    folder = tmp_path_factory.mktemp("dog")
    video = cv2.VideoCapture(str(shared_path("video/dog.mp4")))
    for i in range(4):
        decoded, image = video.read()
        assert decoded
        half = cv2.resize(image, (640, 360), interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(folder / f"{i:05d}.png"), half)
    video.release()
    return folder


@pytest.fixture(scope="session")
def standing_people(shared_path) -> list[Path]:
    """Images of a real video of people who hardly move."""
    return sorted(shared_path("video/static_people").glob("*.jpg"))


@pytest.fixture(scope="session")
def networks(yolox_nano, pose_landmarks) -> Networks:
    """The two by which people are followed."""
    return Networks(yolox_nano, pose_landmarks)


@pytest.fixture
def grey_dir(tmp_path) -> Path:
    """Two frames without anybody."""
    write_pictures(tmp_path / "grey", [np.full((120, 160, 3), 90, np.uint8)] * 2)
    return tmp_path / "grey"


@pytest.fixture(scope="session")
def onnx_bytes() -> OnnxWriter:
    """A writer of networks that only pass their first input through a node."""

    def write(
        *inputs: tuple[str, tuple[int | str, ...]],
        weights: tuple[str, ...] = (),
        operator: str = "Relu",
    ) -> bytes:
        node = helper.make_node(operator, [inputs[0][0]], ["out"])
        values = [helper.make_tensor_value_info(name, 1, shape) for name, shape in inputs]
        out = helper.make_tensor_value_info("out", 1, inputs[0][1])
        tensors = [TensorProto(data_type=1, name=name) for name in weights]
        graph = helper.make_graph([node], "g", values, [out], tensors)
        version = OperatorSetIdProto(version=13)
        return bytes(helper.make_model(graph, opset_imports=[version]).SerializeToString())

    return write


@pytest.fixture
def noise_dir(tmp_path) -> Path:
    """Three frames of noise, 64x48."""
    noise = np.random.default_rng(0).integers(0, 256, (3, 48, 64, 3), dtype=np.uint8)
    write_pictures(tmp_path / "frames", noise)
    return tmp_path / "frames"


@pytest.fixture(scope="session")
def walk(anny) -> Motion:
    """Two seconds of somebody who walks, before a camera that stands 4 m away."""
    motion = make_gait("walk", 2.0, 15.0, anny, np.random.default_rng(1))
    # x right, y down, z forward: the camera looks along the world's y, 4 m from the middle.
    cam_from_world = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    middle_m = motion.pelvis_m.mean(0) - [0, 4.0, 0]
    return replace(
        motion,
        root_rotmats=cam_from_world @ motion.root_rotmats,
        pelvis_m=(motion.pelvis_m - middle_m) @ cam_from_world.T,
        frame="camera",
    )
