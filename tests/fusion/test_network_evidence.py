"""How wrong a network is: measured, found again, and carried to like poses."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator
from scipy.spatial.transform import Rotation

from gmrdata.cli import main
from gmrdata.fusion import network_errors, network_evidence
from gmrdata.fusion.network_errors import (
    HEADINGS,
    HeldOut,
    MeasureConfig,
    SeenBesideTruth,
    beside_truth,
    delta_errors,
    error_rates,
    error_rows,
    fit_errors,
    held_out_motions,
    measure_delta_errors,
)
from gmrdata.fusion.network_evidence import (
    SPEEDS_M_PER_S,
    DeltaErrors,
    DoubtPart,
    ErrorPart,
    corrected_by_like_poses,
    mean_speeds_m_per_s,
    seen_motions,
)
from gmrdata.fusion.smoothing import ErrorProcess, SeenMotions, SeenPoses
from gmrdata.gmr.config import DataConfig
from gmrdata.gmr.predict import DoubtedMotions
from gmrdata.gmr.train import train
from gmrdata.read.body_file import save_body
from gmrdata.values.body import JOINT
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadManifest, BadMotionFile, BadRecipe, BadRecord, MissingInput
from gmrdata.values.files import STAGE_FILE, read_json, write_json
from gmrdata.values.motion import Motion, deltas
from tests.clip_manifests import write_clips
from tests.fusion import test_smoothing as smoothing
from tests.motions import made_up

FPS_HZ = 20.0


def walk(
    seconds: float, speed_m_per_s: float, rates: np.ndarray, doubt: np.ndarray | None = None
) -> SeenBesideTruth:
    """A straight walk, and what a network sees that errs by rates (T-1, 6) [rad/s, m/s]."""
    n = round(seconds * FPS_HZ) + 1
    rotmats = np.tile(np.eye(3), (n, 1, 1))
    pelvis_m = np.arange(n)[:, None] * [0.0, 0.0, speed_m_per_s / FPS_HZ]
    turns, steps_m = deltas(rotmats, pelvis_m)
    wrong = Rotation.from_rotvec(rates[:, :3] / FPS_HZ).as_matrix()
    steps_m = steps_m + rates[:, 3:] / FPS_HZ
    doubt = np.ones((n - 1, 2)) if doubt is None else doubt
    return SeenBesideTruth(turns @ wrong, steps_m, doubt, rotmats, pelvis_m, FPS_HZ)


def wandering(n: int, sigma: float, time_s: float, rng: np.random.Generator) -> np.ndarray:
    return sigma * smoothing.wandering(n, 6, time_s, rng, FPS_HZ)


def record(fast: float = 0.2, slow: float = 0.1) -> DeltaErrors:
    speeds = (0.0, 1.0)
    fast_part, slow_part = (
        ErrorPart((time_s,) * 6, ((10 * at,) * 3,) * 2, ((at,) * 3, (2 * at,) * 3))
        for at, time_s in ((fast, 0.2), (slow, 5.0))
    )
    return DeltaErrors(
        networks=("run",),
        fps_hz=10.0,
        people=("CMU/02",),
        clips=3,
        seconds=50.0,
        pose_noise_deg=3.0,
        pose_noise_time_s=0.5,
        speeds_m_per_s=speeds,
        fast=fast_part,
        slow=slow_part,
        doubt=DoubtPart((1.0, 10.0), (1.0, 2.0), (0.1, 1.0), (1.0, 3.0)),
    )


def test_rates_are_what_was_put_on():
    rates = wandering(100, 0.1, 0.3, np.random.default_rng(0))
    np.testing.assert_allclose(error_rates(walk(5.0, 1.0, rates)), rates, atol=1e-12)


def test_a_fast_and_a_slow_error_are_told_apart():
    rng = np.random.default_rng(1)
    clips = []
    for _ in range(40):
        rates = wandering(300, 0.2, 0.2, rng) + wandering(300, 0.1, 5.0, rng)
        clips.append(walk(15.0, 1.4, rates))
    fitted = fit_errors(clips)
    fast, slow = (np.array(one.place_m_per_s)[-1] for one in (fitted.fast, fitted.slow))
    np.testing.assert_allclose(fast, 0.2, rtol=0.2)
    np.testing.assert_allclose(slow, 0.1, rtol=0.35)
    turns = np.deg2rad(np.array(fitted.fast.turn_deg_per_s)[-1])
    np.testing.assert_allclose(turns, 0.2, rtol=0.2)


def test_errors_that_grow_with_speed_do_so_in_the_record():
    rng = np.random.default_rng(2)
    clips = [
        walk(15.0, speed, wandering(300, 0.02 + 0.1 * speed, 0.2, rng))
        for speed in SPEEDS_M_PER_S
        for _ in range(4)
    ]
    sigma = np.array(fit_errors(clips).fast.place_m_per_s).mean(axis=1)
    assert (np.diff(sigma) > 0).all()
    assert sigma[-1] == pytest.approx(0.16, rel=0.3)


def test_too_little_motion_is_refused_with_the_remedy():
    with pytest.raises(BadMotionFile, match="Hold out more of them"):
        fit_errors([walk(2.0, 1.0, np.zeros((40, 6)))])
    with pytest.raises(BadMotionFile, match="Hold out more of them"):
        fit_errors([])


def test_motions_get_errors_by_their_own_speed():
    still, fast = np.zeros((40, 3)), np.tile([0.0, 0.0, 1.0 / FPS_HZ], (40, 1))
    turns = np.tile(np.eye(3), (40, 1, 1))
    sure = np.zeros((40, 2))
    seen = [
        seen_motions(DoubtedMotions(turns, steps_m, sure), FPS_HZ, record())
        for steps_m in (still, fast)
    ]
    np.testing.assert_allclose(seen[0].fast.sigma[:, 3:], 0.2)
    np.testing.assert_allclose(seen[1].fast.sigma[:, 3:], 0.4)
    np.testing.assert_allclose(seen[1].slow.sigma[:, :3], np.deg2rad(1.0))
    assert seen[0].slow.time_s.tolist() == [5.0] * 6


def test_who_is_doubted_gets_wider_errors():
    turns, steps_m = np.tile(np.eye(3), (40, 1, 1)), np.zeros((40, 3))
    doubt = np.tile([np.deg2rad(np.sqrt(10)), 5.0], (40, 1))
    seen = seen_motions(DoubtedMotions(turns, steps_m, doubt), FPS_HZ, record())
    np.testing.assert_allclose(seen.fast.sigma[:, 3:], 3 * 0.2)  # not beyond the last level
    np.testing.assert_allclose(seen.slow.sigma[:, :3], 1.5 * np.deg2rad(1.0))  # half way, by ratios


def test_errors_that_grow_with_doubt_do_so_in_the_record():
    rng = np.random.default_rng(5)
    clips = []
    for grown in (1.0, 1.0, 1.0, 4.0):
        doubt = np.full((300, 2), 0.1 * grown)
        clips.append(walk(15.0, 1.0, grown * rng.normal(0, 0.1, (300, 6)), doubt))
    part = fit_errors(clips).doubt
    assert len(part.turn_factor) == len(part.turn_deg_per_s) == 2, "two levels of doubt there are"
    assert part.place_m_per_s == pytest.approx((0.1, 0.4))
    assert part.turn_factor[1] / part.turn_factor[0] == pytest.approx(4.0, rel=0.15)
    assert part.place_factor[1] / part.place_factor[0] == pytest.approx(4.0, rel=0.15)


@pytest.mark.parametrize("worst", [0, 3, 5])
def test_motions_of_equal_doubt_have_one_factor_in_any_order(worst):
    """They were cut by the order of their clips, and the worst part's factor was everybody's."""
    ratios = np.full((6, 100), 0.5)
    ratios[worst] = 3.5
    found = network_errors._factors_by_level(np.zeros(600), ratios.ravel())
    assert found == ((1e-9,), (pytest.approx(1.0),))
    # A few who are doubted beside them are a level of their own.
    doubts = np.repeat([0.2, 0.1], [60, 600])
    levels, factors = network_errors._factors_by_level(doubts, np.r_[np.full(60, 9.0), ratios.flat])
    assert levels == (0.1, 0.2) and factors == (pytest.approx(1.0), 3.0)


def test_distinct_doubts_are_cut_into_six_levels():
    doubts = np.random.default_rng(0).permutation(100) + 1.0
    levels, factors = network_errors._factors_by_level(doubts, doubts**2)
    assert levels == (13.0, 38.0, 60.5, 78.0, 90.5, 98.0)
    parts = np.split(np.arange(1.0, 101.0), [25, 50, 70, 85, 95])
    np.testing.assert_allclose(factors, [np.sqrt(np.mean(part**2)) for part in parts])


def test_a_speed_is_the_mean_about_it():
    steps_m = np.zeros((41, 3))
    steps_m[20] = [0.0, 0.0, 1.0]
    speeds = mean_speeds_m_per_s(steps_m, FPS_HZ)
    assert speeds.max() == pytest.approx(FPS_HZ / 21)
    assert (speeds > 0).sum() == 21


def test_the_record_is_read_as_it_was_written(tmp_path):
    path = tmp_path / "delta_errors.json"
    record().write(path)
    assert DeltaErrors.read(path) == record()
    rows = error_rows(record())
    assert len(rows) == 2
    assert {len(row) for row in rows} == {len(HEADINGS)}


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("speeds_m_per_s", [0.0]),
        ("speeds_m_per_s", [1.0, 0.0]),
        ("fps_hz", None),
        ("fast", None),
        ("seconds", "many"),
        ("people", ...),
    ],
)
def test_a_broken_record_is_refused(tmp_path, key, value):
    path = tmp_path / "delta_errors.json"
    record().write(path)
    content = read_json(path)
    content = {k: v for k, v in content.items() if k != key} | (
        {key: value} if value is not ... else {}
    )
    write_json(path, content)
    with pytest.raises(BadRecord, match="delta_errors.json"):
        DeltaErrors.read(path)


def test_a_negative_time_is_refused(tmp_path):
    path = tmp_path / "delta_errors.json"
    good = record()
    bad = good.model_dump(mode="json")
    bad["slow"]["time_s"][2] = -1.0
    write_json(path, bad)
    with pytest.raises(BadRecord, match="not positive"):
        DeltaErrors.read(path)


@pytest.fixture
def cmu_clips(make_clips) -> list[Clip]:
    names = ("02_01", "02_02", "05_01")
    return [replace(clip, id=name) for clip, name in zip(make_clips(3, 1), names, strict=True)]


def test_the_verb_measures_a_run_on_whom_it_held_out(
    cmu_clips, small_body, small_config, tmp_path, monkeypatch, capsys
):
    manifest = write_clips(tmp_path / "cmu", small_body, cmu_clips, sources="CMU")
    save_body(tmp_path / "body.npz", small_body)
    held_out = DataConfig(held_out_subjects=(2,))
    config = small_config.model_copy(update={"data": held_out, "steps": 2})
    run_dir = train([manifest], tmp_path / "run", config, body_path=tmp_path / "body.npz")
    out = run_dir / "delta_errors.json"
    words = ["delta-errors", str(manifest), "--network", str(run_dir), "--out", str(out)]
    with pytest.raises(SystemExit):
        main(words)  # eight seconds are too few
    assert "Hold out more of them" in capsys.readouterr().err.replace("\n", " ")
    monkeypatch.setattr(network_errors, "FEWEST_S", 1.0)
    main(words)
    record = DeltaErrors.read(out)
    assert (record.people, record.clips, record.networks) == (("CMU/02",), 2, ("run",))
    assert record.seconds == pytest.approx(8.0, abs=0.5)
    assert np.array(record.fast.place_m_per_s).max() > 0.05
    nobody = config.model_copy(update={"data": DataConfig()})
    other = train([manifest], tmp_path / "other", nobody, body_path=tmp_path / "body.npz")
    with pytest.raises(BadManifest, match="held none of these clips out"):
        held_out_motions(other, [manifest])
    with pytest.raises(MissingInput, match=r"bundled: no stage\.json.* Name such people with"):
        held_out_motions(Path("bundled"), [manifest])  # a folder of weights alone
    made_by = read_json(run_dir / STAGE_FILE)
    made_by["config"]["windows"]["speeds"] = [1.0]  # as runs of former versions have it
    write_json(run_dir / STAGE_FILE, made_by)
    assert len(held_out_motions(run_dir, [manifest])) == 2
    said = held_out_motions(other, [manifest], people=("2",))
    assert [(one.clip, one.person) for one in said] == [("02_01", "CMU/02"), ("02_02", "CMU/02")]
    # Nobody is trained on here: clips of others beside them were asked for.
    alone = write_clips(tmp_path / "alone", small_body, cmu_clips[:2], sources="CMU")
    assert len(held_out_motions(other, [alone], people=("2",))) == 2


def test_who_was_not_measured_does_not_stand_in_the_record(untrained):
    rates = wandering(1200, 0.2, 0.2, np.random.default_rng(0))
    runs = {"CMU/02": (walk(60.0, 1.0, rates),), "CMU/08": ()}
    found = delta_errors([untrained], [HeldOut("a", who, seen) for who, seen in runs.items()])
    assert (found.people, found.clips) == (("CMU/02",), 1)


def test_networks_of_two_frame_rates_are_not_measured_as_one(
    cmu_clips, small_body, small_config, tmp_path
):
    """The record named the rate of the first, and the errors were of both."""
    manifest = write_clips(tmp_path / "cmu", small_body, cmu_clips)
    save_body(tmp_path / "body.npz", small_body)
    runs = []
    for fps_hz in (10.0, 5.0):
        windows = small_config.windows.model_copy(update={"fps_hz": fps_hz})
        config = small_config.model_copy(update={"windows": windows, "steps": 1})
        into = tmp_path / f"at_{fps_hz:g}"
        runs.append(train([manifest], into, config, body_path=tmp_path / "body.npz"))
    with pytest.raises(BadRecipe, match=r"at_10 is of 10 fps and at_5 is of 5 fps\. Measure"):
        measure_delta_errors(runs, [manifest], people=("02",))


def test_noise_is_put_on_what_the_network_sees_alone(cmu_clips, untrained):
    clip, rng = cmu_clips[0], np.random.default_rng(0)
    exact, noisy = (
        next(beside_truth(untrained, clip, MeasureConfig(pose_noise_deg=deg), rng))
        for deg in (0.0, 10.0)
    )
    np.testing.assert_array_equal(exact.true_pelvis_m, noisy.true_pelvis_m)
    assert exact.fps_hz == clip.motion.fps_hz == 20.0
    assert np.abs(error_rates(exact) - error_rates(noisy)).max() > 0.01


N, LIKE_FPS_HZ, CYCLE = 240, 30.0, 30
PHASE = 2 * np.pi * np.arange(N) / CYCLE
BUT_A_GAP = (np.arange(N) < 100) | (np.arange(N) >= 160)  # frames with a camera
TURN = Rotation.from_rotvec([0.02, 0.0, 0.0])


@pytest.fixture
def stepping(small_body) -> Motion:
    """Who swings both legs and goes ahead, a cycle a second."""
    local = np.tile(np.eye(3), (N, 23, 1, 1))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        swing = np.outer(0.6 * sign * np.sin(PHASE), [1.0, 0.0, 0.0])
        lift = np.outer(0.4 * (1 + sign * np.cos(PHASE)), [1.0, 0.0, 0.0])
        local[:, JOINT[f"{side}_hip"] - 1] = Rotation.from_rotvec(swing).as_matrix()
        local[:, JOINT[f"{side}_knee"] - 1] = Rotation.from_rotvec(lift).as_matrix()
    return made_up(
        local,
        Rotation.from_rotvec(np.outer(0.1 * np.sin(PHASE), [0, 1, 0])).as_matrix(),
        np.outer(np.arange(N) / LIKE_FPS_HZ, [0.3, 0.0, 1.0]),
        fps_hz=LIKE_FPS_HZ,
        body=small_body.name,
    )


def error_m() -> np.ndarray:
    """A step that is wrong to the side of the leg in front, and ahead twice a cycle, (N - 1, 3)."""
    middle = (PHASE[:-1] + PHASE[1:]) / 2
    return 0.01 * np.stack([np.sin(middle), 0 * middle, np.cos(2 * middle)], axis=1)


def seen_by_network(motion: Motion) -> SeenMotions:
    turns, steps_m = deltas(motion.root_rotmats, motion.pelvis_m)
    parts = [ErrorProcess(np.full((N - 1, 6), 0.3), np.full(6, time_s)) for time_s in (0.2, 5.0)]
    return SeenMotions(turns @ TURN.inv().as_matrix(), steps_m - error_m(), *parts)


def seen_by_cameras(motion: Motion, known: np.ndarray, noise_m: float = 0.0005) -> SeenPoses:
    covariances = np.tile(noise_m**2 * np.eye(3), (N, 1, 1))
    turn_rad, still_m = np.full(N, 0.0005), np.zeros((N, 3, 3))
    pelvis_m = motion.pelvis_m
    return SeenPoses(motion.root_rotmats, pelvis_m, known, turn_rad, covariances, still_m, 0.5)


def left_of(motion: Motion, motions: SeenMotions) -> tuple[np.ndarray, np.ndarray]:
    """What is left of the network's errors, (N - 1,) of turns [rad] and steps [m]."""
    turns, steps_m = deltas(motion.root_rotmats, motion.pelvis_m)
    wrong = Rotation.from_matrix(motions.delta_rotmats.swapaxes(-1, -2) @ turns)
    return wrong.magnitude(), np.linalg.norm(steps_m - motions.delta_m, axis=1)


