"""A person's decision on verdicts, and the records of a verdict."""

import json
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from gmrdata.cameras.files import QUALITY_FILE
from gmrdata.values.body import BodyModel
from gmrdata.values.errors import BadRecipe, BadRecord
from gmrdata.values.people import PersonFiles
from gmrdata.world.judge import PseudoGtQuality, load_record, quality_record, unsolved_quality
from gmrdata.world.recipe import (
    Doubts,
    Dropped,
    Override,
    load_dataset_camera,
    overridden,
    save_dataset_camera,
    verdict_of,
)
from tests.reconstructions import good_quality, pseudo_gt_quality
from tests.record_keys import assert_each_key_is_needed
from tests.world.test_compose import (
    Circular,
    as_input,
    made,
    made_of,
    person_files,
    reconstruction,
    true_clip,
)

N = 20
USABLE = np.zeros(N, dtype=bool)
NO_CAMERA = [""] * 15 + ["no camera was found"] * 5
REJECTED = verdict_of("c", False, ("60% of the images have a camera", "a cut"), NO_CAMERA)
ACCEPTED = verdict_of("c", True, (), NO_CAMERA)


@pytest.mark.parametrize(
    ("before", "decided", "because", "reasons"),
    [
        (
            REJECTED, "accepted", "the cut is a flash",
            ("a person decided: the cut is a flash",
             "overruled: 60% of the images have a camera", "overruled: a cut"),
        ),
        (ACCEPTED, "rejected", " the body floats ", ("a person decided: the body floats",)),
        (REJECTED, "rejected", "x", ("a person decided: x", *REJECTED.reasons)),
    ],
)  # fmt: skip
def test_a_person_decides_and_overruled_reasons_stay(before, decided, because, reasons):
    override = Override.model_validate({"verdict": decided, "because": because})
    verdict = overridden(before, override, USABLE)
    assert verdict == verdict_of("c", decided == "accepted", reasons, NO_CAMERA)
    assert verdict.dropped == before.dropped


def test_ranges_alone_leave_the_verdict_to_the_thresholds():
    override = Override(because="looked at it", keep=((14, 17),), drop=((0, 2), (16, 18)))
    unusable = np.arange(N) == 14
    reasons = ["" if row < 13 else "the camera jumps" for row in range(N)]
    for before in (REJECTED, ACCEPTED):
        lost_too = [a or b for a, b in zip(NO_CAMERA, reasons, strict=True)]
        judged = verdict_of("c", before.accepted, before.reasons, lost_too)
        verdict = overridden(judged, override, unusable)
        after = verdict.frame_reasons
        assert (verdict.accepted, verdict.reasons) == (before.accepted, before.reasons)
        said, jumps, lost = override.decision, "the camera jumps", "no camera was found"
        # 14 can't be kept, 16 is dropped by the person although they also keep it.
        assert verdict.dropped == (
            Dropped(0, 2, said),
            Dropped(13, 15, jumps),
            Dropped(16, 18, said),
            Dropped(18, 20, lost),
        )
        assert after == [said] * 2 + [""] * 11 + [jumps] * 2 + [""] + [said] * 2 + [lost] * 2
        assert verdict.kept.mean() == 12 / 20


def test_a_frame_that_cannot_be_used_says_so_even_where_nothing_had_a_reason():
    override = Override(because="all good", keep=((0, N),))
    unusable = np.arange(N) < 3
    verdict = overridden(verdict_of("c", True, (), [""] * N), override, unusable)
    assert verdict.dropped == (Dropped(0, 3, "the frame has no camera or no pose"),)
    assert [bool(reason) for reason in verdict.frame_reasons] == unusable.tolist()


def test_nobody_can_accept_a_sequence_without_frames():
    override = Override(verdict="accepted", because="I like it", drop=((0, 15),))
    verdict = overridden(REJECTED, override, np.arange(N) >= 15)
    assert not verdict.accepted
    assert verdict.kept.mean() == 0
    assert verdict.reasons[-1] == "no frame can be used"
    drop_all = Override(because="blurred", drop=((0, N),))
    verdict = overridden(ACCEPTED, drop_all, USABLE)
    assert (verdict.accepted, verdict.reasons) == (False, ("no frame can be used",))


def test_ranges_beyond_the_sequence_are_refused():
    override = Override(because="x", keep=((15, 21),))
    with pytest.raises(BadRecipe, match=r"keep 15\.\.21: the sequence has 20 frames"):
        overridden(ACCEPTED, override, USABLE)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"verdict": "accepted"}, "because"),
        ({"verdict": "accepted", "because": "  "}, "at least 1 character"),
        ({"because": "nothing"}, "decides nothing"),
        ({"because": "x", "verdict": "good"}, "'accepted' or 'rejected'"),
        ({"because": "x", "keep": ((5, 5),)}, r"keep 5\.\.5 is empty"),
        ({"because": "x", "drop": ((-1, 5),)}, "greater than or equal to 0"),
        ({"because": "x", "drop": ((0, 5),), "kept": ()}, "kept"),
    ],
)
def test_an_override_that_makes_no_sense_is_refused(fields, said):
    with pytest.raises(ValidationError, match=said):
        Override.model_validate(fields)


