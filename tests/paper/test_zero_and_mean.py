"""Zero and mean motion: what they predict, what they leave out, and what they write."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.cli import main
from gmrdata.gmr.runs import runs_at
from gmrdata.manifest.current import Quality
from gmrdata.score.baselines import (
    MeanConfig,
    Subject,
    mean_motion,
    moving_as,
    predict_mean,
    predict_zero,
)
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, load_clip
from gmrdata.values.errors import BadManifest, StageFailed, StaleOutput
from gmrdata.values.files import read_json
from gmrdata.values.motion import accumulate, deltas

WriteSet = Callable[..., Path]


def steady(clip: Clip, rotvec_rad: list[float], delta_m: list[float]) -> Clip:
    """The same person with one motion from each frame to the next."""
    n = clip.motion.n_frames
    root_rotmats, pelvis_m = accumulate(
        np.tile(Rotation.from_rotvec(rotvec_rad).as_matrix(), (n - 1, 1, 1)),
        np.tile(delta_m, (n - 1, 1)),
        clip.motion.root_rotmats[0],
        clip.motion.pelvis_m[0],
    )
    motion = replace(clip.motion, root_rotmats=root_rotmats, pelvis_m=pelvis_m)
    return replace(clip, motion=motion)


def test_zero_motion_stays_in_the_first_valid_pose(
    filmed: tuple[Clip, ...], write_set: WriteSet, tmp_path: Path
) -> None:
    valid = np.arange(40) >= 3
    valid[20] = False
    clips = [replace(filmed[0], valid=valid), filmed[1]]
    made = predict_zero(write_set(tmp_path / "set", clips), tmp_path / "out")
    found = load_clip(made / "predictions" / "walk_0.npz")
    np.testing.assert_array_equal(found.valid, valid)
    np.testing.assert_array_equal(found.image_numbers, clips[0].image_numbers)
    true = clips[0].motion
    assert (found.id, found.motion.frame, found.camera) == ("walk_0", "world", None)
    assert (found.motion.fps_hz, found.motion.n_frames) == (20.0, 40)
    np.testing.assert_allclose(found.motion.pelvis_m[valid] - true.pelvis_m[3], 0, atol=1e-12)
    np.testing.assert_allclose(
        found.motion.root_rotmats[valid] - true.root_rotmats[3], 0, atol=1e-12
    )
    np.testing.assert_allclose(found.motion.local_rotmats, true.local_rotmats, atol=1e-12)
    assert np.isnan(found.motion.pelvis_m[20]).all()
    record = read_json(made / "predictions.json")
    assert record["method"] == "zero"
    assert record["clips"]["walk_0"] == {"fps_hz": 20.0, "n_frames": 40, "n_valid": 36}


def test_clips_that_cannot_be_used_are_named(
    filmed: tuple[Clip, ...], write_set: WriteSet, tmp_path: Path
) -> None:
    rejected = {"walk_0": Quality(verdict="rejected", reasons=("too few points",))}
    nothing = replace(filmed[1], valid=np.zeros(40, bool))
    manifest = write_set(tmp_path / "set", [filmed[0], nothing, filmed[2]], rejected)
    made = predict_zero(manifest, tmp_path / "out")
    assert [path.name for path in (made / "predictions").iterdir()] == ["walk_2.npz"]
    assert read_json(made / "predictions.json")["left_out"] == {
        "walk_0": "rejected: too few points",
        "walk_1": "no frame is valid",
    }
    manifest = write_set(tmp_path / "none", [nothing])
    with pytest.raises(StageFailed, match="zero: nothing to predict in any clip. walk_1: no frame"):
        predict_zero(manifest, tmp_path / "no")


def test_the_mean_of_one_motion_is_that_motion(filmed: tuple[Clip, ...]) -> None:
    clip = steady(filmed[0], [0.1, -0.3, 0.2], [0.01, -0.02, 0.05])
    mean = mean_motion([clip], 20.0)
    np.testing.assert_allclose(
        Rotation.from_matrix(mean.delta_rotmat).as_rotvec(), [0.1, -0.3, 0.2], atol=1e-9
    )
    np.testing.assert_allclose(mean.delta_m, [0.01, -0.02, 0.05], atol=1e-9)
    found = moving_as(mean, Subject(clip, np.zeros(3)))
    np.testing.assert_allclose(found.clip.motion.pelvis_m, clip.motion.pelvis_m, atol=1e-9)
    np.testing.assert_allclose(found.clip.motion.root_rotmats, clip.motion.root_rotmats, atol=1e-9)


def test_the_mean_minimises_the_chordal_distance(filmed: tuple[Clip, ...]) -> None:
    """No rotation near it has less, and the mean dT is numpy's."""
    mean = mean_motion(filmed, 10.0)
    parts = [
        deltas(run.root_rotmats, run.pelvis_m)
        for clip in filmed
        for run in runs_at(clip, 10.0, all_phases=True)
    ]
    rotmats = np.concatenate([part[0] for part in parts])
    assert mean.n_motions == len(rotmats) == 3 * 2 * 19
    np.testing.assert_allclose(
        mean.delta_m, np.concatenate([part[1] for part in parts]).mean(axis=0), atol=1e-12
    )

    def cost(rotmat: np.ndarray) -> float:
        return float(np.square(rotmats - rotmat).sum())

    for axis in np.concatenate([np.eye(3), -np.eye(3)]):
        assert cost(mean.delta_rotmat) < cost(
            mean.delta_rotmat @ Rotation.from_rotvec(0.01 * axis).as_matrix()
        )


