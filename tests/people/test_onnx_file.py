"""Reading the inputs of ONNX files: real ones, small ones, and bytes that are none."""

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gmrdata.people.onnx import OnnxInput, read_inputs
from gmrdata.values.errors import BadDetector, MissingInput

IN_ONE_FOLDER = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)


def test_the_real_weights_want_a_square_of_416_px(yolox_nano: Path) -> None:
    assert read_inputs(yolox_nano) == [OnnxInput("images", (1, 3, 416, 416))]


@IN_ONE_FOLDER
@given(shape=st.lists(st.one_of(st.integers(1, 2**40), st.just("n")), max_size=6))
def test_shapes_come_back(
    shape: list[int | str], onnx_bytes: Callable[..., bytes], tmp_path: Path
) -> None:
    path = tmp_path / "net.onnx"
    path.write_bytes(onnx_bytes(("x", tuple(shape)), ("w", (3,)), weights=("w",)))
    expected = tuple(size if isinstance(size, int) else None for size in shape)
    assert read_inputs(path) == [OnnxInput("x", expected)]


def test_every_cut_of_a_file_is_told(onnx_bytes: Callable[..., bytes], tmp_path: Path) -> None:
    path = tmp_path / "net.onnx"
    whole = onnx_bytes(("x", (1, 3, 64, 64)))
    graph_end = len(whole) - 4  # the last four bytes are the operator set
    for size in range(graph_end):
        path.write_bytes(whole[:size])
        with pytest.raises(BadDetector, match=r"net\.onnx"):
            read_inputs(path)


@IN_ONE_FOLDER
@given(content=st.binary(max_size=200))
def test_noise_is_refused_or_has_no_crash(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "net.onnx"
    path.write_bytes(content)
    try:
        assert all(isinstance(known, OnnxInput) for known in read_inputs(path))
    except BadDetector as error:
        assert "net.onnx" in str(error)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(MissingInput, match=r"no\.onnx: no such model file"):
        read_inputs(tmp_path / "no.onnx")
