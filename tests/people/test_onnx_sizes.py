"""Networks that say absurd sizes are refused before OpenCV makes arrays of them."""

from pathlib import Path

import pytest
from onnx import ModelProto, TensorProto, helper

from gmrdata.people.onnx import OnnxConfig, check_sizes, open_detector
from gmrdata.read import models
from gmrdata.values.errors import BadDetector

FLOAT, INT64 = TensorProto.FLOAT, TensorProto.INT64


def network(side_px: int = 64, count: int = 1, dims: tuple[int, ...] = (1,)) -> ModelProto:
    """One that adds `count` zeros, and weights which say the sizes `dims`, to its picture."""
    nodes = [
        helper.make_node("ConstantOfShape", ["count"], ["zeros"]),
        helper.make_node("Add", ["x", "w"], ["sum"]),
        helper.make_node("Add", ["sum", "zeros"], ["out"]),
    ]
    weights = TensorProto(name="w", data_type=FLOAT, dims=dims, raw_data=bytes(4))
    graph = helper.make_graph(
        nodes,
        "g",
        [helper.make_tensor_value_info("x", FLOAT, (1, 3, side_px, side_px))],
        [helper.make_tensor_value_info("out", FLOAT, None)],
        [weights, helper.make_tensor("count", INT64, (1,), [count])],
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)])


@pytest.mark.parametrize(
    ("hostile", "said"),
    [
        (network(side_px=10**9), "wants pictures of 1000000000x1000000000 px"),
        (network(count=10**11), "'zeros' would have 100000000000 numbers"),
        (network(dims=(10**6, 10**6)), "'w' should be 1000000000000 numbers, and 1 are there"),
        (network(dims=(-1, -1)), "'w' should be"),
    ],
)
def test_absurd_sizes_are_refused(hostile: ModelProto, said: str, tmp_path: Path) -> None:
    path = tmp_path / "hostile.onnx"
    path.write_bytes(hostile.SerializeToString())
    with pytest.raises(BadDetector, match=rf"hostile\.onnx: .*{said}"):
        open_detector(path, OnnxConfig())


def test_plain_networks_are_not(yolox_nano: Path, tmp_path: Path) -> None:
    path = tmp_path / "plain.onnx"
    path.write_bytes(network().SerializeToString())
    for plain in (path, yolox_nano):
        check_sizes(plain)


def test_a_file_larger_than_any_network_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "huge.onnx"
    with path.open("wb") as file:
        file.truncate(models.MOST_NETWORK_BYTES + models.MIB)
    with pytest.raises(BadDetector, match="has 513 MiB, and 512 MiB are the most"):
        models.require_model(path)
