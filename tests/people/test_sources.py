"""Sources of masks as recipes and command lines name them."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from gmrdata.people.sources import (
    FolderSource,
    MaskRcnnSource,
    MasksConfig,
    OnnxSource,
    PersonSource,
    SilhouetteSource,
    make_masks,
    masks_named,
    masks_seconds,
)
from gmrdata.read.frames import read_frames, read_gray
from gmrdata.solve.request import SequenceConfig
from gmrdata.values.errors import BadFrames, BadRecipe, MissingInput


def test_the_body_is_the_source_unless_others_are_named() -> None:
    assert SequenceConfig().masks.sources == (SilhouetteSource(),)


def test_a_recipe_says_the_kinds_and_their_settings() -> None:
    config = MasksConfig.model_validate(
        {
            "max_masked_share": 0.5,
            "sources": [
                {"kind": "silhouette", "dilate_px": 3},
                {"kind": "onnx", "model": "m.onnx", "classes": ["dog"]},
                {"kind": "person", "landmarks": "l.tflite", "dilate_px": 2},
                {"kind": "maskrcnn", "weights": "w.pt"},
                {"kind": "folder", "path": "made", "masked_value": 0},
            ],
        }
    )
    kinds = (SilhouetteSource, OnnxSource, PersonSource, MaskRcnnSource, FolderSource)
    assert tuple(map(type, config.sources)) == kinds
    assert MasksConfig.model_validate_json(config.model_dump_json()) == config


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ({"kind": "sam"}, "'sam' .* 'silhouette', 'folder', 'onnx', 'person', 'maskrcnn'"),
        ({"dilate_px": 3}, "discriminator 'kind'"),
        ({"kind": "folder"}, "path"),
        ({"kind": "silhouette", "model": "m.onnx"}, "Extra inputs"),
    ],
)
def test_wrong_sources_are_refused(source: dict[str, object], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        MasksConfig.model_validate({"sources": [source]})


def test_no_source_at_all_is_refused() -> None:
    with pytest.raises(ValidationError, match="at least 1 item"):
        MasksConfig.model_validate({"sources": []})


def test_a_command_line_names_sources(tmp_path: Path) -> None:
    model = tmp_path / "m.onnx"
    names = ("silhouette", "onnx", "person", "maskrcnn", str(tmp_path))
    config = masks_named(names, detector=model, landmark_network=Path("l"), classes=("dog",))
    assert config.sources == (
        SilhouetteSource(),
        OnnxSource(model=model, classes=("dog",)),
        PersonSource(model=model, landmarks=Path("l")),
        MaskRcnnSource(classes=("dog",)),
        FolderSource(path=tmp_path),
    )


def test_a_recipe_file_brings_its_settings(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(
        "recipe: masks\nmax_masked_share: 0.4\nsources: [{kind: onnx, model: m.onnx}]\n"
    )
    config = masks_named(("silhouette", str(path)))
    assert [source.kind for source in config.sources] == ["silhouette", "onnx"]
    assert config.max_masked_share == 0.4


@pytest.mark.parametrize(
    ("names", "options", "error", "said"),
    [
        (("no_folder",), {}, MissingInput, "no_folder: no such folder of masks; name silhouette"),
        (("none.yaml",), {}, MissingInput, "none.yaml: no such recipe file"),
        (("silhouette",), {"detector": Path("m")}, BadRecipe, "--detector is for onnx and person"),
        (("onnx",), {"landmark_network": Path("l")}, BadRecipe, "--landmark-network is for person"),
        (("silhouette",), {"classes": ("dog",)}, BadRecipe, "--classes is for onnx and maskrcnn"),
        (("onnx",), {"detector": Path("m"), "classes": ("dgo",)}, BadRecipe, "not classes .* dgo"),
        (("onnx",), {"maskrcnn": Path("w")}, BadRecipe, "--maskrcnn is for mask"),
    ],
)
def test_wrong_command_lines_are_told(
    names: tuple[str, ...], options: dict[str, object], error: type[Exception], said: str
) -> None:
    with pytest.raises(error, match=said):
        masks_named(names, **options)


def test_two_folders_are_united_and_stand_in_the_record(noise_dir: Path, tmp_path: Path) -> None:
    for name, column in (("a", 3), ("b", 40)):
        (tmp_path / name).mkdir()
        for i in range(3):
            mask = np.zeros((48, 64), np.uint8)
            mask[5, column] = 255
            cv2.imwrite(str(tmp_path / name / f"{i:05d}.png"), mask)
    config = MasksConfig(
        sources=(FolderSource(path=tmp_path / "a"), FolderSource(path=tmp_path / "b", dilate_px=1))
    )
    out_dir = make_masks(read_frames(noise_dir), tmp_path / "out" / "masks", config)
    mask = read_gray(out_dir / "00002.png")
    assert np.argwhere(mask).tolist() == [[4, 40], [5, 3], [5, 39], [5, 40], [5, 41], [6, 40]]
    record = json.loads((out_dir / "masks.json").read_text())
    assert record["sources"] == ["folder_1", "folder_2"]
    stage = json.loads((out_dir.parent / "masks_by" / "folder_2" / "stage.json").read_text())
    assert stage["config"] == {"masked_value": 255, "dilate_px": 1}
    parts = [out_dir, *(out_dir.parent / "masks_by").glob("folder_*")]
    seconds = [json.loads((part / "stage.json").read_text())["seconds"] for part in parts]
    assert masks_seconds(out_dir) == pytest.approx(sum(seconds))


def test_left_out_images_get_no_mask_and_make_no_error(noise_dir: Path, tmp_path: Path) -> None:
    (noise_dir / "00001.png").write_bytes(b"")
    (tmp_path / "a").mkdir()
    for i in (0, 2):
        cv2.imwrite(str(tmp_path / "a" / f"{i:05d}.png"), np.full((48, 64), 255, np.uint8))
    config = MasksConfig(sources=(FolderSource(path=tmp_path / "a"),))
    with pytest.raises(BadFrames, match=r"00001\.png: empty file"):
        make_masks(read_frames(noise_dir), tmp_path / "masks", config)
    out_dir = make_masks(read_frames(noise_dir, {1}), tmp_path / "masks", config)
    assert sorted(path.name for path in out_dir.glob("*.png")) == ["00000.png", "00002.png"]


@pytest.mark.parametrize(
    ("source", "lacks"),
    [
        (OnnxSource(), "yolox_nano.onnx"),
        (PersonSource(), "yolox_nano.onnx"),
        (PersonSource(model=Path(__file__)), "pose_landmark_lite.tflite"),
    ],
)
def test_a_network_that_was_not_fetched_is_named_with_the_command(
    source: OnnxSource | PersonSource,
    lacks: str,
    noise_dir: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    with pytest.raises(MissingInput, match=f"{lacks}: no such model file; `gmrdata fetch models`"):
        make_masks(read_frames(noise_dir), tmp_path / "masks", MasksConfig(sources=(source,)))


def test_a_silhouette_needs_the_body(noise_dir: Path, tmp_path: Path) -> None:
    with pytest.raises(MissingInput, match="pass --camera-body"):
        make_masks(read_frames(noise_dir), tmp_path / "masks", MasksConfig())
