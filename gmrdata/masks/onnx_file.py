"""What an ONNX file says of its inputs: just enough of protobuf's wire format to read that.

OpenCV runs the network but doesn't tell the size of the picture that it wants.  Field numbers are
those of `onnx.proto3`; the wire format is https://protobuf.dev/programming-guides/encoding.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from gmrdata.errors import BadDetector, MissingInput

MODEL_GRAPH, GRAPH_INITIALIZER, GRAPH_INPUT = 7, 5, 11
TENSOR_NAME = 8
VALUE_NAME, VALUE_TYPE = 1, 2
TYPE_TENSOR, TENSOR_SHAPE, SHAPE_DIM, DIM_VALUE = 1, 2, 1, 1
VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5


@dataclass(frozen=True)
class OnnxInput:
    """One input of a network."""

    name: str
    """Its name."""
    shape: tuple[int | None, ...]
    """Its sizes; None where the file leaves one open."""


def read_inputs(path: Path) -> list[OnnxInput]:
    """The inputs that an ONNX file wants to be given; its weights are none.

    Raises:
        MissingInput: there is no such file.
        BadDetector: empty, truncated, or not ONNX.
    """
    if not path.is_file():
        raise MissingInput(f"{path}: no such model file")
    content = memoryview(path.read_bytes())
    if not content:
        raise BadDetector(f"{path}: empty file (0 bytes); fetch the model again")
    try:
        graphs = _messages(content, MODEL_GRAPH)
        inputs = [_input(message) for graph in graphs for message in _messages(graph, GRAPH_INPUT)]
        weights = {
            name.tobytes().decode()
            for graph in graphs
            for tensor in _messages(graph, GRAPH_INITIALIZER)
            for name in _messages(tensor, TENSOR_NAME)
        }
    except ValueError as error:
        raise BadDetector(
            f"{path}: truncated, or not an ONNX file ({error}); fetch the model again"
        ) from None
    if not inputs:
        raise BadDetector(f"{path}: not an ONNX file: it has no graph with inputs")
    return [known for known in inputs if known.name not in weights]


def _input(message: memoryview) -> OnnxInput:
    name = b"".join(bytes(part) for part in _messages(message, VALUE_NAME)).decode()
    shape: list[int | None] = []
    for kind in _messages(message, VALUE_TYPE):
        for tensor in _messages(kind, TYPE_TENSOR):
            for sizes in _messages(tensor, TENSOR_SHAPE):
                for size in _messages(sizes, SHAPE_DIM):
                    found = [v for n, v in _fields(size) if n == DIM_VALUE and isinstance(v, int)]
                    shape.append(found[-1] if found and found[-1] > 0 else None)
    return OnnxInput(name, tuple(shape))


def _messages(message: memoryview, wanted: int) -> list[memoryview]:
    """The byte fields of one number in a message."""
    return [v for number, v in _fields(message) if number == wanted and not isinstance(v, int)]


def _fields(message: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """(field number, value) of a message: an int for a varint, else the bytes.

    Raises:
        ValueError: the bytes are no message.
    """
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        number, wire_type = key >> 3, key & 7
        if number == 0:
            raise ValueError(f"no field has the number 0, at byte {at}")
        if wire_type == VARINT:
            value, at = _varint(message, at)
            yield number, value
            continue
        if wire_type == BYTES:
            size, at = _varint(message, at)
        elif wire_type in (FIXED64, FIXED32):
            size = 8 if wire_type == FIXED64 else 4
        else:
            raise ValueError(f"wire type {wire_type} at byte {at}")
        if at + size > len(message):
            raise ValueError(f"{at + size - len(message)} bytes are missing")
        yield number, message[at : at + size]
        at += size


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    """A base-128 number, least significant group first, and where it ends."""
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(message):
            raise ValueError("it ends within a number")
        byte = message[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
    raise ValueError(f"a number of more than 64 bits before byte {at}")