def test_an_override_comes_back_from_json():
    override = Override(verdict="rejected", because="x", keep=((1, 4),), drop=((2, 3), (7, 9)))
    assert Override.model_validate_json(override.model_dump_json()) == override


ranges = st.lists(
    st.tuples(st.integers(0, N - 1), st.integers(1, N)).filter(lambda part: part[0] < part[1]),
    max_size=4,
).map(tuple)
masks = st.lists(st.booleans(), min_size=N, max_size=N).map(np.array)
texts = st.lists(st.sampled_from(["", "", "jumps", "few inliers"]), min_size=N, max_size=N)


@given(
    keep=ranges,
    drop=ranges,
    unusable=masks,
    before=texts,
    decided=st.sampled_from(["accepted", "rejected"]),
)
def test_what_is_kept_is_what_sets_of_frames_say(keep, drop, unusable, before, decided):
    override = Override.model_validate(
        {"verdict": decided, "because": "seen", "keep": keep, "drop": drop}
    )
    verdict = overridden(verdict_of("c", True, (), before), override, unusable)
    reasons = verdict.frame_reasons
    passed = {row for row in range(N) if not before[row]}
    expected = (passed | _rows(keep)) - _rows(drop) - set(np.flatnonzero(unusable))
    kept = {row for row in range(N) if not reasons[row]}
    assert kept == expected
    assert kept == set(range(N)) - _rows(tuple((d.start, d.stop) for d in verdict.dropped))
    assert verdict.kept.mean() == len(expected) / N
    assert verdict.accepted == (decided == "accepted" and bool(expected))
    # The ranges say the same as the texts, run by run.
    runs = [(reason, len(list(group))) for reason, group in groupby(reasons) if reason]
    assert runs == [(part.reason, part.stop - part.start) for part in verdict.dropped]
    # Nothing but the ranges of the person changes a frame, and twice is as once.
    for row in set(range(N)) - _rows(keep) - _rows(drop) - set(np.flatnonzero(unusable)):
        assert reasons[row] == before[row]
    assert overridden(verdict, override, unusable).dropped == verdict.dropped


def _rows(parts: tuple[tuple[int, int], ...]) -> set[int]:
    return {row for start, stop in parts for row in range(start, stop)}


DROPPED = verdict_of("walk", True, (), ["", *["the camera jumps"] * 2, "", ""])
RECORD = pseudo_gt_quality(good_quality(5), 2.5).model_copy(update={"people": (DROPPED,)})
DOUBTS = Doubts(frames=(("", "campose_valid is 0"),), sequence=("the intrinsics are wrong",))


def sfm_of(tmp_path: Path, body: BodyModel, figures: Any) -> tuple[Path, tuple[PersonFiles, ...]]:
    """A reconstruction whose `quality.json` another hand wrote."""
    clip = true_clip(body, Circular())
    sfm_dir = reconstruction(tmp_path / "sfm", clip, "full", [])
    path = sfm_dir / QUALITY_FILE
    path.write_text(json.dumps(figures(json.loads(path.read_text()))))
    return sfm_dir, (person_files(tmp_path, as_input(clip), body),)


def test_55_px_under_another_name_are_not_accepted(small_body, tmp_path):
    """A missing figure once counted as 0 px, and the sequence as good."""

    def renamed(figures: dict[str, Any]) -> dict[str, Any]:
        del figures["mean_reprojection_px"]
        return figures | {"reprojection_error_px": 55.0}

    sfm_dir, people = sfm_of(tmp_path, small_body, renamed)
    with pytest.raises(BadRecord, match=r"quality\.json: has no key `mean_reprojection_px`"):
        made_of(sfm_dir, people)
    assert not (tmp_path / "out").exists()


def test_55_px_are_rejected(small_body, tmp_path):
    sfm_dir, people = sfm_of(tmp_path, small_body, lambda said: said | {"mean_reprojection_px": 55})
    record = load_record(made_of(sfm_dir, people))
    assert not record.people[0].accepted
    assert "the mean reprojection error is 55.00 px, more than 1 px" in record.people[0].reasons


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
def test_figures_of_an_older_version_and_of_other_frames(figures, said, small_body, tmp_path):
    sfm_dir, people = sfm_of(tmp_path, small_body, lambda _: figures)
    with pytest.raises(BadRecord, match=said):
        made_of(sfm_dir, people)


