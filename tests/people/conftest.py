"""Real frames, small ONNX files written byte by byte, and motions whose landmarks are known."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.motion.gait import make_gait
from gmrdata.people.following import Networks
from gmrdata.values.body import BodyModel
from gmrdata.values.motion import Motion

OnnxWriter = Callable[..., bytes]


@pytest.fixture(scope="session")
def dog_dir(shared_path: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
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
def standing_people(shared_path: Callable[[str], Path]) -> list[Path]:
    """Images of a real video of people who hardly move."""
    return sorted(shared_path("video/static_people").glob("*.jpg"))


@pytest.fixture(scope="session")
def networks(yolox_nano: Path, pose_landmarks: Path) -> Networks:
    """The two by which people are followed."""
    return Networks(yolox_nano, pose_landmarks)


@pytest.fixture
def grey_dir(tmp_path: Path) -> Path:
    """Two frames without anybody."""
    (tmp_path / "grey").mkdir()
    for n in range(2):
        cv2.imwrite(str(tmp_path / "grey" / f"{n}.png"), np.full((120, 160, 3), 90, np.uint8))
    return tmp_path / "grey"


@pytest.fixture(scope="session")
def onnx_bytes() -> OnnxWriter:
    """A writer of networks that only pass their input through a ReLU: onnx.proto3 by hand."""

    def write(
        *inputs: tuple[str, tuple[int | str, ...]],
        weights: tuple[str, ...] = (),
        operator: str = "Relu",
    ) -> bytes:
        node = _field(1, inputs[0][0].encode()) + _field(2, b"out") + _field(4, operator.encode())
        graph = _field(1, node) + _field(2, b"g")
        for name in weights:
            graph += _field(5, _number(2, 1) + _field(8, name.encode()))
        graph += b"".join(_field(11, _value(*named)) for named in inputs)
        graph += _field(12, _value("out", inputs[0][1]))
        return _number(1, 8) + _field(7, graph) + _field(8, _number(2, 13))

    return write


def _value(name: str, shape: tuple[int | str, ...]) -> bytes:
    sizes = b"".join(
        _field(1, _number(1, size) if isinstance(size, int) else _field(2, size.encode()))
        for size in shape
    )
    tensor = _number(1, 1) + _field(2, sizes)
    return _field(1, name.encode()) + _field(2, _field(1, tensor))


def _field(number: int, content: bytes) -> bytes:
    return _varint(number << 3 | 2) + _varint(len(content)) + content


def _number(number: int, value: int) -> bytes:
    return _varint(number << 3) + _varint(value)


def _varint(value: int) -> bytes:
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


@pytest.fixture
def noise_dir(tmp_path: Path) -> Path:
    """Three frames of noise, 64x48."""
    folder = tmp_path / "frames"
    folder.mkdir()
    rng = np.random.default_rng(0)
    for i in range(3):
        noise = rng.integers(0, 256, (48, 64, 3), dtype=np.uint8)
        cv2.imwrite(str(folder / f"{i:05d}.png"), noise)
    return folder


@pytest.fixture(scope="session")
def walk(anny: BodyModel) -> Motion:
    """Two seconds of somebody who walks, before a camera that stands 4 m away."""
    motion = make_gait("walk", 2.0, 15.0, anny, np.random.default_rng(1))
    # x right, y down, z forward: the camera looks along the world's y, 4 m from the middle.
    cam_from_world = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    middle_m = motion.pelvis_m.mean(0) - [0, 4.0, 0]
    return Motion(
        local_rotmats=motion.local_rotmats,
        root_rotmats=cam_from_world @ motion.root_rotmats,
        pelvis_m=(motion.pelvis_m - middle_m) @ cam_from_world.T,
        shape=motion.shape,
        fps_hz=motion.fps_hz,
        body=motion.body,
        gender=motion.gender,
        frame="camera",
        source=motion.source,
    )