def test_at_a_higher_rate_the_mean_is_reached_after_as_many_frames(
    filmed: tuple[Clip, ...],
) -> None:
    """In every phase: the step is a screw's share, not that of rotation and translation alone."""
    mean = mean_motion([steady(filmed[0], [0.0, 0.8, 0.1], [0.3, 0.0, 0.1])], 20.0)
    fast = replace(filmed[1], motion=replace(filmed[1].motion, fps_hz=60.0))
    motion = moving_as(mean, Subject(fast, np.zeros(3))).clip.motion
    for phase in range(3):
        delta_rotmats, delta_m = deltas(motion.root_rotmats[phase::3], motion.pelvis_m[phase::3])
        np.testing.assert_allclose(delta_rotmats - mean.delta_rotmat, 0, atol=1e-9)
        np.testing.assert_allclose(delta_m - mean.delta_m, 0, atol=1e-9)


def test_the_verbs(
    filmed: tuple[Clip, ...],
    small_body: BodyModel,
    write_set: WriteSet,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    manifest = write_set(tmp_path / "set", filmed[:2])
    training = write_set(tmp_path / "training", filmed[2:])
    main(["baseline", "zero", str(manifest), "--out", str(tmp_path / "zero")])
    asked = ["baseline", "mean", str(manifest), "--training", str(training)]
    main([*asked, "--out", str(tmp_path / "mean")])
    assert capsys.readouterr().out.split() == [str(tmp_path / "zero"), str(tmp_path / "mean")]
    figures = read_json(tmp_path / "mean" / "predictions.json")["figures"]
    assert (figures["fps_hz"], figures["n_motions"]) == (10.0, 38)
    assert figures["mean_m"] == pytest.approx(mean_motion(filmed[2:], 10.0).delta_m.tolist())
    again = predict_mean(manifest, [training], tmp_path / "again")
    names = sorted(path.name for path in (again / "predictions").iterdir())
    assert names == ["walk_0.npz", "walk_1.npz"]
    for name in names:
        one, other = (tmp_path / run / "predictions" / name for run in ("mean", "again"))
        assert one.read_bytes() == other.read_bytes()
    # The rest pelvis travels with the clip, so AMASS's `trans` is right as well.
    with np.load(again / "predictions" / "walk_0.npz") as arrays:
        expected_m = small_body.rest_pelvis_m(filmed[0].motion.shape)
        np.testing.assert_allclose(arrays["rest_pelvis_m"], expected_m)
    with pytest.raises(StaleOutput, match="fps_hz"):
        predict_mean(manifest, [training], tmp_path / "again", MeanConfig(fps_hz=20.0))


def test_there_is_no_mean_of_nothing(filmed: tuple[Clip, ...]) -> None:
    flicker = replace(filmed[0], valid=np.arange(40) % 2 == 0)
    with pytest.raises(BadManifest, match="none of the 1 training clips has two valid frames"):
        mean_motion([flicker], 20.0)
    seen = replace(filmed[0], motion=replace(filmed[0].motion, frame="camera"))
    with pytest.raises(BadManifest, match="clip walk_0: its motion is in the camera's frame"):
        mean_motion([seen], 20.0)