def test_an_error_that_comes_with_each_step_is_taken_off_where_no_camera_sees(stepping, small_body):
    before, seen = seen_by_network(stepping), seen_by_cameras(stepping, BUT_A_GAP)
    after = corrected_by_like_poses(small_body, stepping, before, seen)
    hidden = ~(BUT_A_GAP[:-1] & BUT_A_GAP[1:])
    turn_rad, step_m = left_of(stepping, after)
    assert turn_rad[hidden].max() < 0.1 * 0.02
    assert step_m[hidden].max() < 0.1 * 0.01
    np.testing.assert_array_equal(after.delta_m[~hidden], before.delta_m[~hidden])
    np.testing.assert_array_equal(after.delta_rotmats[~hidden], before.delta_rotmats[~hidden])
    assert after.fast is before.fast and after.slow is before.slow


def test_a_long_film_is_compared_with_no_more_poses_than_a_short_one(
    stepping, small_body, monkeypatch
):
    """For hours of film the search took the square of their number."""
    looked_at: list[int] = []

    def search(known: np.ndarray, *of: np.ndarray, **how: Any) -> RBFInterpolator:
        looked_at.append(len(known))
        return RBFInterpolator(known, *of, **how)

    monkeypatch.setattr(network_evidence, "RBFInterpolator", search)
    motions, seen = seen_by_network(stepping), seen_by_cameras(stepping, BUT_A_GAP)
    hidden = ~(BUT_A_GAP[:-1] & BUT_A_GAP[1:])
    for most in (5000, 90):
        monkeypatch.setattr(network_evidence, "MOST_SEEN", most)
        after = corrected_by_like_poses(small_body, stepping, motions, seen)
        assert left_of(stepping, after)[1][hidden].max() < 0.25 * 0.01
    assert looked_at == 2 * [2 * 178] + 2 * [2 * 89]


