"""How wrong a network is: the two processes are found again, and the record holds its shape."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmrdata.fusion.network_errors import (
    HEADINGS,
    SeenBesideTruth,
    error_rates,
    error_rows,
    fit_errors,
)
from gmrdata.fusion.network_evidence import (
    SPEEDS_M_PER_S,
    DeltaErrors,
    ErrorPart,
    mean_speeds_m_per_s,
    seen_motions,
)
from gmrdata.values.errors import BadMotionFile, BadRecord
from gmrdata.values.files import read_json, write_json
from gmrdata.values.motion import deltas

FPS_HZ = 20.0


def walk(seconds: float, speed_m_per_s: float, rates: np.ndarray) -> SeenBesideTruth:
    """A straight walk, and what a network sees that errs by rates (T-1, 6) [rad/s, m/s]."""
    n = round(seconds * FPS_HZ) + 1
    rotmats = np.tile(np.eye(3), (n, 1, 1))
    pelvis_m = np.arange(n)[:, None] * [0.0, 0.0, speed_m_per_s / FPS_HZ]
    turns, steps_m = deltas(rotmats, pelvis_m)
    wrong = Rotation.from_rotvec(rates[:, :3] / FPS_HZ).as_matrix()
    return SeenBesideTruth(
        turns @ wrong, steps_m + rates[:, 3:] / FPS_HZ, rotmats, pelvis_m, FPS_HZ
    )


def wandering(n: int, sigma: float, time_s: float, rng: np.random.Generator) -> np.ndarray:
    kept = np.exp(-1 / (FPS_HZ * time_s))
    states = [sigma * rng.normal(size=6)]
    for _ in range(n - 1):
        states.append(kept * states[-1] + np.sqrt(1 - kept**2) * sigma * rng.normal(size=6))
    return np.array(states)


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
    )


def test_rates_are_what_was_put_on() -> None:
    rates = wandering(100, 0.1, 0.3, np.random.default_rng(0))
    np.testing.assert_allclose(error_rates(walk(5.0, 1.0, rates)), rates, atol=1e-12)


def test_a_fast_and_a_slow_error_are_told_apart() -> None:
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


def test_errors_that_grow_with_speed_do_so_in_the_record() -> None:
    rng = np.random.default_rng(2)
    clips = [
        walk(15.0, speed, wandering(300, 0.02 + 0.1 * speed, 0.2, rng))
        for speed in SPEEDS_M_PER_S
        for _ in range(4)
    ]
    sigma = np.array(fit_errors(clips).fast.place_m_per_s).mean(axis=1)
    assert (np.diff(sigma) > 0).all()
    assert sigma[-1] == pytest.approx(0.16, rel=0.3)


def test_too_little_motion_is_refused_with_the_remedy() -> None:
    with pytest.raises(BadMotionFile, match="Hold out more of them"):
        fit_errors([walk(2.0, 1.0, np.zeros((40, 6)))])
    with pytest.raises(BadMotionFile, match="Hold out more of them"):
        fit_errors([])


def test_motions_get_errors_by_their_own_speed() -> None:
    still, fast = np.zeros((40, 3)), np.tile([0.0, 0.0, 1.0 / FPS_HZ], (40, 1))
    turns = np.tile(np.eye(3), (40, 1, 1))
    seen = [seen_motions(turns, steps_m, FPS_HZ, record()) for steps_m in (still, fast)]
    np.testing.assert_allclose(seen[0].fast.sigma[:, 3:], 0.2)
    np.testing.assert_allclose(seen[1].fast.sigma[:, 3:], 0.4)
    np.testing.assert_allclose(seen[1].slow.sigma[:, :3], np.deg2rad(1.0))
    assert seen[0].slow.time_s.tolist() == [5.0] * 6


def test_a_speed_is_the_mean_about_it() -> None:
    steps_m = np.zeros((41, 3))
    steps_m[20] = [0.0, 0.0, 1.0]
    speeds = mean_speeds_m_per_s(steps_m, FPS_HZ)
    assert speeds.max() == pytest.approx(FPS_HZ / 21)
    assert (speeds > 0).sum() == 21


def test_the_record_is_read_as_it_was_written(tmp_path: Path) -> None:
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
def test_a_broken_record_is_refused(tmp_path: Path, key: str, value: object) -> None:
    path = tmp_path / "delta_errors.json"
    record().write(path)
    content = read_json(path)
    content = {k: v for k, v in content.items() if k != key} | (
        {key: value} if value is not ... else {}
    )
    write_json(path, content)
    with pytest.raises(BadRecord, match="delta_errors.json"):
        DeltaErrors.read(path)


def test_a_negative_time_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "delta_errors.json"
    good = record()
    bad = good.model_dump(mode="json")
    bad["slow"]["time_s"][2] = -1.0
    write_json(path, bad)
    with pytest.raises(BadRecord, match="not positive"):
        DeltaErrors.read(path)
