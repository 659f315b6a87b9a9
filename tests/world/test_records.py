"""Records that a verdict is made of and leaves: none of their keys may be missing."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gmrdata.cameras.files import QUALITY_FILE
from gmrdata.values.body import BodyModel
from gmrdata.values.errors import BadRecord
from gmrdata.values.people import PersonFiles
from gmrdata.world.judge import PseudoGtQuality, load_record, quality_record, unsolved_quality
from gmrdata.world.pseudo_gt import WorldEvidence, make_pseudo_gt
from gmrdata.world.recipe import (
    Doubts,
    PseudoGtConfig,
    load_dataset_camera,
    save_dataset_camera,
    verdict_of,
)
from tests.reconstructions import good_quality, keys_of, pseudo_gt_quality, without
from tests.world.test_make import Circular, as_input, made, person_files, reconstruction, true_clip

DROPPED = verdict_of("walk", True, (), ["", *["the camera jumps"] * 2, "", ""])
RECORD = pseudo_gt_quality(good_quality(5), 2.5).model_copy(update={"people": (DROPPED,)})
KEYS = list(keys_of(RECORD.model_dump(mode="json")))
DOUBTS = Doubts(frames=(("", "campose_valid is 0"),), sequence=("the intrinsics are wrong",))


def sfm_of(tmp_path: Path, body: BodyModel, figures: Any) -> tuple[Path, tuple[PersonFiles, ...]]:
    """A reconstruction whose `quality.json` another hand wrote."""
    clip = true_clip(body, Circular())
    sfm_dir = reconstruction(tmp_path / "sfm", clip, "full", [])
    path = sfm_dir / QUALITY_FILE
    path.write_text(json.dumps(figures(json.loads(path.read_text()))))
    return sfm_dir, (person_files(tmp_path, as_input(clip), body),)


def test_55_px_under_another_name_are_not_accepted(small_body: BodyModel, tmp_path: Path) -> None:
    """A missing figure once counted as 0 px, and the sequence as good."""

    def renamed(figures: dict[str, Any]) -> dict[str, Any]:
        del figures["mean_reprojection_px"]
        return figures | {"reprojection_error_px": 55.0}

    sfm_dir, people = sfm_of(tmp_path, small_body, renamed)
    with pytest.raises(BadRecord, match=r"quality\.json: has no key `mean_reprojection_px`"):
        make_pseudo_gt(WorldEvidence(sfm_dir, people), tmp_path / "out", PseudoGtConfig())
    assert not (tmp_path / "out").exists()


def test_55_px_are_rejected(small_body: BodyModel, tmp_path: Path) -> None:
    sfm_dir, people = sfm_of(tmp_path, small_body, lambda said: said | {"mean_reprojection_px": 55})
    record = load_record(
        make_pseudo_gt(WorldEvidence(sfm_dir, people), tmp_path / "out", PseudoGtConfig())
    )
    assert not record.people[0].accepted
    assert "the mean reprojection error is 55.00 px, more than 1 px" in record.people[0].reasons


@pytest.mark.parametrize("key", [path for path in KEYS if path[0] == "cameras"], ids=str)
def test_no_figure_of_the_reconstruction_can_be_left_out(
    key: tuple[str | int, ...], small_body: BodyModel, tmp_path: Path
) -> None:
    if len(key) == 1:
        return
    sfm_dir, people = sfm_of(tmp_path, small_body, lambda said: without(said, key[1:]))
    with pytest.raises(
        BadRecord, match=rf"quality\.json: has no .*`{'.'.join(map(str, key[1:]))}`"
    ):
        make_pseudo_gt(WorldEvidence(sfm_dir, people), tmp_path / "out", PseudoGtConfig())


@pytest.mark.parametrize(
    ("figures", "said"),
    [
        (
            {"geometry": "full", "registered_share": 1.0, "inliers_per_frame": [100] * 40},
            r"sfm/quality\.json: has no `format`.*older.*--redo",
        ),
        (good_quality(7).model_dump(mode="json"), "its files are of different frames"),
    ],
)
def test_figures_of_an_older_version_and_of_other_frames(
    figures: dict[str, Any], said: str, small_body: BodyModel, tmp_path: Path
) -> None:
    sfm_dir, people = sfm_of(tmp_path, small_body, lambda _: figures)
    with pytest.raises(BadRecord, match=said):
        make_pseudo_gt(WorldEvidence(sfm_dir, people), tmp_path / "out", PseudoGtConfig())


def test_what_is_written_comes_back(small_body: BodyModel, tmp_path: Path) -> None:
    true = true_clip(small_body, Circular())
    record = load_record(made(tmp_path, true, small_body, "full", [0, 7]))
    assert record.cameras is not None and record.cameras.frames == true.motion.n_frames
    assert [run.start for run in record.people[0].dropped] == [0, 7]
    again = tmp_path / "again" / QUALITY_FILE
    record.write(again)
    assert PseudoGtQuality.read(again) == record
    assert again.read_bytes() == (tmp_path / "out" / QUALITY_FILE).read_bytes()


@pytest.mark.parametrize("path", KEYS, ids=lambda path: ".".join(map(str, path)))
def test_each_key_is_needed_and_named(tmp_path: Path, path: tuple[str | int, ...]) -> None:
    file = tmp_path / QUALITY_FILE
    file.write_text(json.dumps(without(RECORD.model_dump(mode="json"), path)))
    named = rf"quality\.json: has no .*`{'.'.join(map(str, path))}`.*--redo"
    with pytest.raises(BadRecord, match=named):
        load_record(tmp_path)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"scale_sigma": None}, "scale and scale_sigma"),
        ({"cameras": None}, "cameras and camera_motion"),
        ({"camera_motion": "none"}, "cameras and camera_motion"),
        ({"verdict": "accepted"}, "unknown key `verdict`"),
    ],
)
def test_records_that_cannot_be(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    text = json.dumps(RECORD.model_dump(mode="json") | changes)
    (tmp_path / QUALITY_FILE).write_text(text)
    with pytest.raises(BadRecord, match=said):
        load_record(tmp_path)


def test_a_manifest_says_the_same_figures() -> None:
    quality = quality_record(RECORD, 0)
    assert (quality.geometry, quality.verdict, quality.scale) == ("full", "accepted", 2.5)
    assert (quality.reprojection_error_px, quality.inliers) == (0.3, 200.0)
    assert quality.figures["kept_share"] == 0.6 and quality.figures["camera_extent_m"] == 9.0
    assert quality.figures["scale_planted_feet_p0_sigma"] == 0.02
    assert "camera_goes_round" not in quality.figures
    assert quality.figures["interpolated_frames"] == 0.0


def test_a_sequence_without_a_reconstruction_drops_every_row(tmp_path: Path) -> None:
    rejected = verdict_of("walk", False, ("no model",), ["black", "black", ""])
    unsolved_quality([rejected]).write(tmp_path / QUALITY_FILE)
    record = load_record(tmp_path)
    whole = "the sequence is rejected: no model"
    assert record.people[0].row_reasons == ["black", "black", whole]
    quality = quality_record(record, 0)
    assert (quality.geometry, quality.verdict, quality.inliers) == (None, "rejected", None)
    assert quality.figures == {"kept_share": rejected.kept_share}


@pytest.mark.parametrize("key", ["format", "frames", "sequence"])
def test_each_doubt_is_needed_and_named(tmp_path: Path, key: str) -> None:
    file = tmp_path / "doubts.json"
    DOUBTS.write(file)
    assert Doubts.read(file) == DOUBTS
    file.write_text(json.dumps(without(DOUBTS.model_dump(mode="json"), (key,))))
    with pytest.raises(BadRecord, match=rf"doubts\.json: has no .*`{key}`"):
        Doubts.read(file)


@pytest.mark.parametrize("key", ["format", "world_from_cam"])
def test_each_array_of_the_dataset_camera_is_needed_and_named(tmp_path: Path, key: str) -> None:
    file = tmp_path / "dataset_camera.npz"
    save_dataset_camera(file, np.tile(np.eye(4), (3, 1, 1)))
    assert load_dataset_camera(file).shape == (3, 4, 4)
    arrays = {name: array for name, array in np.load(file).items() if name != key}
    np.savez(file, **arrays)
    with pytest.raises(BadRecord, match=rf"dataset_camera\.npz: has no .*{key}"):
        load_dataset_camera(file)


def test_doubts_and_cameras_of_other_frames_are_refused(
    small_body: BodyModel, tmp_path: Path
) -> None:
    sfm_dir, people = sfm_of(tmp_path, small_body, lambda said: said)
    config, out_dir = PseudoGtConfig(), tmp_path / "out"
    DOUBTS.write(tmp_path / "doubts.json")
    with pytest.raises(BadRecord, match="is not of 1 people and 40 frames"):
        evidence = WorldEvidence(sfm_dir, people, doubts_path=tmp_path / "doubts.json")
        make_pseudo_gt(evidence, out_dir, config)
    save_dataset_camera(tmp_path / "camera.npz", np.tile(np.eye(4), (3, 1, 1)))
    with pytest.raises(BadRecord, match="3 cameras for 40 frames"):
        evidence = WorldEvidence(sfm_dir, people, dataset_camera_path=tmp_path / "camera.npz")
        make_pseudo_gt(evidence, out_dir, config)