def test_steps_with_the_left_foot_tell_of_those_with_the_right(stepping, small_body):
    known = PHASE % (2 * np.pi) < np.pi - 1e-9
    motions, seen = seen_by_network(stepping), seen_by_cameras(stepping, known)
    hidden = ~known[:-1] & ~known[1:]
    before_m = left_of(stepping, motions)[1][hidden]
    after_m = left_of(stepping, corrected_by_like_poses(small_body, stepping, motions, seen))[1]
    assert after_m[hidden].max() < 0.25 * before_m.max()


def test_cameras_that_are_noisier_than_the_network_say_little(stepping, small_body):
    motions = seen_by_network(stepping)
    noisy = seen_by_cameras(stepping, BUT_A_GAP, noise_m=1.0)
    after = corrected_by_like_poses(small_body, stepping, motions, noisy)
    assert np.abs(after.delta_m - motions.delta_m).max() < 0.1 * 0.01


def test_nothing_is_carried_over_from_nothing_or_to_nowhere(stepping, small_body):
    motions = seen_by_network(stepping)
    for known in (np.zeros(N, dtype=bool), np.arange(N) < 8, np.ones(N, dtype=bool)):
        seen = seen_by_cameras(stepping, known)
        assert corrected_by_like_poses(small_body, stepping, motions, seen) is motions


def test_rows_that_no_camera_knows_may_hold_anything(stepping, small_body):
    known = np.arange(N) < 150
    motions, seen = seen_by_network(stepping), seen_by_cameras(stepping, known)
    rotmats, pelvis_m = seen.rotmats.copy(), seen.pelvis_m.copy()
    rotmats[~known], pelvis_m[~known] = np.nan, np.nan
    same = corrected_by_like_poses(small_body, stepping, motions, seen)
    after = corrected_by_like_poses(
        small_body, stepping, motions, replace(seen, rotmats=rotmats, pelvis_m=pelvis_m)
    )
    np.testing.assert_array_equal(after.delta_m, same.delta_m)