def test_what_is_written_comes_back(small_body, tmp_path):
    true = true_clip(small_body, Circular())
    record = load_record(made(tmp_path, true, small_body, "full", [0, 7]))
    assert record.cameras is not None and record.cameras.frames == true.motion.n_frames
    assert [run.start for run in record.people[0].dropped] == [0, 7]
    again = tmp_path / "again" / QUALITY_FILE
    record.write(again)
    assert PseudoGtQuality.read(again) == record
    assert again.read_bytes() == (tmp_path / "out" / QUALITY_FILE).read_bytes()


@pytest.mark.parametrize("record", [RECORD, DOUBTS])
def test_each_key_is_needed_and_named(tmp_path, record):
    assert_each_key_is_needed(record, tmp_path / "record.json")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"scale_sigma": None}, "scale and scale_sigma"),
        ({"cameras": None}, "cameras and camera_motion"),
        ({"camera_motion": "none"}, "cameras and camera_motion"),
        ({"verdict": "accepted"}, "unknown key `verdict`"),
    ],
)
def test_records_that_cannot_be(tmp_path, changes, said):
    text = json.dumps(RECORD.model_dump(mode="json") | changes)
    (tmp_path / QUALITY_FILE).write_text(text)
    with pytest.raises(BadRecord, match=said):
        load_record(tmp_path)


def test_a_manifest_says_the_same_figures():
    quality = quality_record(RECORD, 0)
    assert (quality.geometry, quality.verdict, quality.scale) == ("full", "accepted", 2.5)
    assert (quality.reprojection_error_px, quality.inliers) == (0.3, 200.0)
    assert quality.figures["kept_share"] == 0.6 and quality.figures["camera_extent_m"] == 9.0
    assert quality.figures["scale_planted_feet_p0_sigma"] == 0.02
    assert "camera_goes_round" not in quality.figures
    assert quality.figures["interpolated_frames"] == 0.0


def test_a_sequence_without_a_reconstruction_drops_every_row(tmp_path):
    rejected = verdict_of("walk", False, ("no model",), ["black", "black", ""])
    unsolved_quality([rejected]).write(tmp_path / QUALITY_FILE)
    record = load_record(tmp_path)
    whole = "the sequence is rejected: no model"
    assert record.people[0].row_reasons == ["black", "black", whole]
    quality = quality_record(record, 0)
    assert (quality.geometry, quality.verdict, quality.inliers) == (None, "rejected", None)
    assert quality.figures == {"kept_share": rejected.kept_share}


@pytest.mark.parametrize("key", ["format", "world_from_cam"])
def test_each_array_of_the_dataset_camera_is_needed_and_named(tmp_path, key):
    file = tmp_path / "dataset_camera.npz"
    save_dataset_camera(file, np.tile(np.eye(4), (3, 1, 1)))
    assert load_dataset_camera(file).shape == (3, 4, 4)
    arrays = {name: array for name, array in np.load(file).items() if name != key}
    np.savez(file, **arrays)
    with pytest.raises(BadRecord, match=rf"dataset_camera\.npz: has no .*{key}"):
        load_dataset_camera(file)


def test_doubts_of_a_long_video_are_short(tmp_path):
    """The file had a text for each frame and person: 97 MB of a film of 20 minutes."""
    odd = tuple("" if row % 50 else "shown late" for row in range(36_000))
    doubts = Doubts(frames=(36_000 * ("a" * 1000,), odd), sequence=())
    path = tmp_path / "doubts.json"
    doubts.write(path)
    assert Doubts.read(path) == doubts and path.stat().st_size < 200_000
    written, first = json.loads(path.read_text()), [0, 3, "a"]
    for runs in ([first, [4, 5, ""]], [[0, 0, "a"]], [[0, 10**9, "a"]], [["0", 3, "a"]], ["a"]):
        path.write_text(json.dumps(written | {"frames": [runs]}))
        with pytest.raises(BadRecord, match=r"`frames\.0.*` is wrong: .*--redo"):
            Doubts.read(path)


def test_doubts_and_cameras_of_other_frames_are_refused(small_body, tmp_path):
    sfm_dir, people = sfm_of(tmp_path, small_body, lambda said: said)
    DOUBTS.write(tmp_path / "doubts.json")
    with pytest.raises(BadRecord, match="is not of 1 people and 40 frames"):
        made_of(sfm_dir, people, doubts_path=tmp_path / "doubts.json")
    save_dataset_camera(tmp_path / "camera.npz", np.tile(np.eye(4), (3, 1, 1)))
    with pytest.raises(BadRecord, match="3 cameras for 40 frames"):
        made_of(sfm_dir, people, dataset_camera_path=tmp_path / "camera.npz")
