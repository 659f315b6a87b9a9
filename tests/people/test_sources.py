"""Sources and folders of masks; no frame goes unmasked in silence."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from gmrdata.people.folder import (
    RECORD_FILE,
    FolderMaskConfig,
    UnionConfig,
    check_masks,
    folder_masks,
    unite_masks,
)
from gmrdata.people.following import FOLLOWED_FILE, SIGHTINGS_FILE, FollowedRecord, Sightings
from gmrdata.people.sources import (
    FolderSource,
    MaskRcnnSource,
    MasksConfig,
    OnnxSource,
    PersonMaskConfig,
    PersonSource,
    SilhouetteSource,
    _boxes_without,
    make_masks,
    masks_named,
    masks_seconds,
    person_masks,
)
from gmrdata.read.frames import read_frames, read_gray
from gmrdata.read.video import VideoConfig, as_frames, expected_frames
from gmrdata.solve.request import SequenceConfig
from gmrdata.values.errors import BadFrames, BadRecipe, MissingInput, StaleOutput
from tests.fixtures.command_line import Answer
from tests.read.videos import make_video

SIZE = (48, 64)
WHITE = np.full(SIZE, 255, np.uint8)
DYNAMIC = np.zeros(SIZE, dtype=bool)
DYNAMIC[5:12, 20:33] = True


def put(folder: Path, *masks: np.ndarray, name: str = "{}.png") -> Path:
    folder.mkdir()
    for i, mask in enumerate(masks):
        cv2.imwrite(str(folder / name.format(f"{i:05d}")), mask)
    return folder


def test_the_body_is_the_source_unless_others_are_named():
    assert SequenceConfig().masks.sources == (SilhouetteSource(),)


def test_a_recipe_says_the_kinds_and_their_settings():
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
    ("sources", "said"),
    [
        ([{"kind": "sam"}], "'sam' .* 'silhouette', 'folder', 'onnx', 'person', 'maskrcnn'"),
        ([{"dilate_px": 3}], "discriminator 'kind'"),
        ([{"kind": "folder"}], "path"),
        ([{"kind": "silhouette", "model": "m.onnx"}], "Extra inputs"),
        ([], "at least 1 item"),
    ],
)
def test_wrong_sources_are_refused(sources, said):
    with pytest.raises(ValidationError, match=said):
        MasksConfig.model_validate({"sources": sources})


def test_a_command_line_names_sources(tmp_path):
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


def test_a_recipe_file_brings_its_settings(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "recipe: masks\nmax_masked_share: 0.4\nsources: [{kind: onnx, model: m.onnx}]\n"
    )
    config = masks_named(("silhouette", str(path)))
    assert [source.kind for source in config.sources] == ["silhouette", "onnx"]
    assert config.max_masked_share == 0.4
    other = tmp_path / "other.yaml"  # which says nothing of it, and set it back to 0.9
    other.write_text("recipe: masks\nsources: [{kind: person}]\n")
    for files in ((path, other), (other, path)):
        config = masks_named([str(file) for file in files])
        assert len(config.sources) == 2 and config.max_masked_share == 0.4


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
def test_wrong_command_lines_are_told(names, options, error, said):
    with pytest.raises(error, match=said):
        masks_named(names, **options)


def test_two_folders_are_united_and_stand_in_the_record(noise_dir, tmp_path):
    masks = np.zeros((2, *SIZE), np.uint8)
    masks[0, 5, 3] = masks[1, 5, 40] = 255
    a, b = (put(tmp_path / name, *[mask] * 3) for name, mask in zip("ab", masks, strict=True))
    config = MasksConfig(sources=(FolderSource(path=a), FolderSource(path=b, dilate_px=1)))
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


def test_left_out_images_get_no_mask_and_make_no_error(noise_dir, tmp_path):
    (noise_dir / "00001.png").write_bytes(b"")
    masks = put(tmp_path / "a", *[WHITE] * 3)
    (masks / "00001.png").unlink()
    config = MasksConfig(sources=(FolderSource(path=masks),))
    with pytest.raises(BadFrames, match=r"00001\.png: empty file"):
        make_masks(read_frames(noise_dir), tmp_path / "masks", config)
    out_dir = make_masks(read_frames(noise_dir, {1}), tmp_path / "masks", config)
    assert sorted(path.name for path in out_dir.glob("*.png")) == ["00000.png", "00002.png"]


def test_other_images_that_are_left_out_are_another_recipe(noise_dir, tmp_path):
    """The masks of before were taken for whole, and lacked one."""
    config = MasksConfig(sources=(FolderSource(path=put(tmp_path / "a", *[WHITE] * 3)),))
    make_masks(read_frames(noise_dir, {2, 9}), tmp_path / "masks", config)
    for left_out in ((), (0,)):
        with pytest.raises(StaleOutput, match="other values of inputs.left out"):
            make_masks(read_frames(noise_dir, left_out), tmp_path / "masks", config)
    masks = {"a": tmp_path / "masks"}
    unite_masks(masks, read_frames(noise_dir, {2}), tmp_path / "one", UnionConfig())
    with pytest.raises(StaleOutput, match="other values of inputs.left out 2"):
        unite_masks(masks, read_frames(noise_dir), tmp_path / "one", UnionConfig())


def test_boxes_are_of_the_image_with_their_number(noise_dir, tmp_path):
    """With an image left out, those after it got the boxes of the images before them."""
    boxes_px = [[5.0 + 12 * n, 10.0, 13.0 + 12 * n, 40.0] for n in range(3)]
    followed, config = tmp_path / "followed", PersonMaskConfig(dilate_px=0)
    followed.mkdir()
    found = [[{"box_px": box_px, "score": 0.9, "class": 0}] for box_px in boxes_px]
    record = {"size_px": SIZE[::-1], "images": (0, 1, 2), "people": (), "left_out": ()}
    FollowedRecord(**record, detections=tuple(found)).write(followed / FOLLOWED_FILE)
    Sightings.of([]).write(followed / SIGHTINGS_FILE)
    out_dir = person_masks(followed, read_frames(noise_dir, {1}), tmp_path / "some", config)
    for n in (0, 2):
        columns = np.flatnonzero(read_gray(out_dir / f"{n:05d}.png").any(axis=0))
        assert columns.tolist() == list(range(5 + 12 * n, 13 + 12 * n))
    with pytest.raises(StaleOutput, match="other values of inputs.left out 1"):
        person_masks(followed, read_frames(noise_dir), tmp_path / "some", config)


@pytest.mark.parametrize(
    ("source", "lacks"),
    [
        (OnnxSource(), "yolox_nano.onnx"),
        (PersonSource(), "yolox_nano.onnx"),
        (PersonSource(model=Path(__file__)), "pose_landmark_heavy.tflite"),
    ],
)
def test_a_network_that_was_not_fetched_is_named_with_the_command(
    source, lacks, noise_dir, tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    with pytest.raises(MissingInput, match=f"{lacks}: no such model file; `gmrdata fetch models`"):
        make_masks(read_frames(noise_dir), tmp_path / "masks", MasksConfig(sources=(source,)))


def test_a_silhouette_needs_the_body(noise_dir, tmp_path):
    with pytest.raises(MissingInput, match="pass --camera-body"):
        make_masks(read_frames(noise_dir), tmp_path / "masks", MasksConfig())


def left_part(share: float) -> np.ndarray:
    mask = np.zeros(SIZE, np.uint8)
    mask[:, : round(64 * share)] = 255
    return mask


def top_part(share: float) -> np.ndarray:
    mask = np.zeros(SIZE, np.uint8)
    mask[: round(48 * share)] = 255
    return mask


@pytest.mark.parametrize("name", ["{}.png", "{}.png.png"])
@pytest.mark.parametrize("masked_value", [0, 255])
def test_both_senses_and_namings_become_ours(name, masked_value, noise_dir, tmp_path):
    mask = np.where(DYNAMIC, masked_value, 255 - masked_value).astype(np.uint8)
    masks = put(tmp_path / "masks", *[mask] * 3, name=name)
    config = FolderMaskConfig.model_validate({"masked_value": masked_value})
    out_dir = folder_masks(masks, read_frames(noise_dir), tmp_path / "out", config)
    for stem in ("00000", "00001"):
        assert np.array_equal(read_gray(out_dir / f"{stem}.png"), 255 * DYNAMIC)


SPREAD = np.zeros(SIZE, np.uint8)  # three objects, whose numbers were spread from black to white
SPREAD[10:40, 2:20], SPREAD[10:40, 22:40], SPREAD[10:40, 42:60] = 85, 170, 255
NO_MASKS = {
    "spread numbers": (SPREAD, "numbers of objects, one of them as dark as 85 of 255"),
    "number": (DYNAMIC * np.uint8(1), "numbers of objects, none of them brighter than 1 of 255"),
    "numbers of 16 bits": (DYNAMIC * np.uint16(200), "brighter than 200 of 65535"),
    "dark colour": (DYNAMIC[..., None] * np.uint8([0, 0, 128]), "holds colours"),
    "bright colour": (DYNAMIC[..., None] * np.uint8([0, 255, 255]), "holds colours"),
    "cut out": (np.dstack([np.full((*SIZE, 3), 200, np.uint8), DYNAMIC * np.uint8(255)]), "see-th"),
}


@pytest.mark.parametrize("masked_value", [0, 255])
@pytest.mark.parametrize("kind", NO_MASKS)
def test_what_is_no_mask_is_refused_by_name(kind, masked_value, noise_dir, tmp_path):
    """Nothing of them counted as masked, or all, or the brighter colours.  One is enough."""
    mask, said = NO_MASKS[kind]
    good = DYNAMIC * np.uint8(255)
    masks = put(tmp_path / "masks", good, mask, good)
    config = FolderMaskConfig.model_validate({"masked_value": masked_value})
    with pytest.raises(BadFrames, match=rf"masks/00001\.png: .*{said}.*; write 255 where"):
        folder_masks(masks, read_frames(noise_dir), tmp_path / "out", config)


@pytest.mark.parametrize(
    "as_stored",
    [
        lambda mask: mask * np.uint16(257),
        lambda mask: np.dstack([mask] * 3),
        lambda mask: np.dstack([mask] * 3 + [np.full_like(mask, 255)]),
        lambda mask: np.maximum(mask, 100),
        lambda mask: np.maximum(mask, cv2.dilate(mask, np.ones((9, 9))) // 3),
    ],
)
def test_masks_may_be_stored_otherwise(as_stored, noise_dir, tmp_path):
    """As 16 bits, grey colours, opaque, or with soft edges; a frame may have nothing masked."""
    mask = DYNAMIC * np.uint8(255)
    masks = put(tmp_path / "masks", as_stored(mask), as_stored(mask), np.zeros_like(mask))
    out_dir = folder_masks(masks, read_frames(noise_dir), tmp_path / "out", FolderMaskConfig())
    assert np.array_equal(read_gray(out_dir / "00000.png"), mask)
    assert not read_gray(out_dir / "00002.png").any()


def test_a_faint_soft_mask_shows_nobody(noise_dir, tmp_path):
    """Networks leave such where they are sure of nobody; a folder of nothing else is refused."""
    mask, faint = DYNAMIC * np.uint8(255), np.arange(DYNAMIC.size).reshape(DYNAMIC.shape) % 40
    masks = put(tmp_path / "masks", mask, faint.astype(np.uint8), mask)
    out_dir = folder_masks(masks, read_frames(noise_dir), tmp_path / "out", FolderMaskConfig())
    assert not read_gray(out_dir / "00001.png").any()
    masks = put(tmp_path / "faint", *[faint.astype(np.uint8)] * 3)
    with pytest.raises(BadFrames, match="faint: masks are no brighter than 39 of 255"):
        folder_masks(masks, read_frames(noise_dir), tmp_path / "none", FolderMaskConfig())


def test_masks_of_all_frames_are_not_laid_on_every_second(tmp_path):
    video = make_video(tmp_path / "a.mp4")
    frames = as_frames(video, tmp_path / "frames", VideoConfig(every=2))
    of_all = put(tmp_path / "all", *[WHITE] * 8)
    planned = expected_frames(video, VideoConfig(every=2))
    for check in (as_ours, lambda masks, images, out: check_masks(masks, planned)):
        with pytest.raises(
            BadFrames, match="all: masks go beyond image 3, .*; keep those of frames 0, 2, 4"
        ):
            check(of_all, frames.folder, tmp_path / "out")
    of_taken = put(tmp_path / "taken", *[WHITE] * 4)
    folder_masks(of_taken, frames, tmp_path / "out", FolderMaskConfig())
    check_masks(of_taken, planned)

    # Of a part nobody can tell: the remedy for all frames laid right masks on the wrong images.
    some = as_frames(video, tmp_path / "some", VideoConfig(every=2, to_s=0.16))
    with pytest.raises(
        BadFrames,
        match="taken: masks go beyond image 2, the last one, so they are of more images than "
        "this part, or of every frame; keep those of its images, under the images' names",
    ):
        folder_masks(of_taken, some, tmp_path / "part", FolderMaskConfig())
    (of_taken / "00003.png").unlink()
    folder_masks(of_taken, some, tmp_path / "part", FolderMaskConfig())


def test_masks_numbered_from_1_are_not_laid_one_frame_off(tmp_path):
    """Of a video whose start is left out, each image found a mask: that of the frame before."""
    video = make_video(tmp_path / "a.mp4")
    later = as_frames(video, tmp_path / "later", VideoConfig(from_s=0.08))
    from_1 = put(tmp_path / "from_1", *[WHITE] * 9)
    (from_1 / "00000.png").unlink()
    middle = as_frames(video, tmp_path / "middle", VideoConfig(from_s=0.08, to_s=0.2))
    for frames in (later, middle):  # of a part, whose end nobody knows, they passed
        with pytest.raises(BadFrames, match="from_1: masks are numbered from 1; number them from"):
            folder_masks(from_1, frames, tmp_path / "out", FolderMaskConfig())
    whole = put(tmp_path / "whole", *[WHITE] * 8)
    of_later = folder_masks(whole, later, tmp_path / "out", FolderMaskConfig())
    assert [path.stem for path in sorted(of_later.glob("*.png"))] == [
        f"{number:05d}" for number in range(2, 8)
    ]

    # Of a part they may rightly go on.
    folder_masks(whole, middle, tmp_path / "part", FolderMaskConfig())


def test_masks_are_widened_by_a_disc(noise_dir, tmp_path):
    masks = put(tmp_path / "masks", *[DYNAMIC * np.uint8(255)] * 3)
    out_dir = folder_masks(
        masks, read_frames(noise_dir), tmp_path / "out", FolderMaskConfig(dilate_px=3)
    )
    mask = read_gray(out_dir / "00000.png") > 0
    rows, columns = np.nonzero(DYNAMIC)
    y, x = np.mgrid[:48, :64]
    nearest = np.min(np.hypot(y[..., None] - rows, x[..., None] - columns), axis=-1)
    assert mask[nearest <= 2.5].all() and not mask[nearest > 3.5].any()


def as_ours(masks: Path, images: Path, out: Path) -> Path:
    return folder_masks(masks, read_frames(images), out, FolderMaskConfig())


def as_one(masks: Path, images: Path, out: Path) -> Path:
    return unite_masks({"one": masks}, read_frames(images), out, UnionConfig())


@pytest.mark.parametrize("stage", [as_ours, as_one])
@pytest.mark.parametrize(
    ("masks", "error", "said"),
    [
        (None, MissingInput, "masks"),
        ([left_part(0.1)] * 2, BadFrames, r"masks: no mask for 00002\.png; expected 00002\.png or"),
        (
            [left_part(0.1), left_part(0.1)[:40], left_part(0.1)],
            BadFrames,
            r"00001\.png: 64x40 px, its frame is 64x48 px",
        ),
    ],
)
def test_a_missing_folder_or_mask_and_one_of_another_size_are_named(
    stage, masks, error, said, noise_dir, tmp_path
):
    if masks is not None:
        put(tmp_path / "masks", *masks)
    with pytest.raises(error, match=said):
        stage(tmp_path / "masks", noise_dir, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_pixel_is_masked_if_any_source_says_so(noise_dir, tmp_path, capsys):
    a = put(tmp_path / "a", left_part(0.25), left_part(0.5), left_part(0))
    b = put(tmp_path / "b", top_part(0.5), top_part(0), top_part(0))
    out_dir = unite_masks(
        {"one": a, "two": b}, read_frames(noise_dir), tmp_path / "out", UnionConfig()
    )
    united = [read_gray(out_dir / f"{i:05d}.png", (64, 48)) for i in range(3)]
    np.testing.assert_array_equal(united[0], np.maximum(left_part(0.25), top_part(0.5)))
    np.testing.assert_array_equal(united[1], left_part(0.5))
    assert not united[2].any()
    record = json.loads((out_dir / RECORD_FILE).read_text())
    assert record["sources"] == ["one", "two"]
    assert record["masked_share"]["00000"] == {"one": 0.25, "two": 0.5, "united": 0.625}
    assert (record["covered"], record["unmasked"]) == ([], ["00002"])
    said = " ".join(capsys.readouterr().err.split())
    assert "nothing is masked in frame 00002 (1 of 3). If somebody is to be seen there" in said


def test_a_mask_that_covers_everything_is_reported_with_the_frame(noise_dir, tmp_path, capsys):
    # Neither covers too much alone, both together do.
    a = put(tmp_path / "a", left_part(0.1), left_part(0.5), left_part(0.5))
    b = put(tmp_path / "b", top_part(0), 255 - left_part(0.5), top_part(0.5))
    config = UnionConfig(max_masked_share=0.8)
    out_dir = unite_masks({"one": a, "two": b}, read_frames(noise_dir), tmp_path / "out", config)
    assert json.loads((out_dir / RECORD_FILE).read_text())["covered"] == ["00001"]
    first = capsys.readouterr().err
    assert "more than 80% of the picture is masked in frame 00001. Look" in " ".join(first.split())
    # It is said again by a run that finds everything done.
    unite_masks({"one": a, "two": b}, read_frames(noise_dir), tmp_path / "out", config)
    assert capsys.readouterr().err == first


def test_frames_are_masked_and_shown(yolox_nano, dog_dir, gmrdata, tmp_path):
    out = tmp_path / "out"
    answer = gmrdata("masks", dog_dir, "--out", out, "--detector", yolox_nano, "--classes", "dog")
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.split() == [str(out / "masks"), str(out / "sheet" / "contact.jpg")]
    assert "detecting" in answer.stderr and "4/4" in answer.stderr
    record = json.loads((out / "masks" / "masks.json").read_text())
    assert record["sources"] == ["onnx"]
    assert all(0.01 < share["united"] < 0.5 for share in record["masked_share"].values())
    sheet = cv2.imread(str(out / "sheet" / "contact.jpg"))
    assert sheet is not None and sheet.shape[1] == 4 * 400 + 3 * 4


def said_by(answer: Answer, code: int = 1) -> str:
    assert answer.returncode == code, answer.stderr
    return " ".join(answer.stderr.split())


def test_a_video_and_a_folder_of_masks(gmrdata, tmp_path):
    video = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    for i in range(3):
        video.write(np.full((48, 64, 3), 60 * i, np.uint8))
    video.release()
    made = put(tmp_path / "made", *[WHITE] * 3)
    common = ("masks", tmp_path / "v.avi", "--out", tmp_path / "out", "--masks")
    said = said_by(gmrdata(*common, made), 0)
    frames = sorted(p.name for p in (tmp_path / "out" / "frames").glob("*.jpg"))
    assert frames == [f"{i:05d}.jpg" for i in range(3)]
    assert "more than 90% of the picture is masked in frame 00000, 00001, 00002. Look" in said
    part = (*common, made, "--redo", "--from", "0.05", "--to", "0.2")
    said_by(gmrdata(*part), 0)
    frames = sorted(p.name for p in (tmp_path / "out" / "frames").glob("*.jpg"))
    assert frames == ["00001.jpg", "00002.jpg"]
    assert "gmrdata: no frames: to 0.01 s is not after from 0.05 s" in said_by(
        gmrdata(*part[:-1], "0.01")
    )
    of_folder = ("masks", tmp_path / "out" / "frames", *common[2:], made)
    assert "are for a video file" in said_by(gmrdata(*of_folder, "--every", "2"))
    (made / "00001.png").unlink()
    assert "no mask for 00001.jpg" in said_by(gmrdata(*common, made, "--redo"))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--masks", "person"), "no such model file; `gmrdata fetch models` gets it"),
        (("--masks", "silhouette"), "pass --camera-body"),
        (("--detector", "no.onnx"), "no.onnx: no such model file; `gmrdata fetch models` gets it"),
        (("--masks", "maskrcnn", "--detector", "m.onnx"), "--detector is for onnx and person"),
        (("--masks",), "nothing given. Name a source of masks"),
    ],
)
def test_what_is_missing_is_told(arguments, said, noise_dir, tmp_path, gmrdata, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert said in said_by(gmrdata("masks", noise_dir, "--out", tmp_path / "out", *arguments))
    assert not (tmp_path / "out" / "masks").exists()


def test_of_two_side_by_side_the_one_without_an_outline_is_masked():
    """Their boxes overlap so much that both counted as the one who is seen."""
    outlines, beside = np.zeros((2, 480, 320), np.uint8)
    outlines[100:400, 100:200], beside[100:400, 200:240] = 255, 255
    both_px = np.array([[100.0, 100, 200, 400], [140, 100, 240, 400]])
    for boxes_px, filled in ((both_px, beside), (both_px[::-1], beside), (both_px[:1], 0 * beside)):
        found = _boxes_without(outlines, boxes_px, both_px[:1], PersonMaskConfig())
        np.testing.assert_array_equal(found, filled)
