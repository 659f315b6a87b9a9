"""The ONNX detector on real weights and frames, and on broken or hostile models and images."""

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest.mock import Mock

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from onnx import ModelProto, TensorProto, helper

from gmrdata.people import onnx
from gmrdata.people.onnx import (
    DETECTIONS_FILE,
    OnnxConfig,
    OnnxInput,
    check_sizes,
    onnx_masks,
    open_detector,
    read_inputs,
)
from gmrdata.people.yolox import COCO_NAMES, letterbox
from gmrdata.read import models
from gmrdata.read.frames import read_color, read_frames, read_gray
from gmrdata.values.errors import BadDetector, BadFrames, MissingInput, StaleOutput
from tests.folders import bytes_of

FLOAT, INT64 = TensorProto.FLOAT, TensorProto.INT64
IN_ONE_FOLDER = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture
def threads() -> Iterator[Callable[[int], None]]:
    before = cv2.getNumThreads()
    yield cv2.setNumThreads
    cv2.setNumThreads(before)


@pytest.fixture
def model(tmp_path) -> Path:
    """Where a test puts a network."""
    return tmp_path / "net.onnx"


def best_dog_read_directly(model: Path, image: np.ndarray) -> tuple[list[float], float]:
    """The surest dog, straight from YOLOX's definition, one number at a time."""
    height, width = image.shape[:2]
    ratio = min(416 / width, 416 / height)
    reduced_width, reduced_height = int(width * ratio), int(height * ratio)
    canvas = np.full((416, 416, 3), 114, np.uint8)
    canvas[:reduced_height, :reduced_width] = cv2.resize(image, (reduced_width, reduced_height))
    net = cv2.dnn.readNetFromONNX(str(model))
    net.setInput(cv2.dnn.blobFromImage(canvas))
    answer = net.forward()[0]
    dog = answer[:, 4] * answer[:, 5 + 16]
    row = int(dog.argmax())
    stride, at = next(
        (s, row - before)
        for s, before in ((8, 0), (16, 52 * 52), (32, 52 * 52 + 26 * 26))
        if row - before < (416 // s) ** 2
    )
    x = (answer[row, 0] + at % (416 // stride)) * stride
    y = (answer[row, 1] + at // (416 // stride)) * stride
    w, h = np.exp(answer[row, 2]) * stride, np.exp(answer[row, 3]) * stride
    to_x, to_y = width / reduced_width, height / reduced_height
    box = [(x - w / 2) * to_x, (y - h / 2) * to_y, (x + w / 2) * to_x, (y + h / 2) * to_y]
    return box, float(dog[row])


def test_the_dog_is_where_a_direct_reading_finds_it(yolox_nano, dog_dir):
    image = read_color(dog_dir / "00003.png")
    found = open_detector(yolox_nano, OnnxConfig(classes=("dog",)))(image)
    box_px, score = best_dog_read_directly(yolox_nano, image)
    best = int(found.scores.argmax())
    assert score > 0.5
    np.testing.assert_allclose(found.scores[best], score, rtol=1e-6)
    np.testing.assert_allclose(found.boxes_px[best], box_px, atol=1e-3)
    assert COCO_NAMES[found.classes[best]] == "dog"


def test_masks_cover_the_dog_in_every_frame(yolox_nano, dog_dir, tmp_path):
    out_dir = onnx_masks(yolox_nano, read_frames(dog_dir), tmp_path / "masks", OnnxConfig())
    record = json.loads((out_dir / DETECTIONS_FILE).read_text())["frames"]
    for path in sorted(dog_dir.glob("*.png")):
        mask = read_gray(out_dir / path.name, (640, 360))
        assert set(np.unique(mask)) == {0, 255}
        # The dog is the dark part of the middle of these frames: black fur on green grass.
        dark = read_color(path).max(axis=2) < 60
        dark[:, :270] = dark[:, 400:] = False
        assert dark.sum() > 1000
        assert (mask[dark] == 255).mean() > 0.99
        assert 0.02 < (mask == 255).mean() < 0.3
    # The first frame's dog is weak on its own; the track keeps it.
    assert max(box["score"] for box in record["00000"]["found"]) < OnnxConfig().min_score
    assert record["00000"]["masked"]


def test_two_runs_and_two_thread_counts_give_the_same_bytes(yolox_nano, dog_dir, tmp_path, threads):
    made = []
    for run, count in enumerate((1, 1, 2)):
        threads(count)
        out_dir = onnx_masks(yolox_nano, read_frames(dog_dir), tmp_path / str(run), OnnxConfig())
        made.append(bytes_of(out_dir))
    assert len(made[0]) == 5
    assert made[0] == made[1] == made[2]


def test_a_second_input_size_only_adds(yolox_nano, dog_dir):
    image = read_color(dog_dir / "00003.png")
    sizes_px = ((416, 416), (640, 384))
    one = open_detector(yolox_nano, OnnxConfig(classes=("dog",)))(image)
    both = open_detector(yolox_nano, OnnxConfig(classes=("dog",), input_sizes_px=sizes_px))(image)
    assert both.scores.max() >= one.scores.max()
    alone = open_detector(yolox_nano, OnnxConfig(classes=("dog",), input_sizes_px=sizes_px[1:]))
    top = alone(image)
    x0, y0, x1, y1 = one.boxes_px[one.scores.argmax()]
    np.testing.assert_allclose(
        top.boxes_px[top.scores.argmax()], [x0, y0, x1, y1], atol=0.2 * (y1 - y0)
    )


def test_a_stopped_run_goes_on_at_the_next_frame(yolox_nano, dog_dir, tmp_path, monkeypatch):
    seen: list[int] = []

    def stopping(limit: int) -> Callable[..., onnx.Detector]:
        def open_stopping(model_path: Path, config: OnnxConfig) -> onnx.Detector:
            detect = open_detector(model_path, config)

            def counted(image: np.ndarray) -> onnx.Detections:
                if len(seen) == limit:
                    raise KeyboardInterrupt
                seen.append(1)
                return detect(image)

            return counted

        return open_stopping

    whole = onnx_masks(yolox_nano, read_frames(dog_dir), tmp_path / "whole", OnnxConfig())
    monkeypatch.setattr(onnx, "open_detector", stopping(2))
    with pytest.raises(KeyboardInterrupt):
        onnx_masks(yolox_nano, read_frames(dog_dir), tmp_path / "out", OnnxConfig())
    assert not (tmp_path / "out").exists()
    monkeypatch.setattr(onnx, "open_detector", stopping(4))
    resumed = onnx_masks(yolox_nano, read_frames(dog_dir), tmp_path / "out", OnnxConfig())
    assert len(seen) == 4
    names = sorted(p.name for p in whole.iterdir() if p.name != "stage.json")
    assert names == sorted(p.name for p in resumed.iterdir() if p.name != "stage.json")
    assert all((whole / n).read_bytes() == (resumed / n).read_bytes() for n in names)


def test_another_model_or_recipe_asks_for_redo(yolox_nano, dog_dir, tmp_path):
    small = tmp_path / "frames"
    small.mkdir()
    for name in ("00000.png", "00001.png"):
        shutil.copy(dog_dir / name, small)
    model = tmp_path / "moved.onnx"
    shutil.copy(yolox_nano, model)
    onnx_masks(yolox_nano, read_frames(small), tmp_path / "out", OnnxConfig())
    onnx_masks(
        model, read_frames(small), tmp_path / "out", OnnxConfig()
    )  # the same bytes elsewhere
    with pytest.raises(StaleOutput, match="config.min_score"):
        onnx_masks(model, read_frames(small), tmp_path / "out", OnnxConfig(min_score=0.9))
    shutil.copy(dog_dir / "00002.png", small)
    with pytest.raises(StaleOutput, match="inputs.left out 2"):
        onnx_masks(model, read_frames(small, {2}), tmp_path / "out", OnnxConfig())
    with model.open("ab") as stream:
        stream.write(b"\x00")
    with pytest.raises(StaleOutput, match="inputs.model"):
        onnx_masks(model, read_frames(small), tmp_path / "out", OnnxConfig())


@pytest.mark.parametrize(
    ("cut", "said"),
    [
        (lambda b: b"", "empty file"),
        (lambda b: b[: len(b) // 2], "truncated, or not an ONNX file"),
        (lambda b: b[:-1000], "truncated, or not an ONNX file|can't open this network"),
        (lambda b: b"<html>404</html>" * 9, "not an ONNX file"),
        (lambda b: b"\x80\x04\x95" + b[:999], "not an ONNX file"),
    ],
)
def test_a_broken_model_is_told(cut, said, yolox_nano, noise_dir, model):
    model.write_bytes(cut(yolox_nano.read_bytes()))
    with pytest.raises(BadDetector, match=said) as caught:
        onnx_masks(model, read_frames(noise_dir), model.with_name("out"), OnnxConfig())
    assert "net.onnx" in str(caught.value)
    assert not model.with_name("out").exists()


@pytest.mark.parametrize(
    ("inputs", "operator", "said"),
    [
        ([("x", (1, 3, 64, 64))], "Relu", r"its output has the shape \(1, 3, 64, 64\), but YOLOX"),
        ([("x", (1, 1, 28, 28))], "Relu", r"it should have one input .* has x \(1, 1, 28, 28\)"),
        ([("x", (1, 80))], "Relu", r"has x \(1, 80\)"),
        ([("x", (1, 3, 64, 64)), ("y", (1, 4))], "Relu", r"has x .*, y \(1, 4\)"),
        ([("x", (1, 3, "h", "w"))], "Relu", "leaves its input's size open; give input_sizes_px"),
        ([("x", (1, 3, 64, 64))], "NoSuchOperator", "OpenCV can't (open|run) this network"),
    ],
)
def test_a_network_of_another_layout_is_told(inputs, operator, said, onnx_bytes, noise_dir, model):
    model.write_bytes(onnx_bytes(*inputs, operator=operator))
    with pytest.raises(BadDetector, match=said):
        onnx_masks(model, read_frames(noise_dir), model.with_name("out"), OnnxConfig())


def test_a_missing_model_is_named(noise_dir, model):
    with pytest.raises(MissingInput, match=r"net\.onnx: no such model file"):
        read_inputs(model)
    with pytest.raises(MissingInput, match=r"net\.onnx"):
        onnx_masks(model, read_frames(noise_dir), model.with_name("out"), OnnxConfig())


def test_grey_and_16_bit_frames_are_read(yolox_nano, dog_dir, tmp_path):
    frames = tmp_path / "frames"
    frames.mkdir()
    grey = cv2.imread(str(dog_dir / "00003.png"), cv2.IMREAD_GRAYSCALE)
    cv2.imwrite(str(frames / "0.png"), grey)
    cv2.imwrite(str(frames / "1.png"), grey.astype(np.uint16) * 257)
    assert np.array_equal(read_color(frames / "0.png"), read_color(frames / "1.png"))
    out_dir = onnx_masks(yolox_nano, read_frames(frames), tmp_path / "out", OnnxConfig())
    mask = read_gray(out_dir / "0.png", (640, 360))
    assert mask.any()
    assert np.array_equal(mask, read_gray(out_dir / "1.png", (640, 360)))


@pytest.mark.parametrize("content", [b"", b"\x89PNG\r\n\x1a\n" + b"\x00" * 40, b"GIF89a" * 20])
def test_a_broken_frame_is_named(content, onnx_bytes, noise_dir, model):
    (noise_dir / "00001.png").write_bytes(content)
    model.write_bytes(onnx_bytes(("x", (1, 3, 64, 64))))
    with pytest.raises(BadFrames, match=r"00001\.png"):
        onnx_masks(model, read_frames(noise_dir), model.with_name("out"), OnnxConfig())


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        ({"classes": ["persn"]}, "not classes of COCO: persn; there are: person, bicycle"),
        ({"classes": []}, "at least 1"),
        ({"weak_score": 0.9}, "must not be above min_score"),
        ({"input_sizes_px": [[400, 416]]}, "400x416: sides must be multiples of 32"),
        ({"min_scroe": 0.5}, "Extra inputs"),
    ],
)
def test_wrong_recipes_are_refused(bad, said):
    with pytest.raises(ValueError, match=said):
        OnnxConfig.model_validate(bad)


def test_a_wide_frame_lies_in_the_upper_part_of_the_input(dog_dir):
    image = read_color(dog_dir / "00003.png")
    blob, scales = letterbox(image, (416, 416))
    np.testing.assert_allclose(scales, [0.65, 0.65])
    assert (blob[0, :, 234:] == 114).all()


def test_the_real_weights_want_a_square_of_416_px(yolox_nano):
    assert read_inputs(yolox_nano) == [OnnxInput("images", (1, 3, 416, 416))]


@IN_ONE_FOLDER
@given(shape=st.lists(st.one_of(st.integers(1, 2**40), st.just("n")), max_size=6))
def test_shapes_come_back(shape, onnx_bytes, model):
    model.write_bytes(onnx_bytes(("x", tuple(shape)), ("w", (3,)), weights=("w",)))
    expected = tuple(size if isinstance(size, int) else None for size in shape)
    assert read_inputs(model) == [OnnxInput("x", expected)]


def test_every_cut_of_a_file_is_told(onnx_bytes, model):
    whole = onnx_bytes(("x", (1, 3, 64, 64)))
    graph_end = len(whole) - 4  # the last four bytes are the operator set
    for size in range(graph_end):
        model.write_bytes(whole[:size])
        with pytest.raises(BadDetector, match=r"net\.onnx"):
            read_inputs(model)


@IN_ONE_FOLDER
@given(content=st.binary(max_size=200))
def test_noise_is_refused_or_has_no_crash(content, model):
    model.write_bytes(content)
    try:
        assert all(isinstance(known, OnnxInput) for known in read_inputs(model))
    except BadDetector as error:
        assert "net.onnx" in str(error)


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


def branching(dims: tuple[int, ...]) -> ModelProto:
    """One with a branch that is always taken, which adds weights that say the sizes `dims`."""
    image = helper.make_tensor_value_info("x", FLOAT, (1, 3, 64, 64))
    sums = [helper.make_tensor_value_info(name, FLOAT, (1, 3, 64, 64)) for name in ("o", "out")]
    weights = TensorProto(name="w", data_type=FLOAT, dims=dims, raw_data=bytes(4))
    branch = helper.make_graph(
        [helper.make_node("Add", ["x", "w"], ["o"])], "b", [], sums[:1], [weights]
    )
    node = helper.make_node("If", ["yes"], ["out"], then_branch=branch, else_branch=branch)
    yes = helper.make_tensor("yes", TensorProto.BOOL, (1,), [True])
    graph = helper.make_graph([node], "g", [image], sums[1:], [yes])
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)])


@pytest.mark.parametrize(
    ("hostile", "said"),
    [
        (network(side_px=10**9), "wants pictures of 1000000000x1000000000 px"),
        (network(count=10**11), "'zeros' would have 100000000000 numbers"),
        (network(dims=(10**6, 10**6)), "'w' should be 1000000000000 numbers, and 1 are there"),
        (network(dims=(-1, -1)), "'w' should be"),
        (branching((10**6, 10**6)), "'w' should be 1000000000000 numbers, and 1 are there"),
        # OpenCV took the whole process along.
        (branching((1,)), "its branch 'out' hangs on no input; export the model without"),
    ],
)
def test_absurd_sizes_are_refused(hostile, said, model):
    model.write_bytes(hostile.SerializeToString())
    with pytest.raises(BadDetector, match=rf"net\.onnx: .*{said}"):
        open_detector(model, OnnxConfig())


def test_an_error_without_words_is_told_by_its_name(model, monkeypatch):
    """Where memory runs out there are none, and the first line of them was asked for."""
    model.write_bytes(network().SerializeToString())
    monkeypatch.setattr("onnx.shape_inference.infer_shapes", Mock(side_effect=MemoryError))
    with pytest.raises(BadDetector, match=r"sizes don't fit \(MemoryError\); export"):
        check_sizes(model)


def test_plain_networks_are_not(yolox_nano, model):
    model.write_bytes(network().SerializeToString())
    for plain in (model, yolox_nano):
        check_sizes(plain)


def test_a_file_larger_than_any_network_is_not_read(model):
    with model.open("wb") as file:
        file.truncate(models.MOST_NETWORK_BYTES + models.MIB)
    with pytest.raises(BadDetector, match="has 513 MiB, and 512 MiB are the most"):
        models.require_model(model)
