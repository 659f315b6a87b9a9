"""The sizes that an ONNX file says, checked before OpenCV makes arrays of them.

Layout: onnx.proto, messages TensorProto, NodeProto and ValueInfoProto.
"""

from collections.abc import Iterator
from math import prod
from pathlib import Path
from typing import Any

from gmrdata.values.errors import BadDetector
from gmrdata.values.limits import MOST_NETWORK_NUMBERS

_FIELDS = ("float_data", "int32_data", "int64_data", "double_data", "uint64_data", "string_data")


def check_sizes(path: Path) -> None:
    """BadDetector for weights that aren't in the file in the number that it says, and for a node
    whose output is an array of more numbers than any network's that we run."""
    from onnx import ModelProto

    model = ModelProto.FromString(path.read_bytes())
    for tensor in _tensors(model.graph):
        said, held = prod(tensor.dims), _numbers_held(tensor)
        if min(tensor.dims, default=0) < 0 or said > held:
            fault = f"its weights {tensor.name!r} should be {said} numbers, and {held} are there"
            raise BadDetector(f"{path}: {fault}; fetch or export the model again")
    for name, shape in _inferred(path, model):
        if (count := prod(shape)) > MOST_NETWORK_NUMBERS:
            fault = f"{name!r} would have {count} numbers, and {MOST_NETWORK_NUMBERS} are the most"
            raise BadDetector(f"{path}: {fault}; export a smaller model")


def _tensors(graph: Any) -> Iterator[Any]:
    """Every array that stands in a graph: its weights, and the constants of its nodes."""
    yield from graph.initializer
    for node in graph.node:
        for attribute in node.attribute:
            yield from (attribute.t, *attribute.tensors) if attribute.HasField("t") else ()


def _numbers_held(tensor: Any) -> int:
    from onnx.helper import tensor_dtype_to_np_dtype

    if not tensor.raw_data:
        return max(len(getattr(tensor, field)) for field in _FIELDS)
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
        fault = f"its sizes don't fit together ({str(error).splitlines()[0][:200]})"
        raise BadDetector(f"{path}: {fault}; fetch or export the model again") from None
    named = (*graph.input, *graph.value_info, *graph.output)
    return [
        (value.name, [max(1, size.dim_value) for size in value.type.tensor_type.shape.dim])
        for value in named
    ]
