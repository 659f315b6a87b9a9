"""Mask R-CNN: from instances to masks, and the network itself where torchvision runs."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from gmrdata.people import maskrcnn
from gmrdata.people.linking import Detections, TrackConfig, TrackedFrame
from gmrdata.people.maskrcnn import (
    Instances,
    MaskRcnnConfig,
    instances_of,
    maskrcnn_masks,
    open_segmenter,
    united_mask,
)
from gmrdata.people.yolox import CATEGORY_NUMBERS, COCO_NAMES
from gmrdata.read.frames import read_frames, read_gray
from gmrdata.values.errors import BadDetector, MissingExtra, MissingInput, StaleOutput
from tests.damage import Calls

NUMBER = dict(zip(COCO_NAMES, CATEGORY_NUMBERS, strict=True))
Answer = dict[str, np.ndarray]


def answer(*instances: tuple[str, float, tuple[int, int, int, int]]) -> Answer:
    """What the network says of a 64x48 frame: probability 0.9 in a rectangle, 0.4 round it."""
    masks = np.zeros((len(instances), 1, 48, 64), np.float32)
    for mask, (_, _, (left, top, right, bottom)) in zip(masks[:, 0], instances, strict=True):
        mask[max(0, top - 2) : bottom + 2, max(0, left - 2) : right + 2] = 0.4
        mask[top:bottom, left:right] = 0.9
    boxes = np.array([box for *_, box in instances], np.float32).reshape(-1, 4)
    return {
        "boxes": boxes,
        "scores": np.array([score for _, score, _ in instances], np.float32),
        "labels": np.array([NUMBER[name] for name, *_ in instances], np.int64),
        "masks": masks,
    }


SCENE = (
    ("person", 0.95, (5, 5, 15, 40)),
    ("dog", 0.3, (30, 20, 45, 35)),
    ("dog", 0.1, (50, 0, 60, 10)),
    ("chair", 0.99, (0, 40, 64, 48)),
)


def test_scores_classes_and_threshold_choose_the_instances():
    found = instances_of(answer(*SCENE), MaskRcnnConfig(weak_score=0.2))
    assert [COCO_NAMES[index] for index in found.found.classes] == ["person", "dog"]
    np.testing.assert_array_equal(found.found.boxes_px, [[5, 5, 15, 40], [30, 20, 45, 35]])
    assert found.masks.sum(axis=(1, 2)).tolist() == [10 * 35, 15 * 15]
    loose = instances_of(answer(*SCENE), MaskRcnnConfig(mask_threshold=0.3))
    assert loose.masks.sum(axis=(1, 2)).tolist() == [14 * 39, 19 * 19]
    chairs = instances_of(answer(*SCENE), MaskRcnnConfig(classes=("chair",)))
    assert [COCO_NAMES[index] for index in chairs.found.classes] == ["chair"]


def test_nothing_found_is_an_empty_mask():
    none = instances_of(answer(), MaskRcnnConfig())
    choice = TrackedFrame(np.zeros(0, np.int64), np.zeros((0, 4)))
    mask = united_mask(none, choice, (64, 48), 8)
    assert (mask.shape, mask.any()) == ((48, 64), False)


def test_instances_and_filled_boxes_are_united_and_widened():
    masks = np.zeros((3, 48, 64), bool)
    masks[0, 10, 10] = masks[1, 20, 20] = masks[2, 30, 30] = True
    found = Instances(Detections(np.zeros((3, 4)), np.ones(3), np.zeros(3, np.int64)), masks)
    choice = TrackedFrame(np.array([0, 2]), np.array([[40.0, 5.0, 42.0, 6.0]]))
    plain = united_mask(found, choice, (64, 48), 0)
    assert np.argwhere(plain).tolist() == [[5, 40], [5, 41], [10, 10], [30, 30]]
    wide = united_mask(found, choice, (64, 48), 1)
    assert wide[9:12, 10].tolist() == wide[10, 9:12].tolist() == [255] * 3
    assert wide[9, 9] == 0 and not wide[18:23, 18:23].any()


@pytest.fixture
def masked(noise_dir, tmp_path, monkeypatch) -> Callable[..., Path]:
    """Masks of the frames by a network that says what was recorded, frame after frame."""

    def run(
        name: str, answers: list[Answer], left_out: tuple[int, ...] = (), **settings: Any
    ) -> Path:
        left = iter(answers)

        def segment(image: np.ndarray) -> Answer:
            assert image.shape == (48, 64, 3)
            return next(left)

        monkeypatch.setattr(maskrcnn, "open_segmenter", lambda *_: segment)
        config = MaskRcnnConfig(**settings)
        return maskrcnn_masks(None, read_frames(noise_dir, left_out), tmp_path / name, config)

    return run


def test_the_stage_masks_every_frame_and_fills_the_one_that_was_missed(masked):
    person, later = ("person", 0.9, (10, 10, 20, 40)), ("person", 0.3, (14, 10, 24, 40))
    answers, tracks = [answer(person), answer(), answer(later)], TrackConfig(hold_frames=0)
    out_dir = masked("out", answers, dilate_px=0, tracks=tracks)
    lefts = []
    for i in range(3):
        rows, columns = np.nonzero(read_gray(out_dir / f"{i:05d}.png", (64, 48)))
        assert (rows.min(), rows.max(), np.ptp(columns)) == (10, 39, 9)
        lefts.append(int(columns.min()))
    assert lefts == [10, 12, 14]
    record = json.loads((out_dir / "stage.json").read_text())
    assert sorted(record["inputs"]) == ["images"]
    assert sorted(p.name for p in out_dir.iterdir()) == [
        *("00000.png", "00001.png", "00002.png", "stage.json")
    ]
    with pytest.raises(StaleOutput, match="made with other values of inputs.left out 2"):
        masked("out", [], (2,), dilate_px=0, tracks=tracks)


def test_a_stopped_run_keeps_the_frames_it_has(masked):
    every = [answer(("person", 0.9, (x, 10, x + 10, 40))) for x in (10, 12, 14)]
    with pytest.raises(StopIteration):
        masked("out", every[:2])
    resumed, whole = masked("out", every[2:]), masked("whole", every)
    for i in range(3):
        name = f"{i:05d}.png"
        assert (resumed / name).read_bytes() == (whole / name).read_bytes()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "truncated, or not a file of plain tensors"),
        (b"no weights", "truncated, or not a file of plain tensors"),
        (
            {"weight": Calls(Path.touch, Path("was_run"))},
            "truncated, or not a file of plain tensors",
        ),
        ({"other": torch.zeros(2)}, "holds other tensors than linear"),
        (torch.zeros(2), "holds other tensors than linear"),
    ],
)
def test_weights_of_another_kind_or_with_code_in_them_are_refused(
    content, said, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "w.pt"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        torch.save(content, path)
    with pytest.raises(BadDetector, match=rf"w\.pt: {said}"):
        maskrcnn._load_weights(torch.nn.Linear(2, 2), "linear", path)
    assert not (tmp_path / "was_run").exists()


def test_weights_are_loaded_and_missing_ones_named(tmp_path):
    network = torch.nn.Linear(2, 2)
    with pytest.raises(MissingInput, match=r"no\.pt"):
        maskrcnn._load_weights(network, "linear", tmp_path / "no.pt")
    torch.save({"weight": torch.ones(2, 2), "bias": torch.ones(2)}, tmp_path / "w.pt")
    maskrcnn._load_weights(network, "linear", tmp_path / "w.pt")
    assert float(network.weight.detach().sum()) == 4.0


def test_without_torchvision_the_remedy_is_told(noise_dir, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "torchvision", None)
    monkeypatch.delitem(sys.modules, "torchvision.models", raising=False)
    with pytest.raises(MissingExtra, match="pip install torchvision; or mask with"):
        maskrcnn_masks(None, read_frames(noise_dir), tmp_path / "out", MaskRcnnConfig())
    assert not (tmp_path / "out").exists()


def test_a_torchvision_that_does_not_fit_torch_is_told(tmp_path, monkeypatch):
    """What the released wheel does beside the CPU build of torch: RuntimeError on import."""
    package = tmp_path / "torchvision"
    package.mkdir()
    text = "raise RuntimeError('operator torchvision::nms does not exist')\n"
    (package / "__init__.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    for name in [n for n in sys.modules if n.split(".")[0] == "torchvision"]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(MissingExtra, match=r"does not fit torch .*nms does not exist"):
        open_segmenter(None, MaskRcnnConfig())


def test_torchvisions_compiled_operators_are_exact():
    ops = pytest.importorskip("torchvision.ops", exc_type=Exception)
    boxes = torch.tensor([[0.0, 0, 10, 10], [0, 0, 10, 9], [20, 20, 30, 30]])
    scores = torch.tensor([0.8, 0.9, 0.7])
    assert ops.nms(boxes, scores, 0.85).tolist() == [1, 2]  # the first two overlap by 0.9
    assert ops.nms(boxes, scores, 0.95).tolist() == [1, 0, 2]
    y, x = torch.meshgrid(torch.arange(6.0), torch.arange(8.0), indexing="ij")
    ramp = (10 * y + x)[None, None]
    cells = ops.roi_align(ramp, torch.tensor([[0, 1.0, 1, 5, 3]]), (2, 2), 1.0, 2, aligned=True)
    assert cells.tolist() == [[[[11.5, 13.5], [21.5, 23.5]]]]


@pytest.mark.slow
def test_the_real_network_answers_as_the_logic_expects(tmp_path):
    """Random weights: what they see is nonsense, but names, shapes and ranges are the network's."""
    try:
        detection = maskrcnn._import_detection()
    except MissingExtra as error:
        pytest.skip(str(error))
    torch.manual_seed(0)
    network = detection.maskrcnn_resnet50_fpn(weights=None, weights_backbone=None)
    torch.save(network.state_dict(), tmp_path / "w.pt")
    config = MaskRcnnConfig(
        network="maskrcnn_resnet50_fpn", classes=COCO_NAMES, min_score=1e-4, weak_score=1e-4
    )
    # A strip, as the network enlarges a picture until its longer side has 1333 pixels.
    noise = np.random.default_rng(0).integers(0, 256, (12, 96, 3), dtype=np.uint8)
    said = open_segmenter(tmp_path / "w.pt", config)(noise)
    found = instances_of(said, config)
    assert len(found.found) > 0
    assert found.masks.shape == (len(found.found), 12, 96)
    assert set(found.found.classes.tolist()) <= set(range(80))
    assert cv2.countNonZero(found.masks.any(axis=0).astype(np.uint8)) > 0
