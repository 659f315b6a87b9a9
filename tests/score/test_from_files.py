"""Predictions from clip files: what counts, what is dropped, and what is refused."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.gmr.runs import UsableClip
from gmrdata.motion.gait import embedded_motions
from gmrdata.score.clip_errors import clip_errors
from gmrdata.score.predictions import Pairing, PredictedClip, file_clip
from gmrdata.score.protocols import PROTOCOLS
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, save_clip
from gmrdata.values.errors import BadMotionFile, MissingInput

TURN = Rotation.from_euler("xyz", [20, 30, 200], degrees=True).as_matrix()


@pytest.fixture(scope="module")
def true(small_body: BodyModel) -> Clip:
    (motion,) = embedded_motions(
        small_body, np.random.default_rng(0), count=1, fps_hz=30.0, duration_s=2.0
    )
    return Clip("walk", motion, np.ones(60, bool), np.full(60, -1), None)


def moved(clip: Clip) -> Clip:
    """The same motion in another world."""
    motion = replace(
        clip.motion,
        root_rotmats=TURN @ clip.motion.root_rotmats,
        pelvis_m=clip.motion.pelvis_m @ TURN.T + [1.0, 2.0, 3.0],
    )
    return replace(clip, motion=motion)


def read(
    folder: Path, body: BodyModel, true: Clip, predicted: Clip, **options: Any
) -> PredictedClip:
    save_clip(folder / "walk.npz", predicted, body.rest_pelvis_m(predicted.motion.shape))
    found = file_clip(folder, UsableClip(true, "linear"), Pairing(10.0, **options))
    assert isinstance(found, PredictedClip)
    return found


def test_the_truth_in_another_world_has_no_error(
    tmp_path: Path, small_body: BodyModel, true: Clip
) -> None:
    found = read(tmp_path, small_body, true, moved(true))
    assert [run.true.n_frames for run in found.runs] == [20]
    assert [[run.true.n_frames for run in world] for world in found.worlds] == [[60]]
    errors = clip_errors(found, small_body, PROTOCOLS["wham"])
    for values in (*errors.errors["predicted"].values(), errors.over_time_mm["predicted"]):
        np.testing.assert_allclose(values, 0, atol=1e-6)
    assert errors.protocol_fps_hz == 30.0
    for metric in ("w_mpjpe_mm", "wa_mpjpe_mm", "rte_percent", "roe_deg", "erve_mm_per_frame"):
        np.testing.assert_allclose(errors.protocol["predicted"][metric], 0, atol=1e-5)
        assert errors.protocol["zero"][metric].mean() > 1


def test_frames_without_a_prediction_are_an_error_or_dropped(
    tmp_path: Path, small_body: BodyModel, true: Clip
) -> None:
    """Rows without a prediction may hold NaN."""
    has = ~np.isin(np.arange(60), [30, 31])
    other = moved(true).motion
    blanked = replace(
        other,
        root_rotmats=np.where(has[:, None, None], other.root_rotmats, np.nan),
        pelvis_m=np.where(has[:, None], other.pelvis_m, np.nan),
    )
    holed = replace(true, motion=blanked, valid=has)
    with pytest.raises(BadMotionFile, match=r"walk\.npz: no prediction for 2 of 60 .* row 30"):
        read(tmp_path, small_body, true, holed)
    found = read(tmp_path, small_body, true, holed, drop_missing=True)
    assert found.dropped_frames == 2
    # 0, 3, ..., 27, then 32, 35, ..., 59; one world at the full rate.
    assert [run.true.n_frames for run in found.runs] == [10, 10]
    assert [[run.true.n_frames for run in world] for world in found.worlds] == [[30, 28]]
    np.testing.assert_array_equal(
        found.runs[1].true.pelvis_m, true.motion.pelvis_m[np.arange(32, 60, 3)]
    )
    errors = clip_errors(found, small_body, PROTOCOLS["wham"])
    assert errors.n_motions == 9 + 9
    assert len(errors.protocol["predicted"]["erve_mm_per_frame"]) == 29 + 27
    np.testing.assert_allclose(errors.protocol["predicted"]["rte_percent"], 0, atol=1e-6)


def test_a_prediction_that_ends_early_lacks_frames(
    tmp_path: Path, small_body: BodyModel, true: Clip
) -> None:
    short = replace(
        moved(true),
        motion=moved(true).motion.take(slice(0, 50), 30.0),
        valid=np.ones(50, bool),
        image_numbers=np.full(50, -1),
    )
    with pytest.raises(BadMotionFile, match="no prediction for 10 of 60"):
        read(tmp_path, small_body, true, short)
    found = read(tmp_path, small_body, true, short, drop_missing=True)
    assert (found.dropped_frames, found.runs[0].true.n_frames) == (10, 17)


def test_frames_that_the_truth_lacks_are_not_missed(
    tmp_path: Path, small_body: BodyModel, true: Clip
) -> None:
    gap = replace(true, valid=np.arange(60) != 30)
    found = read(tmp_path, small_body, gap, replace(moved(gap), valid=np.ones(60, bool)))
    assert found.dropped_frames == 0
    assert [run.true.n_frames for run in found.runs] == [10, 10]


def test_a_prediction_at_a_lower_rate(tmp_path: Path, small_body: BodyModel, true: Clip) -> None:
    """Every third row at 10 fps; a gap of the truth between two of them is still a gap."""
    slow = replace(
        moved(true),
        motion=moved(true).motion.take(slice(0, None, 3), 10.0),
        valid=np.ones(20, bool),
        image_numbers=np.full(20, -1),
    )
    found = read(tmp_path, small_body, true, slow)
    assert [run.true.n_frames for run in found.runs] == [20]
    assert found.worlds[0][0].true.fps_hz == 10.0
    np.testing.assert_allclose(
        clip_errors(found, small_body).errors["predicted"]["tme_mm"], 0, atol=1e-6
    )
    gap = replace(true, valid=np.arange(60) != 31)  # between rows 10 and 11 of the prediction
    found = read(tmp_path, small_body, gap, slow)
    assert [run.true.n_frames for run in found.runs] == [11, 8]
    assert found.dropped_frames == 0


def test_a_protocols_rate_is_taken_where_it_divides(
    tmp_path: Path, small_body: BodyModel, true: Clip
) -> None:
    rates = {}
    for wanted_hz in (10.0, 20.0, 30.0, None):
        found = read(tmp_path, small_body, true, moved(true), protocol_fps_hz=wanted_hz)
        rates[wanted_hz] = found.worlds[0][0].predicted.fps_hz
    assert rates == {10.0: 10.0, 20.0: 30.0, 30.0: 30.0, None: 30.0}


def test_what_can_not_be_scored_is_named(tmp_path: Path, small_body: BodyModel, true: Clip) -> None:
    other = moved(true)
    nan = replace(other, motion=replace(other.motion, pelvis_m=other.motion.pelvis_m.copy()))
    nan.motion.pelvis_m[7, 1] = np.nan
    long = other.motion.take(np.r_[0:60, 0:5], 30.0)
    refused = {
        "holds clip run": replace(other, id="run"),
        "in the camera's frame": replace(other, motion=replace(other.motion, frame="camera")),
        "no multiple": replace(other, motion=replace(other.motion, fps_hz=25.0)),
        r"walk\.npz: frame 7 holds NaN": nan,
        "65 frames, but the clip has 60": replace(
            other, motion=long, valid=np.ones(65, bool), image_numbers=np.full(65, -1)
        ),
    }
    for message, clip in refused.items():
        with pytest.raises(BadMotionFile, match=message):
            read(tmp_path, small_body, true, clip)
    (tmp_path / "walk.npz").write_bytes(b"PK\x03\x04 cut off")
    with pytest.raises(BadMotionFile, match=r"walk\.npz"):
        file_clip(tmp_path, UsableClip(true, "linear"), Pairing(10.0))


def test_a_missing_file_is_named(tmp_path: Path, true: Clip) -> None:
    one, dropping = UsableClip(replace(true, id="b"), "linear"), Pairing(10.0, drop_missing=True)
    assert file_clip(tmp_path, one, dropping) == "no prediction b.npz"
    with pytest.raises(BadMotionFile, match=r"no prediction b\.npz"):
        file_clip(tmp_path, one, Pairing(10.0))
    with pytest.raises(MissingInput, match="nowhere"):
        file_clip(tmp_path / "nowhere", one, dropping)
